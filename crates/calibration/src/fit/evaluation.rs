//! Errors of a calibration by log and by group, and the difference between two calibrations.
//!
//! Groups that are hard for one calibration are mostly hard for the other, so the difference is known better than
//! either error. With D the row-weighted mean over the groups of the difference of squared errors and s its standard
//! error ([`FoldMean`]), `RMS₁ − RMS₂ = D/(RMS₁ + RMS₂)`, with a 95 % interval of half width `t·s/(RMS₁ + RMS₂)` and
//! Student's t for G − 1 degrees of freedom.

use std::collections::HashMap;

use crate::conversion::Calibration;
use crate::groups::{GroupBy, HeldOut, label_groups};
use crate::validation::excitation::WrenchSums;
use crate::validation::leaks::{LEAKY, RowSample};
use crate::validation::outliers::{self, RowTest, TestedRow};
use least_squares::error::FitError;
use least_squares::held_out_errors::HeldOutErrors;
use least_squares::magnitudes::Magnitudes;
use least_squares::passes::{Workers, each};
use least_squares::quality::{self, AxisErrors, AxisQuality};
use least_squares::uncertainty::student_quantile;
use least_squares::validation::comparison::FoldMean;
use sensor_physics::COVERAGE_LEVEL;
use shell_data::dataset::{Dataset, LabelledBlock};
use shell_data::fingerprint::Fingerprint;
use shell_data::wrench::PerAxis;

#[derive(Clone, Debug, Default)]
pub struct Evaluation {
    pub rows: u64,
    pub skipped_rows: u64,
    pub repeated_rows: u64,
    pub out_of_range_rows: u64,
    /// Predicted minus measured, per axis.
    pub errors: PerAxis<AxisErrors>,
}

impl Evaluation {
    pub fn total(evaluations: &[Self]) -> Self {
        let mut total = Self::default();
        evaluations.iter().for_each(|evaluation| total.merge(evaluation));
        total
    }

    pub fn merge(&mut self, other: &Self) {
        self.rows += other.rows;
        self.skipped_rows += other.skipped_rows;
        self.repeated_rows += other.repeated_rows;
        self.out_of_range_rows += other.out_of_range_rows;
        quality::merge(&mut self.errors, &other.errors);
    }

    pub fn is_out_of_range(&self) -> bool {
        self.rows > 0 && self.out_of_range_rows == self.rows
    }

    /// Returns true if the largest error of an axis is far above its root mean square.
    pub fn has_large_errors(&self) -> bool {
        let is_large =
            |axis: &AxisQuality| axis.max.is_some_and(|max| max > outliers::LIMIT * axis.rms);
        self.quality().is_some_and(|axes| axes.iter().any(is_large))
    }

    pub fn quality(&self) -> Option<PerAxis<AxisQuality>> {
        let [fx, fy, fz, mx, my, mz] = self.errors.map(|errors| errors.quality());
        Some([fx?, fy?, fz?, mx?, my?, mz?])
    }
}

/// Computes the errors of a calibration on each log of a data set.
///
/// # Errors
/// [`FitError::Interrupted`].
pub fn evaluate(
    calibration: &Calibration,
    data: &Dataset,
    workers: Workers<'_>,
) -> Result<Vec<Evaluation>, FitError> {
    Ok(RowErrors::new(calibration, data, EvalOptions::default(), workers)?.logs)
}

#[derive(Clone, Copy, Default)]
struct EvalOptions<'a> {
    size_unit: Option<&'a PerAxis<f64>>,
    row_test: Option<&'a RowTest<'a>>,
    compares: bool,
    sums_loads: bool,
}

#[derive(Default)]
pub(super) struct RowErrors {
    pub(super) logs: Vec<Evaluation>,
    pub(super) sizes: Option<PerAxis<Magnitudes>>,
    pub(super) tested: Vec<Vec<TestedRow>>,
    pub(super) loads: WrenchSums,
    pub(super) fingerprints: Vec<Fingerprint>,
    pub(super) sample: RowSample,
}

