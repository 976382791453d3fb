//! Benchmark of every solver on the same rows: run time against error.
//!
//! Errors are relative to a solution in extended precision: Householder QR in double-double,
//! [`SolverKind::WideTsqr`]. Apart from the features, it shares no step with the solvers under test. Its own
//! error is at most κ²·2⁻¹⁰⁴, far below the resolution of an `f64` for every condition number κ that a
//! calibration can have; certified problems confirm this. If it would take minutes, the reference is refined
//! QR instead, which stops when its gradient in double-double has converged.
//!
//! Rows are held in memory, so that reading them is not timed, and processed on one thread. Ridge by cross-validation
//! and Huber's estimator solve other problems than least squares, so they have a run time here but no error.

use std::time::Instant;

use faer::{Mat, MatRef};

use calibration::features::Features;
use calibration::scaling::Scaling;
use calibration::solver::{self, FitProblem, Solution, SolverKind};
use calibration::{Basis, FitError, Model};
use shell_data::block::Block;
use shell_data::statistics::upper_median;

/// The smallest error that an `f64` can show: smaller ones count as this.
pub const SMALLEST_ERROR: f64 = f64::EPSILON / 2.0;
/// Work of a triangular factorisation, rows × columns², above which the reference is refined QR.
const MOST_WIDE_WORK: f64 = 5e9;
/// Repetitions stop after this time or this number, whichever comes first, but run at least once.
const BUDGET_S: f64 = 1.0;
const MOST_REPETITIONS: usize = 9;

#[derive(Clone, Debug)]
pub struct ModelBench {
    pub model: String,
    pub features: usize,
    pub rows: usize,
    /// Condition number of the features, with columns scaled to norm one.
    pub condition: f64,
    pub reference: &'static str,
    pub solvers: Vec<Measurement>,
}

#[derive(Clone, Debug)]
pub struct Measurement {
    pub solver: &'static str,
    /// Median of the repetitions, s, from readings to coefficients; NaN if it was left out.
    pub seconds: f64,
    pub coefficient_error: Option<f64>,
    /// The largest error of a predicted row, relative to the RMS of its axis.
    pub prediction_error: Option<f64>,
    /// True if no other solver is both faster and more accurate in its coefficients.
    pub on_front: bool,
    pub refused: Option<String>,
}

pub fn walk<'a>(
    blocks: &'a [Block],
    bases: &'a [Basis],
    intercept: bool,
    kinds: &'a [SolverKind],
) -> impl Iterator<Item = (Model, Result<ModelBench, FitError>)> + 'a {
    let channels = blocks.first().map_or(0, |block| block.readings.len());
    bases.iter().map(move |&basis| {
        let model = Model { basis, intercept, channels, memory: 0 };
        (model, bench(blocks, model, kinds))
    })
}

/// A table in Markdown: a line for each solver, with time and error for each model.
pub fn markdown(benches: &[ModelBench]) -> String {
    let mut table = "| solver |".to_owned();
    benches
        .iter()
        .for_each(|bench| table += &format!(" {} ({}) | error |", bench.model, bench.features));
    table += &format!("\n| --- |{}\n", " ---: |".repeat(2 * benches.len()));
    let solvers = benches.first().map_or(&[][..], |bench| &bench.solvers);
    for (i, measurement) in solvers.iter().enumerate() {
        table += &format!("| {} |", measurement.solver);
        for measurement in benches.iter().map(|bench| &bench.solvers[i]) {
            let mark = if measurement.on_front { " *" } else { "" };
            match (&measurement.refused, measurement.coefficient_error) {
                (Some(_), _) => table += " – | – |",
                (None, error) => {
                    let error = error.map_or("–".to_owned(), |error| format!("{error:.1e}"));
                    table += &format!(" {:.2}{mark} | {error} |", 1e3 * measurement.seconds);
                }
            }
        }
        table.push('\n');
    }
    table
}

