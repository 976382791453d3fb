#!/usr/bin/env bash
# Question: the length of a force on a microcontroller without a floating-point unit, by micromath's sqrt and hypot: how
# exact is it?
# Good guess: some 0.1 %: "fast approximations", one step of Newton's method after the famous shift of bits.
# True: the shift alone, so up to 6.1 % too much: 3 N and 4 N give 5.125 N, the root of 2 is 1.5. The reciprocal root has
# no step either (3.4 %). One step by hand, y = (y + x / y) / 2, leaves 0.2 %.
# Package: micromath 2.1.0 (libm 0.2.16 for comparison).
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
libm = "=0.2.16"
micromath = "=2.1.0"
TOML
cat >src/main.rs <<'RUST'
use micromath::F32Ext;

fn main() {
    let (mut root, mut reciprocal, mut with_step) = (0.0_f32, 0.0_f32, 0.0_f32);
    let mut x = 1e-3_f32;
    while x < 1e3 {
        let exact = libm::sqrtf(x);
        let quick = F32Ext::sqrt(x);
        root = root.max((quick / exact - 1.0).abs());
        reciprocal = reciprocal.max((F32Ext::invsqrt(x) * exact - 1.0).abs());
        with_step = with_step.max((0.5 * (quick + x / quick) / exact - 1.0).abs());
        x *= 1.0007;
    }
    let length = F32Ext::hypot(3.0_f32, 4.0);
    println!("hypot(3 N, 4 N) = {length} N, sqrt(2) = {}", F32Ext::sqrt(2.0_f32));
    let percent = [root, reciprocal, with_step].map(|error| 1e2 * error);
    println!("greatest errors from 0.001 to 1000, sqrt, invsqrt, sqrt with a step: {percent:.2?} %");
    assert_eq!(length, 5.125);
    assert!((0.060..0.061).contains(&root) && reciprocal > 0.03 && with_step < 0.002);
}
RUST
CARGO_TARGET_DIR="$folder/target" cargo run --quiet
