//! Identities of a log's least-squares fit, for any numbers.

use calibration::model::{Basis, Model};
use calibration::rank_loss::Dependence;
use calibration::scaling::Scaling;
use calibration::solver::{self, FitProblem, Solution, SolverKind};
use calibration::{Calibration, FitError};
use shell_data::block::Block;
use shell_data::wrench::PerAxis;
use system_tests::random::Random;

/// Pseudo-random whole readings and a noisy wrench, the same on every machine.
fn block(rows: usize) -> Block {
    let mut random = Random(7);
    let mut random = || random.bits(12) as f64;
    let mut columns = |n: usize| -> Vec<Vec<f64>> {
        (0..n).map(|_| (0..rows).map(|_| random()).collect()).collect()
    };
    let readings = columns(8);
    let noise = columns(6);
    let smooth = |row: usize, axis: usize| {
        let z = readings[axis][row] / 4096.0;
        z + z * z - readings[axis + 1][row] / 8192.0
    };
    let wrench = (0..6)
        .map(|axis| (0..rows).map(|row| smooth(row, axis) + 1e-5 * noise[axis][row]).collect())
        .collect();
    Block { rows, readings, wrench, ..Block::default() }
}

fn problem(basis: Basis, intercept: bool, block: &Block) -> FitProblem {
    let model = Model { basis, intercept, channels: block.readings.len(), memory: 0 };
    let scaling = Scaling::from_sample(&block.readings, intercept);
    FitProblem { model, scaling, ridge: 0.0 }
}

fn fit(problem: &FitProblem, block: &Block) -> Result<(Solution, Calibration), FitError> {
    let (solution, ranges) = solver::fit(SolverKind::Tsqr, problem.clone(), &block.into())?;
    let calibration = Calibration::from_solution(&solution, &ranges);
    Ok((solution, calibration))
}

fn reordered(block: &Block, order: &[usize]) -> Block {
    let pick = |columns: &[Vec<f64>]| {
        columns.iter().map(|column| order.iter().map(|&row| column[row]).collect()).collect()
    };
    Block {
        rows: order.len(),
        readings: pick(&block.readings),
        wrench: pick(&block.wrench),
        ..Block::default()
    }
}

#[test]
fn row_order_changes_nothing_but_rounding() {
    let block = block(5000);
    // 5000 and 2377 have no common divisor: every row once.
    let order: Vec<usize> = (0..block.rows).map(|i| i * 2377 % block.rows).collect();
    for basis in Basis::ALL {
        let problem = problem(basis, true, &block);
        let (one, _) = fit(&problem, &block).unwrap();
        let (other, _) = fit(&problem, &reordered(&block, &order)).unwrap();
        let difference = (&one.coefficients - &other.coefficients).norm_max();
        // Backward errors of some 2⁻⁵³·√p, magnified by the condition number.
        let bound = 1e-14 * one.condition * one.coefficients.norm_max();
        assert!(difference < bound, "{basis:?}: {difference:e}, bound {bound:e}");
    }
}

#[test]
fn a_wrench_in_other_units_gives_coefficients_in_other_units_to_the_bit() {
    let block = block(2000);
    let problem = problem(Basis::Quadratic, true, &block);
    let (one, _) = fit(&problem, &block).unwrap();
    for factor in [2f64.powi(-100), 2f64.powi(100)] {
        let mut scaled = block.clone();
        scaled.wrench.iter_mut().flatten().for_each(|w| *w *= factor);
        let (other, _) = fit(&problem, &scaled).unwrap();
        let scaled_back = one.coefficients.as_ref() * faer::Scale(factor);
        let difference = (&other.coefficients - scaled_back).norm_max();
        // Columns are reflected one by one; a power of two changes exponents only.
        assert_eq!(difference, 0.0);
    }
}

#[test]
fn the_raw_export_of_a_fit_evaluates_to_the_same_wrench() {
    let block = block(3000);
    for basis in Basis::ALL {
        for intercept in [false, true] {
            let (_, calibration) = fit(&problem(basis, intercept, &block), &block).unwrap();
            let raw = calibration.polynomial().unwrap().raw_coefficients();
            let mut wrench = PerAxis::default();
            calibration.wrench(&block.readings, &mut wrench);
            for row in (0..block.rows).step_by(100) {
                for axis in 0..6 {
                    let term = |(term, c): (&calibration::model::Term, &PerAxis<f64>)| {
                        let s = |&c: &u8| block.readings[usize::from(c)][row];
                        c[axis] * term.factors().iter().map(s).product::<f64>()
                    };
                    let terms: Vec<f64> = calibration
                        .polynomial()
                        .unwrap()
                        .model()
                        .terms()
                        .iter()
                        .zip(&raw)
                        .map(term)
                        .collect();
                    let largest = terms.iter().fold(0.0, |m: f64, t| m.max(t.abs()));
                    let difference = terms.iter().sum::<f64>() - wrench[axis][row];
                    assert!(difference.abs() < 1e-12 * largest, "{basis:?} {difference:e}");
                }
            }
        }
    }
}

#[test]
fn dependent_channels_are_found_in_every_model_and_none_invented() {
    let full = block(3000);
    for basis in Basis::ALL {
        for intercept in [false, true] {
            let (solution, _) = fit(&problem(basis, intercept, &full), &full).unwrap();
            assert_eq!(solution.rank, solution.coefficients.nrows());

            let mut twice = full.clone();
            twice.readings[6] = twice.readings[1].iter().map(|s| 3.0 * s).collect();
            let error = fit(&problem(basis, intercept, &twice), &twice).unwrap_err();
            let FitError::RankDeficient(loss) = error else { panic!("{error}") };
            let [Dependence::Line { first: 1, second: 6, ratio, offset }] = loss.dependences[..]
            else {
                panic!("{loss}")
            };
            assert!((ratio - 3.0).abs() < 1e-12 && offset.abs() < 1e-8, "{ratio} {offset}");
        }
        let mut still = full.clone();
        still.readings[4].fill(77.0);
        let error = fit(&problem(basis, true, &still), &still).unwrap_err();
        let FitError::RankDeficient(loss) = error else { panic!("{error}") };
        assert_eq!(loss.dependences, [Dependence::Constant { channel: 4, value: 77.0 }]);
    }
}

#[test]
fn channels_one_count_apart_make_a_quadratic_model_singular_and_are_named() {
    // d = s2 − s1 is 0 or 1, so d² = d: a relation among their features.
    let mut block = block(3000);
    block.readings[1] =
        block.readings[0].iter().zip(&block.readings[2]).map(|(s, r)| s + r % 2.0).collect();
    let error = fit(&problem(Basis::Quadratic, true, &block), &block).unwrap_err();
    let FitError::RankDeficient(loss) = error else { panic!("{error}") };
    assert_eq!((loss.rank, loss.features), (44, 45));
    let [Dependence::Combination(shares)] = &loss.dependences[..] else { panic!("{loss}") };
    for (term, _) in shares {
        assert!(term.factors().iter().all(|&channel| channel < 2), "{loss}");
    }
}
