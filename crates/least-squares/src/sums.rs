//! The reduced form of rows, in total and by group, in any of three kinds.
//!
//! | kind | rows | held-out groups | reason |
//! | --- | --- | --- | --- |
//! | [`ExactSums`] | integers, or decimals of few digits | subtracted exactly | the same bits in any order |
//! | [R factors](crate::factored) | any | the other groups are merged | sums of rounded products would cancel |
//! | rows by group | any | downdated from the fit, or fitted again if the solver clips rows | an R factor of each group costs more |

use std::ops::Range;

use serde::{Deserialize, Serialize};

use crate::error::{ExactError, FitError};
use crate::exact::ExactSums;
use crate::factored::{FactoredGroups, FactoredRows};
use crate::fitted_groups::FittedGroups;
use crate::grouped_rows::GroupedRows;
use crate::held_out_errors::HeldOutErrors;
use crate::model::Model;
use crate::passes::Workers;
use crate::quality::AxisQuality;
use crate::reading_ranges::ReadingRanges;
use crate::solution::Solution;
use crate::solver::SolverKind;
use crate::uncertainty::Covariance;
use crate::validation::cross_validation::{CrossValidation, cross_validate};
use crate::validation::factored;
use crate::validation::grouped::SumsByGroup;
use crate::validation::selection::{self, Advice, Candidate, Selection};
use shell_data::wrench::PerAxis;

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "SumsDocument")]
pub enum RowSums {
    /// Exact sums: the same bits in any order of merging.
    #[serde(rename = "moments")]
    Exact(ExactSums),
    /// The R factor of rows that cannot be summed exactly: the last digits depend on the order of merging.
    #[serde(rename = "triangle")]
    Factored(FactoredRows),
}

#[derive(Deserialize)]
struct SumsDocument {
    moments: Option<ExactSums>,
    triangle: Option<FactoredRows>,
}

impl TryFrom<SumsDocument> for RowSums {
    type Error = &'static str;

    fn try_from(SumsDocument { moments, triangle }: SumsDocument) -> Result<Self, Self::Error> {
        match (moments, triangle) {
            (Some(moments), None) => Ok(Self::Exact(moments)),
            (None, Some(triangle)) => Ok(Self::Factored(triangle)),
            (None, None) => Err("missing field `moments` or `triangle`"),
            (Some(_), Some(_)) => Err("it has both `moments` and `triangle`"),
        }
    }
}

#[derive(Clone, Debug)]
pub struct SolvedSums {
    pub solution: Solution,
    pub quality: PerAxis<AxisQuality>,
    pub ranges: ReadingRanges,
    pub solver: SolverKind,
}

impl RowSums {
    pub fn rows(&self) -> u64 {
        match self {
            Self::Exact(sums) => sums.rows(),
            Self::Factored(rows) => rows.rows(),
        }
    }

    pub fn channels(&self) -> usize {
        match self {
            Self::Exact(sums) => sums.channels(),
            Self::Factored(rows) => rows.model().channels,
        }
    }

    /// Returns true if the channels and the basis match `model`.
    pub fn suit(&self, model: &Model) -> bool {
        let basis = match self {
            Self::Exact(sums) => sums.basis(),
            Self::Factored(rows) => rows.model().basis,
        };
        (self.channels(), basis) == (model.channels, model.basis)
    }

    /// Root mean square loads, N and N·m.
    pub fn loads(&self) -> PerAxis<f64> {
        match self {
            Self::Exact(sums) => std::array::from_fn(|axis| sums.mean_square(axis).sqrt()),
            Self::Factored(rows) => rows.mean_squares().map(f64::sqrt),
        }
    }

