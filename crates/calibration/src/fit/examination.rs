//! Examination of a fit: test errors against promised errors, a cure if they are larger, and contradicting training
//! rows.

use super::cure_search::cure_of_test;
use super::evaluation::{GroupErrors, group_errors};
use super::{Fit, contradictions};
use crate::conversion::Calibration;
use crate::groups::{GroupBy, HeldOut, label_groups};
use crate::validation::excitation::Excitation;
use least_squares::error::FitError;
use least_squares::passes::Workers;
use least_squares::quality::{AxisQuality, significant};
use least_squares::uncertainty::fisher_quantile;
use least_squares::validation::cross_validation::CrossValidation;
use sensor_physics::COVERAGE_LEVEL;
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// A test fails if its error is certainly larger than this many times the promised error. The first number is for
/// promises from held-out rows, the second for promises from training rows alone.
const MOST: f64 = 2.0;
const MOST_OF_TRAINING: f64 = 3.0;

/// Errors below this share of the calibrated range never fail a test.
const NO_ERROR: f64 = 1e-3;

/// Blocks of time whose mean loads differ by less than this share of the calibrated range are one pose.
const SAME_LOAD: f64 = 0.02;

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultPlace {
    Test,
    Data,
}

/// Reason not to use a calibration, or not before something has been done.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Fault {
    pub place: FaultPlace,
    /// Description, with the cure if one is known.
    pub text: String,
}

/// The error on the test divided by the promised error, on the axis where it is most certainly too large.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TestRatio {
    pub axis: Axis,
    pub ratio: f64,
    /// 95 % interval, from the numbers of independent groups in the test and behind the promise, by Fisher's F.
    pub interval: [f64; 2],
    /// Number of independent groups of test rows.
    pub groups: usize,
    /// Ratio that the whole interval exceeds if the test fails.
    pub most: f64,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct Examination {
    /// `None` without a test or if no axis varies.
    pub test: Option<TestRatio>,
    /// Most important first.
    pub faults: Vec<Fault>,
}

impl Fault {
    pub fn of_test(text: impl Into<String>) -> Self {
        Self { place: FaultPlace::Test, text: text.into() }
    }

    pub fn of_data(text: impl Into<String>) -> Self {
        Self { place: FaultPlace::Data, text: text.into() }
    }
}

/// Errors that a calibration promises on new rows, and the loads that it was fitted to.
#[derive(Clone, Debug, PartialEq)]
pub struct Promise {
    /// Root mean square errors, N and N·m.
    pub rms: PerAxis<f64>,
    /// Factor by which errors may be larger in a new file, from the scatter between files; 1 if none were held out.
    pub spread: PerAxis<f64>,
    /// True for errors on held-out rows, false for those on training rows.
    pub is_held_out: bool,
    /// Number of independent groups that `rms` comes from; infinite if `spread` includes their scatter, or if it is
    /// not known.
    pub groups: f64,
    /// Difference between the largest and the smallest training load of each axis, zero if it is not known.
    pub range: PerAxis<f64>,
}

impl Promise {
    /// Creates a promise from held-out errors and their spread between files or, without these, from training errors.
    pub fn new(
        train: &PerAxis<AxisQuality>,
        (held_out, spread): (Option<&CrossValidation>, Option<PerAxis<f64>>),
        excitation: Option<&Excitation>,
    ) -> Self {
        let rms = |axis: usize| match held_out {
            Some(found) => found.grouped[axis].rms,
            None => train[axis].rms,
        };
        let groups = held_out.filter(|_| spread.is_none()).map(|found| found.groups as f64);
        let range =
            |axis: usize| excitation.map_or(0.0, |of| of.axes[axis].max - of.axes[axis].min);
        Self {
            rms: std::array::from_fn(rms),
            spread: spread.unwrap_or([1.0; 6]),
            is_held_out: held_out.is_some(),
            groups: groups.unwrap_or(f64::INFINITY),
            range: std::array::from_fn(range),
        }
    }

    fn most(&self) -> f64 {
        if self.is_held_out { MOST } else { MOST_OF_TRAINING }
    }

    /// Compares test errors with the promise. Returns the ratio on the axis that most certainly exceeds it, and the
    /// fault if the test or one of its logs fails. `outside`: numbers of rows out of the calibrated range and of all.
    ///
    /// # Errors
    /// [`FitError::Interrupted`].
    pub fn examine(
        &self,
        calibration: &Calibration,
        tested: &Dataset,
        outside: [u64; 2],
        workers: Workers<'_>,
    ) -> Result<(Option<TestRatio>, Option<Fault>), FitError> {
        let whole = self.ratio(calibration, tested, workers)?;
        let mut failed = whole.filter(TestRatio::fails).map(|of| of.words(outside));
        // The interval of a few logs together may be too wide to show that one of them is wrong.
        for log in tested.logs.iter().filter(|_| tested.logs.len() > 1) {
            if failed.is_some() {
                break;
            }
            let alone = Dataset { logs: vec![log.clone()] };
            let of_log = self.ratio(calibration, &alone, workers)?;
            failed = of_log
                .filter(TestRatio::fails)
                .map(|of| format!("in `{}` {}", log.name.display(), of.words(outside)));
        }
        let limit = self.least().map(|of| self.most() * of);
        let fault = failed.map(|words| cure_of_test(calibration, tested, &limit).unwrap_or(words));
        Ok((whole, fault.map(Fault::of_test)))
    }

