//! One fit: from rows in memory to a calibration, and how far it can be trusted.
//!
//! ```text
//! Dataset ─▶ outliers left out ─▶ groups ─▶ model, by held-out groups ─▶ solution ─▶ errors, intervals, warnings
//! ```
//!
//! Logs and arrays enter as a [`Dataset`], [partial fits](fit_sums) as sums in place of rows. The
//! result is a [`Fit`], with everything the user should know as [`Warning`] values.
//!
//! ```
//! use calibration::{Basis, FitOptions, fit};
//! use shell_data::{Axes, Block, Dataset};
//!
//! // One channel that reads 100 counts per newton of Fx, and 2 of noise.
//! let readings = vec![vec![0.0, 102.0, 198.0, 300.0]];
//! let mut wrench = vec![vec![0.0; 4]; 6];
//! wrench[0] = vec![0.0, 1.0, 2.0, 3.0];
//! let block = Block { rows: 4, readings, wrench, ..Block::default() };
//! let data = Dataset::from_blocks("bench", Axes::ALL, vec![block]);
//!
//! let options = FitOptions { model: Basis::Linear.into(), ..FitOptions::default() };
//! let fitted = fit(data, Dataset::default(), &options)?;
//! let mut converted = Default::default();
//! fitted.calibration.wrench(&[vec![150.0]], &mut converted);
//! assert!((converted[0][0] - 1.5).abs() < 0.01);
//! # Ok::<_, calibration::FitError>(())
//! ```

mod choice;
mod contradictions;
mod cure_search;
mod cures;
mod evaluation;
mod examination;
mod files;
mod held_out;
mod means;
mod options;
mod outcome;
mod outlier_search;
mod outliers;
mod parts;
mod physics;
mod polynomial;
mod refits;
mod screen;
mod tested;
mod verdict;
mod warning;

pub use self::evaluation::{
    Better, Evaluation, GroupErrors, Leaks, PairedError, PairedErrors, evaluate, group_errors,
    paired_errors,
};
pub use self::examination::{Examination, Fault, FaultPlace, Promise, TestRatio};
pub use self::files::contradicting_sums;
pub use self::held_out::HeldOutModels;
pub use self::options::{CovarianceRule, FitOptions, GroupsAsked, ModelRule, OutlierRule};
pub use self::outcome::Outcome;
pub use self::outlier_search::find_outliers;
pub use self::outliers::{Outlier, OutlierColumn, Outliers, Reason, RowName};
pub use self::physics::{ModelComparison, PhysicsFit};
pub use self::polynomial::fit_sums;
pub use self::refits::{RANDOM_FOLDS, random_split, sum_groups};
pub use self::screen::Screen;
pub use self::tested::{TestedCalibration, frame_interval};
pub use self::verdict::{FrameInterval, UnseenErrors, UnseenRows, Verdict};
pub use self::warning::{FewGroups, Warning};
pub use crate::groups::{
    FoundGroups, FoundKind, GroupBy, HeldOut, label_groups, label_poses_or_files, may_have_poses,
};
pub use crate::load_labels::{PoseMismatch, label_loads};
pub use least_squares::passes::Workers;

use self::choice::{FitInput, ModelChoice, choose};
use self::evaluation::RowErrors;
use crate::conversion::{Calibration, Kind};
use crate::dynamics::{Dynamics, NotSearched};
use crate::validation::excitation::{Excitation, LONGEST_LEVER_M};
use crate::validation::leaks::share_in_several_groups;
use least_squares::error::FitError;
use least_squares::model::Basis;
use least_squares::quality::AxisQuality;
use least_squares::solver::{Solution, SolverKind};
use least_squares::validation::cross_validation::CrossValidation;
use least_squares::validation::selection::{Advice, Selection};
use sensor_physics::COVERAGE_LEVEL;
use shell_data::dataset::Dataset;
use shell_data::wrench::PerAxis;

