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

mod description;
mod equations;
mod lag;
mod noise;
mod prepared;
mod refusal;
mod samples;
mod search;
#[cfg(test)]
mod tests;

pub use self::lag::ReferenceLag;
pub use self::prepared::prepared;
pub use self::refusal::NotSearched;

use self::samples::SearchRows;
use crate::error::FitError;
use crate::memory::{MemoryTerms, TimeBase};
use crate::passes::Workers;
use shell_data::dataset::Dataset;
use shell_data::wrench::PerAxis;

/// A step of the clock of more than so many usual ones is a gap.
const GAP_PERIODS: f64 = 10.0;

/// What is done about a lag of the reference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LagRule {
    /// It is searched for.
    Auto,
    /// It is this, s; rows where logs have no clock.
    Given(f64),
}

/// Which memory terms a polynomial gets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MemoryRule<'a> {
    /// Those that pay.
    Auto,
    /// Those of these time constants, s; rows where logs have no clock.
    Given(&'a [f64]),
}

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DynamicsRule<'a> {
    /// The lag.
    pub lag: LagRule,
    /// The memory terms.
    pub memory: MemoryRule<'a>,
    /// Whether rows of labelled groups are searched as well: see [`NotSearched::Groups`].
    pub in_groups: bool,
}

impl DynamicsRule<'_> {
    /// Neither.
    pub const NOTHING: Self =
        Self { lag: LagRule::Given(0.0), memory: MemoryRule::Given(&[]), in_groups: false };
    /// Both are searched for, but not in labelled groups.
    pub const AUTO: Self = Self { lag: LagRule::Auto, memory: MemoryRule::Auto, in_groups: false };

    /// Whether rows stay as they are.
    pub fn is_nothing(&self) -> bool {
        *self == Self::NOTHING
    }

    /// Whether anything is searched for.
    pub fn searches(&self) -> bool {
        self.lag == LagRule::Auto || self.memory == MemoryRule::Auto
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
    let given_lag = match rule.lag {
        LagRule::Given(by) if by != 0.0 => Some(ReferenceLag { time_base: clock.time_base, by }),
        _ => None,
    };
    let given_memory = match rule.memory {
        MemoryRule::Given(times) if !times.is_empty() => Some(clock.memory(times)?),
        _ => None,
    };
    let given = Dynamics {
        time_base: clock.time_base,
        lag: given_lag,
        lag_standard_error: None,
        memory: given_memory,
        gain: None,
    };
    if !rule.searches() {
        return Ok(Ok(given));
    }
    if let Some(reason) = refusal::reason(data, rule.in_groups) {
        // What was given is taken, whatever the rows are.
        let has_given = given.lag.is_some() || given.memory.is_some();
        return Ok(if has_given { Ok(given) } else { Err(reason) });
    }
    let found = SearchRows::new(data, &clock, intercept)
        .map(|samples| search::search(&samples, rule, &given, workers));
    Ok(found.ok_or(NotSearched::FewRows))
}
