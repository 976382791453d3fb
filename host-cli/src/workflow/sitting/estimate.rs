//! The model after the loads so far, and its error on new poses.

use std::collections::BTreeMap;
use std::fmt;

use calibration::FitError;
use calibration::fit::Workers;
use calibration::physics::{Observation, PhysicsCalibration, PhysicsValidation, TrainingRows};
use calibration::quality::significant;
use calibration::uncertainty::HALF_WIDTH;
use load_table::HungLoad;
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, Axis, PerAxis};

use crate::workflow::hung_loads::{LoadCorrection, first_alike, judged};

/// A load contradicts the others if it multiplies the squared error on them by more than this; a good load at the
/// edge of the range hardly changes that error.
const WORSE: f64 = 1.5;

#[derive(Clone, Debug)]
pub struct Estimate {
    pub calibration: PhysicsCalibration,
    /// Root mean square error on held-out loads, N and N·m.
    pub error: PerAxis<f64>,
    /// Upper end of the 95 % interval of that error, N and N·m.
    pub upper: PerAxis<f64>,
    /// Squared error on each load while it was held out, relative to the loads of each axis and added over the axes; 0
    /// for a load that is there already.
    squares: Vec<f64>,
    /// True for each load that the readings at all loads contradict.
    suspicious: Vec<bool>,
}

impl Estimate {
    /// Fits the model to loads and their mean readings. Errors are against the loads as stated, except for loads that
    /// the readings contradict. Fails with [`FitError`] if the loads do not determine a model.
    pub fn new(
        loads: &[HungLoad],
        readings: &[&[f64]],
        workers: Workers<'_>,
    ) -> Result<Self, FitError> {
        let observed: Vec<Observation> = (0..)
            .zip(loads)
            .zip(readings)
            .map(|((group, load), readings)| Observation {
                group,
                wrench: load.wrench(),
                readings: readings.to_vec(),
            })
            .collect();
        let LoadCorrection { corrected, .. } = LoadCorrection::new(loads, &observed)?;
        let alike = first_alike(loads, &corrected);
        let wrenches = || corrected.loads.iter().map(|load| load.wrench);
        let block = Block {
            rows: loads.len(),
            readings: columns(readings.iter().copied()),
            wrench: columns(wrenches().map(|wrench| wrench.to_vec())),
            groups: alike.iter().map(|first| (first.to_string(), 1)).collect(),
            ..Block::default()
        };
        let data = Dataset::from_blocks("sitting", Axes::ALL, vec![block]);
        let (mut rows, labels) = TrainingRows::from_dataset(&data);
        let firsts: Vec<usize> = labels.iter().filter_map(|label| label.parse().ok()).collect();
        rows.judged_by = (0..)
            .zip(&firsts)
            .map(|(group, &at)| (group, judged(&loads[at], &corrected.loads[at])))
            .collect::<BTreeMap<_, _>>();
        let (calibration, choice) = PhysicsCalibration::fit(&rows, workers)?;
        let validation = PhysicsValidation::new(&rows, &choice.folds(), &choice, workers)?;
        let (mut error, mut upper) = (PerAxis::default(), PerAxis::default());
        for axis in 0..6 {
            let squares: Vec<f64> = validation
                .groups()
                .map(|group| group.errors[axis].squares / group.errors[axis].rows as f64)
                .collect();
            (error[axis], upper[axis]) = root_mean(&squares);
        }
        // The folds need not list the groups in order.
        let mut squares = vec![0.0; loads.len()];
        let groups = choice.folds().into_iter().flatten();
        for (group, errors) in groups.zip(validation.groups()) {
            squares[firsts[group as usize]] = (0..6)
                .map(|axis| {
                    let scale = calibration.model().wrench_scale[axis];
                    errors.errors[axis].squares / errors.errors[axis].rows as f64 / scale.powi(2)
                })
                .sum();
        }
        let suspicious = corrected.loads.iter().map(|load| load.suspicious.is_some()).collect();
        Ok(Self { calibration, error, upper, squares, suspicious })
    }

