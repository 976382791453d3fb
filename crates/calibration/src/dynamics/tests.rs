//! Tests with a synthetic sensor: its six channels mix six loads and creep, and its reference is late.

use least_squares::error::FitError;
use std::f64::consts::TAU;

use super::*;
use shell_data::block::Block;
use shell_data::dataset::{BLOCK_ROWS, Dataset};
use shell_data::wrench::Axes;
use system_tests::random::Random;

const RATE_HZ: f64 = 200.0;

const SINES: usize = 12;

struct SyntheticSensor {
    lag_s: f64,
    /// Share and time constant, s, of both creep terms.
    creep: [(f64, f64); 2],
    noise: f64,
}

impl SyntheticSensor {
    fn log(&self, seed: u64, seconds: usize) -> Dataset {
        let mut random = Random(seed);
        let sines: Vec<(f64, f64, f64)> = (0..6 * SINES)
            .map(|_| (random.unit() - 0.5, TAU * (0.05 + 3.0 * random.unit()), TAU * random.unit()))
            .collect();
        let load = |axis: usize, t: f64| -> f64 {
            let own = sines[axis * SINES..][..SINES].iter();
            own.map(|(size, speed, phase)| size * (speed * t + phase).sin()).sum()
        };
        let mix = |channel: usize, axis: usize| match channel == axis {
            true => 1000.0,
            false => 100.0 * ((channel * 6 + axis) as f64).sin(),
        };
        // A reading `s` and its moving averages `e` satisfy `s + Σ c·(s − e) = u`.
        let stiffness = 1.0 + self.creep.iter().map(|(share, _)| share).sum::<f64>();
        const STEPS: usize = 5;
        let step = 1.0 / RATE_HZ / STEPS as f64;
        // The sensor has rested under the first load of the log.
        let mixed = |channel: usize, t: f64| -> f64 {
            (0..6).map(|axis| mix(channel, axis) * load(axis, t)).sum()
        };
        let mut past = [std::array::from_fn::<f64, 6, _>(|channel| mixed(channel, 0.0)); 2];
        let rows = seconds * RATE_HZ as usize;
        let mut block = Block {
            rows,
            readings: vec![Vec::new(); 6],
            wrench: vec![Vec::new(); 6],
            ..Block::default()
        };
        for i in 0..rows * STEPS {
            let t = i as f64 * step;
            let is_row = i % STEPS == 0;
            for channel in 0..6 {
                let held: f64 =
                    self.creep.iter().zip(&past).map(|((share, _), e)| share * e[channel]).sum();
                let reading = (mixed(channel, t) + held) / stiffness;
                for ((_, tau), past) in self.creep.iter().zip(&mut past) {
                    past[channel] += (reading - past[channel]) * -(-step / tau).exp_m1();
                }
                if is_row {
                    let noise = self.noise * 1000.0 * (random.unit() - 0.5);
                    block.readings[channel].push((reading + noise).round());
                }
            }
            if is_row {
                block.time_s.push(t);
                for (axis, column) in block.wrench.iter_mut().enumerate() {
                    column.push(load(axis, t - self.lag_s) + self.noise * (random.unit() - 0.5));
                }
            }
        }
        let blocks = (0..rows).step_by(BLOCK_ROWS).map(|start| {
            let is_in = |row: usize| (start..start + BLOCK_ROWS).contains(&row);
            block.kept(&(0..rows).map(is_in).collect::<Vec<_>>())
        });
        Dataset::from_blocks(format!("log {seed}"), Axes::ALL, blocks.collect())
    }

    fn logs(&self, count: u64) -> Dataset {
        let logs = (0..count).flat_map(|seed| self.log(seed + 1, 30).logs);
        Dataset { logs: logs.collect() }
    }
}

const RIGID: SyntheticSensor = SyntheticSensor { lag_s: 0.0, creep: [(0.0, 1.0); 2], noise: 0.02 };

