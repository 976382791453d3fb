//! Files, or partial fits, that contradict all others: fits with and without their rows both err far more on them.
//!
//! Held-out errors alone would blame a file that is the only one with some loads. A fit to all rows follows such a file,
//! but not one whose reference differs. With more channels than needed, it may also follow exchanged channels. Held-out
//! errors therefore suffice for a file whose loads the others have, too.

use std::collections::BTreeSet;

use super::cure_search::cure_of_test;
use super::evaluation::{Evaluation, evaluate};
use super::{CovarianceRule, Fit, FitMethod, FitOptions, OutlierRule};
use crate::conversion::{Calibration, Kind};
use least_squares::error::FitError;
use least_squares::factored::FactoredGroups;
use least_squares::grouped_rows::GroupedRows;
use least_squares::model::Model;
use least_squares::passes::Workers;
use least_squares::quality::significant;
use least_squares::sums::{GroupedSums, RowSums, errors_without};
use least_squares::validation::cross_validation::CrossValidation;
use least_squares::validation::grouped::SumsByGroup;
use sensor_physics::PhysicsCalibration;
use shell_data::dataset::{Dataset, LogRows};
use shell_data::statistics::upper_median;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// With two files, nothing tells which is wrong.
const FEWEST_FILES: usize = 3;

/// Smallest error of a contradicting file and, second, of a file that is left out on trial, in multiples of the others'
/// errors. The error relative to the loads must be as many times larger, because sessions with large loads err more. A
/// sound session errs up to 4.1 times as much where a linear model does not follow its loads.
const FAR_MORE: f64 = 5.0;
const SUSPICIOUS: f64 = 1.5;

/// The others have the loads of a file, too, if they have at least `ROWS_OF_OTHERS` times its rows, and if its RMS load
/// is at most `LARGER_LOADS` times the largest of theirs on each axis.
const ROWS_OF_OTHERS: u64 = 2;
const LARGER_LOADS: f64 = 1.2;

/// Smallest held-out error of such a file, in multiples of the others': with few poses, all files have large ones.
const FAR_MORE_HELD_OUT: f64 = 3.0;

/// Errors below this share of the loads of a file count as none.
const NO_ERROR: f64 = 1e-3;

/// Most products to sum for fits without each file, if files were not held out.
const MOST_PRODUCTS: u64 = 2_000_000_000;

/// Describes each contradicting file, with the cure if there is one.
pub(super) fn find(fit: &Fit, workers: Workers<'_>) -> Result<Vec<String>, FitError> {
    let (data, axes) = (&fit.used, fit.calibration.axes);
    if data.logs.len() < FEWEST_FILES || data.has_weights() {
        return Ok(Vec::new());
    }
    let loads = |log: &LogRows| {
        std::array::from_fn(|axis| {
            let values = log.blocks.iter().flat_map(|of| &of.rows.wrench[axis]);
            let squares: f64 = values.map(|load| load * load).sum();
            (squares / log.rows().max(1) as f64).sqrt()
        })
    };
    let errors_by = |calibration: &Calibration| -> Result<Vec<PerAxis<f64>>, FitError> {
        let found = evaluate(calibration, data, workers)?;
        let rms = |of: &Evaluation| of.quality().map_or([0.0; 6], |axes| axes.map(|of| of.rms));
        Ok(found.iter().map(rms).collect())
    };
    let errors = |left_out: &[usize]| match left_out {
        [] => errors_by(&fit.calibration).map(Some),
        _ => without(fit, left_out, workers)?.map(|rest| errors_by(&rest)).transpose(),
    };
    let rows = data.logs.iter().map(LogRows::rows).collect();
    let parts = Parts { loads: data.logs.iter().map(loads).collect(), rows, axes };
    let names = data.logs.iter().map(|log| log.name.display().to_string()).collect::<Vec<_>>();
    let mut held_out = fit.cross_validation.as_ref().and_then(|found| of_each(found, &names));
    let terms = fit.parameter_count() as u64;
    if held_out.is_none() && data.rows() * terms * terms * data.logs.len() as u64 <= MOST_PRODUCTS {
        let alone = |part: usize| Ok(errors(&[part])?.map(|of| of[part]));
        held_out = (0..data.logs.len()).map(alone).collect::<Result<_, FitError>>()?;
    }
    let found = parts.contradictions(held_out, errors)?;
    let left_out: Vec<usize> = found.iter().map(|of| of.part).collect();
    let rest = if found.is_empty() { None } else { without(fit, &left_out, workers)? };
    let words = |of: &Contradiction| {
        let name = data.logs[of.part].name.display();
        let alone = Dataset { logs: vec![data.logs[of.part].clone()] };
        let cure = rest.as_ref().and_then(|rest| cure_of_test(rest, &alone, &of.limit));
        match cure {
            Some(cure) if cure.starts_with("in ") => cure,
            Some(cure) => format!("in `{name}` {cure}"),
            None => of.words(&format!("`{name}`"), "files"),
        }
    };
    Ok(found.iter().map(words).collect())
}

