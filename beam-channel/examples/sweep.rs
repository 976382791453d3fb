//! Drag over position, timed: the computation of `benches/peer_companion.py` with this crate.
//!
//! ```text
//! cargo run --release -p beam-channel --example sweep -- WIDTH_M BEAMS PITCH_M FROM_M TO_M POSITIONS REPEATS
//! ```
//!
//! prints one JSON document: the forces, the number of contacts, and the seconds of every repeat.
#![allow(clippy::print_stdout, reason = "an example shows its result")]

use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

use beam_channel::{Model, Setup};

fn main() -> Result<(), Box<dyn Error>> {
    let numbers: Result<Vec<f64>, _> = std::env::args().skip(1).map(|text| text.parse()).collect();
    let [width, beams, pitch, from, to, positions, repeats] = numbers?[..] else {
        return Err("expected WIDTH_M BEAMS PITCH_M FROM_M TO_M POSITIONS REPEATS".into());
    };
    let mut setup = Setup::default();
    setup.channel.width_m = width;
    setup.channel.beams = beams as u32;
    setup.channel.pitch_m = pitch;
    let model = Model::new(&setup)?;
    let count = positions as u32;
    let at = |i: u32| from + (to - from) * f64::from(i) / (positions - 1.0);

    let mut seconds = Vec::new();
    for _ in 0..repeats as u32 {
        let start = Instant::now();
        for i in 0..count {
            black_box(model.total(black_box(at(i))));
        }
        seconds.push(start.elapsed().as_secs_f64());
    }
    let totals: Vec<_> = (0..count).map(|i| model.total(at(i))).collect();
    let forces: Vec<f64> = totals.iter().map(|total| total.fx_n).collect();
    let contacts: u32 = totals.iter().map(|total| total.contacts[0]).sum();
    println!(r#"{{"seconds": {seconds:?}, "totals": {forces:?}, "contacts": {contacts}}}"#);
    Ok(())
}
