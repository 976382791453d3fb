//! Errors after loads in the order that a sitting plans, and after loads in random order, for
//! several simulated sensors.

use load_table::HungLoad;
use shell_data::random::{Purpose, RandomStream};
use shellcal::workflow::sitting::Sitting;

use crate::sitting::{Bench, rig};

/// Numbers of loads after which errors are compared. From 18 loads on, creep and hysteresis
/// dominate, whatever the order.
const COUNTS: [usize; 3] = [12, 14, 16];

fn seeds(usual: u64) -> u64 {
    std::env::var("SITTING_SEEDS").ok().and_then(|text| text.parse().ok()).unwrap_or(usual)
}

/// Returns the error of a sensor after these numbers of loads, N, in the planned order or a random one.
fn errors_after(counts: &[usize], seed: u64, planned: bool) -> Vec<f64> {
    let loads = rig();
    let mut random = RandomStream::new(seed, Purpose::Replay, 0);
    let mut shuffled: Vec<usize> = (0..loads.loads().len()).collect();
    for last in (1..shuffled.len()).rev() {
        shuffled.swap(last, (random.uniform() * (last + 1) as f64) as usize);
    }
    let mut bench = Bench::new(seed);
    let mut sitting = Sitting::new(rig(), [None; 2], 0);
    let (mut order, mut errors) = (shuffled.iter(), Vec::new());
    while errors.len() < counts.len() {
        let next = order.next();
        let line = if planned { sitting.next_line() } else { *next.unwrap() };
        let held = bench.hold(&HungLoad::wrench(&loads.loads()[line]));
        let before = sitting.used();
        sitting.record(line, &held).unwrap();
        if sitting.used() > before && counts.contains(&sitting.used()) {
            errors.push(bench.error(sitting.estimate().unwrap(), seed));
        }
    }
    errors
}

#[test]
fn a_sitting_errs_less_than_a_random_order_while_loads_are_few() {
    let seeds = seeds(3);
    let mut squares = [[0.0; COUNTS.len()]; 2];
    for seed in 1..=seeds {
        for (squares, planned) in squares.iter_mut().zip([true, false]) {
            let errors = errors_after(&COUNTS, seed, planned);
            squares.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error.powi(2));
        }
    }
    let errors = squares.map(|squares| squares.map(|sum| (sum / seeds as f64).sqrt()));
    for (at, count) in COUNTS.iter().enumerate() {
        let [planned, random] = errors.map(|errors| errors[at]);
        println!("{count} loads: planned {planned:.4} N, random {random:.4} N");
        // Over the three sensors the planned order errs a tenth to a fifth less.
        assert!(planned < random, "{count} loads: {planned} {random}");
    }
}

#[test]
#[ignore = "prints the figures of docs/plan.md"]
fn loads_until_an_error_is_reached() {
    let (seeds, counts): (_, Vec<usize>) = (seeds(20), (10..=30).collect());
    let orders = [true, false].map(|planned| {
        (1..=seeds).map(|seed| errors_after(&counts, seed, planned)).collect::<Vec<_>>()
    });
    for limit in [0.3, 0.25, 0.2, 0.18, 0.16] {
        // Number of loads from which on the error stays within the limit. If it never does, the number of loads
        // hung plus one.
        let reached = |errors: &Vec<f64>| {
            let within = errors.iter().rev().take_while(|error| **error <= limit).count();
            10 + counts.len() - within
        };
        let [planned, random] = orders.each_ref().map(|errors| {
            let mut loads: Vec<usize> = errors.iter().map(reached).collect();
            loads.sort_unstable();
            loads
        });
        let half = |loads: &[usize]| loads[(loads.len() - 1) / 2];
        let most = |loads: &[usize]| loads[(9 * loads.len()).div_ceil(10) - 1];
        println!(
            "{limit} N: half of the sensors after {} planned and {} random loads, nine in ten after {} and {}",
            half(&planned),
            half(&random),
            most(&planned),
            most(&random)
        );
        assert!(half(&planned) <= half(&random) + 1, "{planned:?} {random:?}");
    }
}