/// Describes each partial fit, given with its name, that contradicts all others.
///
/// # Errors
/// [`FitError`] if all parts together do not determine the model, or cannot be summed exactly.
pub fn contradicting_sums(
    parts: &[(String, RowSums)],
    (model, ridge): (&Model, f64),
    axes: Axes,
) -> Result<Vec<String>, FitError> {
    if parts.len() < FEWEST_FILES {
        return Ok(Vec::new());
    }
    let sums: Vec<&RowSums> = parts.iter().map(|(_, sums)| sums).collect();
    let errors = |left_out: &[usize]| match errors_without(&sums, left_out, model, ridge) {
        Ok(errors) => Ok(Some(errors.iter().map(|of| of.map(|axis| axis.rms())).collect())),
        // The others do not determine the model.
        Err(_) if !left_out.is_empty() => Ok(None),
        Err(error) => Err(error),
    };
    let names: Vec<String> = parts.iter().map(|(name, _)| name.clone()).collect();
    let held_out = cross_validate_parts(parts, model, ridge).ok();
    let held_out = held_out.as_ref().and_then(|found| of_each(found, &names));
    let rows = sums.iter().map(|sums| sums.rows()).collect();
    let compared = Parts { loads: sums.iter().map(|sums| sums.loads()).collect(), rows, axes };
    let found = compared.contradictions(held_out, errors)?;
    Ok(found.iter().map(|of| of.words(&parts[of.part].0, "partial fits")).collect())
}

/// Root mean square errors on each named group, if each was held out alone.
fn of_each(found: &CrossValidation, names: &[String]) -> Option<Vec<PerAxis<f64>>> {
    let errors = found.errors_alone();
    let of = |name: &String| Some(errors.get(name.as_str())?.map(|axis| axis.rms()));
    names.iter().map(of).collect()
}

fn cross_validate_parts(
    parts: &[(String, RowSums)],
    model: &Model,
    ridge: f64,
) -> Result<CrossValidation, FitError> {
    let (mut exact, mut factored) = (Vec::new(), Vec::new());
    for (name, sums) in parts {
        match sums {
            RowSums::Exact(sums) => exact.push((name.clone(), sums.clone())),
            RowSums::Factored(rows) => factored.push((name.clone(), rows.clone())),
        }
    }
    let sums = match factored.is_empty() {
        true => {
            let sums = SumsByGroup::new(exact, Vec::new()).map_err(FitError::NotExact)?;
            GroupedSums::Exact(Box::new(sums))
        }
        false => GroupedSums::Factored(FactoredGroups { groups: factored }),
    };
    sums.cross_validate(model, ridge, None)
}

struct Parts {
    /// Root mean square loads of each part, N and N·m.
    loads: Vec<PerAxis<f64>>,
    rows: Vec<u64>,
    axes: Axes,
}

struct Contradiction {
    part: usize,
    axis: Axis,
    /// Error of the part in a fit without it, in multiples of the others' errors.
    ratio: f64,
    /// Errors that would still be usual, N and N·m.
    limit: PerAxis<f64>,
}

