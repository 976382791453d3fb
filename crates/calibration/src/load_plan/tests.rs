use std::num::NonZeroU64;

use faer::Mat;
use system_tests::random::Random;

use super::planner::observe as observe_load;
use super::*;
use least_squares::passes::Workers;
use sensor_physics::cholesky::diagonal;
use sensor_physics::response::{Parameters, Response};
use sensor_physics::{Inversion, Observation, PhysicsModel};
use shell_data::wrench::PerAxis;

fn load(random: &mut Random) -> PerAxis<f64> {
    std::array::from_fn(|axis| (2.0 * random.unit() - 1.0) * if axis < 3 { 5.0 } else { 0.2 })
}

fn loads(count: usize, seed: u64) -> Vec<PerAxis<f64>> {
    let mut random = Random(seed);
    (0..count).map(|_| load(&mut random)).collect()
}

/// Parameters of eight sensors, each sensitive to a different direction.
fn parameters(sensor: usize) -> Parameters {
    let mut random = Random(77 + sensor as u64);
    let mut gain = || 2.4 * random.unit() - 1.2;
    let [fx, fy, fz, mx, my, mz] = std::array::from_fn(|_| gain());
    [0.15 * sensor as f64 - 0.5, fx, fy, fz, mx, my, mz, 0.0, 0.0, 0.1]
}

/// Readings of these sensors, with noise of this many counts on 1000.
fn observe(group: u64, wrench: PerAxis<f64>, noise: f64, random: &mut Random) -> Observation {
    let scale = [2.9, 2.9, 2.9, 0.115, 0.115, 0.115];
    let x: PerAxis<f64> = std::array::from_fn(|axis| wrench[axis] / scale[axis]);
    let reading = |sensor: usize| 1000.0 * Response::at(&parameters(sensor), &x).value;
    let readings = (0..8).map(|sensor| reading(sensor) + noise * random.normal()).collect();
    Observation { group, wrench, readings }
}

#[test]
fn an_observation_adds_its_information() {
    let mut covariance = diagonal([2.0, 0.5]);
    observe_load(&mut covariance, &[1.0, 3.0], 4.0);
    // The inverse of (1/2, 2) on the diagonal plus (1, 3)(1, 3)ᵀ/4, by hand.
    let (a, b, c): (f64, f64, f64) = (0.5 + 0.25, 0.75, 2.0 + 2.25);
    let determinant = a * c - b * b;
    for (found, expected) in
        covariance.as_flattened().iter().zip([c, -b, -b, a].map(|x| x / determinant))
    {
        assert!((found - expected).abs() < 1e-15, "{found} {expected}");
    }
}

#[test]
fn gains_of_a_design_without_readings_add_up_to_its_determinant() {
    let candidates = loads(60, 1);
    let planned: Vec<PlannedLoad> =
        Planner::new(None, Order::Gain, &[], &candidates).take(30).collect();
    let surface = |loads: &[PerAxis<f64>]| Surface::new(loads, &candidates);
    let chosen: Vec<PerAxis<f64>> = planned.iter().map(|of| candidates[of.candidate]).collect();
    let ln_determinant =
        |of: &Surface| Mat::from_fn(28, 28, |i, j| of.covariance[i][j]).determinant().ln();
    let gained = ln_determinant(&surface(&[])) - ln_determinant(&surface(&chosen));
    let sum: f64 = planned.iter().map(|of| of.gain).sum();
    // Thirty roundings of a matrix with condition 1e4.
    assert!((sum / gained - 1.0).abs() < 1e-8, "{sum} {gained}");
    // The covariance after random loads has a larger determinant.
    for at in 0..30 {
        let random = ln_determinant(&surface(&candidates[at..at + 30]));
        assert!(ln_determinant(&surface(&chosen)) < random);
    }
}

#[test]
fn a_load_that_was_hung_tells_less_the_second_time() {
    let candidates = loads(20, 2);
    for criterion in [Order::Gain, Order::AverageVariance] {
        let first = Planner::new(None, criterion, &[], &candidates).next().unwrap();
        let hung = [candidates[first.candidate]];
        let again = Planner::new(None, criterion, &hung, &candidates).next().unwrap();
        assert_ne!(first.candidate, again.candidate, "{criterion:?}");
    }
}

