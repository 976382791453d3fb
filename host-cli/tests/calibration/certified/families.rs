//! Families of problems, each hard in its own way.

use calibration::methods::{LeastSquaresError, SolverKind};
use faer::Mat;
use num_rational::BigRational;
use system_tests::random::Random;

use super::exact;
use super::problem::{ALL_DIGITS, METHODS, Problem, digits, error, theory};
use super::random::integer;
use super::report;

/// Whole numbers of up to `bits` bits, either sign.
fn integers(random: &mut Random, rows: usize, columns: usize, bits: u32) -> Mat<f64> {
    Mat::from_fn(rows, columns, |_, _| integer(random, bits))
}

fn vandermonde(degree: usize) -> Problem {
    let mut random = Random(degree as u64);
    let x = Mat::from_fn(41, degree + 1, |i, j| (i as f64 / 64.0 + 0.25).powi(j as i32));
    Problem::new(format!("Vandermonde, degree {degree}"), x, integers(&mut random, 41, 2, 20))
}

fn hilbert(columns: usize) -> Problem {
    let mut random = Random(columns as u64);
    let x = Mat::from_fn(16, columns, |i, j| 1.0 / (i + j + 1) as f64);
    Problem::new(format!("Hilbert, 16 × {columns}"), x, integers(&mut random, 16, 2, 20))
}

/// Läuchli (Numer. Math. 3, 1961): `XᵀX` loses the small numbers.
fn lauchli(exponent: i32) -> Problem {
    let small = 2f64.powi(exponent);
    let x = Mat::from_fn(5, 4, |i, j| match i {
        0 => 1.0,
        _ if i == j + 1 => small,
        _ => 0.0,
    });
    let y = Mat::from_fn(5, 1, |i, _| if i == 0 { 4.0 } else { small * i as f64 });
    Problem::new(format!("Läuchli, 2^{exponent}"), x, y)
}

fn graded() -> Problem {
    let mut random = Random(1);
    let values = integers(&mut random, 60, 9, 30);
    let x = Mat::from_fn(60, 9, |i, j| values[(i, j)] * 10f64.powi(-100 + 25 * j as i32));
    Problem::new("columns graded over 200 decades", x, integers(&mut random, 60, 3, 30))
}

fn nearly_dependent(exponent: i32) -> Problem {
    let mut random = Random(2);
    let values = integers(&mut random, 100, 6, 2);
    let gap = 2f64.powi(exponent);
    let x = Mat::from_fn(100, 5, |i, j| match j {
        4 => values[(i, 3)] + gap * values[(i, 5)],
        _ => values[(i, j)],
    });
    let noise = integers(&mut random, 100, 2, 6);
    let y = Mat::from_fn(100, 2, |i, a| {
        (a + 1) as f64 * values[(i, 0)] - values[(i, 3)] + 2f64.powi(-16) * noise[(i, a)]
    });
    Problem::new(format!("channels that differ by {gap:.0e}"), x, y)
}

fn large_offset() -> Problem {
    let mut random = Random(3);
    let noise = integers(&mut random, 200, 3, 10);
    let x = Mat::from_fn(200, 4, |i, j| if j == 3 { 1.0 } else { 1e12 + noise[(i, j)] });
    Problem::new("offsets of 10¹²", x, integers(&mut random, 200, 2, 16))
}

fn units(name: &str, unit: f64) -> Problem {
    let mut random = Random(4);
    let x = integers(&mut random, 50, 6, 12);
    let y = integers(&mut random, 50, 6, 12);
    Problem::new(name, x, Mat::from_fn(50, 6, |i, a| y[(i, a)] * unit))
}

/// Large rows last, the worst order for an R factor of small ones, or first.
fn row_order(ascending: bool) -> Problem {
    let mut random = Random(5);
    let values = integers(&mut random, 64, 4, 8);
    let size = |i: usize| {
        let step = if ascending { i as i32 } else { 63 - i as i32 };
        2f64.powi(step / 2 - 16) * if i.is_multiple_of(2) { 1.0 } else { -1.0 }
    };
    let x = Mat::from_fn(64, 4, |i, j| values[(i, j)] * size(i));
    let y = integers(&mut random, 64, 2, 8);
    let y = Mat::from_fn(64, 2, |i, a| y[(i, a)] * size(i));
    Problem::new(if ascending { "small rows first" } else { "large rows first" }, x, y)
}