impl Contradiction {
    fn words(&self, name: &str, others: &str) -> String {
        format!(
            "{name} errs {} times as much as the other {others} on {}: check its columns, units and zero",
            significant(self.ratio, 2),
            self.axis.name()
        )
    }
}

/// Median errors of some parts, absolute and relative to their loads.
struct Usual {
    errors: PerAxis<f64>,
    relative: PerAxis<f64>,
}

impl Parts {
    /// Finds contradicting parts one by one. `errors` returns the RMS errors, on all parts, of a fit without some of
    /// them, or `None` if the others do not determine it. A contradicting part may bend the fit to all parts, so
    /// held-out errors of each part, if known, show more than the errors of this fit.
    fn contradictions(
        &self,
        held_out: Option<Vec<PerAxis<f64>>>,
        errors: impl Fn(&[usize]) -> Result<Option<Vec<PerAxis<f64>>>, FitError>,
    ) -> Result<Vec<Contradiction>, FitError> {
        let mut found: Vec<Contradiction> = Vec::new();
        let Some(of_all) = errors(&[])? else { return Ok(found) };
        let mut known: Vec<Vec<PerAxis<f64>>> = held_out.clone().into_iter().collect();
        known.push(of_all.clone());
        // The majority is right.
        while 2 * (found.len() + 1) < self.loads.len() {
            let left_out: Vec<usize> = found.iter().map(|of| of.part).collect();
            let mut suspects: Vec<usize> =
                known.iter().filter_map(|errors| self.worst(errors, &left_out)).collect();
            suspects.dedup();
            let mut next = None;
            for part in suspects {
                let left_out = [&left_out[..], &[part]].concat();
                let Some(now) = errors(&left_out)? else { continue };
                let tested =
                    self.contradiction(part, [&of_all[..], &now], held_out.as_deref(), &left_out);
                if let Some(contradiction) = tested {
                    next = Some((contradiction, now));
                    break;
                }
            }
            let Some((contradiction, now)) = next else { break };
            found.push(contradiction);
            known = vec![now];
        }
        Ok(found)
    }

    /// Tests a part by the errors of two fits, to `all` parts and `without` those that are left out, and by held-out
    /// errors, if known.
    fn contradiction(
        &self,
        part: usize,
        [all, without]: [&[PerAxis<f64>]; 2],
        held_out: Option<&[PerAxis<f64>]>,
        left_out: &[usize],
    ) -> Option<Contradiction> {
        let usual = self.usual(without, left_out);
        let held_out = held_out.filter(|_| self.others_have_loads_of(part, left_out));
        let exceeds = |axis: Axis| {
            let [all, ratio] = [all, without].map(|errors| self.ratio(&usual, errors, part, axis));
            let is_far_more = |errors: &[PerAxis<f64>]| {
                let usual = self.usual(errors, left_out);
                self.ratio(&usual, errors, part, axis) > FAR_MORE_HELD_OUT
            };
            let is_told = all > FAR_MORE || held_out.is_some_and(is_far_more);
            (is_told && ratio > FAR_MORE).then_some((axis, ratio))
        };
        let worst = self.axes.iter().filter_map(exceeds).max_by(|a, b| a.1.total_cmp(&b.1));
        let (axis, ratio) = worst?;
        let limit = usual.errors.map(|error| FAR_MORE * error);
        Some(Contradiction { part, axis, ratio, limit })
    }

    fn others_have_loads_of(&self, part: usize, left_out: &[usize]) -> bool {
        let others = || (0..self.rows.len()).filter(|other| !left_out.contains(other));
        let has_loads = |axis: Axis| {
            let loads = |part: usize| self.loads[part][axis.index()];
            loads(part) <= LARGER_LOADS * others().map(loads).fold(0.0, f64::max)
        };
        others().map(|other| self.rows[other]).sum::<u64>() >= ROWS_OF_OTHERS * self.rows[part]
            && self.axes.iter().all(has_loads)
    }

