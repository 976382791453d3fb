#!/usr/bin/env bash
# Question: a task samples a converter each time an embassy-time Ticker of 10 ms comes, and is held up once for 55 ms. At
# what times does it sample then?
# Good guess: missed ticks are gone: the next sample is at the next whole 10 ms, a gap of 60 ms in the log.
# True: every missed tick comes, at once: five samples within microseconds, then the regular ones. A log that counts 10 ms
# from sample to sample looks as if nothing had been missed, with five readings of one instant spread over 50 ms.
# Ticker::reset starts anew.
# Package: embassy-time 0.5.1 (its own mock clock).
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
mkdir "$folder/src"
cd "$folder"
cat >Cargo.toml <<'TOML'
[package]
name = "finding"
edition = "2024"

[dependencies]
critical-section = { version = "=1.2.0", features = ["std"] }
embassy-time = { version = "=0.5.1", features = ["mock-driver", "generic-queue-8"] }
TOML
cat >src/main.rs <<'RUST'
use std::future::Future;
use std::pin::pin;
use std::task::{Context, Waker};

use embassy_time::{Duration, Instant, MockDriver, Ticker};

fn ticks(ticker: &mut Ticker) -> u32 {
    let mut context = Context::from_waker(Waker::noop());
    let mut count = 0;
    while pin!(ticker.next()).poll(&mut context).is_ready() {
        count += 1;
    }
    println!("at {} ms: {count} ticks", Instant::now().as_millis());
    count
}

fn main() {
    let clock = MockDriver::get();
    let mut ticker = Ticker::every(Duration::from_millis(10));
    let mut after = |ms| {
        clock.advance(Duration::from_millis(ms));
        ticks(&mut ticker)
    };
    assert_eq!(after(10), 1);
    assert_eq!(after(55), 5);
    assert_eq!(after(5), 1);
}
RUST
CARGO_TARGET_DIR="$folder/target" cargo run --quiet
