//! The eleven linear regressions of NIST's Statistical Reference Datasets.

use calibration::double_double::DoubleDouble;
use calibration::methods::SolverKind;
use faer::Mat;
use num_rational::BigRational;

use super::exact;
use super::problem::{ALL_DIGITS, METHODS, Problem, digits};
use super::report;

#[derive(Clone, Copy)]
enum Right {
    /// Powers of x from 0.
    Polynomial(usize),
    Proportional,
    Columns,
}

const SETS: [(&str, &str, Right); 11] = [
    ("norris", include_str!("strd/norris.csv"), Right::Polynomial(1)),
    ("pontius", include_str!("strd/pontius.csv"), Right::Polynomial(2)),
    ("noint1", include_str!("strd/noint1.csv"), Right::Proportional),
    ("noint2", include_str!("strd/noint2.csv"), Right::Proportional),
    ("filip", include_str!("strd/filip.csv"), Right::Polynomial(10)),
    ("longley", include_str!("strd/longley.csv"), Right::Columns),
    ("wampler1", include_str!("strd/wampler1.csv"), Right::Polynomial(5)),
    ("wampler2", include_str!("strd/wampler2.csv"), Right::Polynomial(5)),
    ("wampler3", include_str!("strd/wampler3.csv"), Right::Polynomial(5)),
    ("wampler4", include_str!("strd/wampler4.csv"), Right::Polynomial(5)),
    ("wampler5", include_str!("strd/wampler5.csv"), Right::Polynomial(5)),
];

fn fields(csv: &str) -> Vec<Vec<&str>> {
    csv.lines().skip(1).map(|line| line.split(',').map(str::trim).collect()).collect()
}

/// Returns the columns of `X` and `Y` of a set, with numbers read by `read`.
fn columns<T: Clone>(
    csv: &str,
    right: Right,
    one: T,
    read: impl Fn(&str) -> T,
    product: impl Fn(&T, &T) -> T,
) -> (Vec<Vec<T>>, Vec<T>) {
    let rows = fields(csv);
    let column = |j: usize| -> Vec<T> { rows.iter().map(|row| read(row[j])).collect() };
    let x = column(1);
    let ones = vec![one; rows.len()];
    let features = match right {
        Right::Proportional => vec![x],
        Right::Columns => [ones].into_iter().chain((1..rows[0].len()).map(column)).collect(),
        Right::Polynomial(degree) => {
            let mut powers = vec![ones];
            for _ in 0..degree {
                let last = powers.last().unwrap();
                powers.push(last.iter().zip(&x).map(|(power, x)| product(power, x)).collect());
            }
            powers
        }
    };
    (features, column(0))
}

fn certified(set: &str) -> Vec<BigRational> {
    let lines = include_str!("strd/certified.csv").lines().map(|line| line.split(','));
    let of_set = lines.map(Iterator::collect::<Vec<_>>).filter(|line| line[0] == set);
    of_set.map(|line| exact::decimal(line[2])).collect()
}

#[test]
fn exact_solutions_of_the_decimal_data_are_the_certified_ones() {
    for (name, csv, right) in SETS {
        let one = exact::decimal("1");
        let (x, y) = columns(csv, right, one, exact::decimal, |a, b| a * b);
        let truth = exact::solve(&x, &[y], |_| 1).unwrap().remove(0);
        let certified = certified(name);
        assert_eq!(truth.len(), certified.len(), "{name}");
        for (truth, certified) in truth.iter().zip(&certified) {
            // NIST gives 15 digits; not all last ones are right.
            let error = exact::to_f64(&((certified - truth) / truth)).abs();
            assert!(error < 1e-13, "{name}: {error:e}");
        }
    }
}

#[test]
fn nist_regressions_are_solved_to_thirteen_digits_and_more() {
    let mut lines: Vec<report::Line> =
        METHODS.iter().map(|(name, _)| ((*name).to_owned(), Vec::new())).collect();
    for (name, csv, right) in SETS {
        let read = |text: &str| DoubleDouble::from(text.parse::<f64>().unwrap());
        let (x, y) = columns(csv, right, DoubleDouble::ONE, read, |&a, &b| a * b);
        let (n, p) = (y.len(), x.len());
        let problem = Problem {
            name: name.to_owned(),
            x: Mat::from_fn(n, p, |i, j| x[j][i].to_f64()),
            tails: Some(Mat::from_fn(n, p, |i, j| x[j][i].tail())),
            y: Mat::from_fn(n, 1, |i, _| y[i].to_f64()),
        };
        // Numbers as `f64` reads them, with exact powers.
        let binary = |text: &str| exact::binary(text.parse().unwrap());
        let (x, y) = columns(csv, right, exact::decimal("1"), binary, |a, b| a * b);
        let truth = exact::solve(&x, &[y], |_| 1).unwrap();
        for ((_, method), (label, line)) in METHODS.iter().zip(&mut lines) {
            let digits = problem.solve(*method).ok().map(|s| digits(&s.coefficients, &truth));
            println!("{name} {label}: {digits:?}");
            if *method == SolverKind::WideTsqr {
                // Every digit except the last, which has the final rounding.
                assert!(digits.unwrap() > ALL_DIGITS - 0.4, "{name}: {digits:?}");
            }
            line.push(digits);
        }
    }
    for line in include_str!("strd/others.csv").lines().skip(1) {
        let (tool, digits) = line.split_once(',').unwrap();
        let digits = digits.split(',').map(|d| d.parse().ok()).collect();
        lines.push((tool.to_owned(), digits));
    }
    report::check("strd", &SETS.map(|(name, ..)| name), &lines);
}
