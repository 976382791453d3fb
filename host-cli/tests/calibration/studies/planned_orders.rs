//! Poses that planning would have saved in a recorded session, in random and in planned orders.

use std::num::NonZeroU64;

use calibration::fit::Workers;
use calibration::load_plan::{Order, Replay, ReplayOptions};
use log_file::{Log, Mapping, ReadOptions};
use shellcal::workflow::plan::observations;
use system_tests::real_recording;

/// Relative distance from the error with all poses that counts as reached.
const NEAR: f64 = 0.15;

/// `SHELLCAL_SPLITS=20` makes the tables of `docs/plan.md`.
#[test]
#[ignore = "needs the recordings"]
fn planned_orders_save_poses_of_a_recorded_session() {
    let path = real_recording("others/photointerrupters/poses.csv");
    let log = Log::open(&path, &Mapping::default()).unwrap();
    let observations = observations(&[log], &ReadOptions::default()).unwrap();
    let splits = std::env::var("SHELLCAL_SPLITS").ok().and_then(|text| text.parse().ok());
    let splits = splits.unwrap_or(const { NonZeroU64::new(4).unwrap() });
    let options = ReplayOptions { held_out: 8, start: 8, seed: 1, splits };
    let replayed = Replay::new(&observations, options, Workers::new(0)).unwrap();
    for (at, poses) in replayed.poses.iter().enumerate() {
        let errors = replayed.errors.iter().map(|errors| format!("{:.3}", errors[at]));
        println!("{poses} {}", errors.collect::<Vec<_>>().join(" "));
    }
    let needed = |order| replayed.poses_within(order, NEAR);
    Order::ALL.iter().for_each(|order| println!("{}: {}", order.name(), needed(*order)));
    // Four of the splits in `docs/plan.md`: each planned order needs fewer poses than a random one.
    let [random, planned @ ..] = Order::ALL;
    assert!(planned.into_iter().all(|order| needed(order) < needed(random)));
}
