//! The mean of some rows, which the sensors are fitted to.

use shell_data::wrench::PerAxis;

/// Most channels of a model: a frame's flags are bits, its values are on the stack.
pub const MOST_CHANNELS: usize = 16;

/// The mean of some rows.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// Which rows are one observation or hang together: validation holds out whole groups.
    pub group: u64,
    /// Mean wrench, N and N·m.
    pub wrench: PerAxis<f64>,
    /// Mean reading of each channel, counts.
    pub readings: Vec<f64>,
}

/// The root mean square of each axis of the wrench, N and N·m; 1 for one that is never loaded.
pub(crate) fn wrench_scale<'a>(
    observations: impl ExactSizeIterator<Item = &'a Observation> + Clone,
) -> PerAxis<f64> {
    std::array::from_fn(|axis| {
        let squares: f64 = observations.clone().map(|o| o.wrench[axis].powi(2)).sum();
        if squares > 0.0 { (squares / observations.len() as f64).sqrt() } else { 1.0 }
    })
}