    /// Finds the load without which the errors on all others are less than half. Tries those that the others predict
    /// worst. This estimate was made from `loads` and `readings`.
    pub fn wrong_load(
        &self,
        loads: &[HungLoad],
        readings: &[&[f64]],
        workers: Workers<'_>,
    ) -> Option<WrongLoad> {
        const TRIED: usize = 3;
        const BETTER: f64 = 0.25;
        let mut worst: Vec<usize> = (0..loads.len()).collect();
        worst.sort_by(|a, b| self.squares[*b].total_cmp(&self.squares[*a]));
        let of_rest = |at: usize| self.squares.iter().sum::<f64>() - self.squares[at];
        let without = |at: usize| {
            let (mut loads, mut readings) = (loads.to_vec(), readings.to_vec());
            loads.remove(at);
            readings.remove(at);
            let rest = Self::new(&loads, &readings, workers).ok()?;
            Some((rest.squares.iter().sum::<f64>() / of_rest(at), at, rest))
        };
        let tried = worst.into_iter().take(TRIED).filter_map(without);
        let (ratio, at, rest) = tried.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let gain = |axis: &Axis| self.error[axis.index()] / rest.error[axis.index()];
        let axis = Axis::ALL.into_iter().max_by(|a, b| gain(a).total_cmp(&gain(b)))?;
        let errors = [self.error, rest.error].map(|error| error[axis.index()]);
        (ratio < BETTER).then(|| WrongLoad { load: loads[at].clone(), axis, errors })
    }

    /// Returns true if the newest load contradicts the others: it is suspicious, or the squared error on the
    /// others exceeds [`WORSE`] times that of `before`, the estimate without it.
    pub(super) fn contradicts(&self, before: &Self) -> bool {
        let others = before.squares.len();
        let sum = |squares: &[f64]| squares.iter().sum::<f64>();
        self.suspicious.get(others).copied().unwrap_or(false)
            || sum(&self.squares[..others]) > WORSE * sum(&before.squares)
    }

    /// The wrench predicted from readings, N and N·m, with its standard errors.
    pub(super) fn wrench(&self, readings: &[f64]) -> (PerAxis<f64>, PerAxis<f64>) {
        let estimate = self.calibration.estimates(&columns([readings].into_iter())).row(0);
        (estimate.wrench, estimate.standard_errors)
    }
}

/// A load without which the errors on the others are far smaller.
#[derive(Clone, Debug)]
pub struct WrongLoad {
    pub load: HungLoad,
    /// The axis whose error falls most, with its errors before and after.
    pub axis: Axis,
    pub errors: [f64; 2],
}

impl fmt::Display for WrongLoad {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([with, without], axis) = (self.errors.map(|error| significant(error, 2)), self.axis);
        write!(
            f,
            "load `{}` ({}) is probably wrong: without it the error in {} falls from {with} to {without} {}",
            self.load.group,
            self.load,
            axis.name(),
            axis.unit()
        )
    }
}

fn columns(rows: impl Iterator<Item = impl AsRef<[f64]>>) -> Vec<Vec<f64>> {
    let mut columns = Vec::new();
    for row in rows {
        columns.resize_with(row.as_ref().len(), Vec::new);
        columns.iter_mut().zip(row.as_ref()).for_each(|(column, value)| column.push(*value));
    }
    columns
}

/// Root mean square from the squares, and the upper end of its 95 % interval: the root of the mean plus 1.96
/// standard errors of the mean.
fn root_mean(squares: &[f64]) -> (f64, f64) {
    let count = squares.len() as f64;
    let mean = squares.iter().sum::<f64>() / count;
    let deviations: f64 = squares.iter().map(|square| (square - mean).powi(2)).sum();
    let standard_error = (deviations / (count * (count - 1.0).max(1.0))).sqrt();
    (mean.sqrt(), (mean + HALF_WIDTH * standard_error).sqrt())
}
