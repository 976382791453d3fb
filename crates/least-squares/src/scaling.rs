//! Shift and scale of readings before powers are computed. Raw cubic features of 12-bit readings
//! span ten orders of magnitude and are nearly collinear; relative to their mean they are not.
//! Shifts are integers and scales powers of two, so every feature of integer readings of up to 16
//! bits is an exact `f64`.

use shell_data::statistics::extremes;

/// The standardisation of readings: `z = (s − centre) / scale`, channel by channel.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Scaling {
    /// Centre of each channel, in counts. Zero for models without an intercept.
    pub centre: Vec<f64>,
    /// Scale of each channel, in counts: a power of two.
    pub scale: Vec<f64>,
}

impl Scaling {
    /// No shift and no scaling.
    pub fn identity(channels: usize) -> Self {
        Self { centre: vec![0.0; channels], scale: vec![1.0; channels] }
    }

    /// Chooses the centre (the rounded mean) and the scale (the next power of two above the largest distance from the
    /// centre), so |z| ≤ 1 over the sample. Without an intercept the centre is zero: powers of a shifted reading span
    /// the powers of the reading only together with a constant.
    pub fn from_sample(readings: &[Vec<f64>], intercept: bool) -> Self {
        Self::from_channels(readings.iter().map(|column| ChannelSample::new(column)), intercept)
    }

    pub(crate) fn from_channels(
        channels: impl Iterator<Item = ChannelSample>,
        intercept: bool,
    ) -> Self {
        let (centre, scale) = channels
            .map(|channel| {
                let centre = if intercept { channel.rounded_mean() } else { 0.0 };
                (centre, channel.scale_about(centre))
            })
            .unzip();
        Self { centre, scale }
    }
}

pub(crate) struct ChannelSample {
    pub(crate) min: f64,
    pub(crate) max: f64,
    pub(crate) mean: f64,
    pub(crate) integers: bool,
}

impl ChannelSample {
    fn new(column: &[f64]) -> Self {
        let (min, max) = extremes(column.iter().copied());
        let mean = column.iter().map(|s| s - min).sum::<f64>() / column.len() as f64 + min;
        Self { min, max, mean, integers: column.iter().all(|s| s.fract() == 0.0) }
    }

    /// Mean, rounded so that subtracting it stays exact: to an integer or, for decimals within a few counts, to a
    /// power-of-two fraction of the range.
    fn rounded_mean(&self) -> f64 {
        let Self { min, max, mean, integers } = *self;
        if min > max {
            return 0.0;
        }
        let grid = if integers || max == min { 1.0 } else { power_of_two_above(max - min) / 16.0 };
        let rounded = (mean / grid.min(1.0)).round() * grid.min(1.0);
        if rounded.is_finite() { rounded } else { 0.0 }
    }

    fn scale_about(&self, centre: f64) -> f64 {
        let reach = f64::max((self.min - centre).abs(), (self.max - centre).abs());
        power_of_two_above(if self.min > self.max { 0.0 } else { reach })
    }
}

/// The smallest power of two not below `value`; 1 for zero and if there is none.
fn power_of_two_above(value: f64) -> f64 {
    if !value.is_normal() {
        return 1.0;
    }
    let mantissa_bits = (1u64 << 52) - 1;
    let below = f64::from_bits(value.abs().to_bits() & !mantissa_bits);
    let power = if below == value.abs() { below } else { 2.0 * below };
    // Readings are multiplied by the reciprocal, so it must be a normal number too.
    if power.recip().is_normal() && power.is_finite() { power } else { 1.0 }
}

pub fn is_power_of_two(value: f64) -> bool {
    value > 0.0 && value.recip().is_normal() && value.to_bits().trailing_zeros() >= 52
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integer_readings_get_an_integer_centre_and_end_up_within_one() {
        let scaling = Scaling::from_sample(&[vec![1000.0, 1001.0, 1500.0]], true);
        assert_eq!(scaling, Scaling { centre: vec![1167.0], scale: vec![512.0] });
    }

    #[test]
    fn without_an_intercept_nothing_is_shifted() {
        let scaling = Scaling::from_sample(&[vec![1000.0, 1024.0]], false);
        assert_eq!(scaling, Scaling { centre: vec![0.0], scale: vec![1024.0] });
    }

    #[test]
    fn readings_in_volts_are_centred_on_a_fraction_of_their_range() {
        let scaling = Scaling::from_sample(&[vec![2.5, 2.5625, 2.6]], true);
        assert!((scaling.centre[0] - 2.55).abs() < 0.01);
        assert_eq!(scaling.centre[0] * 128.0, (scaling.centre[0] * 128.0).round());
        assert_eq!(scaling.scale, [0.0625]);
    }

    #[test]
    fn constant_and_empty_channels_have_a_scaling_too() {
        let scaling = Scaling::from_sample(&[vec![7.0, 7.0], vec![]], true);
        assert_eq!(scaling, Scaling { centre: vec![7.0, 0.0], scale: vec![1.0, 1.0] });
    }

    #[test]
    fn a_power_of_two_beyond_the_exponent_range_is_one() {
        assert_eq!(power_of_two_above(1.0), 1.0);
        assert_eq!(power_of_two_above(1.0 + f64::EPSILON), 2.0);
        assert_eq!(power_of_two_above(f64::MAX), 1.0);
        assert_eq!(power_of_two_above(f64::NAN), 1.0);
    }
}