/// Runs every solver of `kinds` on one model. Fails with [`FitError`] if the rows do not determine the coefficients,
/// even in extended precision.
pub fn bench(blocks: &[Block], model: Model, kinds: &[SolverKind]) -> Result<ModelBench, FitError> {
    let problem = problem(blocks, model)?;
    let rows: usize = blocks.iter().map(|block| block.rows).sum();
    let columns = (model.terms().len() + 6) as f64;
    let is_small = rows as f64 * columns * columns <= MOST_WIDE_WORK;
    let kind = if is_small { SolverKind::WideTsqr } else { SolverKind::RefinedTsqr };
    let reference = solve(blocks, kind, &problem)?;
    let mut solvers: Vec<Measurement> =
        kinds.iter().map(|&kind| measure(blocks, kind, &problem, &reference, is_small)).collect();
    mark_front(&mut solvers);
    Ok(ModelBench {
        model: model.name(),
        features: model.terms().len(),
        rows,
        condition: reference.condition,
        reference: kind.name(),
        solvers,
    })
}

/// The problem that all solvers get: in the basis that the exact solver chooses, so that coefficients are comparable.
/// Fails with [`FitError`] if the rows do not determine the coefficients.
pub fn problem(blocks: &[Block], model: Model) -> Result<FitProblem, FitError> {
    let first = blocks.first().map_or(&[][..], |block| &block.readings);
    let problem =
        FitProblem { model, scaling: Scaling::from_sample(first, model.intercept), ridge: 0.0 };
    match solve(blocks, SolverKind::Exact, &problem) {
        Ok(solution) => Ok(FitProblem { scaling: solution.scaling, ..problem }),
        Err(FitError::NotExact(_)) => Ok(problem),
        Err(error) => Err(error),
    }
}

/// Solves from readings to coefficients; this is the timed part. Fails like [`solver::fit`].
pub fn solve(
    blocks: &[Block],
    kind: SolverKind,
    problem: &FitProblem,
) -> Result<Solution, FitError> {
    solver::fit(kind, problem.clone(), &blocks.into()).map(|(solution, _)| solution)
}

fn measure(
    blocks: &[Block],
    kind: SolverKind,
    problem: &FitProblem,
    reference: &Solution,
    is_small: bool,
) -> Measurement {
    let unmeasured = Measurement {
        solver: kind.name(),
        seconds: f64::NAN,
        coefficient_error: None,
        prediction_error: None,
        on_front: false,
        refused: None,
    };
    if !is_small && kind == SolverKind::WideTsqr {
        let refused = Some("left out: it would take minutes".to_owned());
        return Measurement { refused, ..unmeasured };
    }
    let mut seconds = Vec::new();
    let solved = loop {
        let start = Instant::now();
        let solved = solve(blocks, kind, problem);
        seconds.push(start.elapsed().as_secs_f64());
        if seconds.iter().sum::<f64>() > BUDGET_S || seconds.len() == MOST_REPETITIONS {
            break solved;
        }
    };
    let seconds = upper_median(&mut seconds).expect("it was solved once at least");
    let mut measurement = Measurement { seconds, ..unmeasured };
    let is_least_squares = !matches!(kind, SolverKind::RidgeGcv | SolverKind::Huber);
    match solved {
        Ok(solution) if is_least_squares => {
            let (found, truth) = (&solution.coefficients, &reference.coefficients);
            measurement.coefficient_error = Some(coefficient_error(found, truth));
            let features = Features::new(problem.model, problem.scaling.clone());
            measurement.prediction_error =
                Some(prediction_error(blocks, &features, &(found - truth)));
        }
        Ok(_) => {}
        Err(error) => measurement.refused = Some(error.to_string()),
    }
    measurement
}

/// `max |c − truth| / |truth|`.
fn coefficient_error(found: &Mat<f64>, truth: &Mat<f64>) -> f64 {
    let pairs = found.col_iter().zip(truth.col_iter()).flat_map(|(f, t)| f.iter().zip(t.iter()));
    let relative = pairs.map(|(found, truth)| match (found - truth).abs() {
        0.0 => 0.0,
        error => error / truth.abs().max(f64::MIN_POSITIVE),
    });
    relative.fold(SMALLEST_ERROR, f64::max)
}

