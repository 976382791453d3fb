//! The command line: what all subcommands share.

use clap::Parser;

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
    fn the_command_line_is_consistent() {
        super::Args::command().debug_assert();
    }
}
