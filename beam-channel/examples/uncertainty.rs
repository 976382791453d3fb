//! Uncertainty of a simulated drag by Monte Carlo over uncertain parameters.
//!
//! ```text
//! cargo run --release -p beam-channel --example uncertainty -- DRAWS THICKNESS_SHARE FRICTION_SD
//! ```
//!
//! prints the median of the mean drag on the plateau and its 95 % interval for the paper's channels. THICKNESS_SHARE is
//! the standard deviation of the beams' thickness as a share of the thickness; FRICTION_SD is the standard deviation of the friction.
//! Draws in which the body jams are left out and counted.
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use std::error::Error;
use std::f64::consts::TAU;

use beam_channel::{Model, Setup};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

fn main() -> Result<(), Box<dyn Error>> {
    let numbers: Result<Vec<f64>, _> = std::env::args().skip(1).map(|text| text.parse()).collect();
    let [draws, thickness_share, friction_sd] = numbers?[..] else {
        return Err("expected DRAWS THICKNESS_SHARE FRICTION_SD, such as 1000 0.05 0.05".into());
    };
    for deflection_m in [0.01, 0.02, 0.03] {
        let mut setup = Setup::default();
        setup.channel.width_m = 2.0 * setup.ellipse.semi_width_m - 2.0 * deflection_m;
        // Every channel gets the same draws, so that differences come from the channels.
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let (mut drags, mut refused) = (Vec::new(), 0);
        for _ in 0..draws as u32 {
            let mut drawn = setup;
            let [a, b] = normal_pair(&mut random);
            drawn.beam.thickness_m *= 1.0 + thickness_share * a;
            drawn.beam.friction += friction_sd * b;
            match Model::new(&drawn) {
                Ok(model) => drags.extend(model.plateau().map(|plateau| plateau.mean_drag_n)),
                Err(_) => refused += 1,
            }
        }
        drags.sort_unstable_by(f64::total_cmp);
        let quantile = |share: f64| drags[(share * (drags.len() - 1) as f64).round() as usize];
        if drags.is_empty() {
            return Err("the body jams in every draw".into());
        }
        let [low, median, high] = [0.025, 0.5, 0.975].map(quantile);
        println!(
            "{} cm: {median:.4} N, 95 % of the draws from {low:.4} to {high:.4} N; {refused} refused",
            100.0 * deflection_m
        );
    }
    Ok(())
}

/// Returns two normal deviates, by the Box–Muller transform.
fn normal_pair(random: &mut ChaCha8Rng) -> [f64; 2] {
    let mut uniform = || ((random.next_u64() >> 11) as f64 + 0.5) / (1_u64 << 53) as f64;
    let (radius, angle) = ((-2.0 * uniform().ln()).sqrt(), TAU * uniform());
    [radius * angle.cos(), radius * angle.sin()]
}
