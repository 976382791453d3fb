//! The training data of one sensor.

use shell_data::wrench::PerAxis;

/// What one sensor is fitted to. Columns are as long as a multiple of
/// [`MOST_LANES`](super::lanes::MOST_LANES) from `rows` on; what is added has no weight.
#[derive(Clone, Debug)]
pub(super) struct Data<'a> {
    /// Wrenches, in units of the model's scales.
    pub(super) wrench: &'a PerAxis<Vec<f64>>,
    /// Readings, in ranges above the least.
    pub(super) readings: &'a [f64],
    /// Rows of the data.
    pub(super) rows: usize,
    /// Inverse variances.
    pub(super) weights: Vec<f64>,
}