fn subnormal() -> Problem {
    let mut random = Random(6);
    // The smallest of these numbers is 2⁻¹⁰²², next to subnormal ones.
    let unit = f64::from_bits(1 << 44);
    let x = integers(&mut random, 50, 4, 20);
    let y = integers(&mut random, 50, 2, 20);
    let of = |m: Mat<f64>| Mat::from_fn(m.nrows(), m.ncols(), |i, j| m[(i, j)] * unit);
    Problem::new("subnormal numbers", of(x), of(y))
}

fn families() -> Vec<Problem> {
    [5, 8, 11]
        .map(vandermonde)
        .into_iter()
        .chain([4, 6, 8, 10].map(hilbert))
        .chain([-10, -20, -26, -40].map(lauchli))
        .chain([-10, -20, -30, -40, -50].map(nearly_dependent))
        .chain([
            graded(),
            large_offset(),
            units("wrench in tiny units", 2f64.powi(-900)),
            units("wrench in huge units", 2f64.powi(900)),
            row_order(true),
            row_order(false),
            subnormal(),
        ])
        .collect()
}

/// Returns a line of the table; fails on an error above the theory's.
fn line(problem: &Problem, truth: &[Vec<BigRational>]) -> report::Line {
    let widest = problem.solve(SolverKind::WideTsqr);
    let cells = METHODS.iter().map(|(label, method)| {
        let solved = match problem.solve(*method) {
            Ok(solved) => solved,
            Err(LeastSquaresError::IllConditioned { .. }) => return None,
            Err(LeastSquaresError::RankDeficient { .. }) if *method != SolverKind::WideTsqr => {
                return None;
            }
            Err(error) => panic!("{}, {label}: {error}", problem.name),
        };
        let digits = digits(&solved.coefficients, truth);
        println!("{}, {label}: {digits:.1}", problem.name);
        if let Ok(widest) = &widest {
            let error = error(&solved.coefficients, truth, &problem.norms());
            // The theory's constants are polynomials in the number of columns.
            let allowed = 50.0 * theory(*method, problem, widest);
            assert!(error <= allowed, "{}, {label}: {error:e} > {allowed:e}", problem.name);
        }
        Some(digits)
    });
    (problem.name.clone(), cells.collect())
}

#[test]
fn hard_families_get_the_digits_that_theory_promises_or_a_refusal() {
    let mut lines: Vec<report::Line> = families()
        .iter()
        .map(|problem| line(problem, &problem.truth().expect("independent columns")))
        .collect();
    lines.push(repeated_row());
    for (name, digits) in &lines {
        let widest = digits.last().unwrap();
        // Every digit but for the last rounding.
        assert!(widest.is_some_and(|d| d > ALL_DIGITS - 0.4), "{name}: {widest:?}");
    }
    report::check("families", &METHODS.map(|(name, _)| name), &lines);
}

/// A row that a million others repeat: small sums must not drown.
fn repeated_row() -> report::Line {
    const TIMES: usize = 1_000_000;
    let mut random = Random(7);
    let (few_x, few_y) = (integers(&mut random, 12, 3, 10), integers(&mut random, 12, 1, 10));
    let row = |i: usize| i.saturating_sub(TIMES - 1);
    let of = |few: &Mat<f64>| Mat::from_fn(TIMES + 11, few.ncols(), |i, j| few[(row(i), j)]);
    let problem = Problem::new("one row 10⁶ times", of(&few_x), of(&few_y));
    let columns = |m: &Mat<f64>| -> Vec<Vec<BigRational>> {
        let column = |j: usize| (0..12).map(|i| exact::binary(m[(i, j)])).collect();
        (0..m.ncols()).map(column).collect()
    };
    let times = |row: usize| if row == 0 { TIMES as u64 } else { 1 };
    let truth = exact::solve(&columns(&few_x), &columns(&few_y), times).unwrap();
    line(&problem, &truth)
}
