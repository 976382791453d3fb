//! How readings become forces while they arrive: the flags of `record`, `live` and `stream`.

use board_link::recording::LiveForces;
use forces::{ForceOptions, RowRule, TareRule};

use super::frames::{ForceArgs, describe_forces, parse_tare};
use super::mapping::EditedArg;
use crate::files::InputPath;
use crate::printer::Printer;

/// How readings become forces
#[derive(Debug, clap::Args)]
pub(crate) struct LiveForceArgs {
    /// Calibration for forces beside the readings
    #[arg(long, value_name = "CAL")]
    calibration: Option<InputPath>,

    /// Subtract the mean wrench of the first N frames from the forces after them [default: 50]; or,
    /// with `rests`, that of the last stretch at rest
    #[arg(long, value_name = "N|rests", requires = "calibration", value_parser = parse_tare)]
    tare: Option<TareRule>,

    /// Subtract nothing
    #[arg(long, requires = "calibration", conflicts_with = "tare")]
    no_tare: bool,

    /// Cutoff of the Butterworth low-pass over the forces, in Hz; causal, as nothing later is known
    /// [default: 10, where the rate is above 20 Hz]
    #[arg(long, value_name = "HZ", requires = "calibration")]
    lowpass: Option<f64>,

    /// Do not filter the forces
    #[arg(long, requires = "calibration", conflicts_with = "lowpass")]
    no_lowpass: bool,

    /// Number of poles of the low-pass
    #[arg(long, value_name = "N", requires = "calibration", default_value_t = 4)]
    order: usize,

    #[command(flatten)]
    edited: EditedArg,
}

impl LiveForceArgs {
    /// Whether there are to be forces.
    pub(crate) fn is_given(&self) -> bool {
        self.calibration.is_some()
    }

    /// The calibration with its options, which are noted; `None` if there is none.
    pub(crate) fn read(&self, printer: &Printer) -> anyhow::Result<Option<LiveForces>> {
        let Some(path) = &self.calibration else { return Ok(None) };
        let calibration = self.edited.read(path)?.calibration;
        let options = self.options();
        printer.note(describe_forces(&options));
        Ok(Some(LiveForces { calibration, options }))
    }

    fn options(&self) -> ForceOptions {
        let forces = ForceArgs {
            tare: self.tare,
            no_tare: self.no_tare,
            lowpass: self.lowpass,
            no_lowpass: self.no_lowpass,
            order: self.order,
            causal: true,
            ..ForceArgs::default()
        };
        forces.options(RowRule::Time)
    }
}
