//! Dynamics of a sensor: a reference that lags behind the readings, and readings with memory.
//!
//! ```text
//! Dataset ─▶ is it in order of time? ─▶ lag, time constants, by held-out files or blocks of time ─▶ Dataset with memory
//!                                                                                    terms, the wrench moved by the lag
//! ```
//!
//! Later steps use this data set like any other. Both searches use the largest family of features that the number of
//! rows supports. A lag or memory term is kept if it lowers the held-out errors by over a standard error of their
//! difference between folds. A memory term must also lower them without the part of noise: a filter is not a memory.

mod equations;
mod errors;
mod prepared;
mod samples;
mod search;
#[cfg(test)]
mod tests;

pub use self::prepared::{ReferenceLag, prepared};

use std::fmt;

use self::samples::SearchRows;
use crate::groups::{SHUFFLED_BELOW, has_poses, load_correlation};
use crate::memory::{MemoryTerms, TimeBase};
use least_squares::error::FitError;
use least_squares::passes::Workers;
use least_squares::quality::{in_units, significant};
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axis, PerAxis};

/// Number of median periods above which a step of the clock is a gap.
const GAP_PERIODS: f64 = 10.0;

/// Given lag and memory, s, or rows if logs have no clock. `None` requests a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DynamicsRule<'a> {
    pub lag: Option<f64>,
    pub memory: Option<&'a [f64]>,
}

impl DynamicsRule<'_> {
    pub const NOTHING: Self = Self { lag: Some(0.0), memory: Some(&[]) };
    pub const AUTO: Self = Self { lag: None, memory: None };

    pub fn is_nothing(&self) -> bool {
        *self == Self::NOTHING
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Dynamics {
    pub time_base: TimeBase,
    pub lag: Option<ReferenceLag>,
    pub lag_standard_error: Option<f64>,
    pub memory: Option<MemoryTerms>,
    pub gain: Option<Gain>,
}

/// Root mean square errors on held-out rows, N and N·m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gain {
    /// Number of folds: files or blocks of time.
    pub folds: usize,
    /// Errors with rows as recorded.
    pub plain: PerAxis<f64>,
    /// Errors with the compensated lag, without memory terms.
    pub with_lag: PerAxis<f64>,
    /// Errors with the compensated lag and all kept memory terms.
    pub with_all: PerAxis<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NotSearched {
    #[error("the loads are constant in each pose")]
    Poses,
    /// Largest correlation of neighbouring rows.
    #[error(
        "the rows are not in the order of time: neighbouring loads are not alike (correlation {0:.2})"
    )]
    Shuffled(f64),
    #[error("there are too few rows to hold some out")]
    FewRows,
    #[error("rows with weights are not in the order of time")]
    Weights,
}

/// Finds lag and memory as `rule` requests. Rows that cannot be searched give [`NotSearched`], not a [`FitError`].
///
/// # Errors
/// [`FitError::TimeConstant`] if a given time constant is not positive.
pub fn find(
    data: &Dataset,
    rule: &DynamicsRule<'_>,
    intercept: bool,
    workers: Workers<'_>,
) -> Result<Result<Dynamics, NotSearched>, FitError> {
    let clock = prepared::RowClock::new(data);
    let time_base = clock.time_base;
    let times = rule.memory.filter(|times| !times.is_empty());
    let given = Dynamics {
        time_base,
        lag: rule.lag.filter(|&by| by != 0.0).map(|by| ReferenceLag { time_base, by }),
        lag_standard_error: None,
        memory: times.map(|times| clock.memory(times)).transpose()?,
        gain: None,
    };
    if rule.lag.is_some() && rule.memory.is_some() {
        return Ok(Ok(given));
    }
    if let Some(reason) = refusal(data) {
        // Given values apply to any rows.
        let has_given = given.lag.is_some() || given.memory.is_some();
        return Ok(if has_given { Ok(given) } else { Err(reason) });
    }
    let found = SearchRows::new(data, &clock, intercept)
        .map(|samples| search::search(&samples, rule, &given, workers));
    Ok(found.ok_or(NotSearched::FewRows))
}

fn refusal(data: &Dataset) -> Option<NotSearched> {
    if data.has_weights() {
        return Some(NotSearched::Weights);
    }
    // Checked before poses, because shuffled loads may look like poses.
    let correlation = load_correlation(data, 1);
    if correlation < SHUFFLED_BELOW {
        return Some(NotSearched::Shuffled(correlation));
    }
    has_poses(data).then_some(NotSearched::Poses)
}

impl Dynamics {
    pub fn words(&self) -> String {
        let lag = match &self.lag {
            Some(lag) => {
                let by = lag.by.abs();
                let (factor, unit) = unit(by, self.time_base);
                let error = self.lag_standard_error.map_or_else(String::new, |error| {
                    format!(" ± {}", significant(factor * error, 1))
                });
                let by = significant(factor * by, 3);
                let what = match lag.by > 0.0 {
                    true => "the reference lags behind the readings",
                    false => "the readings lag behind the reference",
                };
                format!("{what} by {by}{error} {unit}, corrected by the fit")
            }
            None => "no lag between readings and reference".to_owned(),
        };
        let memory = match &self.memory {
            Some(memory) => {
                let time = |&tau: &f64| {
                    let (factor, unit) = unit(tau, self.time_base);
                    format!("{} {unit}", significant(factor * tau, 3))
                };
                let times: Vec<String> = memory.time_constants.iter().map(time).collect();
                format!("memory terms of {}", times.join(", "))
            }
            None => "no memory terms".to_owned(),
        };
        format!("{lag}; {memory}")
    }
}

impl fmt::Display for Dynamics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.words())?;
        let Some(gain) = &self.gain else { return Ok(()) };
        if self.lag.is_none() && self.memory.is_none() {
            return f.write_str(" (none lowers the held-out error by more than a standard error)");
        }
        write!(f, ". Held-out errors: {}", gain.steps(self))
    }
}

impl Gain {
    /// Text such as `Fx 0.113 → 0.078 → 0.055 N, …`.
    fn steps(&self, of: &Dynamics) -> String {
        let mut columns: Vec<&PerAxis<f64>> = vec![&self.plain];
        columns.extend(of.lag.map(|_| &self.with_lag));
        columns.extend(of.memory.as_ref().map(|_| &self.with_all));
        let varies = |axis: &Axis| self.plain[axis.index()] > 0.0;
        in_units(Axis::ALL.into_iter().filter(varies), |axis| {
            let errors = columns.iter().map(|errors| significant(errors[axis], 3));
            errors.collect::<Vec<_>>().join(" → ")
        })
    }
}

fn unit(time: f64, base: TimeBase) -> (f64, &'static str) {
    match base {
        TimeBase::Rows => (1.0, "rows"),
        TimeBase::Seconds if time < 1.0 => (1e3, "ms"),
        TimeBase::Seconds => (1.0, "s"),
    }
}
