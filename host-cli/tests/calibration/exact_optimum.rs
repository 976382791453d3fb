//! The fit against the exact least-squares optimum. Every `f64` is a dyadic rational, so the normal
//! equations can be solved in rational arithmetic, without rounding.

use calibration::Calibration;
use calibration::model::{Basis, Model};
use calibration::scaling::Scaling;
use calibration::solver::{self, FitProblem, SolverKind};
use num_bigint::BigInt;
use num_rational::BigRational;
use shell_data::block::Block;

/// Rows of the lab's training recording: time, eight readings, six components of the wrench.
fn recording() -> Block {
    let path = system_tests::real_recording("skinproc/behavior4_2Hz.csv");
    let text = std::fs::read_to_string(path).unwrap();
    let mut columns = vec![Vec::new(); 15];
    for line in text.lines() {
        for (column, field) in columns.iter_mut().zip(line.split(',')) {
            column.push(field.parse().unwrap());
        }
    }
    let wrench = columns.split_off(9);
    let readings = columns.split_off(1);
    Block { rows: readings[0].len(), readings, wrench, ..Block::default() }
}

fn exact(value: f64) -> BigRational {
    BigRational::from_float(value).unwrap()
}

/// Number of bits after the binary point that represent every component of a wrench exactly.
const BITS: u32 = 80;

/// Features and wrench as whole numbers, the latter in units of 2^-[`BITS`].
fn integers(block: &Block, model: Model) -> (Vec<Vec<BigInt>>, Vec<Vec<BigInt>>) {
    let terms = model.terms();
    let features = terms.iter().map(|term| {
        let value = |row: usize| {
            let factors = term.factors().iter().map(|&c| block.readings[usize::from(c)][row]);
            factors.map(|s| BigInt::from(s as i64)).product()
        };
        (0..block.rows).map(value).collect()
    });
    let scaled = |w: &f64| {
        let scaled = exact(*w) * BigRational::from_integer(BigInt::from(1) << BITS);
        assert!(scaled.is_integer(), "a component of the wrench finer than 2^-{BITS}");
        scaled.to_integer()
    };
    let wrench = block.wrench.iter().map(|axis| axis.iter().map(scaled).collect());
    (features.collect(), wrench.collect())
}

fn dot(a: &[BigInt], b: &[BigInt]) -> BigInt {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Returns the smallest possible sum of squared residuals, by Bareiss's fraction-free elimination
/// of the Gram matrix of `[X | w]`: its last pivot over the one before is the Schur complement.
fn optimum(features: &[Vec<BigInt>], wrench: &Vec<BigInt>) -> BigRational {
    let columns: Vec<&Vec<BigInt>> = features.iter().chain([wrench]).collect();
    let n = columns.len();
    let mut gram: Vec<Vec<BigInt>> =
        columns.iter().map(|a| columns.iter().map(|b| dot(a, b)).collect()).collect();
    let mut previous = BigInt::from(1);
    for k in 0..n - 1 {
        let pivot = gram[k][k].clone();
        assert_ne!(pivot, BigInt::ZERO, "full rank");
        for i in k + 1..n {
            for j in k + 1..n {
                gram[i][j] = (&gram[i][j] * &pivot - &gram[i][k] * &gram[k][j]) / &previous;
            }
        }
        previous = pivot;
    }
    BigRational::new(gram[n - 1][n - 1].clone(), previous << (2 * BITS))
}

/// Returns the exact sum of squared residuals of a calibration, per axis.
fn residual(block: &Block, calibration: &Calibration) -> Vec<BigRational> {
    let polynomial = calibration.polynomial().unwrap();
    let terms = polynomial.model().terms();
    let scaling = polynomial.scaling();
    let mut sums = vec![exact(0.0); 6];
    for row in 0..block.rows {
        let z: Vec<BigRational> = (0..block.readings.len())
            .map(|c| {
                let shifted = exact(block.readings[c][row]) - exact(scaling.centre[c]);
                shifted / exact(scaling.scale[c])
            })
            .collect();
        let features: Vec<BigRational> = terms
            .iter()
            .map(|term| term.factors().iter().map(|&c| &z[usize::from(c)]).product())
            .collect();
        for (axis, sum) in sums.iter_mut().enumerate() {
            let predicted: BigRational = std::iter::zip(&features, &polynomial.coefficients)
                .map(|(x, c)| x * exact(c[axis]))
                .sum();
            let error = predicted - exact(block.wrench[axis][row]);
            *sum += &error * &error;
        }
    }
    sums
}

/// Converts by way of a quotient of about 64 bits.
fn to_f64(value: &BigRational) -> f64 {
    let shift = 64 + value.denom().bits() as i64 - value.numer().bits() as i64;
    let quotient: BigInt = if shift >= 0 {
        (value.numer() << shift) / value.denom()
    } else {
        value.numer() / (value.denom() << -shift)
    };
    i128::try_from(quotient).unwrap() as f64 * 2f64.powi(-shift as i32)
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn residuals_on_a_real_recording_equal_those_of_the_exact_optimum() {
    let block = recording();
    for intercept in [false, true] {
        let model = Model { basis: Basis::Cubic, intercept, channels: 8, memory: 0 };
        let scaling = Scaling::from_sample(&block.readings, intercept);
        let problem = FitProblem { model, scaling, ridge: 0.0 };
        let (solution, ranges) = solver::fit(SolverKind::Tsqr, problem, &(&block).into()).unwrap();
        let calibration = Calibration::from_solution(&solution, &ranges);
        let (features, wrench) = integers(&block, model);
        let reached = residual(&block, &calibration);
        for (axis, (wrench, reached)) in wrench.iter().zip(&reached).enumerate() {
            let optimum = optimum(&features, wrench);
            // The exact relative excess of the sum of squares over its minimum.
            let excess = to_f64(&((reached - &optimum) / &optimum));
            let rms = (to_f64(&optimum) / block.rows as f64).sqrt();
            println!("{} axis {axis}: optimum {rms:.12e}, excess {excess:.1e}", model.name());
            assert!(excess >= 0.0, "nothing is better than the optimum");
            // The RMS has half that excess. 1e-9 would do; it is of second order in the rounding of
            // the coefficients, and measured 1e-22.
            assert!(excess / 2.0 < 1e-18, "{} axis {axis}: {excess:e}", model.name());
            let told = solution.residual_products[(axis, axis)];
            assert!((told / to_f64(reached) - 1.0).abs() < 1e-9);
        }
    }
}
