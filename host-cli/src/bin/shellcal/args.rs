//! The command line: what all subcommands share.

use std::ffi::OsString;

use clap::{ColorChoice, Parser};

use crate::cmd::Command;
use crate::config::ConfigArgs;
use crate::printer::OutputArgs;

/// From the recordings of an optical 6-axis force/torque shell to forces and moments.
///
/// Exit codes: 0 done, 1 ran but a check failed, 2 could not run.
#[derive(Debug, Parser)]
#[command(name = "shellcal", version, max_term_width = 100)]
pub(crate) struct Args {
    #[command(flatten)]
    pub(crate) output: OutputArgs,

    #[command(flatten)]
    pub(crate) config: ConfigArgs,

    #[command(subcommand)]
    pub(crate) command: Command,
}

/// Whether help and errors of the command line itself are coloured: they are printed while it is still being
/// read.
pub(crate) fn color_of(arguments: impl Iterator<Item = OsString>) -> ColorChoice {
    let arguments: Vec<OsString> = arguments.take_while(|argument| argument != "--").collect();
    let value = |at: usize| match arguments[at].to_str()?.strip_prefix("--color")? {
        "" => arguments.get(at + 1)?.to_str(),
        joined => joined.strip_prefix('='),
    };
    match (0..arguments.len()).find_map(value) {
        Some("always") => ColorChoice::Always,
        Some("never") => ColorChoice::Never,
        _ => ColorChoice::Auto,
    }
}

/// What is said to who has said nothing.
pub(crate) const GREETING: &str = "\
From recordings of an optical force/torque shell to forces and moments:

  shellcal info LOG                           what a log holds
  shellcal fit TRAIN --test TEST -o CAL       fit a calibration
  shellcal convert CAL LOG -o OUT             readings to forces and moments
  shellcal batch MANIFEST --calibration CAL   drag, lift and energies of trials
  shellcal record PORT -o LOG                 record from a board

`shellcal help` lists all commands, `shellcal help COMMAND` has examples.";

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    #[test]
    fn the_colour_is_known_before_the_command_line_is_read() {
        let of = |line: &str| super::color_of(line.split(' ').map(Into::into));
        assert_eq!(of("shellcal fit --color never --help"), clap::ColorChoice::Never);
        assert_eq!(of("shellcal --color=always"), clap::ColorChoice::Always);
        assert_eq!(of("shellcal fit -- --color never"), clap::ColorChoice::Auto);
        assert_eq!(of("shellcal fit --color"), clap::ColorChoice::Auto);
    }

    #[test]
    fn the_command_line_is_consistent() {
        super::Args::command().debug_assert();
    }
}