impl RowErrors {
    fn new(
        calibration: &Calibration,
        data: &Dataset,
        look: EvalOptions<'_>,
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let mut all =
            Self { fingerprints: vec![Fingerprint::default(); data.logs.len()], ..Self::default() };
        all.logs.extend(data.logs.iter().map(|log| Evaluation {
            skipped_rows: log.summary.skipped_rows,
            repeated_rows: log.summary.repeated_rows,
            ..Evaluation::default()
        }));
        let stride = RowSample::stride(data.rows());
        type State = (PerAxis<Vec<f64>>, Option<PerAxis<Magnitudes>>);
        let work = |(predicted, sizes): &mut State, &(log, block): &(usize, &LabelledBlock)| {
            let rows = &*block.rows;
            calibration.wrench(&rows.readings, predicted);
            if let Some(units) = look.size_unit {
                for (axis, sizes) in sizes.get_or_insert_default().iter_mut().enumerate() {
                    sizes.add_differences(&predicted[axis], &rows.wrench[axis], units[axis]);
                }
            }
            let test =
                |test: &RowTest<'_>| test.test(rows, &test.suspects(rows, predicted), &|_| false);
            let tested = look.row_test.map(test).unwrap_or_default();
            let errors = Evaluation {
                rows: rows.rows as u64,
                out_of_range_rows: calibration.rows_out_of_range(&rows.readings),
                errors: quality::errors(predicted, &rows.wrench),
                ..Evaluation::default()
            };
            let compared =
                look.compares.then(|| (Fingerprint::new(rows), RowSample::new(rows, stride)));
            let loads = look.sums_loads.then(|| WrenchSums::new(&rows.wrench));
            Ok((log, errors, tested, compared, loads))
        };
        let fold = |(log, errors, tested, compared, loads): (usize, _, _, Option<_>, Option<_>)| {
            all.logs[log].merge(&errors);
            all.tested.push(tested);
            if let Some((fingerprint, sample)) = compared {
                all.fingerprints[log].merge(fingerprint);
                all.sample.add(sample);
            }
            loads.iter().for_each(|loads| all.loads.merge(loads));
            Ok(())
        };
        let blocks: Vec<_> = data.blocks().collect();
        let init = State::default;
        let states = each(&blocks, |(_, block)| &block.rows, workers, init, work, fold)?;
        let sizes = states.into_iter().filter_map(|(_, sizes)| sizes);
        all.sizes = sizes.reduce(|mut all, part| {
            all.iter_mut().zip(&part).for_each(|(all, part)| all.merge(part));
            all
        });
        Ok(all)
    }

    /// Computes the errors. On training rows, also counts error sizes in `size_unit`, and tests the rows by `row_test`.
    pub(super) fn of_fit(
        calibration: &Calibration,
        [train, test]: [&Dataset; 2],
        (size_unit, row_test): (Option<&PerAxis<f64>>, Option<&RowTest<'_>>),
        workers: Workers<'_>,
    ) -> Result<[Self; 2], FitError> {
        // A single log cannot be a copy of another.
        let compares = train.logs.len() + test.logs.len() > 1;
        // Training rows are always within the range, because they define it.
        let mut without_range = calibration.clone();
        without_range.valid_range = None;
        let look = EvalOptions { size_unit, row_test, compares, sums_loads: true };
        let of_test = EvalOptions { compares, ..EvalOptions::default() };
        Ok([
            Self::new(&without_range, train, look, workers)?,
            Self::new(calibration, test, of_test, workers)?,
        ])
    }
}

/// Shares of rows whose pose is on both sides of a split, if the rows were recorded in poses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Leaks {
    /// Share of test rows at poses of the training rows.
    pub test: Option<f64>,
    /// Share of training rows whose pose also has rows in other groups.
    pub groups: Option<f64>,
}

impl Leaks {
    /// The share of leaking test rows, if it is so large that errors on the test say nothing about new poses.
    pub fn in_test(&self) -> Option<f64> {
        self.test.filter(|&share| share >= LEAKY)
    }

    /// The share of leaking training rows, if errors on held-out groups then say nothing about new poses.
    pub fn in_groups(&self) -> Option<f64> {
        self.groups.filter(|&share| share >= LEAKY)
    }
}

/// Errors by group, and a sample of the loads.
#[derive(Clone, Debug, Default)]
pub struct GroupedErrors {
    /// In the order of their first rows.
    pub groups: Vec<GroupErrors>,
    /// Measured wrenches, sampled evenly from all rows, N and N·m.
    pub loads: Vec<PerAxis<f64>>,
}

#[derive(Clone, Debug)]
pub struct GroupErrors {
    pub label: String,
    pub rows: u64,
    /// Mean measured wrench, N and N·m.
    pub load: PerAxis<f64>,
    /// Predicted minus measured.
    pub errors: PerAxis<AxisErrors>,
}

/// Computes the errors on each group of labelled rows, and keeps the loads of about `sample` rows.
///
/// # Errors
/// [`FitError::Interrupted`].
pub fn group_errors(
    calibration: &Calibration,
    data: &Dataset,
    sample: u64,
    workers: Workers<'_>,
) -> Result<GroupedErrors, FitError> {
    let convert = |block: &LabelledBlock, predicted: &mut _| {
        calibration.wrench(&block.rows.readings, predicted);
    };
    errors_by_group(convert, data, sample, workers)
}