/// A calibration, its errors, and how it was found.
#[derive(Clone, Debug)]
pub struct Fit {
    pub calibration: Calibration,
    pub method: FitMethod,
    /// The rows that were fitted, with the labels of their groups if these are known.
    pub used: Dataset,
    pub tested: Dataset,
    pub rows: u64,
    pub rows_of_logs: Vec<u64>,
    pub skipped_rows: u64,
    pub repeated_rows: u64,
    pub train: PerAxis<AxisQuality>,
    pub tests: Vec<Evaluation>,
    pub excitation: Option<Excitation>,
    /// Shares of rows whose pose is on both sides of a split.
    pub leaks: Leaks,
    pub group_by: Option<GroupBy>,
    pub found_groups: Option<FoundGroups>,
    /// Reason for no standard errors: too few groups.
    pub few_groups: Option<FewGroups>,
    /// The choice of the family of features, if it was chosen.
    pub selection: Option<Selection>,
    /// Held-out errors, if they were requested or the model was chosen by them.
    pub cross_validation: Option<CrossValidation>,
    /// Reason why [`ModelRule::Auto`] could not choose a model on held-out groups.
    pub not_judged: Option<FitError>,
    pub advice: Option<Advice>,
    pub comparison: Outcome<ModelComparison, String>,
    /// The groups that were reduced to means, for a fit to means.
    pub means: Option<MeansOf>,
    pub dropped: Outliers,
    /// Outliers that were used, if a search took place.
    pub outliers: Outcome<Outliers, FitError>,
    pub dynamics: Outcome<Dynamics, NotSearched>,
    pub warnings: Vec<Warning>,
    /// Faults of the test and the training rows, if [`Fit::examine`] ran.
    pub examination: Option<Examination>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MeansOf {
    pub groups: usize,
    pub rows: u64,
    pub skipped_rows: u64,
}

#[derive(Clone, Debug)]
pub enum FitMethod {
    /// A polynomial in the readings.
    Polynomial {
        solution: Box<Solution>,
        solver: SolverKind,
        /// See [`FitOptions::truncate`].
        truncate: Option<f64>,
    },
    Physics(Box<PhysicsFit>),
}

impl Fit {
    pub fn solution(&self) -> Option<&Solution> {
        match &self.method {
            FitMethod::Polynomial { solution, .. } => Some(solution),
            FitMethod::Physics(_) => None,
        }
    }

    /// Number of features or parameters of the model.
    pub fn parameter_count(&self) -> usize {
        match &self.calibration.kind {
            Kind::Polynomial(polynomial) => polynomial.model().term_count(),
            Kind::Physics(physics) => physics.model().parameter_count(),
        }
    }

    /// Number of independent features, or of parameters for a physics model.
    pub fn rank(&self) -> usize {
        self.solution().map_or_else(|| self.parameter_count(), |solution| solution.rank)
    }

    /// Condition number of the features with columns of norm one; `None` if infinite or for physics models.
    pub fn condition(&self) -> Option<f64> {
        Some(self.solution()?.condition).filter(|condition| condition.is_finite())
    }

    pub fn test(&self) -> Evaluation {
        Evaluation::total(&self.tests)
    }

    fn new(
        calibration: Calibration,
        choice: ModelChoice,
        method: FitMethod,
        rows: u64,
        train: PerAxis<AxisQuality>,
    ) -> Self {
        Self {
            calibration,
            method,
            used: Dataset::default(),
            tested: Dataset::default(),
            rows,
            rows_of_logs: Vec::new(),
            skipped_rows: 0,
            repeated_rows: 0,
            train,
            tests: Vec::new(),
            excitation: None,
            leaks: Leaks::default(),
            group_by: choice.group_by,
            found_groups: choice.found_groups(),
            few_groups: choice.few_groups,
            selection: choice.selection,
            cross_validation: choice.cross_validation,
            not_judged: None,
            advice: choice.advice,
            comparison: Outcome::NotAsked,
            means: None,
            dropped: Outliers::default(),
            outliers: Outcome::NotAsked,
            dynamics: Outcome::NotAsked,
            warnings: Vec::new(),
            examination: None,
        }
    }