/// Largest `|X·ΔC|` over the rows, each axis in units of its RMS.
fn prediction_error(blocks: &[Block], features: &Features, difference: &Mat<f64>) -> f64 {
    const ROWS: usize = 512;
    let mut largest = [0.0_f64; 6];
    let mut squares = [0.0_f64; 6];
    for block in blocks {
        for (sum, axis) in squares.iter_mut().zip(&block.wrench) {
            *sum += axis.iter().map(|w| w * w).sum::<f64>();
        }
        for start in (0..block.rows).step_by(ROWS) {
            let rows = start..block.rows.min(start + ROWS);
            let (count, width) = (rows.len(), features.len());
            let mut columns = vec![0.0; ROWS * width];
            features.fill(&block.readings, rows, &mut columns, ROWS);
            let columns = MatRef::from_column_major_slice_with_stride(&columns, count, width, ROWS);
            let errors = columns * difference;
            for (largest, errors) in largest.iter_mut().zip(errors.col_iter()) {
                *largest = errors.iter().fold(*largest, |l, e| l.max(e.abs()));
            }
        }
    }
    let rows: usize = blocks.iter().map(|block| block.rows).sum();
    let relative = largest.iter().zip(squares).map(|(&largest, squares)| match largest {
        0.0 => 0.0,
        largest => largest / (squares / rows as f64).sqrt().max(f64::MIN_POSITIVE),
    });
    relative.fold(SMALLEST_ERROR, f64::max)
}

fn mark_front(solvers: &mut [Measurement]) {
    let point = |m: &Measurement| m.coefficient_error.map(|error| (m.seconds, error));
    let points: Vec<(f64, f64)> = solvers.iter().filter_map(point).collect();
    solvers
        .iter_mut()
        .for_each(|m| m.on_front = point(m).is_some_and(|own| is_on_front(own, &points)));
}

/// True if none of these points of time and error is better in one and no worse in the other.
fn is_on_front((seconds, error): (f64, f64), points: &[(f64, f64)]) -> bool {
    let beats = |&(s, e): &(f64, f64)| (s < seconds && e <= error) || (s <= seconds && e < error);
    !points.iter().any(beats)
}

#[cfg(test)]
mod tests {
    use system_tests::random::Random;

    use super::*;

    fn measured(seconds: f64, error: Option<f64>) -> Measurement {
        Measurement {
            solver: "any",
            seconds,
            coefficient_error: error,
            prediction_error: error,
            on_front: false,
            refused: None,
        }
    }

    #[test]
    fn the_front_has_the_solvers_that_none_beats_in_both_time_and_error() {
        let mut solvers = [
            measured(1.0, Some(1e-9)),
            measured(2.0, Some(1e-16)),
            measured(3.0, Some(1e-12)),
            measured(4.0, Some(1e-16)),
            measured(0.5, None),
        ];
        mark_front(&mut solvers);
        assert_eq!(solvers.map(|m| m.on_front), [true, true, false, false, false]);
    }

    #[test]
    fn least_squares_solvers_agree_with_the_reference_and_the_exact_one_to_every_digit() {
        let mut random = Random(1);
        let mut random = || random.bits(12) as f64;
        let mut columns = |n: usize| -> Vec<Vec<f64>> {
            (0..n).map(|_| (0..700).map(|_| random()).collect()).collect()
        };
        let block =
            Block { rows: 700, readings: columns(3), wrench: columns(6), ..Block::default() };
        let model = Model { basis: Basis::Poly3, intercept: true, channels: 3, memory: 0 };
        let bench = bench(&[block], model, &SolverKind::ALL).unwrap();
        for m in &bench.solvers {
            assert_eq!(m.refused, None);
            let (Some(coefficients), Some(prediction)) = (m.coefficient_error, m.prediction_error)
            else {
                assert!(["ridge-gcv", "huber"].contains(&m.solver));
                continue;
            };
            // Well-conditioned features; small coefficients lose a few more digits.
            assert!(coefficients < 1e-9 && prediction < 1e-12, "{m:?}");
            if ["exact", "refined-tsqr", "wide-gram", "wide-tsqr"].contains(&m.solver) {
                // Rounding in the last place, either way.
                assert!(coefficients <= 2.0 * f64::EPSILON, "{m:?}");
            }
        }
        assert!(markdown(std::slice::from_ref(&bench)).contains("| poly3 + offset (20) | error |"));
    }
}
