//! The columns of a table of wrenches.

use shell_data::wrench::{Axes, Axis, PerAxis};

/// What is written of every frame, in this order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Columns {
    /// Time in s.
    pub time: bool,
    /// The axes of the wrench, N and N·m.
    pub axes: PerAxis<bool>,
    /// The standard error of each axis written, N and N·m: that of the frame before filtering.
    pub standard_errors: bool,
    /// The prediction interval of each axis written, N and N·m: the level, between 0 and 1. About
    /// the wrench as written, as wide as that of the frame before filtering.
    pub interval: Option<f64>,
    /// Which channels cannot be trusted: `s3:range` outside the calibrated range, `s3:saturated` at
    /// an end of the converter or on a plateau of its curve, `s3:left-out` not used by the model; empty
    /// when all is well.
    pub flags: bool,
}

impl Columns {
    /// The axes that are written.
    pub(super) fn axes(&self) -> Axes {
        Axis::ALL.into_iter().filter(|axis| self.axes[axis.index()]).collect()
    }

    /// Whether standard errors are needed.
    pub(super) fn need_errors(&self) -> bool {
        self.standard_errors || self.interval.is_some()
    }
}
