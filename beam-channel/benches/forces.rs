//! Cost of a contact; beams that do not touch cost nothing.
//!
//! An `item` is a contact of one wall; the other wall is its mirror image and costs nothing.
#![allow(missing_docs, reason = "no one reads the documentation of a benchmark")]

use beam_channel::{Model, Setup, Wall};
use divan::counter::ItemsCount;
use divan::{Bencher, black_box};

fn main() {
    divan::main();
}

const POSITIONS: u32 = 1000;

/// The paper's widths: 8, 6 and 4 cm.
const WIDTHS: [f64; 3] = [0.08, 0.06, 0.04];

fn setup(width_m: f64, beams: u32) -> Setup {
    let mut setup = Setup::default();
    setup.channel.width_m = width_m;
    setup.channel.beams = beams;
    setup
}

fn positions(model: &Model) -> impl Iterator<Item = f64> {
    let channel = model.setup().channel;
    let middle = channel.pitch_m * f64::from(channel.beams / 2);
    (0..POSITIONS).map(move |i| middle + channel.pitch_m * f64::from(i) / f64::from(POSITIONS))
}

#[divan::bench(args = [11, 110, 11_000])]
fn beams_in_the_channel(bencher: Bencher<'_, '_>, beams: u32) {
    sweep(bencher, &Model::new(&setup(0.06, beams)).expect("a channel of the paper"));
}

#[divan::bench(args = [1, 10, 100])]
fn beams_in_contact(bencher: Bencher<'_, '_>, density: u32) {
    let mut setup = setup(0.06, 11 * density);
    setup.channel.pitch_m /= f64::from(density);
    sweep(bencher, &Model::new(&setup).expect("a channel of the paper"));
}

#[divan::bench(args = WIDTHS)]
fn widths(bencher: Bencher<'_, '_>, width_m: f64) {
    sweep(bencher, &Model::new(&setup(width_m, 11)).expect("a channel of the paper"));
}

fn sweep(bencher: Bencher<'_, '_>, model: &Model) {
    let contacts: usize = positions(model).map(|x| model.touching(Wall::Left, x).len()).sum();
    bencher
        .counter(ItemsCount::new(contacts))
        .bench_local(|| positions(model).map(|x| model.total(black_box(x)).fx_n).sum::<f64>());
}

#[divan::bench(args = WIDTHS)]
fn new_model(bencher: Bencher<'_, '_>, width_m: f64) {
    bencher.bench_local(|| Model::new(black_box(&setup(width_m, 11))));
}

#[divan::bench(args = WIDTHS)]
fn energy(bencher: Bencher<'_, '_>, width_m: f64) {
    let model = Model::new(&setup(width_m, 11)).expect("a channel of the paper");
    bencher.bench_local(|| black_box(&model).energy());
}

#[divan::bench(args = WIDTHS)]
fn plateau(bencher: Bencher<'_, '_>, width_m: f64) {
    let model = Model::new(&setup(width_m, 11)).expect("a channel of the paper");
    bencher.bench_local(|| black_box(&model).plateau());
}
