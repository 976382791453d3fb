//! Examination of a fit: errors on the test against the promised errors, the cure if they are
//! larger, and contradictions among the training rows.

use super::cures::{Cure, WrenchProducts, delay};
use super::evaluation::{GroupErrors, group_errors};
use super::parts::{ROWS, predicted, spread};
use super::{Fit, contradictions};
use crate::conversion::Calibration;
use crate::groups::{GroupBy, HeldOut, label_groups};
use least_squares::error::FitError;
use least_squares::passes::Workers;
use least_squares::quality::significant;
use least_squares::uncertainty::student_quantile;
use sensor_physics::COVERAGE_LEVEL;
use shell_data::block::Block;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// A test fails if its error is certainly larger than this many times the promised error. The
/// second limit applies if only the training error is known, not the error on held-out rows.
const MOST: f64 = 2.0;
const MOST_OF_TRAINING: f64 = 3.0;

/// Errors below this share of the calibrated range never fail a test.
const NO_ERROR: f64 = 1e-3;

/// Maximum number of rows on which each exchange of two channels is tried.
const ROWS_OF_EXCHANGE: usize = 300;

/// The subject of a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultPlace {
    /// The test.
    Test,
    /// The training rows.
    Data,
}

/// A reason not to use a calibration, or not before something has been done.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Fault {
    /// Its subject.
    pub place: FaultPlace,
    /// The description, with the cure if one is known.
    pub text: String,
}

/// The error on the test divided by the promised error, on the axis where it is most certainly too large.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TestRatio {
    /// The axis.
    pub axis: Axis,
    /// The error divided by the promised error.
    pub ratio: f64,
    /// The 95 % interval of the ratio, from the scatter between groups of test rows; zero to
    /// infinity for a single group.
    pub interval: [f64; 2],
}

/// The results of an examination.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Examination {
    /// The result of the test, if there is a test and an axis varies.
    pub test: Option<TestRatio>,
    /// Faults, the most important first.
    pub faults: Vec<Fault>,
}

impl Fault {
    /// Creates a fault of the test.
    pub fn of_test(text: impl Into<String>) -> Self {
        Self { place: FaultPlace::Test, text: text.into() }
    }

    /// Creates a fault of the training rows.
    pub fn of_data(text: impl Into<String>) -> Self {
        Self { place: FaultPlace::Data, text: text.into() }
    }
}

impl Fit {
    /// Examines the test and the training rows. This takes a small part of the time of the fit.
    ///
    /// # Errors
    /// [`FitError::Interrupted`].
    pub fn examine(&mut self, workers: Workers<'_>) -> Result<(), FitError> {
        workers.start("examination");
        let (limit, test) = self.test_ratio(workers)?;
        let mut faults = Vec::new();
        let fails = test.is_some_and(|of| of.fails(self.promise().1));
        if let Some(of) = test.filter(|_| fails) {
            faults.push(Fault::of_test(self.test_fault(&of, &limit)));
        }
        faults.extend(contradictions::find(self, workers)?.into_iter().map(Fault::of_data));
        self.examination = Some(Examination { test, faults });
        Ok(())
    }

    /// The errors promised on new rows, and the factor by which errors on a test may exceed them.
    pub(super) fn promise(&self) -> (PerAxis<f64>, f64) {
        match &self.cross_validation {
            Some(found) => {
                let files = self.group_by.filter(|by| *by == GroupBy::File);
                let spread = files.and_then(|_| found.spread()).unwrap_or([1.0; 6]);
                (std::array::from_fn(|axis| spread[axis] * found.grouped[axis].rms), MOST)
            }
            None => (self.train.map(|of| of.rms), MOST_OF_TRAINING),
        }
    }

    /// The largest errors with which a test passes, and the ratio on the axis that most certainly
    /// exceeds its promise.
    fn test_ratio(
        &self,
        workers: Workers<'_>,
    ) -> Result<(PerAxis<f64>, Option<TestRatio>), FitError> {
        let (promise, most) = self.promise();
        let range = |axis: usize| {
            self.excitation.as_ref().map_or(0.0, |of| of.axes[axis].max - of.axes[axis].min)
        };
        let least: PerAxis<f64> =
            std::array::from_fn(|axis| promise[axis].max(NO_ERROR * range(axis)));
        let limit = least.map(|of| most * of);
        let Some((_, labelled)) = label_groups(&self.tested, HeldOut::Auto) else {
            return Ok((limit, None));
        };
        let groups = group_errors(&self.calibration, &labelled, 0, workers)?.groups;
        let ratios = self.calibration.axes.iter().filter(|axis| least[axis.index()] > 0.0);
        let ratios = ratios.filter_map(|axis| TestRatio::new(axis, &groups, least[axis.index()]));
        Ok((limit, ratios.max_by(|a, b| a.interval[0].total_cmp(&b.interval[0]))))
    }

    fn test_fault(&self, of: &TestRatio, limit: &PerAxis<f64>) -> String {
        if let Some(cure) = self.cure_of_test(limit) {
            return cure;
        }
        let [low, high] = of.interval.map(|bound| significant(bound, 2));
        let mut text = format!(
            "{} errs by {} times what was promised (95 %: {low} to {high})",
            of.axis.name(),
            significant(of.ratio, 2)
        );
        let test = self.test();
        if 2 * test.out_of_range_rows > test.rows {
            let share = 100.0 * test.out_of_range_rows as f64 / test.rows as f64;
            text += &format!(
                "; {share:.0} % of its rows are out of the calibrated range of readings: was the sensor zeroed anew?"
            );
        }
        text
    }