pub(super) fn errors_by_group(
    convert: impl Fn(&LabelledBlock, &mut PerAxis<Vec<f64>>) + Sync,
    data: &Dataset,
    sample: u64,
    workers: Workers<'_>,
) -> Result<GroupedErrors, FitError> {
    let stride = (data.rows() / sample.max(1)).max(1) as usize;
    // The groups of one block, with sums of loads in place of means.
    let work = |(): &mut (), (_, block): &(usize, &LabelledBlock)| {
        let (mut groups, mut predicted, mut start) = (Vec::new(), PerAxis::default(), 0);
        let (rows, wrench) = (block.rows.rows, &block.rows.wrench);
        convert(block, &mut predicted);
        for (label, rows) in block.labels.iter().filter(|(_, rows)| *rows > 0) {
            let of_group = start..start + rows;
            start = of_group.end;
            let pairs: PerAxis<[&[f64]; 2]> = std::array::from_fn(|axis| {
                [&predicted[axis][of_group.clone()], &wrench[axis][of_group.clone()]]
            });
            groups.push(GroupErrors {
                label: label.clone(),
                rows: *rows as u64,
                load: pairs.map(|[_, loads]| loads.iter().fold(0.0, |sum, load| sum + load)),
                errors: pairs.map(|[predicted, loads]| AxisErrors::new(predicted, loads)),
            });
        }
        let load = |row: usize| std::array::from_fn(|axis| wrench[axis][row]);
        Ok(GroupedErrors { groups, loads: (0..rows).step_by(stride).map(load).collect() })
    };
    let mut positions: HashMap<String, usize> = HashMap::new();
    let mut all = GroupedErrors::default();
    let fold = |of_block: GroupedErrors| {
        all.loads.extend(of_block.loads);
        for group in of_block.groups {
            let at = *positions.entry(group.label.clone()).or_insert(all.groups.len());
            let Some(known) = all.groups.get_mut(at) else {
                all.groups.push(group);
                continue;
            };
            known.rows += group.rows;
            known.load.iter_mut().zip(group.load).for_each(|(load, sum)| *load += sum);
            quality::merge(&mut known.errors, &group.errors);
        }
        Ok(())
    };
    let blocks: Vec<_> = data.blocks().collect();
    each(&blocks, |(_, block)| &block.rows, workers, || (), work, fold)?;
    for group in &mut all.groups {
        group.load.iter_mut().for_each(|load| *load /= group.rows as f64);
    }
    Ok(all)
}

/// The errors of two calibrations on the same rows.
#[derive(Clone, Debug, PartialEq)]
pub struct PairedErrors {
    pub rows: u64,
    pub group_by: GroupBy,
    pub groups: usize,
    pub axes: PerAxis<PairedError>,
}

/// A difference below this share of the sum of both errors is rounding.
const ROUNDING: f64 = 1e-9;

/// The errors of two calibrations on one axis, N or N·m.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PairedError {
    pub rms: [f64; 2],
    /// The first minus the second.
    pub difference: f64,
    /// Half the width of the 95 % interval of the difference.
    pub half_width: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Better {
    First,
    Second,
    /// The interval of the difference contains zero.
    Neither,
}

impl PairedError {
    pub fn interval(&self) -> [f64; 2] {
        [self.difference - self.half_width, self.difference + self.half_width]
    }

    /// The calibration with the smaller errors, if the interval excludes zero.
    pub fn better(&self) -> Better {
        match self.difference {
            difference if difference < -self.half_width => Better::First,
            difference if difference > self.half_width => Better::Second,
            _ => Better::Neither,
        }
    }
}

