//! The model after the loads so far, and its error on new poses.

use std::collections::BTreeMap;

use calibration::FitError;
use calibration::fit::Workers;
use calibration::physics::{Observation, PhysicsCalibration, PhysicsValidation, TrainingRows};
use calibration::uncertainty::HALF_WIDTH;
use load_table::HungLoad;
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, PerAxis};

use crate::workflow::hung_loads::{LoadCorrection, judged};

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
    /// Squared error on each load while it was held out, relative to the loads of each axis and added over the axes.
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
        let wrenches = || corrected.loads.iter().map(|load| load.wrench);
        let block = Block {
            rows: loads.len(),
            readings: columns(readings.iter().copied()),
            wrench: columns(wrenches().map(|wrench| wrench.to_vec())),
            groups: (0..loads.len()).map(|group| (group.to_string(), 1)).collect(),
            ..Block::default()
        };
        let data = Dataset::from_blocks("sitting", Axes::ALL, vec![block]);
        let (mut rows, _) = TrainingRows::from_dataset(&data);
        rows.judged_by = (0..)
            .zip(loads.iter().zip(&corrected.loads))
            .map(|(group, (load, found))| (group, judged(load, found)))
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
            squares[group as usize] = (0..6)
                .map(|axis| {
                    let scale = calibration.model().wrench_scale[axis];
                    errors.errors[axis].squares / errors.errors[axis].rows as f64 / scale.powi(2)
                })
                .sum();
        }
        let suspicious = corrected.loads.iter().map(|load| load.suspicious.is_some()).collect();
        Ok(Self { calibration, error, upper, squares, suspicious })
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
