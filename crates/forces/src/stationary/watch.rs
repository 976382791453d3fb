//! Test for a change of the zero between the start and the end of a log.
//!
//! The means of the first and the last stationary interval differ significantly if on any of k axes they differ by more
//! than `t·√(e₁² + e₂²)`. The standard errors e of the means are from [`PARTS`] parts each; t is Student's quantile
//! with `2·(PARTS − 1)` degrees of freedom at the level `1 − FALSE_ALARMS/k` (Bonferroni). A reported change also
//! exceeds the noise of one frame. If the noise is uncorrelated over a fifth of an interval, at most [`FALSE_ALARMS`]
//! of logs with a constant zero give an alarm. An offset that a load leaves in the springs (play, creep) counts as a
//! change.

use calibration::Calibration;
use calibration::uncertainty::student_quantile;
use shell_data::statistics::RunningVariance;
use shell_data::wrench::{Axis, AxisValues, PerAxis};

use super::{PARTS, StationaryFinder, StationaryInterval};

/// The maximum share of logs with a constant zero for which a change is reported.
pub const FALSE_ALARMS: f64 = 0.01;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ZeroEstimate {
    pub mean: f64,
    /// RMS distance of a frame from the mean.
    pub noise: f64,
    /// Standard error of the mean, from the means of the parts.
    pub standard_error: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct ZeroChange {
    pub change: f64,
    pub limit: f64,
    /// Noise of a frame, RMS in the first stationary interval.
    pub noise: f64,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct ZeroMove {
    pub rests: u64,
    pub first_s: f64,
    pub last_s: f64,
    #[serde(serialize_with = "super::super::tare::by_column")]
    pub axes: AxisValues<ZeroChange>,
}

impl ZeroEstimate {
    /// The zero from the values at the frames of a stationary interval.
    pub fn new(values: &[f64], parts: &[usize]) -> Self {
        let whole = RunningVariance::new(values);
        let mut means = Vec::with_capacity(parts.len());
        let mut rest = values;
        for &frames in parts {
            let (part, after) = rest.split_at(frames.min(rest.len()));
            means.push(RunningVariance::new(part).mean);
            rest = after;
        }
        let parts = RunningVariance::new(&means);
        let n = parts.count as f64;
        Self {
            mean: whole.mean,
            noise: whole.rms_about_mean(),
            standard_error: (parts.squares / (n * (n - 1.0))).sqrt(),
        }
    }

    pub fn from_wrench(
        calibration: &Calibration,
        stationary: &StationaryInterval,
    ) -> PerAxis<Self> {
        let mut wrench = PerAxis::default();
        calibration.wrench(&stationary.readings, &mut wrench);
        wrench.map(|values| Self::new(&values, &stationary.parts))
    }
}

impl ZeroChange {
    pub fn new(first: &ZeroEstimate, last: &ZeroEstimate, quantities: usize) -> Self {
        let level = 1.0 - FALSE_ALARMS / quantities.max(1) as f64;
        let t = student_quantile(level, 2.0 * (PARTS - 1) as f64);
        let by_chance = t * first.standard_error.hypot(last.standard_error);
        let (change, noise) = (last.mean - first.mean, first.noise);
        Self { change, limit: by_chance.max(noise), noise }
    }

    pub(crate) fn has_moved(&self) -> bool {
        self.change.abs() > self.limit
    }
}

/// The largest of the changes beyond their limits, relative to the limit.
pub fn largest_change<T: Copy>(
    changes: impl Iterator<Item = (T, ZeroChange)>,
) -> Option<(T, ZeroChange)> {
    let size = |change: &ZeroChange| change.change.abs() / change.limit;
    let moved = changes.filter(|(_, change)| change.has_moved());
    moved.max_by(|(_, a), (_, b)| size(a).total_cmp(&size(b)))
}

impl ZeroMove {
    /// The largest change relative to its limit; `None` if none exceeds it.
    pub fn largest(&self) -> Option<(Axis, ZeroChange)> {
        largest_change(self.axes.iter().copied())
    }

    pub fn in_words(&self) -> Option<String> {
        let (axis, ZeroChange { change, noise, .. }) = self.largest()?;
        let decimals = if axis.is_moment() { 5 } else { 3 };
        let (name, unit) = (axis.name(), axis.unit());
        Some(format!(
            "the zero of {name} moves by {change:.decimals$} {unit} from the stationary interval at {:.1} s to that at {:.1} s, \
             where its noise is {noise:.decimals$} {unit}",
            self.first_s, self.last_s
        ))
    }
}

#[derive(Clone, Debug, Default)]
pub struct ZeroWatch {
    finder: StationaryFinder,
    first: Option<StationaryInterval>,
    last: Option<StationaryInterval>,
    rests: u64,
}

impl ZeroWatch {
    /// Takes the next fresh frames, see [`StationaryFinder::look_at`].
    pub fn look_at(&mut self, times_s: &[f64], readings: &[Vec<f64>]) {
        let Self { finder, first, last, rests } = self;
        finder.look_at(times_s, readings, &mut |stationary| {
            *rests += 1;
            match first {
                None => *first = Some(stationary.clone()),
                Some(_) => *last = Some(stationary.clone()),
            }
        });
    }

    /// The change of the zero; `None` with fewer than two stationary intervals.
    pub fn finish(&self, calibration: &Calibration) -> Option<ZeroMove> {
        let (first, last) = (self.first.as_ref()?, self.last.as_ref()?);
        let zeros = [first, last].map(|of| ZeroEstimate::from_wrench(calibration, of));
        let count = calibration.axes.iter().count();
        let change = |axis: usize| ZeroChange::new(&zeros[0][axis], &zeros[1][axis], count);
        Some(ZeroMove {
            rests: self.rests,
            first_s: first.middle_s(),
            last_s: last.middle_s(),
            axes: calibration.axes.values(&std::array::from_fn(change)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums of twelve uniform numbers, an approximation of a normal distribution.
    struct Noise(u64);

    impl Noise {
        fn next(&mut self) -> f64 {
            let mut uniform = || {
                self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (self.0 >> 11) as f64 / (1_u64 << 53) as f64
            };
            (0..12).map(|_| uniform()).sum::<f64>() - 6.0
        }
    }

    #[test]
    fn noise_alone_exceeds_the_limit_at_the_stated_rate() {
        let mut noise = Noise(1);
        let parts = [10; PARTS];
        let mut zero =
            || ZeroEstimate::new(&std::array::from_fn::<f64, 50, _>(|_| noise.next()), &parts);
        // Without the noise of a frame in the limit, only the statistical test remains.
        let alarm = |first: ZeroEstimate, last: ZeroEstimate| {
            ZeroChange::new(&ZeroEstimate { noise: 0.0, ..first }, &last, 1).has_moved()
        };
        let alarms = (0..20_000).filter(|_| alarm(zero(), zero())).count() as f64 / 20_000.0;
        // Three standard deviations of a share of 20,000.
        assert!((alarms - FALSE_ALARMS).abs() < 0.0022, "{alarms}");
    }

    #[test]
    fn a_zero_has_the_error_of_its_parts() {
        let zero = ZeroEstimate::new(&[1.0, 3.0, 2.0, 4.0, 6.0, 2.0], &[2, 2, 2]);
        // The means of the three parts, 2, 3 and 4, have the variance 1.
        assert_eq!((zero.mean, zero.standard_error), (3.0, (1.0_f64 / 3.0).sqrt()));
        assert_eq!(zero.noise, (16.0_f64 / 6.0).sqrt());
    }
}