/// Compares the errors of two calibrations on the rows of `data`, with the lag and memory of each corrected.
/// Groups come from a column, are files or found poses, or are blocks of time.
///
/// # Errors
/// [`FitError`] if there are fewer than two groups, or the watcher of the workers stops the pass.
pub fn paired_errors(
    calibrations: [&Calibration; 2],
    data: &Dataset,
    workers: Workers<'_>,
) -> Result<PairedErrors, FitError> {
    let (group_by, data) = label_groups(data, HeldOut::Auto).ok_or(FitError::NoRows)?;
    let squares = |group: &GroupErrors| group.errors.each_ref().map(squares_of);
    let of = |calibration: &Calibration| -> Result<Vec<PerAxis<HeldOutErrors>>, FitError> {
        let rows = calibration.prepared(&data)?;
        Ok(group_errors(calibration, &rows, 0, workers)?.groups.iter().map(squares).collect())
    };
    let [first, second] = [of(calibrations[0])?, of(calibrations[1])?];
    let groups = first.len();
    if groups < 2 {
        return Err(FitError::TooFewGroups { found: groups });
    }
    let t = student_quantile(COVERAGE_LEVEL, (groups - 1) as f64);
    let total = [&first, &second].map(HeldOutErrors::total);
    let axes = std::array::from_fn(|axis| {
        let rms = total.map(|errors| errors[axis].rms());
        let difference = |(first, second): (&PerAxis<HeldOutErrors>, &PerAxis<HeldOutErrors>)| {
            let (first, second) = (first[axis], second[axis]);
            (first.rows, (first.squares - second.squares) / first.rows as f64)
        };
        let differences: Vec<_> = first.iter().zip(&second).map(difference).collect();
        let per_square = if rms[0] + rms[1] > 0.0 { (rms[0] + rms[1]).recip() } else { 0.0 };
        let half_width = t * FoldMean::new(&differences).standard_error * per_square;
        // A difference by rounding means nothing, however narrow the interval.
        let is_rounding = (rms[0] - rms[1]).abs() <= ROUNDING * (rms[0] + rms[1]);
        let difference = if is_rounding { 0.0 } else { rms[0] - rms[1] };
        PairedError { rms, difference, half_width }
    });
    Ok(PairedErrors { rows: data.rows(), group_by, groups, axes })
}

fn squares_of(errors: &AxisErrors) -> HeldOutErrors {
    let (rows, quality) = (errors.rows(), errors.quality().unwrap_or_default());
    let count = rows as f64;
    HeldOutErrors { rows, sum: quality.bias * count, squares: quality.rms.powi(2) * count }
}

#[cfg(test)]
mod tests {
    use shell_data::block::Block;

    use super::*;
    use least_squares::model::{Basis, Model};
    use least_squares::scaling::Scaling;
    use shell_data::wrench::Axes;
    use system_tests::random::Random;

    /// A calibration of one channel that reads the load, with a constant error of `offset`.
    fn off_by(offset: f64) -> Calibration {
        let model = Model { basis: Basis::Linear, intercept: true, channels: 1, memory: 0 };
        let scaling = Scaling { centre: vec![0.0], scale: vec![1.0] };
        Calibration::new(model, scaling, vec![[1.0; 6], [offset; 6]])
    }

    /// Twenty poses of thirty rows, where each pose has its own error.
    fn poses() -> Dataset {
        let (mut random, mut reading, mut load) = (Random(3), Vec::new(), Vec::new());
        for _ in 0..20 {
            let (at, error) = (10.0 * random.unit(), 0.5 * random.normal());
            for _ in 0..30 {
                reading.push(at);
                load.push(at + error + 0.01 * random.normal());
            }
        }
        let groups = (0..20).map(|pose| (pose.to_string(), 30)).collect();
        let wrench = vec![load; 6];
        let block =
            Block { rows: 600, readings: vec![reading], wrench, groups, ..Block::default() };
        Dataset::from_blocks("poses", Axes::ALL, vec![block])
    }

    #[test]
    fn a_difference_is_told_from_chance_by_poses_and_not_by_rows() {
        let (data, right) = (poses(), off_by(0.0));
        let compare = |other: &Calibration| {
            paired_errors([&right, other], &data, Workers::ONE).unwrap().axes[2]
        };
        let found = compare(&off_by(1.5));
        assert_eq!(found.better(), Better::First);
        // The difference of squares is the mean of (e + 1.5)² − e² over the poses.
        let difference =
            (found.rms[0].powi(2) - found.rms[1].powi(2)) / (found.rms[0] + found.rms[1]);
        assert!((found.difference - difference).abs() < 1e-12);
        // Six hundred independent rows would distinguish 0.02 from zero; twenty poses do not.
        let chance = compare(&off_by(0.02));
        assert_eq!(chance.better(), Better::Neither);
        assert!(chance.half_width > chance.difference.abs());
        // Both errors are equal except for the last bits.
        let rounded = compare(&off_by(1e-13));
        assert_ne!(rounded.rms[0], rounded.rms[1]);
        assert_eq!((rounded.better(), rounded.difference), (Better::Neither, 0.0));
        let swapped = paired_errors([&off_by(1.5), &right], &data, Workers::ONE).unwrap().axes[2];
        assert_eq!(swapped.better(), Better::Second);
        assert_eq!(swapped.difference, -found.difference);
    }
}
