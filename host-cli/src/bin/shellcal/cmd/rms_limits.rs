//! Limits of errors, above which a command fails: `fit` and `eval` have the same.

use std::cmp::Ordering;

use calibration::quality::significant;
use shell_data::wrench::{Axes, Axis, PerAxis};

use crate::printer::Printer;

#[derive(Debug, clap::Args)]
pub(super) struct RmsLimits {
    /// Fail when the RMS error of Fx, Fy or Fz is above this many N
    #[arg(long, value_name = "N", value_parser = limit)]
    max_rms: Option<f64>,

    /// Fail when the RMS error of Mx, My or Mz is above this many N·m
    #[arg(long, value_name = "N·m", value_parser = limit)]
    max_rms_moment: Option<f64>,
}

/// An axis whose error is above its limit.
pub(super) struct AboveLimit {
    pub(super) axis: Axis,
    rms: f64,
    limit: f64,
}

impl RmsLimits {
    /// Whether there are any.
    pub(super) fn are_given(&self) -> bool {
        self.max_rms.is_some() || self.max_rms_moment.is_some()
    }

    /// The axes whose RMS error is above its limit.
    pub(super) fn above(&self, rms: &PerAxis<f64>, axes: Axes) -> Vec<AboveLimit> {
        let limit = |axis: Axis| if axis.is_moment() { self.max_rms_moment } else { self.max_rms };
        axes.iter()
            .filter_map(|axis| {
                Some(AboveLimit { axis, rms: rms[axis.index()], limit: limit(axis)? })
            })
            // What cannot be compared, such as NaN, is not below the limit.
            .filter(|of| of.rms.partial_cmp(&of.limit).is_none_or(Ordering::is_gt))
            .collect()
    }
}

impl AboveLimit {
    /// Says so.
    pub(super) fn warn(&self, printer: &mut Printer) {
        let Self { axis, rms, limit } = self;
        let (name, unit) = (axis.name(), axis.unit());
        let (rms, limit) = (significant(*rms, 4), significant(*limit, 4));
        printer.warning(format!(
            "the RMS error of `{name}` is {rms} {unit}, above the limit of {limit} {unit}"
        ));
    }
}

fn limit(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(limit) if limit >= 0.0 => Ok(limit),
        _ => Err("expected a number that is not negative".to_owned()),
    }
}
