//! How far a calibration can be trusted on what it was not trained on.
//!
//! Rows of one recording, or of one pose, resemble each other. A random split puts neighbours on both sides,
//! and a model is then tested on what it has all but seen. So rows are held out by group: [`grouped`] sums
//! them group by group in one pass, [`cross_validation`] fits without each group and finds the errors on it
//! from those sums, [`selection`] compares models by these errors, [`plateaus`] finds groups where none are
//! named, [`excitation`] says how well the training loads cover the six axes.
//!
//! Without exact sums, taking a group away from the whole would cancel: for readings that the exact solver
//! cannot take, `normal_equations` adds the other groups up instead.

pub mod advice;
pub mod comparison;
pub mod cross_validation;
pub mod excitation;
pub mod factored;
pub mod grouped;
pub mod leaks;
pub(crate) mod normal_equations;
pub mod outliers;
pub mod plateaus;
pub mod selection;

use super::exact::ExactError;
use crate::FitError;
use shell_data::hint::Hint;

/// Why a calibration cannot be validated.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ValidationError {
    /// The rows cannot be summed exactly.
    #[error("sums by group must be exact: {0}")]
    NotExact(#[from] ExactError),
    /// Nothing to hold out, or nothing left.
    #[error("at least `2` groups are needed, found `{found}`")]
    TooFewGroups {
        /// Groups.
        found: usize,
    },
    /// A column that is no group label, most likely.
    #[error("more than `{limit}` groups")]
    TooManyGroups {
        /// The largest number.
        limit: usize,
    },
    /// Folds that the groups do not fill.
    #[error("`{folds}` folds of `{groups}` groups, expected `2` to the number of groups")]
    Folds {
        /// Folds asked for.
        folds: usize,
        /// Groups.
        groups: usize,
    },
    /// No fold leaves enough rows to fit the model.
    #[error("the model cannot be fitted without any one of the groups: {0}")]
    Undetermined(Box<FitError>),
    /// Some groups determine a coefficient alone, so that nothing can be learned from how groups
    /// scatter.
    #[error("without {} the model cannot be fitted", names(groups))]
    Alone {
        /// Their labels.
        groups: Vec<String>,
    },
    /// A row that no fit can take, or sums that do not suit the model.
    #[error(transparent)]
    Rows(Box<FitError>),
    /// None of the models can be fitted.
    #[error("the rows determine none of the models")]
    NoModel,
}

impl From<FitError> for ValidationError {
    fn from(error: FitError) -> Self {
        Self::Rows(Box::new(error))
    }
}

impl Hint for ValidationError {
    fn hint(&self) -> Option<String> {
        let text = match self {
            Self::TooFewGroups { .. } => {
                "record more poses, give several logs, or name the column of groups with `--group`"
            }
            Self::TooManyGroups { .. } => {
                "name the column of groups with `--group`, or assign them to K folds with `--cv=K`"
            }
            Self::Folds { .. } => "leave the number out to hold out one group at a time",
            Self::Undetermined(_) | Self::NoModel => {
                "record more poses, choose a smaller `--model`, or accept a damped answer with \
                 `--ridge 1e-6`"
            }
            _ => return None,
        };
        Some(text.to_owned())
    }
}

/// The first few of `labels`.
fn names(labels: &[String]) -> String {
    const SHOWN: usize = 5;
    let shown: Vec<String> = labels.iter().take(SHOWN).map(|label| format!("`{label}`")).collect();
    let more = if labels.len() > SHOWN { " or any of others" } else { "" };
    format!("the group {}{more}", shown.join(" or "))
}
