//! The choice of a model where rows cannot be summed exactly.
//!
//! Of the rows of every fold the triangle of a QR factorisation is kept. Those of all other folds, put below each
//! other and factored again, are that of a fit without the fold, whatever the ridge, and its errors on the
//! fold come from the fold's own:
//!
//! ```text
//! ‖X_f·C − W_f‖² = ‖R_f·C − Z_f‖² + ‖E_f‖²
//! ```
//!
//! Nothing is taken away from anything, so nothing cancels, and rows are passed over once a family.

use super::ValidationError;
use super::selection::{ErrorsByRidge, Selection, choose};
use crate::exact::HeldOutErrors;
use crate::features::Features;
use crate::model::{Basis, Model};
use crate::passes::Rows;
use crate::solver::{Centring, triangle};
use crate::triangle::{RFactor, Ridge};
use shell_data::block::Block;
use shell_data::statistics::RunningVariance;
use shell_data::wrench::{Axis, PerAxis};

/// Families of more features than this are left out: a triangle for each fold would take minutes.
const MOST_FEATURES: usize = 400;

/// Compares the families of features, each with `ridges` (and larger ones, as
/// [`select`](super::selection::select) does), by their errors on folds of rows that were held out.
///
/// # Errors
/// [`ValidationError`] if there are too few folds, a row is not finite, or no model can be fitted.
pub fn select(
    folds: &[Block],
    intercept: bool,
    ridges: &[f64],
) -> Result<Selection, ValidationError> {
    let Some(first) = folds.first().filter(|_| folds.len() > 1) else {
        return Err(ValidationError::TooFewGroups { found: folds.len() });
    };
    let channels = first.readings.len();
    let rows = |error| ValidationError::Rows(Box::new(error));
    let centring = Centring { channels, intercept };
    let scaling = centring.scaling(&Rows::from(folds).reduce(&centring).map_err(rows)?);
    let model = |basis| Model { basis, intercept, channels };
    let errors_of = |basis: Basis| -> Result<Option<ErrorsByRidge<'_>>, ValidationError> {
        let model = model(basis);
        if model.term_count() > MOST_FEATURES {
            return Ok(None);
        }
        let features = Features::new(model, scaling.clone());
        let free_column = intercept.then(|| features.len() - 1);
        let triangles: Vec<RFactor> = folds
            .iter()
            .map(|fold| triangle(&features, fold))
            .collect::<Result<_, _>>()
            .map_err(rows)?;
        let rest: Vec<RFactor> =
            (0..triangles.len()).map(|fold| all_but(&triangles, fold)).collect();
        Ok(Some(Box::new(move |lambda| {
            let ridge = Ridge { lambda, free_column };
            let pairs = rest.iter().zip(&triangles);
            Ok(pairs.map(|(rest, fold)| errors_on(fold, rest, ridge)).collect())
        })))
    };
    choose(model, ridges, &variances(folds), errors_of)
}

/// The triangle of the rows of all folds but one.
fn all_but(triangles: &[RFactor], fold: usize) -> RFactor {
    let mut others = triangles.iter().enumerate().filter(|(at, _)| *at != fold).map(|(_, of)| of);
    let mut rest = others.next().cloned().unwrap_or_else(|| RFactor::new(0, 0));
    others.for_each(|other| rest.merge(other));
    rest
}

/// The errors on a fold of the fit to the rest; `None` where that cannot be.
fn errors_on(fold: &RFactor, rest: &RFactor, ridge: Ridge) -> Option<PerAxis<HeldOutErrors>> {
    let coefficients = rest.solve(ridge).ok()?.coefficients;
    let products = fold.residual_products(coefficients.as_ref());
    let sums = ridge.free_column.map(|ones| fold.sums_of_residuals(coefficients.as_ref(), ones));
    Some(std::array::from_fn(|axis| HeldOutErrors {
        rows: fold.rows(),
        sum: sums.as_ref().map_or(0.0, |sums| sums[axis]),
        squares: products[(axis, axis)],
    }))
}

fn variances(folds: &[Block]) -> PerAxis<f64> {
    Axis::ALL.map(|axis| {
        let mut all = RunningVariance::default();
        for fold in folds {
            all.merge(&RunningVariance::of(&fold.wrench[axis.index()]));
        }
        all.squares / all.count.max(1) as f64
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::validation::grouped::{Apart, GroupSums, RandomSplit};
    use crate::validation::selection;
    use system_tests::random::Random;

    /// Uniform numbers from −1 to 1.
    fn noise(i: usize) -> f64 {
        2.0 * Random(i as u64).unit() - 1.0
    }

    /// The same rows by exact sums: seven groups, which are the folds.
    #[test]
    fn errors_are_those_that_exact_sums_tell() {
        let fold = |group: usize| -> Block {
            let rows = 40 + group;
            let of = |column: usize, row: usize| noise(group * 4000 + row * 31 + column);
            let reading =
                |c: usize| (0..rows).map(|row| (1500.0 + 700.0 * of(c, row)).round()).collect();
            let readings: Vec<Vec<f64>> = (0..3).map(reading).collect();
            let load = |axis: usize, row: usize| {
                let s = |c: usize| (readings[c][row] - 1500.0) / 700.0;
                s(axis % 3) + 0.3 * s(0) * s(2) - 0.2 * s(1).powi(3) + 0.1 * of(9 + axis, row)
            };
            let wrench =
                (0..6).map(|axis| (0..rows).map(|row| load(axis, row)).collect()).collect();
            let groups = vec![(group.to_string(), rows)];
            Block { rows, wrench, readings, groups, ..Block::default() }
        };
        let folds: Vec<Block> = (0..7).map(fold).collect();
        let mut sums = GroupSums::new(Basis::Poly3, 3, Apart::Groups, RandomSplit::default());
        let mut worker = sums.worker();
        for fold in &folds {
            sums.add(worker.add(fold, &fold.groups).unwrap()).unwrap();
        }
        let sums = sums.finish([worker]).unwrap();
        let ridges = [0.0, 1e-6, 1e-2];
        let exact = selection::select(&sums, true, &ridges).unwrap();
        let found = select(&folds, true, &ridges).unwrap();
        assert_eq!((found.folds, found.best, found.chosen), (7, exact.best, exact.chosen));
        assert_eq!(found.candidates.len(), exact.candidates.len());
        for (found, exact) in found.candidates.iter().zip(&exact.candidates) {
            let (found, exact) = (found.errors.unwrap(), exact.errors.unwrap());
            // Condition numbers below 100 in double precision.
            assert!((found.score / exact.score - 1.0).abs() < 1e-9, "{found:?} {exact:?}");
            assert!((found.standard_error / exact.standard_error - 1.0).abs() < 1e-7);
            let pairs = found.rms.iter().zip(exact.rms);
            assert!(pairs.clone().all(|(a, b)| (a / b - 1.0).abs() < 1e-9), "{found:?} {exact:?}");
        }
        let few = select(&folds[..1], true, &ridges).unwrap_err();
        assert_eq!(few, ValidationError::TooFewGroups { found: 1 });
    }
}
