//! Forces at the time stamps of their rows, for a calibration whose reference lagged behind the readings.

use calibration::dynamics::ReferenceLag;
use calibration::memory::TimeBase;
use shell_data::wrench::PerAxis;

/// Resamples forces at the time stamps of their rows, read on the reference's clock. Between two rows, forces follow
/// the cubic with the forces and slopes of both; slopes are from parabolas through three rows. Forces are held before
/// the first row, after the last, and where time goes back. Linear interpolation would flatten fast forces, as the fit
/// has already done once.
#[derive(Clone, Debug)]
pub(super) struct LagShift {
    lag: ReferenceLag,
    rows: u64,
    /// Times of the buffered rows, in the unit of the lag, and the known forces of these rows.
    times: Vec<f64>,
    forces: PerAxis<Vec<f64>>,
    next: usize,
}

impl LagShift {
    pub(super) fn new(lag: ReferenceLag) -> Self {
        Self { lag, rows: 0, times: Vec::new(), forces: PerAxis::default(), next: 0 }
    }

    /// Takes the times of the next rows, s, and the next forces. Returns the forces that are now known, oldest first.
    pub(super) fn push(&mut self, times_s: &[f64], forces: PerAxis<Vec<f64>>) -> PerAxis<Vec<f64>> {
        match self.lag.time_base {
            TimeBase::Seconds => self.times.extend_from_slice(times_s),
            TimeBase::Rows => {
                let count = times_s.len().max(longest(&forces)) as u64;
                self.times.extend((self.rows..self.rows + count).map(|row| row as f64));
                self.rows += count;
            }
        }
        self.take(forces, false)
    }

    /// Takes the last forces, and returns the forces of all pending rows.
    pub(super) fn finish(&mut self, forces: PerAxis<Vec<f64>>) -> PerAxis<Vec<f64>> {
        self.take(forces, true)
    }

    fn take(&mut self, forces: PerAxis<Vec<f64>>, are_last: bool) -> PerAxis<Vec<f64>> {
        self.forces.iter_mut().zip(forces).for_each(|(kept, next)| kept.extend(next));
        let known = longest(&self.forces);
        let mut outputs = PerAxis::<Vec<f64>>::default();
        let mut oldest = 0;
        while self.next < known {
            let times = &self.times[..known];
            let wanted = times[self.next] - self.lag.by;
            let Some(at) = Between::find(times, self.next, wanted, are_last) else { break };
            for (output, column) in outputs.iter_mut().zip(&self.forces) {
                if column.len() == known {
                    output.push(at.value(times, column));
                }
            }
            // The slope at row `before` needs the row before that.
            oldest = at.before.saturating_sub(1).min(self.next);
            self.next += 1;
        }
        self.times.drain(..oldest);
        self.forces.iter_mut().for_each(|of| drop(of.drain(..oldest.min(of.len()))));
        self.next -= oldest;
        outputs
    }
}

fn longest(forces: &PerAxis<Vec<f64>>) -> usize {
    forces.iter().map(Vec::len).max().unwrap_or(0)
}

struct Between {
    before: usize,
    share: f64,
}

impl Between {
    /// Finds the rows around `wanted`, searching from row `from`. `None` if a needed row may not have arrived yet.
    fn find(times: &[f64], from: usize, wanted: f64, are_all: bool) -> Option<Self> {
        let mut before = from;
        while before > 0 && times[before] > wanted && times[before - 1] <= times[before] {
            before -= 1;
        }
        while times[before] <= wanted {
            match times.get(before + 1) {
                Some(&next) if times[before] <= next && next <= wanted => before += 1,
                Some(&next) if times[before] < next && times[before] < wanted => {
                    let share = (wanted - times[before]) / (next - times[before]);
                    let is_known = are_all || before + 2 < times.len();
                    return is_known.then_some(Self { before, share });
                }
                // The time equals that of a row, or goes back.
                Some(_) => break,
                None if are_all || times[before] == wanted => break,
                None => return None,
            }
        }
        Some(Self { before, share: 0.0 })
    }

    fn value(&self, times: &[f64], forces: &[f64]) -> f64 {
        let &Self { before, share } = self;
        if share == 0.0 {
            return forces[before];
        }
        let after = before + 1;
        let [step, rise] = [times, forces].map(|of| of[after] - of[before]);
        let secant = rise / step;
        // Slope at one end of the step, by a parabola through the outer neighbour, or else by the straight line.
        let slope = |at: usize, other: Option<usize>| {
            let other = other.filter(|&other| other < times.len());
            let far = other.map(|other| (times[other] - times[at], forces[other] - forces[at]));
            let is_ahead =
                |&(span, _): &(f64, f64)| if at == before { span < 0.0 } else { span > 0.0 };
            far.filter(is_ahead).map_or(secant, |(span, rise)| {
                let (own, far) = (step, span.abs());
                (secant * far + rise / span * own) / (own + far)
            })
        };
        let [start, end] = [slope(before, before.checked_sub(1)), slope(after, Some(after + 1))];
        // The cubic is the straight line plus a bend.
        let bend = (1.0 - share) * (start - secant) - share * (end - secant);
        forces[before] + share * rise + share * (1.0 - share) * step * bend
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn moved(by: f64, time_base: TimeBase, times_s: &[f64], pieces: usize) -> Vec<f64> {
        let mut shift = LagShift::new(ReferenceLag { time_base, by });
        let line = |times: &[f64]| -> PerAxis<Vec<f64>> {
            let mut forces = PerAxis::<Vec<f64>>::default();
            forces[2] = times.iter().map(|time| 2.0 * time).collect();
            forces
        };
        let mut all = Vec::new();
        for times in times_s.chunks(times_s.len().div_ceil(pieces)) {
            all.extend(shift.push(times, line(times))[2].iter());
        }
        all.extend(shift.finish(PerAxis::default())[2].iter());
        all
    }

    #[test]
    fn a_straight_line_is_shifted_along_itself_for_any_blocks() {
        let times = [0.0, 1.0, 1.5, 3.0, 4.0];
        for pieces in [1, 2, 5] {
            let late = moved(0.25, TimeBase::Seconds, &times, pieces);
            assert_eq!(late, [0.0, 1.5, 2.5, 5.5, 7.5]);
            let early = moved(-0.75, TimeBase::Seconds, &times, pieces);
            assert_eq!(early, [1.5, 3.5, 4.5, 7.5, 8.0]);
            let rows = moved(-0.5, TimeBase::Rows, &times, pieces);
            // By row, the forces do not lie on a line. Cubics join them, with straight-line slopes at both ends.
            assert_eq!(rows, [1.0625, 2.4375, 4.4375, 7.0625, 8.0]);
        }
    }

    #[test]
    fn forces_are_not_taken_across_a_clock_that_goes_back() {
        let times = [0.0, 1.0, 2.0, 0.0, 1.0];
        assert_eq!(moved(-0.5, TimeBase::Seconds, &times, 1), [1.0, 3.0, 4.0, 1.0, 2.0]);
        assert_eq!(moved(0.5, TimeBase::Seconds, &times, 1), [0.0, 1.0, 3.0, 0.0, 1.0]);
    }
}