    /// Name of the field in a document.
    pub fn field(&self) -> &'static str {
        match self {
            Self::Exact(_) => "moments",
            Self::Factored(_) => "triangle",
        }
    }

    pub fn kind(&self) -> &'static str {
        match self {
            Self::Exact(_) => "exact sums",
            Self::Factored(_) => "R factors",
        }
    }

    /// Adds the rows of `other`, with the same features.
    ///
    /// # Errors
    /// [`ExactError`] if both together cannot be summed exactly.
    ///
    /// # Panics
    /// If `other` has another [kind](Self::kind), or other features.
    pub fn merge(&mut self, other: &Self) -> Result<(), ExactError> {
        match (&mut *self, other) {
            (Self::Exact(own), Self::Exact(other)) => own.merge(other)?,
            (Self::Factored(own), Self::Factored(other)) => own.merge(other),
            (own, other) => panic!("{} cannot be added to {}", other.kind(), own.kind()),
        }
        Ok(())
    }

    /// Fits `model` with λ = `ridge`.
    ///
    /// # Errors
    /// [`FitError`] if the rows do not determine the coefficients, or features of the model were not kept.
    pub fn solve(&self, model: &Model, ridge: f64) -> Result<SolvedSums, FitError> {
        match self {
            Self::Exact(sums) => {
                let fit = sums.solve(model, ridge)?;
                let (quality, ranges) = (fit.quality(sums), sums.reading_ranges());
                Ok(SolvedSums {
                    solution: fit.solution,
                    quality,
                    ranges,
                    solver: SolverKind::Exact,
                })
            }
            Self::Factored(rows) => {
                let solution = rows.solve(model, ridge)?;
                let quality = rows.quality(&solution).ok_or(FitError::NoRows)?;
                let ranges = rows.ranges.clone();
                Ok(SolvedSums { solution, quality, ranges, solver: SolverKind::Tsqr })
            }
        }
    }
}

/// Errors, on each of the `parts`, of a fit to all except those at `left_out`. Parts are of one [kind](RowSums::kind).
///
/// # Errors
/// [`FitError`] if the other parts do not determine the coefficients, or all together cannot be summed exactly.
pub fn errors_without(
    parts: &[&RowSums],
    left_out: &[usize],
    model: &Model,
    ridge: f64,
) -> Result<Vec<PerAxis<HeldOutErrors>>, FitError> {
    let merged = |is_wanted: &dyn Fn(&usize) -> bool| -> Result<Option<RowSums>, FitError> {
        let mut wanted = (0..parts.len()).filter(is_wanted).map(|at| parts[at]);
        let Some(mut all) = wanted.next().cloned() else { return Ok(None) };
        wanted.try_for_each(|part| all.merge(part)).map_err(FitError::NotExact)?;
        Ok(Some(all))
    };
    let rest = merged(&|at| !left_out.contains(at))?.ok_or(FitError::NoRows)?;
    match (rest, merged(&|_| true)?, merged(&|at| left_out.contains(at))?) {
        // Takes the sums of the rest in the units of all parts, because the errors on left-out parts need these.
        (RowSums::Exact(rest), Some(RowSums::Exact(all)), left_out) => {
            let rest = match &left_out {
                Some(RowSums::Exact(part)) => all.without(part),
                _ => rest,
            };
            let fit = rest.solve(model, ridge)?;
            let errors = parts.iter().filter_map(|part| match part {
                RowSums::Exact(part) => Some(fit.errors_on(part)),
                RowSums::Factored(_) => None,
            });
            Ok(errors.collect())
        }
        (RowSums::Factored(rest), ..) => {
            let solution = rest.solve(model, ridge)?;
            let errors = parts.iter().filter_map(|part| match part {
                RowSums::Factored(part) => part.errors(&solution),
                RowSums::Exact(_) => None,
            });
            Ok(errors.collect())
        }
        (RowSums::Exact(_), ..) => Err(FitError::NoRows),
    }
}

#[derive(Clone, Debug)]
pub enum GroupedSums {
    Exact(Box<SumsByGroup>),
    Factored(FactoredGroups),
    /// Rows of each group with its label, for the covariance of a solution that is not known yet.
    Rows(GroupedRows, Vec<String>),
}

impl GroupedSums {
    /// Number of groups, or sets of groups, with separate sums.
    pub fn groups(&self) -> usize {
        match self {
            Self::Exact(sums) => sums.groups.len(),
            Self::Factored(rows) => rows.groups.len(),
            Self::Rows(_, labels) => labels.len(),
        }
    }

    /// Number of groups: more than [`groups`](Self::groups) if sets of groups were summed.
    pub fn group_count(&self) -> usize {
        match self {
            Self::Exact(sums) => sums.group_count,
            _ => self.groups(),
        }
    }

    pub fn rows(&self) -> u64 {
        match self {
            Self::Exact(sums) => sums.total().map_or(0, ExactSums::rows),
            Self::Factored(rows) => rows.groups.iter().map(|(_, rows)| rows.rows()).sum(),
            Self::Rows(rows, _) => rows.row_count() as u64,
        }
    }

