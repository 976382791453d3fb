use std::collections::BTreeMap;

use super::outcome::Outcome;
use crate::dynamics::{Dynamics, DynamicsRule, NotSearched, find, prepared};
use crate::groups::HeldOut;
use least_squares::error::FitError;
use least_squares::model::Basis;
use least_squares::passes::Workers;
use least_squares::solver::SolverKind;
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, PerAxis};

/// The model to fit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelRule {
    Given(Basis),
    /// The smallest polynomial that predicts new groups about as well as the best, or the physics model if that
    /// predicts better. The cubic polynomial if nothing can be held out.
    Auto,
    Physics,
}

impl ModelRule {
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "auto" => Some(Self::Auto),
            "physics" => Some(Self::Physics),
            _ => Basis::ALL.into_iter().find(|basis| basis.name() == name).map(Self::Given),
        }
    }

    /// The default rule for lag and memory: both are chosen if the model is chosen.
    pub fn usual_dynamics(self) -> DynamicsRule<'static> {
        match self {
            Self::Auto => DynamicsRule::AUTO,
            _ => DynamicsRule::NOTHING,
        }
    }
}

impl From<Basis> for ModelRule {
    fn from(basis: Basis) -> Self {
        Self::Given(basis)
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutlierRule {
    /// Searches for outliers if a row stands out, but uses them for the fit.
    Report,
    Drop,
    /// Uses outliers, without a search.
    Keep,
}

/// The source of the covariance of the coefficients.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CovarianceRule {
    /// Groups of a column of the logs, poses or blocks of time, if there are at least ten; otherwise rows.
    Auto,
    /// Groups within which errors are alike: groups of a column, files, or groups found in the rows.
    Groups,
    /// Rows, whose errors are independent of each other.
    Rows,
    /// No covariance.
    Nothing,
}

#[derive(Clone, Copy, Debug)]
pub struct FitOptions<'a> {
    pub model: ModelRule,
    /// Fits a constant in addition to the features.
    pub intercept: bool,
    /// λ of a ridge on columns of norm one. Zero means no ridge or, if the family of features is
    /// chosen, the best of several.
    pub ridge: f64,
    /// Solver of a polynomial. Refined QR replaces the exact solver for rows that the exact one cannot take.
    pub solver: SolverKind,
    /// For [`SolverKind::Svd`]: leaves out singular values below this share of the largest. Columns have norm one.
    pub truncate: Option<f64>,
    /// Finds the errors on held-out groups. For a model that is chosen, they are found in any case.
    pub cross_validation: Option<HeldOut>,
    /// Seed of the random folds that the held-out errors are compared with.
    pub seed: u64,
    pub covariance: CovarianceRule,
    /// Fits to the mean of each group of rows, each counted once.
    pub means: bool,
    pub dynamics: DynamicsRule<'a>,
    /// Uses only rows whose readings differ from the previous row's.
    pub fresh: bool,
    /// Rows with a reading outside this range are left out.
    pub valid_range: Option<[f64; 2]>,
    pub outliers: OutlierRule,
    /// Name of a requested option that only polynomials support: [`ModelRule::Auto`] then considers no other models.
    pub polynomials_only: Option<&'a str>,
    /// Stated loads by group label. They replace the wrench in held-out errors of the physics model, if the wrench of
    /// the rows was corrected by their own readings.
    pub stated_loads: Option<&'a BTreeMap<String, PerAxis<f64>>>,
    pub workers: Workers<'a>,
}

/// The groups that a fit needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroupsAsked {
    Nothing,
    /// Groups given with the rows, or poses found in them.
    IfAny,
    HeldOut(HeldOut),
}

impl Default for FitOptions<'_> {
    fn default() -> Self {
        Self {
            model: ModelRule::Auto,
            intercept: true,
            ridge: 0.0,
            solver: SolverKind::Exact,
            truncate: None,
            cross_validation: None,
            seed: 1,
            covariance: CovarianceRule::Auto,
            means: false,
            dynamics: DynamicsRule::NOTHING,
            fresh: false,
            valid_range: None,
            outliers: OutlierRule::Report,
            polynomials_only: None,
            stated_loads: None,
            workers: Workers::default(),
        }
    }
}

