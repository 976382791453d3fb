//! Ten thousand random problems, with condition numbers from 1 to 10¹⁴ and planted losses of rank.

use calibration::methods::{LeastSquaresError, SolverKind};
use faer::Mat;
use system_tests::random::Random;

use super::problem::{METHODS, Problem, error, theory};

/// Whole number of at most `bits` bits, either sign.
pub(crate) fn integer(random: &mut Random, bits: u32) -> f64 {
    let range = 1_i64 << bits;
    ((random.next() >> 8) as i64 % (2 * range + 1) - range) as f64
}

fn below(random: &mut Random, n: usize) -> usize {
    random.below(n as u64) as usize
}

fn matrix(random: &mut Random, rows: usize, columns: usize) -> Mat<f64> {
    Mat::from_fn(rows, columns, |_, _| 2.0 * random.unit() - 1.0)
}

/// `U·S·Vᵀ` with singular values from 1 down to 1/`condition`, elements multiples of 2⁻⁵⁰.
fn conditioned(random: &mut Random, rows: usize, columns: usize, condition: f64) -> Mat<f64> {
    let u = matrix(random, rows, columns).qr().compute_thin_Q();
    let v = matrix(random, columns, columns).qr().compute_thin_Q();
    let share = |j: usize| if columns > 1 { j as f64 / (columns - 1) as f64 } else { 0.0 };
    let scaled = Mat::from_fn(rows, columns, |i, j| u[(i, j)] * condition.powf(-share(j)));
    let product = scaled * v.transpose();
    Mat::from_fn(rows, columns, |i, j| grid(product[(i, j)]))
}

fn grid(value: f64) -> f64 {
    (value * 2f64.powi(50)).round() * 2f64.powi(-50)
}

fn problem(random: &mut Random) -> Problem {
    let columns = 1 + below(random, 6);
    let rows = columns + below(random, 12);
    let condition = 10f64.powf(14.0 * random.unit());
    let x = conditioned(random, rows, columns, condition);
    let noise = 10f64.powf(-12.0 * random.unit());
    let c = matrix(random, columns, 2);
    let (fitted, off) = (&x * c, matrix(random, rows, 2));
    let y = Mat::from_fn(rows, 2, |i, a| grid(fitted[(i, a)] + noise * off[(i, a)]));
    Problem::new(format!("{rows} × {columns}, condition {condition:.1e}"), x, y)
}

/// A problem in which one column is an exact combination of one or two others, or zero.
fn deficient(random: &mut Random) -> Problem {
    let columns = 2 + below(random, 6);
    let rows = columns + 1 + below(random, 12);
    let mut x = Mat::from_fn(rows, columns, |_, _| integer(random, 20));
    let (target, a, b) = (below(random, columns), below(random, columns), below(random, columns));
    let (f, g) = (integer(random, 3), integer(random, 3));
    for i in 0..rows {
        let combination =
            if a == target || b == target { 0.0 } else { f * x[(i, a)] + g * x[(i, b)] };
        x[(i, target)] = combination;
    }
    let y = Mat::from_fn(rows, 2, |_, _| integer(random, 20));
    Problem::new(format!("{rows} × {columns}, column {target} dependent"), x, y)
}

/// Problems of full rank, without planted losses.
const PROBLEMS: usize = 10_000;

#[test]
fn ten_thousand_random_problems_have_the_digits_of_theory_or_are_refused() {
    let mut random = Random(2024);
    let mut worst = METHODS.map(|_| 0.0_f64);
    let mut answered = METHODS.map(|_| 0);
    let mut hardest = METHODS.map(|_| 0.0_f64);
    for _ in 0..PROBLEMS {
        let problem = problem(&mut random);
        let name = &problem.name;
        // Rounding to the grid may make columns of condition 10¹⁴ dependent, though it never has.
        let truth = problem.truth().expect("independent columns");
        let widest = problem.solve(SolverKind::WideTsqr).unwrap_or_else(|e| panic!("{name}: {e}"));
        let norms = problem.norms();
        for (k, (label, method)) in METHODS.iter().enumerate() {
            match problem.solve(*method) {
                Ok(solved) => {
                    assert!(solved.coefficients.is_all_finite() && solved.factor.is_all_finite());
                    assert_eq!(solved.rank, problem.x.ncols(), "{name}, {label}");
                    let error = error(&solved.coefficients, &truth, &norms);
                    worst[k] = worst[k].max(error / theory(*method, &problem, &widest));
                    answered[k] += 1;
                    hardest[k] = hardest[k].max(solved.condition);
                }
                Err(LeastSquaresError::IllConditioned { limit }) => {
                    assert!(widest.condition > 0.5 * limit, "{name}, {label}: {limit:e}");
                }
                Err(error) => panic!("{name}, {label}: {error}"),
            }
        }
    }
    for (k, (label, _)) in METHODS.iter().enumerate() {
        println!(
            "{label}: {} of {PROBLEMS} answered, condition up to {:.1e}, error at most {:.2} times theory",
            answered[k], hardest[k], worst[k]
        );
        // The constants of the theory are small polynomials in the number of columns, six at most.
        assert!(worst[k] < 20.0, "{label}");
    }
    assert_eq!(answered[6], PROBLEMS);
}

#[test]
fn a_loss_of_rank_is_found_among_many_rows_and_columns() {
    let mut random = Random(2026);
    for (rows, columns) in [(300_000, 5), (20_000, 45)] {
        let mut x = Mat::from_fn(rows, columns, |_, _| integer(&mut random, 20));
        for i in 0..rows {
            x[(i, 3)] = x[(i, 1)] - 3.0 * x[(i, 4)];
        }
        let y = Mat::from_fn(rows, 1, |_, _| integer(&mut random, 20));
        let problem = Problem::new(format!("{rows} × {columns}"), x, y);
        match problem.solve(SolverKind::Tsqr) {
            Err(LeastSquaresError::RankDeficient { rank, .. }) => assert_eq!(rank, columns - 1),
            other => panic!("{rows} × {columns}: {other:?}"),
        }
    }
}

#[test]
fn every_planted_loss_of_rank_is_found() {
    let mut random = Random(2025);
    for _ in 0..1_000 {
        let problem = deficient(&mut random);
        assert!(problem.truth().is_none());
        for (label, method) in METHODS {
            let name = &problem.name;
            match problem.solve(method) {
                Err(LeastSquaresError::RankDeficient { rank, columns, null_space, .. }) => {
                    assert_eq!(rank, columns - 1, "{name}, {label}");
                    assert!(null_space.is_all_finite());
                }
                // Normal equations cannot decide, and report it.
                Err(LeastSquaresError::IllConditioned { .. })
                    if matches!(method, SolverKind::Gram | SolverKind::WideGram) => {}
                other => panic!("{name}, {label}: {other:?}"),
            }
        }
    }
}
