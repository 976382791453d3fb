//! Options of a fit.

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

/// Which model is fitted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ModelRule {
    /// A polynomial of this family of features.
    Given(Basis),
    /// The smallest polynomial that predicts new groups as well as the best, or the physics model where that
    /// predicts them better. Where nothing can be held out, the cubic one.
    Auto,
    /// The physics model.
    Physics,
}

impl ModelRule {
    /// The rule that users call so.
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "auto" => Some(Self::Auto),
            "physics" => Some(Self::Physics),
            _ => Basis::ALL.into_iter().find(|basis| basis.name() == name).map(Self::Given),
        }
    }

    /// The default for lag and memory: both are chosen if the model is.
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

/// What is done about outliers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OutlierRule {
    /// They are looked for where a row stands out, and used.
    Report,
    /// They are left out.
    Drop,
    /// They are used, and not looked for.
    Keep,
}

/// What the covariance of the coefficients is found from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CovarianceRule {
    /// By the log's group column or its plateaus where there are ten at least, by rows otherwise.
    Auto,
    /// Errors are alike within groups: those of the group column, files, or those that are found.
    Groups,
    /// Errors are independent from row to row.
    Rows,
    /// None is wanted.
    Nothing,
}

/// What is to be fitted, and how.
#[derive(Clone, Copy, Debug)]
pub struct FitOptions<'a> {
    /// The model.
    pub model: ModelRule,
    /// Fits a constant in addition to the features.
    pub intercept: bool,
    /// λ of a ridge on columns of norm one; 0 for none, or for the best of several where the family of features is
    /// chosen.
    pub ridge: f64,
    /// The solver. Where the exact one cannot take the rows, refined QR does.
    pub solver: SolverKind,
    /// For [`SolverKind::Svd`]: leaves out directions whose singular value, of columns of norm one,
    /// is below this share of the largest.
    pub truncate: Option<f64>,
    /// Find the errors on groups that were held out; those of a model that is chosen are found in any case.
    pub cross_validation: Option<HeldOut>,
    /// Which way rows are assigned to the random folds that those are compared with.
    pub seed: u64,
    /// The source of the covariance.
    pub covariance: CovarianceRule,
    /// Fit to the mean of each group of rows, each counted once.
    pub means: bool,
    /// The treatment of lag and memory.
    pub dynamics: DynamicsRule<'a>,
    /// Use only rows whose readings differ from those of the row before.
    pub fresh: bool,
    /// Readings outside are wrong: rows with any are left out.
    pub valid_range: Option<[f64; 2]>,
    /// The treatment of outliers.
    pub outliers: OutlierRule,
    /// What was asked for that polynomials alone have: with [`ModelRule::Auto`] nothing else is then chosen.
    pub polynomials_only: Option<&'a str>,
    /// What errors of the physics model on held-out groups are against, by label, where the wrench of their rows was
    /// corrected by their own readings.
    pub stated_loads: Option<&'a BTreeMap<String, PerAxis<f64>>>,
    /// Who works on it.
    pub workers: Workers<'a>,
}

/// Which groups a fit asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GroupsAsked {
    /// None.
    Nothing,
    /// Those that rows are given in, or poses that are found.
    IfAny,
    /// The groups that can be held out.
    HeldOut(HeldOut),
}

impl Default for FitOptions<'_> {
    /// The defaults of `shellcal fit`.
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
    /// Which groups are asked for, and so which columns of logs.
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

    /// The family of features, where it is not to be chosen.
    pub(super) fn basis(&self) -> Option<Basis> {
        match self.model {
            ModelRule::Given(basis) => Some(basis),
            ModelRule::Auto | ModelRule::Physics => None,
        }
    }

    /// Returns true if conspicuous rows start a search for outliers.
    pub(super) fn looks_for_outliers(&self) -> bool {
        // A mean is no row that was recorded.
        !self.means && self.outliers == OutlierRule::Report
    }

    /// What can be had of rows that have weights, which no exact sum can take: a plain least-squares fit, and
    /// standard errors by row.
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

    /// Why the physics model cannot be compared with a polynomial, if it cannot.
    pub(super) fn why_no_physics(&self, data: &Dataset) -> Option<String> {
        match self.polynomials_only {
            Some(option) => Some(format!("`{option}` is for polynomials in the readings")),
            None => check_physics(data).err().map(|error| error.to_string()),
        }
    }

    /// Finds lag and memory as far as that is asked for, and prepares rows for a model that has them: with memory terms
    /// beside their readings, and the wrench at the time of the readings.
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
        let outcome = Outcome::from(find(&train, &rule, self.intercept, self.workers)?);
        let found = outcome.found();
        let memory = found.and_then(|found| found.memory.as_ref());
        let lag = found.and_then(|found| found.lag);
        Ok(([prepared(train, memory, lag)?, prepared(test, memory, lag)?], outcome))
    }
}

/// Checks that rows have all axes of the wrench, to which every sensor answers, and count alike.
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