    fn with_errors(
        self,
        used: Dataset,
        tested: &Dataset,
        [errors, of_tests]: [RowErrors; 2],
        options: &FitOptions<'_>,
    ) -> Self {
        let train = Evaluation::total(&errors.logs);
        let mut fitted = Self {
            tested: tested.clone(),
            rows_of_logs: errors.logs.iter().map(|log| log.rows).collect(),
            skipped_rows: train.skipped_rows,
            repeated_rows: train.repeated_rows,
            excitation: errors.loads.excitation(),
            leaks: Leaks {
                test: errors.sample.poses().and_then(|poses| poses.share_of(&of_tests.sample)),
                groups: options.validation().and_then(|_| share_in_several_groups(&used)),
            },
            tests: of_tests.logs,
            used,
            ..self
        };
        fitted.warn(options.stated_loads.is_some());
        fitted
    }

    fn warn(&mut self, are_hung: bool) {
        let test = self.test();
        let lever_m = self.excitation.as_ref().and_then(Excitation::lever_m);
        let lever_m = lever_m.filter(|_| self.calibration.axes.are_all());
        let is_long = |lever_m: &f64| *lever_m > LONGEST_LEVER_M;
        let warning = if are_hung { Warning::PointUnit } else { Warning::MomentUnit };
        self.warnings.extend(lever_m.filter(is_long).map(warning));
        self.warnings.extend(self.leaks.in_test().map(Warning::TestLeaks));
        self.warnings.extend(self.leaks.in_groups().map(Warning::GroupsLeak));
        if let Some(solution) = self.solution() {
            let (rows, coefficients) = (solution.rows, solution.rank);
            let left_out = solution.model.term_count() - solution.rank;
            if left_out > 0 {
                self.warnings.push(Warning::DirectionsLeftOut(left_out));
            }
            if rows < 2 * coefficients as u64 {
                self.warnings.push(Warning::FewRows { rows, coefficients });
            }
            if test.is_out_of_range() {
                self.warnings.push(Warning::AllOutOfRange(test.rows));
            }
        }
        if let Kind::Physics(physics) = &self.calibration.kind {
            let intervals = physics.intervals.as_ref();
            let none = intervals.and_then(|of| of.factors(COVERAGE_LEVEL).err());
            self.warnings.extend(none.map(Warning::NoIntervalsAtAll));
            let dead = physics.model().dead_channels();
            if !dead.is_empty() {
                self.warnings.push(Warning::DeadChannels(dead));
            }
        }
        if test.out_of_range_rows > 0 {
            let (outside, rows) = (test.out_of_range_rows, test.rows);
            self.warnings.push(Warning::OutOfRange { outside, rows });
        }
    }
}

/// Fits a calibration to `train` and finds its errors there and on `test`, which may have no rows.
/// Both need the same channels and axes. If lag or memory is found, the correction modifies the
/// blocks of rows in place, or copies blocks that the caller still holds.
///
/// # Errors
/// [`FitError`] if the rows do not determine a calibration, an option needs groups and there are
/// none, a log is a copy of another, or the watcher of the workers stops the fit.
pub fn fit(train: Dataset, test: Dataset, options: &FitOptions<'_>) -> Result<Fit, FitError> {
    if train.logs.is_empty() {
        return Err(FitError::NoRows);
    }
    if train.has_weights() {
        options.check_weighted()?;
    }
    let ([train, test], dynamics) = options.prepare([train, test])?;
    let train = &train;
    let dropped = drop_outliers(train, options)?;
    let excluded = dropped.excluded();
    let test = &test.select(options.fresh, &Default::default());
    let input = FitInput { train, excluded: &excluded, test, options };
    let mut fitted = if options.means { fit_to_means(input)? } else { fit_rows(input)? };
    fitted.dropped = dropped;
    if let Some(found) = dynamics.found() {
        fitted.calibration.lag = found.lag;
        let has_terms = fitted.calibration.columns() > fitted.calibration.channels();
        fitted.calibration.memory = found.memory.clone().filter(|_| has_terms);
    }
    fitted.dynamics = dynamics;
    Ok(fitted)
}

fn drop_outliers(train: &Dataset, options: &FitOptions<'_>) -> Result<Outliers, FitError> {
    let drops = options.outliers == OutlierRule::Drop;
    if !drops && options.valid_range.is_none() {
        return Ok(Outliers::default());
    }
    let mut found = find_outliers(train, options)?;
    if !drops {
        found.rows.retain(|row| row.reason == Reason::OutOfRange);
    }
    Ok(found)
}

fn fit_to_means(input: FitInput<'_>) -> Result<Fit, FitError> {
    let held_out = input.options.validation().unwrap_or(HeldOut::Auto);
    let labelled = input.labelled(held_out).filter(|(by, _)| !by.is_time_blocks());
    let (by, rows) = labelled.ok_or(FitError::NoGroups)?;
    let means = means::group_means(&rows)?;
    let options = &FitOptions { fresh: false, ..*input.options };
    let excluded = &Default::default();
    let mut fitted = fit_rows(FitInput { train: &means, excluded, options, ..input })?;
    fitted.rows_of_logs = rows.logs.iter().map(|log| log.rows()).collect();
    fitted.found_groups = fitted.found_groups.or_else(|| by.found());
    fitted.means = Some(MeansOf {
        groups: means.rows() as usize,
        rows: rows.rows(),
        skipped_rows: rows.logs.iter().map(|log| log.summary.skipped_rows).sum(),
    });
    Ok(fitted)
}

fn fit_rows(input: FitInput<'_>) -> Result<Fit, FitError> {
    let options = input.options;
    match options.model {
        ModelRule::Physics => physics::fit(input, None),
        ModelRule::Given(_) => polynomial::fit(input, choose(input)?),
        ModelRule::Auto => match choose(input) {
            Ok(choice) => fit_best(input, choice),
            Err(reason @ FitError::Interrupted) => Err(reason),
            Err(reason) if options.cross_validation.is_some() => Err(reason),
            Err(reason) => {
                let given = FitOptions { model: Basis::Cubic.into(), ..*options };
                let fitted = fit_rows(FitInput { options: &given, ..input })?;
                Ok(Fit { not_judged: Some(reason), ..fitted })
            }
        },
    }
}

/// Fits the chosen polynomial, or the physics model if its held-out errors are smaller.
fn fit_best(input: FitInput<'_>, choice: ModelChoice) -> Result<Fit, FitError> {
    let comparison = match input.options.why_no_physics(input.train) {
        Some(reason) => Outcome::NotPossible(reason),
        None if input.train.memory_terms() > 0 => {
            Outcome::NotPossible("it has no memory terms, which reduce the error here".to_owned())
        }
        // The physics model is fitted to rows, not to means.
        None if input.options.means => Outcome::NotAsked,
        None => match ModelComparison::of(input, &choice) {
            Err(FitError::Interrupted) => return Err(FitError::Interrupted),
            Err(error) => Outcome::NotPossible(error.to_string()),
            Ok(None) => Outcome::NotAsked,
            Ok(Some((comparison, tried))) if comparison.physics_is_better() => {
                let (selection, comparison) = (choice.selection, Outcome::Found(comparison));
                return Ok(Fit { selection, comparison, ..physics::fit(input, tried)? });
            }
            Ok(Some((comparison, _))) => Outcome::Found(comparison),
        },
    };
    polynomial::fit(input, choice).map(|fitted| Fit { comparison, ..fitted })
}
