//! A zero that follows the stationary intervals.

use calibration::Calibration;
use shell_data::wrench::PerAxis;

use super::StationaryInterval;

/// The zero at every time, from stationary intervals in their order.
#[derive(Clone, Debug, PartialEq)]
pub(in super::super) struct StationaryZeros {
    /// Hold the zero of the last rest that has ended, in place of a straight line between stationary intervals.
    causal: bool,
    knots: Vec<Knot>,
}

/// The zero at a rest.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Knot {
    middle_s: f64,
    end_s: f64,
    wrench: PerAxis<f64>,
}

impl StationaryZeros {
    pub(in super::super) fn new(causal: bool) -> Self {
        Self { causal, knots: Vec::new() }
    }

    pub(in super::super) fn add(&mut self, calibration: &Calibration, rest: &StationaryInterval) {
        if let Some(tare) = calibration.tare(&rest.readings) {
            let (middle_s, end_s) = (rest.middle_s(), rest.end_s());
            self.knots.push(Knot { middle_s, end_s, wrench: tare.wrench });
        }
    }

    /// How many stationary intervals there were.
    pub(in super::super) fn count(&self) -> usize {
        self.knots.len()
    }

    /// The end of the last, s.
    pub(in super::super) fn end_s(&self) -> Option<f64> {
        self.knots.last().map(|knot| knot.end_s)
    }

    /// The zero at a time, N and N·m; zero where there was no rest.
    pub(in super::super) fn at(&self, time_s: f64) -> PerAxis<f64> {
        if self.causal {
            let next = self.knots.partition_point(|knot| knot.end_s <= time_s);
            return self.knots.get(next.saturating_sub(1)).map_or([0.0; 6], |knot| knot.wrench);
        }
        let next = self.knots.partition_point(|knot| knot.middle_s <= time_s);
        match (next.checked_sub(1).map(|before| &self.knots[before]), self.knots.get(next)) {
            (Some(a), Some(b)) => {
                let share = (time_s - a.middle_s) / (b.middle_s - a.middle_s);
                std::array::from_fn(|axis| {
                    a.wrench[axis] + (b.wrench[axis] - a.wrench[axis]) * share
                })
            }
            (one, other) => one.or(other).map_or([0.0; 6], |knot| knot.wrench),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_zero_runs_straight_between_rests_and_is_held_while_recording() {
        let knot = |end_s: f64, fx| Knot {
            middle_s: end_s - 1.0,
            end_s,
            wrench: [fx, 0.0, 0.0, 0.0, 0.0, 0.0],
        };
        let knots = vec![knot(2.0, 1.0), knot(6.0, 3.0), knot(12.0, 0.0)];
        let fx = |causal, time_s| StationaryZeros { causal, knots: knots.clone() }.at(time_s)[0];
        let straight = [0.0, 1.0, 3.0, 5.0, 7.0, 11.0, 20.0].map(|t| fx(false, t));
        assert_eq!(straight, [1.0, 1.0, 2.0, 3.0, 2.0, 0.0, 0.0]);
        let held = [0.0, 2.0, 5.9, 6.0, 11.9, 12.0, 20.0].map(|t| fx(true, t));
        assert_eq!(held, [1.0, 1.0, 1.0, 3.0, 3.0, 0.0, 0.0]);
        assert_eq!(StationaryZeros::new(true).at(1.0), [0.0; 6]);
    }
}
