//! Apparent gravity in the sensor's frame over time.

use super::vector::{Vector, add, scaled, subtract};
use shell_data::statistics::upper_median;

/// A motion is unknown further than this number of usual intervals from the nearest sample.
const FAR: f64 = 10.0;

/// Apparent gravity over time, linear between samples and held before the first and after the last.
#[derive(Clone, Debug, PartialEq)]
pub struct Motion {
    times_s: Vec<f64>,
    gravity_m_s2: Vec<Vector>,
    period_s: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum MotionError {
    #[error("it has `{0}` samples of motion at different times, at least 2 are needed")]
    TooFewSamples(usize),
    /// The clock was set back; the fields are the times of two consecutive samples, s.
    #[error("its time goes back from `{before}` to `{after}` s")]
    Backward { before: f64, after: f64 },
}

impl Motion {
    /// Creates a motion from samples in order. The first of several samples at one time is used.
    ///
    /// # Errors
    /// [`MotionError`].
    pub fn new(times_s: &[f64], gravity_m_s2: &[Vector]) -> Result<Self, MotionError> {
        let mut motion = Self { times_s: Vec::new(), gravity_m_s2: Vec::new(), period_s: 0.0 };
        for (&time, &gravity) in times_s.iter().zip(gravity_m_s2) {
            match motion.times_s.last() {
                Some(&before) if time < before => {
                    return Err(MotionError::Backward { before, after: time });
                }
                Some(&before) if time == before => {}
                _ => {
                    motion.times_s.push(time);
                    motion.gravity_m_s2.push(gravity);
                }
            }
        }
        let mut periods: Vec<f64> =
            motion.times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
        let too_few = MotionError::TooFewSamples(motion.times_s.len());
        motion.period_s = upper_median(&mut periods).ok_or(too_few)?;
        Ok(motion)
    }

    pub fn earlier_by(mut self, lag_s: f64) -> Self {
        self.times_s.iter_mut().for_each(|time| *time -= lag_s);
        self
    }

    pub fn span_s(&self) -> (f64, f64) {
        (self.times_s[0], self.times_s[self.times_s.len() - 1])
    }

    pub fn at(&self, time_s: f64) -> Vector {
        let after = self.times_s.partition_point(|&time| time <= time_s);
        if after == 0 {
            return self.gravity_m_s2[0];
        }
        let before = after - 1;
        let Some(&next) = self.gravity_m_s2.get(after) else { return self.gravity_m_s2[before] };
        let (start, end) = (self.times_s[before], self.times_s[after]);
        let share = (time_s - start) / (end - start);
        let first = self.gravity_m_s2[before];
        add(first, scaled(subtract(next, first), share))
    }

    /// Returns true if a time is so far from any sample that the motion is unknown.
    pub fn is_far(&self, time_s: f64) -> bool {
        let after = self.times_s.partition_point(|&time| time <= time_s);
        let neighbours = &self.times_s[after.saturating_sub(1)..self.times_s.len().min(after + 1)];
        let distances = neighbours.iter().map(|time| (time - time_s).abs());
        distances.fold(f64::INFINITY, f64::min) > FAR * self.period_s
    }
}

/// Integral of a motion, which gives means over any block of time.
pub(super) struct Integral<'a> {
    motion: &'a Motion,
    sums: Vec<Vector>,
}

impl<'a> Integral<'a> {
    pub(super) fn new(motion: &'a Motion) -> Self {
        let mut sums = vec![[0.0; 3]];
        for (times, values) in motion.times_s.windows(2).zip(motion.gravity_m_s2.windows(2)) {
            let part = scaled(add(values[0], values[1]), 0.5 * (times[1] - times[0]));
            sums.push(add(sums[sums.len() - 1], part));
        }
        Self { motion, sums }
    }

    /// The mean over `length_s` after a time minus the mean over `length_s` before it.
    pub(super) fn step(&self, time_s: f64, length_s: f64) -> Vector {
        let ends = add(self.to(time_s + length_s), self.to(time_s - length_s));
        scaled(subtract(ends, scaled(self.to(time_s), 2.0)), 1.0 / length_s)
    }

    fn to(&self, time_s: f64) -> Vector {
        let Motion { times_s, gravity_m_s2, .. } = self.motion;
        let before = times_s.partition_point(|&time| time <= time_s).saturating_sub(1);
        let mean = scaled(add(gravity_m_s2[before], self.motion.at(time_s)), 0.5);
        add(self.sums[before], scaled(mean, time_s - times_s[before]))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_motion_is_straight_between_samples_and_held_beyond() {
        let motion =
            Motion::new(&[1.0, 2.0, 2.0, 4.0], &[[0.0; 3], [1.0; 3], [9.0; 3], [3.0; 3]]).unwrap();
        for (time, value) in
            [(0.0, 0.0), (1.5, 0.5), (2.0, 1.0), (3.0, 2.0), (4.0, 3.0), (9.0, 3.0)]
        {
            assert_eq!(motion.at(time), [value; 3], "{time}");
        }
        assert_eq!(motion.clone().earlier_by(1.0).at(0.5), [0.5; 3]);
        assert!(!motion.is_far(20.0) && motion.is_far(25.0) && motion.is_far(-20.0));
        let backward = Motion::new(&[1.0, 0.5], &[[0.0; 3]; 2]).unwrap_err();
        assert_eq!(backward, MotionError::Backward { before: 1.0, after: 0.5 });
        assert_eq!(Motion::new(&[1.0; 3], &[[0.0; 3]; 3]), Err(MotionError::TooFewSamples(1)));
    }

    #[test]
    fn a_step_is_between_the_means_of_adjoining_blocks() {
        let motion = Motion::new(&[0.0, 1.0, 3.0], &[[0.0; 3], [2.0; 3], [2.0; 3]]).unwrap();
        let integral = Integral::new(&motion);
        for (time, length, step) in [(1.0, 1.0, 1.0), (2.0, 1.0, 0.0), (0.5, 0.5, 1.0)] {
            assert_eq!(integral.step(time, length), [step; 3], "{time} {length}");
        }
        // Held before the first sample and after the last.
        assert_eq!(integral.step(0.0, 1.0), [1.0; 3]);
        assert_eq!(integral.step(3.0, 2.0), [0.0; 3]);
    }
}
