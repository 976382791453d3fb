//! `shellcal profile`: the built-in robot profile, to start another from.

use trial::{Profile, VELOCIROACH};

use crate::printer::Printer;

#[derive(Debug, clap::Args)]
#[command(after_help = "Example:\n  shellcal profile > robot.toml")]
pub(crate) struct ProfileArgs {}

impl ProfileArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        printer.finish(&Profile::velociroach(), |printer| printer.line(VELOCIROACH.trim_end()))
    }
}