    /// Promised errors that the test errors are compared with, N and N·m.
    fn least(&self) -> PerAxis<f64> {
        std::array::from_fn(|axis| {
            (self.spread[axis] * self.rms[axis]).max(NO_ERROR * self.range[axis])
        })
    }

    /// Ratio of errors to the promise, on the axis that most certainly exceeds it.
    fn ratio(
        &self,
        calibration: &Calibration,
        rows: &Dataset,
        workers: Workers<'_>,
    ) -> Result<Option<TestRatio>, FitError> {
        let least = self.least();
        let Some((by, labelled)) = label_groups(rows, HeldOut::Auto) else { return Ok(None) };
        let groups = group_errors(calibration, &labelled, 0, workers)?.groups;
        let independent = match by.is_time_blocks() {
            true => self.distinct_loads(&groups, calibration.axes),
            false => groups.len(),
        };
        let of_axis = |axis: Axis| self.ratio_of(axis, &groups, independent);
        let ratios = calibration.axes.iter().filter(|axis| least[axis.index()] > 0.0);
        Ok(ratios.filter_map(of_axis).max_by(|a, b| a.interval[0].total_cmp(&b.interval[0])))
    }

    fn ratio_of(
        &self,
        axis: Axis,
        groups: &[GroupErrors],
        independent: usize,
    ) -> Option<TestRatio> {
        let at = axis.index();
        let of = |group: &GroupErrors| {
            let rms = group.errors[at].quality()?.rms;
            Some((group.rows as f64, rms * rms))
        };
        let squares: Vec<(f64, f64)> = groups.iter().filter_map(of).collect();
        let sum = |of: fn(&(f64, f64)) -> f64| squares.iter().map(of).sum::<f64>();
        let rows = sum(|(rows, _)| *rows);
        let ratio = (sum(|(rows, square)| rows * square) / rows).sqrt() / self.least()[at];
        // Effective number of groups, as if all had the same size.
        let count = (rows * rows / sum(|(rows, _)| rows * rows)).min(independent as f64);
        let level = 0.5 + COVERAGE_LEVEL / 2.0;
        let low = ratio / fisher_quantile(level, count, self.groups).sqrt();
        let high = ratio / fisher_quantile(1.0 - level, count, self.groups).sqrt();
        let (interval, groups) = ([low, high], count.round() as usize);
        ratio.is_finite().then_some(TestRatio { axis, ratio, interval, groups, most: self.most() })
    }

    /// Number of distinct loads of the groups.
    fn distinct_loads(&self, groups: &[GroupErrors], axes: Axes) -> usize {
        let is_same = |a: &GroupErrors, b: &GroupErrors| {
            let is_near =
                |axis: usize| (a.load[axis] - b.load[axis]).abs() <= SAME_LOAD * self.range[axis];
            axes.iter().all(|axis| is_near(axis.index()))
        };
        let mut distinct: Vec<&GroupErrors> = Vec::new();
        for group in groups {
            if !distinct.iter().any(|known| is_same(known, group)) {
                distinct.push(group);
            }
        }
        distinct.len()
    }
}

impl Fit {
    /// Examines test and training rows, in a small part of the time of the fit.
    ///
    /// # Errors
    /// [`FitError::Interrupted`].
    pub fn examine(&mut self, workers: Workers<'_>) -> Result<(), FitError> {
        workers.start("examination");
        let test = self.test();
        let outside = [test.out_of_range_rows, test.rows];
        let promise = self.promise();
        let (test, fault) = promise.examine(&self.calibration, &self.tested, outside, workers)?;
        let mut faults: Vec<Fault> = fault.into_iter().collect();
        faults.extend(contradictions::find(self, workers)?.into_iter().map(Fault::of_data));
        self.examination = Some(Examination { test, faults });
        Ok(())
    }

    fn promise(&self) -> Promise {
        let held_out = (self.cross_validation.as_ref(), self.spread());
        Promise::new(&self.train, held_out, self.excitation.as_ref())
    }

    /// Factor by which errors may be larger in a new file; `None` if no files were held out.
    pub fn spread(&self) -> Option<PerAxis<f64>> {
        self.group_by.filter(|by| *by == GroupBy::File)?;
        self.cross_validation.as_ref()?.spread()
    }
}

impl TestRatio {
    /// Describes an error that is too large. `outside` of `rows` rows are out of the calibrated range.
    fn words(&self, [outside, rows]: [u64; 2]) -> String {
        let [low, high] = self.interval.map(|bound| significant(bound, 2));
        let mut text = format!(
            "{} errs by {} times what was promised (95 %: {low} to {high})",
            self.axis.name(),
            significant(self.ratio, 2)
        );
        if 2 * outside > rows {
            let share = 100.0 * outside as f64 / rows as f64;
            text += &format!(
                "; {share:.0} % of the rows are out of the calibrated range of readings: was the sensor zeroed since then?"
            );
        }
        text
    }

    fn fails(&self) -> bool {
        self.interval[0] > self.most
    }

    /// Reason why the test says nothing: the error is too large, but the test is too small to be certain.
    pub fn doubt(&self) -> Option<String> {
        let pose = if self.groups == 1 { "pose is" } else { "poses are" };
        (self.ratio > self.most && !self.fails()).then(|| {
            format!(
                "{} independent test {pose} too few to tell; {}",
                self.groups,
                self.words([0, 0])
            )
        })
    }
}
