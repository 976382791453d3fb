//! Straightened readings: the inverse of each channel's optics, approximated by a polynomial.
//!
//! A channel responds monotonically to one displacement, which is linear in the load and in the memory of the springs.
//! The reading is therefore bent back:
//!
//! ```text
//! z = y + r Σₖ βₖ xᵏ      x = (y − ȳ) / r      k = 2, 3, 4
//! ```
//!
//! with the median ȳ of a channel's readings, and the distance r from it that 1 % of them exceed.
//! The least-squares problem of the map also gives βₖ: with the coefficient of y held at 1, they
//! minimise the part of z that the load does not explain. Powers of the load would require the
//! memory in advance, and a wrong memory gives a wrong offset.

/// Number of powers of each reading, from the square on.
pub(super) const POWERS: usize = 3;

/// Coefficients of the powers that are added to a reading.
pub(super) type Bend = [f64; POWERS];

/// Limit on x, in units of r: powers of damaged readings, which are farther out, are held there.
const FARTHEST: f64 = 2.0;

/// Median of a channel's readings, and the distance from it that 1 % exceed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ReadingReach {
    median: f64,
    reach: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Straight {
    pub(super) reading: f64,
    /// Its derivative with respect to the raw reading.
    pub(super) gain: f64,
    /// The powers to which the bend gives coefficients, counts.
    pub(super) powers: [f64; POWERS],
}

impl ReadingReach {
    pub(super) fn new(mut readings: Vec<f64>) -> Self {
        let Some(last) = readings.len().checked_sub(1) else {
            return Self { median: 0.0, reach: 1.0 };
        };
        let median = *readings.select_nth_unstable_by(last / 2, f64::total_cmp).1;
        readings.iter_mut().for_each(|y| *y = (*y - median).abs());
        let reach = *readings.select_nth_unstable_by(last - last / 100, f64::total_cmp).1;
        // A channel that is constant in all but a few rows has no bend.
        Self { median, reach: reach.max(1e-300) }
    }

    pub(super) fn straighten(&self, reading: f64, bend: &Bend) -> Straight {
        let all = (reading - self.median) / self.reach;
        let x = all.clamp(-FARTHEST, FARTHEST);
        let mut straight = Straight { reading, gain: 1.0, powers: [0.0; POWERS] };
        let mut power = x;
        for (k, share) in bend.iter().enumerate() {
            straight.gain += if x == all { (k as f64 + 2.0) * share * power } else { 0.0 };
            power *= x;
            straight.powers[k] = self.reach * power;
            straight.reading += share * straight.powers[k];
        }
        straight
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reading_is_bent_by_its_powers() {
        let range = ReadingReach::new(vec![1.0, 4.0, 10.0, 3.0, 5.0]);
        // Median 4, reach 6.
        let straight = range.straighten(7.0, &[0.2, -0.4, 0.0]);
        assert_eq!(straight.powers, [1.5, 0.75, 0.375]);
        assert!((straight.reading - (7.0 + 0.2 * 1.5 - 0.4 * 0.75)).abs() < 1e-15);
        let ahead = range.straighten(7.0 + 1e-6, &[0.2, -0.4, 0.0]).reading;
        assert!((straight.gain - (ahead - straight.reading) / 1e-6).abs() < 1e-6);
    }

    #[test]
    fn damaged_readings_do_not_affect_the_range_or_high_powers() {
        let mut readings: Vec<f64> = (0..1010).map(|k| f64::from(k % 101)).collect();
        readings[0] = 1e9;
        let range = ReadingReach::new(readings);
        assert_eq!(range, ReadingReach { median: 50.0, reach: 50.0 });
        let straight = range.straighten(1e9, &[0.5, 0.0, 0.0]);
        assert_eq!((straight.powers, straight.gain), ([200.0, 400.0, 800.0], 1.0));
    }

    #[test]
    fn a_constant_channel_is_unchanged() {
        let range = ReadingReach::new(vec![5.0; 3]);
        assert_eq!(range.straighten(5.0, &[1.0; POWERS]).reading, 5.0);
        assert_eq!(ReadingReach::new(vec![]).straighten(5.0, &[0.0; POWERS]).reading, 5.0);
    }
}
