//! The load that a sensor carries, taken off its wrench.

use super::{Lag, Motion, Payload};
use shell_data::wrench::PerAxis;

/// What a sensor carries in a run.
#[derive(Clone, Debug, PartialEq)]
pub struct CarriedLoad {
    /// The body.
    pub payload: Payload,
    /// Apparent gravity over time, on the clock of the wrench.
    pub motion: Motion,
    /// Whether that was measured by an accelerometer, and has inertia in it.
    pub has_inertia: bool,
    /// How much later the clock of the motion was found to be, taken or not.
    pub lag: Option<Lag>,
}

impl CarriedLoad {
    /// The mean load at some times, without the sensor's zero; `None` of none.
    pub fn mean(&self, times_s: &[f64]) -> Option<PerAxis<f64>> {
        let mut sum = PerAxis::<f64>::default();
        for &time in times_s {
            let load = self.payload.load(self.motion.at(time));
            sum.iter_mut().zip(load).for_each(|(sum, load)| *sum += load);
        }
        (!times_s.is_empty()).then(|| sum.map(|sum| sum / times_s.len() as f64))
    }

    /// Takes the load at each row's time off its wrench, and `zero`. Returns the number of rows where the
    /// load is not known.
    pub fn subtract(
        &self,
        times_s: &[f64],
        zero: &PerAxis<f64>,
        wrench: &mut PerAxis<Vec<f64>>,
    ) -> u64 {
        let mut unknown = 0;
        for (row, &time) in times_s.iter().enumerate() {
            let load = self.payload.load(self.motion.at(time));
            unknown += u64::from(self.motion.is_far(time));
            for ((column, load), zero) in wrench.iter_mut().zip(load).zip(zero) {
                column[row] -= load + zero;
            }
        }
        unknown
    }
}
