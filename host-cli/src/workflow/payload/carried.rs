//! The load that a sensor carries, taken off its wrench.

use crate::workflow::selection::by_column;
use forces::payload::{Lag, Motion, Payload};
use shell_data::wrench::{AxisValues, PerAxis};

/// What a sensor carries in a run.
#[derive(Clone, Debug, PartialEq)]
pub struct CarriedLoad {
    /// The body.
    pub payload: Payload,
    /// Apparent gravity over time, on the clock of the wrench.
    pub motion: Motion,
    /// Whether that was measured by an accelerometer, and has inertia in it.
    pub has_inertia: bool,
    /// How much later the clock of the motion was, where that was found.
    pub lag: Option<Lag>,
}

/// What taking off a load has left.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct LoadSummary {
    /// Whether inertia was taken off, too.
    pub has_inertia: bool,
    /// How late the clock of the motion was.
    pub lag: Option<Lag>,
    /// Rows so far from any sample of the motion that the load there is not known.
    pub rows_without_motion: u64,
    /// Standard deviation of the wrench that is left, N and N·m.
    #[serde(serialize_with = "by_column")]
    pub standard_deviation: AxisValues<f64>,
}

impl CarriedLoad {
    /// The mean load at some times, without the sensor's zero; `None` of none.
    pub(in crate::workflow) fn mean(&self, times_s: &[f64]) -> Option<PerAxis<f64>> {
        let mut sum = PerAxis::<f64>::default();
        for &time in times_s {
            let load = self.payload.load(self.motion.at(time));
            sum.iter_mut().zip(load).for_each(|(sum, load)| *sum += load);
        }
        (!times_s.is_empty()).then(|| sum.map(|sum| sum / times_s.len() as f64))
    }

    /// Takes the load at each row's time off its wrench, and `zero`. Returns the number of rows where the
    /// load is not known.
    pub(in crate::workflow) fn subtract(
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
