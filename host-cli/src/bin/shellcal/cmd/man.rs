//! `shellcal man`: the manual, one page for each command.

use anyhow::Context;
use clap::Command;
use clap_mangen::Man;

use crate::files::OutputLocation;
use crate::printer::Printer;

#[derive(Debug, clap::Args)]
#[command(after_help = "Example:
  shellcal man ~/.local/share/man/man1; man shellcal-fit")]
pub(crate) struct ManArgs {
    /// The folder of the pages, made if it is not there
    directory: OutputLocation,
}

impl ManArgs {
    pub(crate) fn run(&self, printer: &Printer, mut command: Command) -> anyhow::Result<()> {
        std::fs::create_dir_all(&self.directory)
            .with_context(|| format!("cannot make `{}`", self.directory.display()))?;
        command.build();
        let count = self.write(command, printer)?;
        printer.note(format!("{count} pages in `{}`", self.directory.display()));
        Ok(())
    }

    /// Writes the page of a command and those of its subcommands; says how many.
    fn write(&self, command: Command, printer: &Printer) -> anyhow::Result<usize> {
        let is_page = |command: &&Command| !command.is_hide_set() && command.get_name() != "help";
        let subcommands: Vec<Command> =
            command.get_subcommands().filter(is_page).cloned().collect();
        let page = Man::new(command);
        let mut bytes = Vec::new();
        page.render(&mut bytes)?;
        printer.files.write(self.directory.join(page.get_filename()), &bytes)?;
        let of_subcommands = subcommands.into_iter().map(|command| self.write(command, printer));
        of_subcommands.sum::<anyhow::Result<usize>>().map(|count| count + 1)
    }
}