#[test]
fn predicted_errors_are_those_that_are_found() {
    let mut random = Random(5);
    let training = loads(40, 3);
    let fitted: Vec<Observation> =
        (0..).zip(&training).map(|(i, &w)| observe(i, w, 4.0, &mut random)).collect();
    let model = PhysicsModel::fit(&fitted, 0.1, 0.5).unwrap();
    let tests = loads(400, 4);
    let sensors = Some(SensorKnowledge::from_model(&model));
    let planner = Planner::new(sensors, Order::Gain, &training, &tests);
    let PredictedError::Wrench(predicted) = planner.error() else { panic!("a model of sensors") };
    let inversion = Inversion::new(&model);
    let mut squares = [0.0; 6];
    for &wrench in &tests {
        let readings = observe(0, wrench, 4.0, &mut random).readings;
        let columns: Vec<Vec<f64>> = readings.into_iter().map(|reading| vec![reading]).collect();
        let found = inversion.estimates(&columns).wrench;
        (0..6).for_each(|axis| squares[axis] += (found[axis][0] - wrench[axis]).powi(2) / 400.0);
    }
    for (axis, (predicted, square)) in predicted.iter().zip(squares).enumerate() {
        let ratio = predicted / f64::sqrt(square);
        // The tolerance allows for Laplace's approximation, and for variances of noise from 320 numbers.
        assert!((0.7..1.4).contains(&ratio), "axis {axis}: {ratio}");
    }
    let sizes = planner.take(5).map(|of| match of.error {
        PredictedError::Wrench(errors) => errors[0] / 5.0 + errors[5] / 0.2,
        PredictedError::Relative(_) => f64::NAN,
    });
    assert!(sizes.collect::<Vec<_>>().is_sorted_by(|before, after| before > after));
}

#[test]
fn planned_orders_need_fewer_poses_than_random_ones() {
    let mut random = Random(9);
    let observations: Vec<Observation> =
        (0..).zip(loads(60, 6)).map(|(i, w)| observe(i, w, 4.0, &mut random)).collect();
    let splits = NonZeroU64::new(3).unwrap();
    let options = ReplayOptions { held_out: 20, start: 10, seed: 1, splits };
    let replay = Replay::new(&observations, options, Workers::ONE).unwrap();
    assert_eq!((replay.poses[0], *replay.poses.last().unwrap()), (10, 40));
    // Compares at twice the final error: closer to it, the mean of three splits varies by a third.
    let needed = Order::ALL.map(|order| replay.poses_within(order, 1.0));
    assert!(needed[1..].iter().all(|&poses| poses < needed[0]), "{needed:?} {replay:?}");
    let ends = |errors: &Vec<f64>| [errors[0], errors[errors.len() - 1]];
    for errors in &replay.errors[1..] {
        let (ends, random) = (ends(errors), ends(&replay.errors[0]));
        // Another order of the same poses is rounded differently.
        assert!(ends[0] == random[0] && (ends[1] / random[1] - 1.0).abs() < 1e-3);
    }
    let few = Replay::new(&observations[..25], options, Workers::ONE);
    let said = "`25` poses are too few: with `20` held out at least `31` are needed";
    assert_eq!(few.unwrap_err().to_string(), said);
}

#[test]
fn a_load_that_breaks_a_coupling_is_named() {
    // Every push forward is made at a height of 40 mm.
    let pushes: Vec<PerAxis<f64>> = (0..12)
        .map(|i| {
            let fx = f64::from(i) - 5.5;
            [fx, f64::from(i % 3), 1.0 - f64::from(i % 2), 0.0, 0.04 * fx, 0.0]
        })
        .collect();
    let candidates = [[4.0, 0.0, 0.0, 0.0, 0.16, 0.0], [6.0, 0.0, 0.0, 0.0, 0.0, 0.0]];
    let found = couplings(&pushes, &candidates);
    assert_eq!(found.len(), 1);
    let Coupling { first, second, correlation, broken_by } = found[0];
    assert_eq!((first.name(), second.name()), ("Fx", "My"));
    assert!((correlation - 1.0).abs() < 1e-12);
    let (candidate, after) = broken_by.unwrap();
    assert!(candidate == 1 && after < 0.95, "{after}");
    assert_eq!(couplings(&pushes, &candidates[..1])[0].broken_by, None);
    assert_eq!(couplings(&[], &candidates), []);
}
