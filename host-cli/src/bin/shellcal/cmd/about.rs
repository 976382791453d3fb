//! What the program says of itself: `shellcal completions`, `man` and `licences`.

use std::any::TypeId;

use clap::{Arg, Command, ValueHint};
use clap_complete::Shell;
use clap_mangen::Man;
use serde_json::json;

use crate::files::{InputPath, OutputLocation, OutputPath, create_folder};
use crate::printer::Printer;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal completions bash > ~/.local/share/bash-completion/completions/shellcal
  shellcal completions zsh > \"${fpath[1]}/_shellcal\"
  shellcal completions fish > ~/.config/fish/completions/shellcal.fish")]
pub(crate) struct CompletionsArgs {
    /// The shell
    shell: Shell,
}

impl CompletionsArgs {
    pub(crate) fn run(&self, printer: &Printer, mut command: Command) -> anyhow::Result<()> {
        command.build();
        let mut command = with_hints(command);
        let name = command.get_name().to_owned();
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut command, name, &mut script);
        printer.print(&String::from_utf8(script)?);
        Ok(())
    }
}

/// What files an argument names is in its type.
fn with_hints(command: Command) -> Command {
    let hint = |argument: Arg| {
        let kind = argument.get_value_parser().type_id();
        if kind == TypeId::of::<InputPath>() || kind == TypeId::of::<OutputPath>() {
            argument.value_hint(ValueHint::FilePath)
        } else if kind == TypeId::of::<OutputLocation>() {
            argument.value_hint(ValueHint::AnyPath)
        } else {
            argument
        }
    };
    command.mut_args(hint).mut_subcommands(with_hints)
}

#[derive(Debug, clap::Args)]
#[command(after_help = "Example:
  shellcal man ~/.local/share/man/man1; man shellcal-fit")]
pub(crate) struct ManArgs {
    /// The folder of the pages, made if it is not there
    directory: OutputLocation,
}

impl ManArgs {
    pub(crate) fn run(&self, printer: &Printer, mut command: Command) -> anyhow::Result<()> {
        create_folder(&self.directory)?;
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

/// Package, version and licence (SPDX) in a line each; `cargo xtask licences` writes it.
const NOTICES: &str = include_str!("../../../../assets/licences.tsv");

#[derive(Debug, clap::Args)]
pub(crate) struct LicencesArgs {}

impl LicencesArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let rows: Vec<Vec<String>> =
            NOTICES.lines().map(|line| line.split('\t').map(str::to_owned).collect()).collect();
        let (version, licence) = (env!("CARGO_PKG_VERSION"), env!("CARGO_PKG_LICENSE"));
        let package =
            |row: &Vec<String>| json!({ "package": row[0], "version": row[1], "licence": row[2] });
        let document = json!({
            "program": { "package": "shellcal", "version": version, "licence": licence },
            "made_of": rows.iter().map(package).collect::<Vec<_>>(),
        });
        printer.finish(&document, |printer| {
            printer.line(format!("shellcal {version}: {licence}, at your choice; made of"));
            printer.table(&["package", "version", "licence"], rows);
            printer.line(
                "The texts are in the packages of a release and, for each package, at \
                 https://crates.io/crates/PACKAGE/VERSION.",
            )
        })
    }
}
