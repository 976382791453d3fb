//! `shellcal completions`: what a shell has to know to complete a command line.

use std::any::TypeId;

use clap::{Arg, Command, ValueHint};
use clap_complete::Shell;

use crate::files::{InputPath, OutputLocation, OutputPath};
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
        printer.file(&script)
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