    /// Error of a part in multiples of the usual one, absolute or relative, whichever is smaller; zero if negligible.
    fn ratio(&self, usual: &Usual, errors: &[PerAxis<f64>], part: usize, axis: Axis) -> f64 {
        let at = axis.index();
        let (error, load) = (errors[part][at], self.loads[part][at]);
        if error <= NO_ERROR * load || usual.errors[at] <= 0.0 || load <= 0.0 {
            return 0.0;
        }
        (error / usual.errors[at]).min(error / load / usual.relative[at])
    }

    fn usual(&self, errors: &[PerAxis<f64>], left_out: &[usize]) -> Usual {
        let others = || (0..errors.len()).filter(|part| !left_out.contains(part));
        let median = |of: &dyn Fn(usize) -> f64| {
            upper_median(&mut others().map(of).collect::<Vec<f64>>()).unwrap_or_default()
        };
        let relative = |part: usize, axis: usize| match self.loads[part][axis] {
            load if load > 0.0 => errors[part][axis] / load,
            _ => 0.0,
        };
        Usual {
            errors: std::array::from_fn(|axis| median(&|part| errors[part][axis])),
            relative: std::array::from_fn(|axis| median(&|part| relative(part, axis))),
        }
    }

    /// The part with the largest error in multiples of the others', if it is suspicious. Errors relative to loads say
    /// nothing while a part in another unit bends the fit.
    fn worst(&self, errors: &[PerAxis<f64>], left_out: &[usize]) -> Option<usize> {
        let ratio = |part: usize| {
            let usual = self.usual(errors, &[left_out, &[part]].concat()).errors;
            let of_axis = |axis: Axis| match usual[axis.index()] {
                usual if usual > 0.0 => errors[part][axis.index()] / usual,
                _ => 0.0,
            };
            self.axes.iter().map(of_axis).fold(0.0, f64::max)
        };
        let parts = (0..errors.len()).filter(|part| !left_out.contains(part));
        let worst = parts.map(|part| (part, ratio(part))).max_by(|a, b| a.1.total_cmp(&b.1));
        // A part that pulls a fit as much as each of the others errs as many times as much as there are others.
        let others = (errors.len() - left_out.len() - 1) as f64;
        let suspicious = SUSPICIOUS.max(others / 2.0);
        worst.filter(|(_, ratio)| *ratio > suspicious).map(|(part, _)| part)
    }
}

/// The model of `fit`, fitted without some of its logs; `None` if the others do not determine it.
fn without(
    fit: &Fit,
    left_out: &[usize],
    workers: Workers<'_>,
) -> Result<Option<Calibration>, FitError> {
    let others = fit.used.logs.iter().enumerate().filter(|(at, _)| !left_out.contains(at));
    let rest = Dataset { logs: others.map(|(_, log)| log.clone()).collect() };
    match &fit.method {
        FitMethod::Polynomial { solution, solver, truncate } => {
            let options = FitOptions {
                model: solution.model.basis.into(),
                intercept: solution.model.intercept,
                ridge: solution.ridge,
                solver: *solver,
                truncate: *truncate,
                covariance: CovarianceRule::Nothing,
                outliers: OutlierRule::Keep,
                workers,
                ..FitOptions::default()
            };
            match super::fit(rest, Dataset::default(), &options) {
                Ok(fitted) => Ok(Some(fitted.calibration)),
                Err(FitError::Interrupted) => Err(FitError::Interrupted),
                Err(_) => Ok(None),
            }
        }
        FitMethod::Physics(physics) => {
            let kept: BTreeSet<String> = GroupedRows::from_labels(&rest).1.into_iter().collect();
            let labels = GroupedRows::from_labels(&fit.used).1;
            let numbered = (0..).zip(labels).filter(|(_, label)| !kept.contains(label));
            let groups: BTreeSet<u64> = numbered.map(|(number, _)| number).collect();
            let model = PhysicsCalibration::new(physics.choice.without(&groups), [1.0; 6]);
            Ok(Some(Calibration::from_kind(Kind::Physics(Box::new(model)))))
        }
    }
}
