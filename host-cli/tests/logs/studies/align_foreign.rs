//! Actual and stated errors of an alignment on other sensors: nine kinds of springs, six of load,
//! three of optics, all unknown to the program.
use alignment::{Options, align};

use crate::foreign::{Kind, Load, Session};

/// Error and stated standard error of an offset, s.
struct Outcome {
    kind: Kind,
    load: Load,
    error_s: f64,
    stated_s: f64,
}

fn outcomes(seeds: std::ops::Range<u64>) -> Vec<Outcome> {
    let sessions = Kind::ALL.into_iter().flat_map(|kind| seeds.clone().map(move |s| (kind, s)));
    let outcome = |(kind, seed)| {
        let Session { load, optics, offset_s, skew, reference, board, .. } =
            Session::draw(kind, seed);
        let aligned = align(reference, board, Options::default())
            .unwrap_or_else(|error| panic!("{kind:?} {load:?} {optics:?} {seed}: {error}"));
        let clock = aligned.clock;
        let error_s = clock.offset_s - offset_s - skew * clock.pivot_s;
        Outcome { kind, load, error_s, stated_s: clock.offset_se_s }
    };
    sessions.map(outcome).collect()
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn within_three(outcomes: &[&Outcome]) -> usize {
    outcomes.iter().filter(|o| o.error_s.abs() <= 3.0 * o.stated_s).count()
}

fn line(name: &str, outcomes: &[&Outcome]) {
    let errors = || outcomes.iter().map(|o| 1e3 * o.error_s.abs());
    let root = |squares: f64| (squares / outcomes.len() as f64).sqrt();
    println!(
        "| {name} | {} | {:.3} | {:.3} | {:.3} | {:.3} | {:.2} | {} |",
        outcomes.len(),
        median(errors()),
        root(errors().map(|e| e * e).sum()),
        errors().fold(0.0, f64::max),
        median(outcomes.iter().map(|o| 1e3 * o.stated_s)),
        root(outcomes.iter().map(|o| (o.error_s / o.stated_s).powi(2)).sum()),
        within_three(outcomes),
    );
}

fn check(outcomes: &[Outcome], beyond: usize) {
    let all: Vec<&Outcome> = outcomes.iter().collect();
    // Sensors with memory must meet 0.2 ms. Exceptions are friction that depends on the speed, which looks like another
    // offset, and loads that jump between two frames.
    let is_clear = |o: &&&Outcome| o.kind != Kind::LuGre && o.load != Load::Steps;
    assert!(median(all.iter().filter(is_clear).map(|o| o.error_s.abs())) <= 200e-6);
    assert!(within_three(&all) + beyond >= all.len(), "{} of {}", within_three(&all), all.len());
    // Standard errors must not be needlessly large. The mean square of error over standard error is 1 if they are
    // right; they may be four times too large.
    let squares: f64 = all.iter().map(|o| (o.error_s / o.stated_s).powi(2)).sum();
    assert!(squares / all.len() as f64 > 1.0 / 16.0, "{squares}");
}

#[test]
fn sessions_of_nine_unknown_sensors_err_as_stated() {
    // All of these 27 errors are within three standard errors; in the longer study, 98 % are.
    check(&outcomes(200..203), 0);
}

/// Prints the table of `docs/alignment.md` in some minutes: `cargo test --profile checked -p
/// shellcal --test logs of_many_sessions -- --ignored --nocapture`.
#[test]
#[ignore = "minutes; 27 others are in every run"]
fn errors_of_many_sessions_are_as_stated() {
    let all = outcomes(400..436);
    println!("| | sessions | median (ms) | RMS | largest | stated | error/stated | within 3 |");
    println!("| --- | --- | --- | --- | --- | --- | --- | --- |");
    for kind in Kind::ALL {
        line(&format!("{kind:?}"), &all.iter().filter(|o| o.kind == kind).collect::<Vec<_>>());
    }
    for load in Load::ALL {
        line(&format!("{load:?}"), &all.iter().filter(|o| o.load == load).collect::<Vec<_>>());
    }
    line("all", &all.iter().collect::<Vec<_>>());
    // 98 % of 324.
    check(&all, 6);
}