    /// Number of channels; 0 without groups.
    pub fn channels(&self) -> usize {
        match self {
            Self::Exact(sums) => sums.total().map_or(0, ExactSums::channels),
            Self::Factored(rows) => {
                rows.groups.first().map_or(0, |(_, rows)| rows.model().channels)
            }
            Self::Rows(rows, _) => rows.channels(),
        }
    }

    pub fn exact(&self) -> Option<&SumsByGroup> {
        match self {
            Self::Exact(sums) => Some(sums),
            Self::Factored(_) | Self::Rows(..) => None,
        }
    }

    /// Errors of `model` with λ = `ridge` on each group, or each of `folds` folds of groups, from fits without it.
    ///
    /// # Errors
    /// [`FitError`] for too few groups or rows outside each fold; [`FitError::NoGroupSums`] if rows were kept.
    pub fn cross_validate(
        &self,
        model: &Model,
        ridge: f64,
        folds: Option<usize>,
    ) -> Result<CrossValidation, FitError> {
        match self {
            Self::Exact(sums) => cross_validate(sums, model, ridge, folds),
            Self::Factored(rows) => factored::cross_validate(rows, model, ridge, folds),
            Self::Rows(..) => Err(FitError::NoGroupSums),
        }
    }

    /// Compares the families of features within those kept on folds of groups, with `ridges` and, if the largest is
    /// best, larger ones. R factors give no advice: computing the errors on each fold twice is too expensive.
    ///
    /// # Errors
    /// [`FitError`] for too few groups or no possible model; [`FitError::NoGroupSums`] if rows were kept.
    pub fn select(
        &self,
        intercept: bool,
        ridges: &[f64],
    ) -> Result<(Selection, Option<Advice>), FitError> {
        match self {
            Self::Exact(sums) => {
                let tried = selection::select(sums, intercept, ridges)?;
                let advice = Advice::new(&tried, None);
                Ok((tried.selection, Some(advice)))
            }
            Self::Factored(rows) => Ok((factored::select(rows, intercept, ridges)?, None)),
            Self::Rows(..) => Err(FitError::NoGroupSums),
        }
    }

    /// Compares `model` with the smaller ones within it. `None` if there are none, if `model` cannot be fitted without
    /// one of the folds, or without exact sums, where the comparison would take as long as the fit.
    ///
    /// # Errors
    /// As [`select`](Self::select).
    pub fn advice(&self, model: &Model, ridge: f64) -> Result<Option<Advice>, FitError> {
        let Self::Exact(sums) = self else { return Ok(None) };
        let tried = selection::select(sums, model.intercept, &[ridge])?;
        let candidates = &tried.selection.candidates;
        let is_given =
            |candidate: &Candidate| candidate.basis == model.basis && candidate.errors.is_some();
        let given = candidates.iter().position(is_given).filter(|_| candidates.len() > 1);
        Ok(given.map(|given| Advice::new(&tried, Some(given))))
    }

    /// Covariance of a solution by `solver` of all these rows, with errors correlated within groups; `ridge` is the
    /// requested one. If groups are blocks of time, `time_blocks` lists those held out together; exact sums hold out
    /// each alone.
    ///
    /// # Errors
    /// [`FitError`] if there are too few groups, or the model cannot be fitted without one of them.
    pub fn covariance(
        &self,
        solution: &Solution,
        (solver, ridge): (SolverKind, f64),
        time_blocks: Option<&[Range<usize>]>,
        workers: Workers<'_>,
    ) -> Result<Covariance, FitError> {
        match self {
            Self::Exact(sums) => {
                let are_time_blocks = time_blocks.is_some();
                Covariance::from_groups(sums, &solution.model, ridge, are_time_blocks, workers)
            }
            Self::Factored(rows) => {
                let groups = FittedGroups::from_factors(rows, solution, workers)?;
                Covariance::from_fitted(&groups, time_blocks, solution.rows, workers)
            }
            Self::Rows(rows, labels) if solver == SolverKind::Huber => {
                let block = rows.to_block(labels);
                Covariance::from_clipped_groups(&block, solution, ridge, workers)
            }
            Self::Rows(rows, labels) => {
                let groups = FittedGroups::from_rows(rows, labels, solution, workers)?;
                Covariance::from_fitted(&groups, time_blocks, solution.rows, workers)
            }
        }
    }
}
