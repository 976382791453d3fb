//! How a calibration errs on each group of rows, and how two differ.
//!
//! Groups that are hard for one calibration are mostly hard for the other, so the difference is known better than either
//! error. With D the mean over the groups of the difference of squared errors, weighted by rows, and s its standard error
//! ([`FoldMean`]), the errors differ by `RMS₁ − RMS₂ = D/(RMS₁ + RMS₂)`, 95 % of the time within t·s of it, with
//! Student's t of G − 1 degrees of freedom.

use std::collections::HashMap;

use crate::conversion::Calibration;
use crate::error::FitError;
use crate::exact::HeldOutErrors;
use crate::groups::{GroupBy, HeldOut, label_groups};
use crate::passes::{Workers, each};
use crate::physics::COVERAGE_LEVEL;
use crate::quality::{self, AxisErrors};
use crate::uncertainty::student_quantile;
use crate::validation::comparison::FoldMean;
use shell_data::dataset::{Dataset, LabelledBlock};
use shell_data::wrench::PerAxis;

/// The groups of some rows, and a sample of their loads.
#[derive(Clone, Debug, Default)]
pub struct GroupedErrors {
    /// In the order in which they are met.
    pub groups: Vec<GroupErrors>,
    /// Wrenches that were measured, evenly from all rows, N and N·m.
    pub loads: Vec<PerAxis<f64>>,
}

/// The errors of a calibration on one group.
#[derive(Clone, Debug)]
pub struct GroupErrors {
    /// The label of a column, a file, a plateau.
    pub label: String,
    /// Its rows.
    pub rows: u64,
    /// The mean wrench that was measured, N and N·m.
    pub load: PerAxis<f64>,
    /// Predicted less measured.
    pub errors: PerAxis<AxisErrors>,
}

/// The errors on each group of labelled rows. Of the loads about `sample` are kept.
///
/// # Errors
/// [`FitError::Interrupted`].
pub fn group_errors(
    calibration: &Calibration,
    data: &Dataset,
    sample: u64,
    workers: Workers<'_>,
) -> Result<GroupedErrors, FitError> {
    let stride = (data.rows() / sample.max(1)).max(1) as usize;
    // Of one block, with sums of loads in place of means.
    let work = |(): &mut (), (_, block): &(usize, &LabelledBlock)| {
        let (mut groups, mut predicted, mut start) = (Vec::new(), PerAxis::default(), 0);
        let (rows, wrench) = (block.rows.rows, &block.rows.wrench);
        calibration.wrench(&block.rows.readings, &mut predicted);
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
    /// Rows.
    pub rows: u64,
    /// What the groups are.
    pub group_by: GroupBy,
    /// Groups.
    pub groups: usize,
    /// For each axis.
    pub axes: PerAxis<PairedError>,
}

/// The errors of two calibrations on one axis, N or N·m.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PairedError {
    /// Root mean squares.
    pub rms: [f64; 2],
    /// The first less the second.
    pub difference: f64,
    /// Half the width of the 95 % interval of the difference.
    pub half_width: f64,
}

/// Which of two calibrations errs less.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Better {
    /// The first.
    First,
    /// The second.
    Second,
    /// The interval of the difference contains zero.
    Neither,
}

impl PairedError {
    /// The 95 % interval of the difference.
    pub fn interval(&self) -> [f64; 2] {
        [self.difference - self.half_width, self.difference + self.half_width]
    }

    /// Which calibration errs less.
    pub fn better(&self) -> Better {
        match self.difference {
            difference if difference < -self.half_width => Better::First,
            difference if difference > self.half_width => Better::Second,
            _ => Better::Neither,
        }
    }
}

/// The errors of two calibrations on the rows of `data`, by its groups: of a column, files, those that are found, or
/// stretches of time.
///
/// # Errors
/// [`FitError`] if there are fewer than two groups, or whoever watches wants no more.
pub fn paired_errors(
    calibrations: [&Calibration; 2],
    data: &Dataset,
    workers: Workers<'_>,
) -> Result<PairedErrors, FitError> {
    let (group_by, data) = label_groups(data, HeldOut::Auto).ok_or(FitError::NoRows)?;
    let squares = |group: &GroupErrors| group.errors.each_ref().map(squares_of);
    let of = |calibration| -> Result<Vec<PerAxis<HeldOutErrors>>, FitError> {
        Ok(group_errors(calibration, &data, 0, workers)?.groups.iter().map(squares).collect())
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
        PairedError { rms, difference: rms[0] - rms[1], half_width }
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
    use crate::model::{Basis, Model};
    use crate::scaling::Scaling;
    use shell_data::wrench::Axes;
    use system_tests::random::Random;

    /// A calibration of one channel that reads the load, and is off by so much.
    fn off_by(offset: f64) -> Calibration {
        let model = Model { basis: Basis::Linear, intercept: true, channels: 1, memory: 0 };
        let scaling = Scaling { centre: vec![0.0], scale: vec![1.0] };
        Calibration::new(model, scaling, vec![[1.0; 6], [offset; 6]])
    }

    /// Twenty poses of thirty rows, each pose off by an error of its own.
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
        // Squares: the mean of (e + 1.5)² − e² over the poses.
        let difference =
            (found.rms[0].powi(2) - found.rms[1].powi(2)) / (found.rms[0] + found.rms[1]);
        assert!((found.difference - difference).abs() < 1e-12);
        // Six hundred rows would tell 0.02 from zero, twenty poses do not.
        let chance = compare(&off_by(0.02));
        assert_eq!(chance.better(), Better::Neither);
        assert!(chance.half_width > chance.difference.abs());
        let swapped = paired_errors([&off_by(1.5), &right], &data, Workers::ONE).unwrap().axes[2];
        assert_eq!(swapped.better(), Better::Second);
        assert_eq!(swapped.difference, -found.difference);
    }
}