    /// The change that cures the whole test, one of its files, or half of a file.
    fn cure_of_test(&self, limit: &PerAxis<f64>) -> Option<String> {
        let (calibration, axes) = (&self.calibration, self.calibration.axes);
        let search = |rows: &Block| cure(calibration, rows, limit, axes);
        let logs: Vec<Vec<&Block>> = self
            .tested
            .logs
            .iter()
            .map(|log| log.blocks.iter().map(|block| &*block.rows).collect())
            .collect();
        let all: Vec<&Block> = logs.iter().flatten().copied().collect();
        if let Some(found) = search(&spread(&all, 0.0..1.0)) {
            return Some(found.to_string());
        }
        for (log, blocks) in self.tested.logs.iter().zip(&logs) {
            let name = log.name.display();
            if let Some(found) = search(&spread(blocks, 0.0..1.0)).filter(|_| logs.len() > 1) {
                return Some(format!("in `{name}` {found}"));
            }
            if let Some(found) = late(calibration, blocks, limit, axes) {
                return Some(found.to_string());
            }
            for (half, part) in [("first", 0.0..0.5), ("second", 0.5..1.0)] {
                if let Some(found) = search(&spread(blocks, part)) {
                    return Some(format!("in the {half} half of `{name}` {found}"));
                }
            }
        }
        None
    }
}

impl TestRatio {
    fn new(axis: Axis, groups: &[GroupErrors], promise: f64) -> Option<Self> {
        let at = axis.index();
        let of = |group: &GroupErrors| {
            let rms = group.errors[at].quality()?.rms;
            Some((group.rows as f64, rms * rms))
        };
        let squares: Vec<(f64, f64)> = groups.iter().filter_map(of).collect();
        let rows: f64 = squares.iter().map(|(rows, _)| rows).sum();
        let mean = squares.iter().map(|(rows, square)| rows * square).sum::<f64>() / rows;
        let ratio = mean.sqrt() / promise;
        let logs: Vec<f64> =
            squares.iter().filter(|(_, of)| *of > 0.0).map(|(_, of)| of.ln()).collect();
        let n = logs.len() as f64;
        let half = match logs.len() {
            0 | 1 => f64::INFINITY,
            _ => {
                let centre = logs.iter().sum::<f64>() / n;
                let variance = logs.iter().map(|of| (of - centre).powi(2)).sum::<f64>() / (n - 1.0);
                // Halved, because the logarithm of a root is half that of the square.
                0.5 * student_quantile(COVERAGE_LEVEL, n - 1.0) * (variance / n).sqrt()
            }
        };
        let interval = [ratio * (-half).exp(), ratio * half.exp()];
        ratio.is_finite().then_some(Self { axis, ratio, interval })
    }

    /// Returns true if the error is certainly larger than `most` times the promised error. A single
    /// group has an infinite interval: its limit is `most` squared.
    fn fails(&self, most: f64) -> bool {
        match self.interval[1].is_finite() {
            true => self.interval[0] > most,
            false => self.ratio > most * most,
        }
    }
}

/// The change of the reference, or the exchange of two channels, that cures the rows.
fn cure(calibration: &Calibration, rows: &Block, limit: &PerAxis<f64>, axes: Axes) -> Option<Cure> {
    if rows.rows == 0 {
        return None;
    }
    let products = WrenchProducts::new(&predicted(calibration, rows), &rows.wrench);
    let found = products.cure(limit, axes);
    found.or_else(|| exchanged_channels(calibration, rows, limit, axes))
}

fn exchanged_channels(
    calibration: &Calibration,
    rows: &Block,
    limit: &PerAxis<f64>,
    axes: Axes,
) -> Option<Cure> {
    let channels = calibration.channels();
    let few = {
        let every = rows.rows.div_ceil(ROWS_OF_EXCHANGE).max(1);
        let mut few = Block::default();
        (0..rows.rows).step_by(every).for_each(|row| few.append(rows, row..row + 1));
        few
    };
    let products = |readings: &[Vec<f64>]| {
        let mut predicted = PerAxis::default();
        calibration.wrench(readings, &mut predicted);
        WrenchProducts::new(&predicted, &few.wrench)
    };
    let now = products(&few.readings);
    let (before, loads) = (now.plain(), now.loads());
    let mut best: Option<Cure> = None;
    for (a, b) in (0..channels).flat_map(|a| (a + 1..channels).map(move |b| (a, b))) {
        let mut readings = few.readings.clone();
        // The memory terms of both channels are exchanged, too.
        for first in (0..readings.len()).step_by(channels) {
            readings.swap(first + a, first + b);
        }
        let change = format!("exchanging the readings s{} and s{}", a + 1, b + 1);
        let after = products(&readings).plain();
        let found = Cure::if_cured(change, axes, limit, &loads, [&before, &after]);
        let gain = |of: &Cure| of.rms[0] / of.rms[1];
        if let Some(found) = found
            && best.as_ref().is_none_or(|best| gain(&found) > gain(best))
        {
            best = Some(found);
        }
    }
    best
}

/// The delay that cures the rows of one log.
fn late(
    calibration: &Calibration,
    blocks: &[&Block],
    limit: &PerAxis<f64>,
    axes: Axes,
) -> Option<Cure> {
    let mut rows = Block::default();
    for block in blocks {
        let some = block.rows.min(ROWS - rows.rows);
        rows.append(block, 0..some);
    }
    delay(&predicted(calibration, &rows), &rows.wrench, limit, axes).map(|(_, cure)| cure)
}
