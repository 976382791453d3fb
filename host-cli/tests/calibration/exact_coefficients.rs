//! The exact solver against independent rational solutions.

use std::cell::Cell;

use calibration::exact::{Accumulator, ExactFit, ExactSums};
use calibration::model::{Basis, Model};
use calibration::scaling::Scaling;
use proptest::prelude::*;
use proptest::test_runner::TestRunner;

use crate::rational::{Rows, relative_errors, solve};

/// Half a unit in the last place is 1.1e-16.
const NEAREST: f64 = 1.2e-16;

fn moments(rows: &Rows, basis: Basis) -> ExactSums {
    let mut accumulator = Accumulator::new(basis, rows.readings.len());
    accumulator.absorb(&rows.readings, &rows.wrench).unwrap();
    accumulator.finish().unwrap()
}

fn worst(rows: &Rows, model: &Model, fit: &ExactFit) -> f64 {
    let exact = solve(rows, model, &fit.solution.scaling.centre, &fit.solution.scaling.scale);
    let computed: Vec<[f64; 6]> =
        fit.coefficients.iter().map(|row| row.map(|c| c.to_f64())).collect();
    let worst = relative_errors(&computed, &exact).into_iter().flatten().fold(0.0, f64::max);
    println!("{}: condition {:.1e}, worst error {worst:.2e}", model.name(), fit.solution.condition);
    worst
}

fn worst_of(rows: &Rows, basis: Basis, intercept: bool) -> f64 {
    let model = Model { basis, intercept, channels: rows.readings.len(), memory: 0 };
    let fit = moments(rows, basis).solve(&model, 0.0).unwrap();
    worst(rows, &model, &fit)
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn every_model_of_a_real_recording_has_coefficients_right_to_the_last_place() {
    let rows = Rows::recorded("skinproc/behavior4_2Hz.csv");
    for intercept in [true, false] {
        for basis in Basis::ALL {
            assert!(worst_of(&rows, basis, intercept) <= NEAREST);
        }
    }
}

#[test]
fn synthetic_readings_of_any_width_have_coefficients_right_to_the_last_place() {
    let sets = [(1, 8, 1.0), (2, 12, 0.3), (3, 12, 1.0), (4, 16, 0.01), (5, 16, 1.0)];
    for (seed, bits, spread) in sets {
        let rows = Rows::synthetic(seed, 700, 8, bits, spread);
        for intercept in [true, false] {
            for basis in [Basis::Linear, Basis::Cubic, Basis::Quadratic] {
                assert!(worst_of(&rows, basis, intercept) <= NEAREST, "{bits} bits");
            }
        }
    }
}

#[test]
fn all_products_of_three_synthetic_readings_too() {
    for (seed, bits) in [(6, 12), (7, 16)] {
        let rows = Rows::synthetic(seed, 600, 5, bits, 0.5);
        assert!(worst_of(&rows, Basis::Poly3, true) <= NEAREST, "{bits} bits");
    }
}

#[test]
fn readings_in_sixteenths_of_a_count_are_as_exact_as_whole_ones() {
    // Averages of sixteen conversions have such values.
    for (seed, intercept) in [(10, true), (11, false)] {
        let whole = Rows::synthetic(seed, 700, 4, 16, 0.6);
        let mut rows = whole.clone();
        rows.readings.iter_mut().flatten().for_each(|s| *s /= 16.0);
        for basis in Basis::ALL {
            let model = Model { basis, intercept, channels: 4, memory: 0 };
            let mut fit = moments(&rows, basis).solve(&model, 0.0).unwrap();
            // The rational solution needs whole readings: times 16, they have the same features.
            let Scaling { centre, scale } = &mut fit.solution.scaling;
            centre.iter_mut().chain(scale).for_each(|s| *s *= 16.0);
            assert!(worst(&whole, &model, &fit) <= NEAREST);
        }
    }
}

#[test]
fn nearly_equal_channels_are_no_obstacle() {
    // The second channel differs from the first by a count or so in a few rows.
    let mut rows = Rows::synthetic(8, 500, 4, 12, 0.5);
    let first = rows.readings[0].clone();
    rows.readings[1] = first.iter().enumerate().map(|(i, s)| s + f64::from(i % 97 == 0)).collect();
    rows.readings[1][3] += 2.0;
    rows.readings[1][4] -= 1.0;
    rows.readings[1][9] += 3.0;
    for basis in [Basis::Linear, Basis::Cubic] {
        assert!(worst_of(&rows, basis, true) <= NEAREST);
    }
}

#[test]
fn residuals_and_variance_agree_with_exact_arithmetic() {
    let rows = Rows::synthetic(9, 400, 3, 10, 0.7);
    let model = Model { basis: Basis::Quadratic, intercept: true, channels: 3, memory: 0 };
    let moments = moments(&rows, Basis::Quadratic);
    let fit = moments.solve(&model, 0.0).unwrap().solution;
    let Scaling { centre, scale } = &fit.scaling;
    let (residuals, total) = solve(&rows, &model, centre, scale).residuals();
    for a in 0..6 {
        for b in 0..6 {
            // Sums that cancel by eight digits at most, in arithmetic of thirty.
            let tolerance = 1e-15 * (residuals[a][a] * residuals[b][b]).sqrt();
            assert!((fit.residual_products[(a, b)] - residuals[a][b]).abs() <= tolerance);
        }
        let total_square = moments.total_square(a);
        assert!((total_square / total[a] - 1.0).abs() <= 3e-16);
        let r_squared = 1.0 - fit.residual_products[(a, a)] / total_square;
        assert!((r_squared - (1.0 - residuals[a][a] / total[a])).abs() <= 3e-16);
    }
}

#[test]
fn random_problems_are_solved_to_the_last_place() {
    let shape = (any::<u64>(), 1usize..5, 4u32..17, 0.02..1.0_f64, any::<bool>());
    let (posed, solved) = (Cell::new(0), Cell::new(0));
    let case = |(seed, channels, bits, spread, intercept)| {
        let rows = Rows::synthetic(seed, 150, channels, bits, spread);
        for basis in Basis::ALL {
            let model = Model { basis, intercept, channels, memory: 0 };
            posed.update(|count| count + 1);
            let Ok(fit) = moments(&rows, basis).solve(&model, 0.0) else { continue };
            solved.update(|count| count + 1);
            prop_assert!(worst(&rows, &model, &fit) <= NEAREST);
        }
        Ok(())
    };
    let config = ProptestConfig { source_file: Some(file!()), ..ProptestConfig::with_cases(60) };
    TestRunner::new(config).run(&shape, case).unwrap();
    // Readings of few bits leave fewer different rows than features, which is refused.
    assert!(4 * solved.get() >= 3 * posed.get(), "{} of {}", solved.get(), posed.get());
}
