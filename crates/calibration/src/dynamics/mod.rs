//! What time does to a sensor: a reference that lags behind the readings, and readings that remember.
//!
//! ```text
//! Dataset ─▶ is it in order of time? ─▶ lag, time constants, by held-out files or blocks of time ─▶ Dataset with memory
//!                                                                                    terms, the wrench moved by the lag
//! ```
//!
//! Everything after it, the choice of a model, its errors, intervals, takes the data set that comes of it as any other.
//! Both are searched for on one family of features, the largest that the rows bear, by the errors on rows
//! that were held out. A lag or a memory term is kept if it lowers these by more than one standard error of their
//! difference between folds, and still does when the part of noise is taken off: a filter is no memory.

mod equations;
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

/// A step of the clock of more than so many usual ones is a gap.
const GAP_PERIODS: f64 = 10.0;

/// What is given of lag and memory, s; rows where logs have no clock. What is `None` is searched for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DynamicsRule<'a> {
    /// The lag of the reference.
    pub lag: Option<f64>,
    /// The time constants of the memory terms that a polynomial gets.
    pub memory: Option<&'a [f64]>,
}

impl DynamicsRule<'_> {
    /// Neither.
    pub const NOTHING: Self = Self { lag: Some(0.0), memory: Some(&[]) };
    /// Both are searched for.
    pub const AUTO: Self = Self { lag: None, memory: None };

    /// Whether rows stay as they are.
    pub fn is_nothing(&self) -> bool {
        *self == Self::NOTHING
    }
}

/// What was found, or given.
#[derive(Clone, Debug, PartialEq)]
pub struct Dynamics {
    /// What time is counted in.
    pub time_base: TimeBase,
    /// The lag that was made up for.
    pub lag: Option<ReferenceLag>,
    /// Its standard error, where it was searched for.
    pub lag_standard_error: Option<f64>,
    /// The memory terms that were kept.
    pub memory: Option<MemoryTerms>,
    /// What they gain, where anything was searched for.
    pub gain: Option<Gain>,
}

/// Root mean square errors on rows that were held out, N and N·m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gain {
    /// Folds of files or blocks of time.
    pub folds: usize,
    /// Rows as they were recorded.
    pub plain: PerAxis<f64>,
    /// With the lag made up for, without memory terms.
    pub with_lag: PerAxis<f64>,
    /// With all that was kept.
    pub with_all: PerAxis<f64>,
}

/// Why neither lag nor memory was searched for.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NotSearched {
    /// Nothing moves within a pose.
    #[error("the loads are constant in each pose")]
    Poses,
    /// Neighbouring rows have nothing to do with each other; this is their largest correlation.
    #[error(
        "the rows are not in the order of time: neighbouring loads are not alike (correlation {0:.2})"
    )]
    Shuffled(f64),
    /// There are too few rows to hold some out.
    #[error("there are too few rows to hold some out")]
    FewRows,
    /// Rows count more or less than one another.
    #[error("rows with weights are not in the order of time")]
    Weights,
}

/// Finds what is asked for. What a search is refused for is a value: the rows are then as good as they were.
///
/// # Errors
/// [`FitError::TimeConstant`] if a time constant that is given is not positive.
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
        // What was given is taken, whatever the rows are.
        let has_given = given.lag.is_some() || given.memory.is_some();
        return Ok(if has_given { Ok(given) } else { Err(reason) });
    }
    let found = SearchRows::new(data, &clock, intercept)
        .map(|samples| search::search(&samples, rule, &given, workers));
    Ok(found.ok_or(NotSearched::FewRows))
}

/// Why nothing should be searched for in these rows, if there is a reason.
fn refusal(data: &Dataset) -> Option<NotSearched> {
    if data.has_weights() {
        return Some(NotSearched::Weights);
    }
    // Before poses, which loads in any order might seem to be.
    let correlation = load_correlation(data, 1);
    if correlation < SHUFFLED_BELOW {
        return Some(NotSearched::Shuffled(correlation));
    }
    has_poses(data).then_some(NotSearched::Poses)
}

impl Dynamics {
    /// Lag and memory in words, without what they gain.
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
                format!("{what} by {by}{error} {unit}, which the fit makes up for")
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
    /// `Fx 0.113 → 0.078 → 0.055 N, …`
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

/// The factor and the unit that times are printed with.
fn unit(time: f64, base: TimeBase) -> (f64, &'static str) {
    match base {
        TimeBase::Rows => (1.0, "rows"),
        TimeBase::Seconds if time < 1.0 => (1e3, "ms"),
        TimeBase::Seconds => (1.0, "s"),
    }
}