#[test]
fn lag_and_both_time_constants_of_a_known_sensor_are_found() {
    // Memory terms assume that a reading holds until the next one, 5 ms later. This shifts the lag by
    // 0.06 ms. Half a minute determines the lag less exactly than two minutes.
    for (lag_s, logs, tolerance) in [(0.0031, 4, 1e-4), (-0.0074, 1, 1.5e-4)] {
        // Noise is 0.2 % of the loads; more noise would shift the lag by a tenth of its value.
        let sensor = SyntheticSensor { lag_s, creep: [(0.08, 0.06), (0.1, 1.4)], noise: 0.005 };
        let found =
            find(&sensor.logs(logs), &DynamicsRule::AUTO, true, Workers::ONE).unwrap().unwrap();
        let lag = found.lag.unwrap();
        assert!((lag.by - lag_s).abs() < tolerance, "{lag:?}");
        let memory = found.memory.unwrap();
        assert_eq!(memory.time_constants.len(), 2, "{memory:?}");
        for (found, (_, tau)) in memory.time_constants.iter().zip(sensor.creep) {
            assert!((found / tau - 1.0).abs() < 0.2, "{memory:?}");
        }
        // A late reference and creep look alike: a lag alone may gain nothing.
        let Gain { plain, with_all, .. } = found.gain.unwrap();
        assert!((0..6).all(|axis| with_all[axis] < 0.5 * plain[axis]), "{with_all:?} {plain:?}");
    }
}

#[test]
fn a_lag_is_found_without_memory_and_memory_without_a_lag() {
    let late = SyntheticSensor { lag_s: 0.0125, ..RIGID };
    let found = find(&late.logs(2), &DynamicsRule::AUTO, true, Workers::ONE).unwrap().unwrap();
    assert!((found.lag.unwrap().by - late.lag_s).abs() < 1e-4, "{found:?}");
    assert_eq!(found.memory, None);
    let creeps = SyntheticSensor { creep: [(0.2, 0.5), (0.0, 1.0)], ..RIGID };
    let found = find(&creeps.logs(2), &DynamicsRule::AUTO, true, Workers::ONE).unwrap().unwrap();
    let times = found.memory.unwrap().time_constants;
    assert!(times.iter().any(|tau| (tau / 0.5 - 1.0).abs() < 0.2), "{times:?}");
    assert!(found.lag.is_none_or(|lag| lag.by.abs() < 1e-4), "{:?}", found.lag);
}

#[test]
fn a_rigid_sensor_has_neither() {
    let found = find(&RIGID.logs(4), &DynamicsRule::AUTO, true, Workers::ONE).unwrap().unwrap();
    assert_eq!((found.lag, found.memory), (None, None));
}

#[test]
fn rows_in_no_order_and_poses_are_not_searched() {
    let mut data = RIGID.log(1, 30);
    let mut random = Random(2);
    let mut shuffle = |block: &Block| {
        let mut rows: Vec<usize> = (0..block.rows).collect();
        rows.sort_by_cached_key(|_| random.unit().to_bits());
        let pick = |column: &Vec<f64>| rows.iter().map(|&row| column[row]).collect();
        Block {
            readings: block.readings.iter().map(pick).collect(),
            wrench: block.wrench.iter().map(pick).collect(),
            ..block.clone()
        }
    };
    for block in &mut data.logs[0].blocks {
        *block = shuffle(&block.rows).into();
    }
    let refused = find(&data, &DynamicsRule::AUTO, true, Workers::ONE).unwrap().unwrap_err();
    assert!(matches!(refused, NotSearched::Shuffled(_)), "{refused}");
    let mut poses = RIGID.log(1, 30);
    poses.logs[0].has_groups = true;
    let refused = find(&poses, &DynamicsRule::AUTO, true, Workers::ONE).unwrap().unwrap_err();
    assert_eq!(refused, NotSearched::Poses);
}

#[test]
fn what_is_given_is_taken_without_a_search() {
    let data = RIGID.log(1, 5);
    let rule = DynamicsRule { lag: Some(0.01), memory: Some(&[2.0, 0.5]) };
    let given = find(&data, &rule, true, Workers::ONE).unwrap().unwrap();
    assert_eq!(given.memory.as_ref().unwrap().time_constants, [0.5, 2.0]);
    assert_eq!((given.lag.unwrap().by, given.gain), (0.01, None));
    let rows = prepared(data.clone(), given.memory.as_ref(), given.lag).unwrap();
    assert_eq!((rows.channels(), rows.memory_terms(), rows.rows()), (6, 2, data.rows()));
    let wrong = DynamicsRule { memory: Some(&[0.0]), ..rule };
    assert_eq!(find(&data, &wrong, true, Workers::ONE), Err(FitError::TimeConstant(0.0)));
}