impl FitOptions<'_> {
    /// The groups that the fit needs, and thereby the columns to read from logs.
    pub fn groups_asked(&self) -> GroupsAsked {
        match self.covariance {
            _ if self.means || self.validates() => {
                GroupsAsked::HeldOut(self.validation().unwrap_or(HeldOut::Auto))
            }
            CovarianceRule::Groups => GroupsAsked::HeldOut(HeldOut::Auto),
            CovarianceRule::Auto => GroupsAsked::IfAny,
            CovarianceRule::Rows | CovarianceRule::Nothing => GroupsAsked::Nothing,
        }
    }

    pub(super) fn basis(&self) -> Option<Basis> {
        match self.model {
            ModelRule::Given(basis) => Some(basis),
            ModelRule::Auto | ModelRule::Physics => None,
        }
    }

    /// Returns true if conspicuous rows start a search for outliers.
    pub(super) fn looks_for_outliers(&self) -> bool {
        // A mean is not a recorded row.
        !self.means && self.outliers == OutlierRule::Report
    }

    /// Checks that rows with weights, which exact sums cannot take, get a plain least-squares fit and standard errors
    /// by row.
    pub(super) fn check_weighted(&self) -> Result<(), FitError> {
        let what = match self {
            Self { model: ModelRule::Physics, .. } => "the physics model",
            Self { cross_validation: Some(_), .. } => "cross-validation",
            Self { covariance: CovarianceRule::Groups, .. } => "a covariance by group",
            Self { means: true, .. } => "a fit to means",
            Self { ridge, .. } if *ridge != 0.0 => "a ridge",
            Self { truncate: Some(_), .. } => "a truncated solution",
            Self { solver: SolverKind::RidgeGcv | SolverKind::Huber, .. } => "this solver",
            _ => return Ok(()),
        };
        Err(FitError::Weights(what))
    }

    pub(super) fn why_no_physics(&self, data: &Dataset) -> Option<String> {
        match self.polynomials_only {
            Some(option) => Some(format!("`{option}` is for polynomials in the readings")),
            None => check_physics(data).err().map(|error| error.to_string()),
        }
    }

    /// Finds lag and memory as requested, appends memory terms to the readings, and moves the wrench by the lag.
    pub(super) fn prepare(
        &self,
        [train, test]: [Dataset; 2],
    ) -> Result<([Dataset; 2], Outcome<Dynamics, NotSearched>), FitError> {
        let mut rule = self.dynamics;
        if self.means && !rule.is_nothing() {
            if rule.lag.is_some() || rule.memory.is_some() {
                return Err(FitError::DynamicsOfMeans);
            }
            rule = DynamicsRule::NOTHING;
        }
        if self.model == ModelRule::Physics {
            rule.memory = Some(&[]);
        }
        if rule.is_nothing() {
            return Ok(([train, test], Outcome::NotAsked));
        }
        self.workers.start("lag and memory");
        let outcome = Outcome::from(find(&train, &rule, self.intercept, self.workers)?);
        let found = outcome.found();
        let memory = found.and_then(|found| found.memory.as_ref());
        let lag = found.and_then(|found| found.lag);
        Ok(([prepared(train, memory, lag)?, prepared(test, memory, lag)?], outcome))
    }
}

/// Checks that rows have all axes of the wrench, to which every sensor responds, and no weights.
///
/// # Errors
/// [`FitError::PhysicsAxes`], [`FitError::Weights`].
pub(super) fn check_physics(data: &Dataset) -> Result<(), FitError> {
    if data.has_weights() {
        return Err(FitError::Weights("the physics model"));
    }
    let found = data.logs.first().map_or(Axes::ALL, |log| log.axes);
    if found.are_all() { Ok(()) } else { Err(FitError::PhysicsAxes(found)) }
}
