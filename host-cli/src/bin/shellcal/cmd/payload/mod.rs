//! `shellcal payload`: what a sensor carries.

mod fit;
pub(in crate::cmd) mod load;
mod subtract;

use clap::Subcommand;

use crate::printer::Printer;

#[derive(Debug, clap::Args)]
pub(crate) struct PayloadArgs {
    #[command(subcommand)]
    action: PayloadAction,
}

#[derive(Debug, Subcommand)]
enum PayloadAction {
    /// Find mass, centre of mass and the sensor's zero from poses at rest
    ///
    /// A log of wrenches with the orientation of each row (`gx gy gz` of gravity in the sensor's frame,
    /// `r11` … `r33`, `qx qy qz qw`), accelerations (`ax ay az`), or both: then the frame, scale and offsets
    /// of the accelerometer are found, too. Every row is a pose, or every label of the group column.
    Fit(fit::PayloadFitArgs),

    /// Take weight and inertia of a payload off a log of wrenches
    ///
    /// For a log of readings see `shellcal convert --payload`.
    Subtract(subtract::SubtractArgs),
}

impl PayloadArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        match &self.action {
            PayloadAction::Fit(args) => args.run(printer),
            PayloadAction::Subtract(args) => args.run(printer),
        }
    }
}
