//! Comparison with an independent contact finder: a quartic in the tangent of half the beam's
//! angle, with roots by bisection in double-double arithmetic.
use std::f64::consts::TAU;

use crate::quartic::{Intersection, Tip, intersections};
use beam_channel::{Beam, Model, Pose, Setup, Side, Wall};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

const GEOMETRIES: u64 = 100_000;

/// Tolerance of `φ`, rad. Near a release `φ` depends on the travel, exact to rounding, by a square
/// root: 1e-16 of a length moves it by this within 1e-8 of the path; no position is that close.
const TOLERANCE: f64 = 1e-12;

/// Each thread has its own random numbers, so that geometries do not depend on the machine.
const THREADS: u64 = 4;

struct Random(ChaCha8Rng);

impl Random {
    fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn scale(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    /// Needles, circles, beams much shorter and longer than the body, grazing and nearly jammed.
    fn setup(&mut self) -> Setup {
        let mut setup = Setup::default();
        let semi_width_m = self.scale(0.01, 0.1);
        setup.ellipse.semi_width_m = semi_width_m;
        setup.ellipse.semi_length_m = semi_width_m * self.scale(0.05, 20.0);
        let length_m = semi_width_m * self.scale(0.05, 20.0);
        setup.beam = Beam { length_m, ..Beam::default() };
        let deepest = semi_width_m.min(2.0 * length_m);
        let depth = match self.0.next_u64() % 4 {
            0 => deepest * self.scale(1e-6, 1.0),
            1 => deepest * (1.0 - self.scale(1e-6, 1.0)),
            _ => deepest * self.between(0.0, 1.0),
        };
        // Neither grazing with zero depth nor jammed completely.
        let depth = depth.clamp(1e-6 * deepest, (1.0 - 1e-6) * deepest);
        setup.channel.width_m = (2.0 * (semi_width_m - depth)).max(1e-6);
        setup
    }
}

fn tip(setup: &Setup, ahead_m: f64) -> Tip {
    let Pose { offset_m, yaw_rad } = setup.pose;
    Tip {
        semi_length: setup.ellipse.semi_length_m,
        semi_width: setup.ellipse.semi_width_m,
        beam: setup.beam.length_m,
        gap: 0.5 * setup.channel.width_m - offset_m,
        ahead: ahead_m,
        yaw: yaw_rad,
    }
}

/// Picks the tip's intersection: with an upright ellipse, the one furthest forward, as in the paper; with a yawed
/// ellipse, which may come round from behind, the first beyond the first touch.
fn pick(setup: &Setup, side: &Side, found: Vec<Intersection>) -> Option<f64> {
    let found = found.into_iter();
    let beyond = |at: &Intersection| (at.phi - side.first_touch_rad).rem_euclid(TAU);
    let picked = if setup.pose.yaw_rad == 0.0 {
        found.max_by(|a, b| a.forward.total_cmp(&b.forward))
    } else {
        found.min_by(|a, b| beyond(a).total_cmp(&beyond(b)))
    };
    picked.map(|at| at.phi)
}

#[derive(Clone, Copy, Debug, Default)]
struct Tally {
    in_contact: u64,
    snapped: u64,
}

fn compare(seed: u64, count: u64, make: impl Fn(&mut Random) -> Setup) -> Tally {
    let mut random = Random::new(seed);
    let mut tally = Tally::default();
    for i in 0..count {
        let setup = make(&mut random);
        let Ok(model) = Model::new(&setup) else { continue };
        let Some(side) = model.side(Wall::Left) else { continue };
        if side.meets_faces_first() {
            continue;
        }
        let travel = side.travel_m() * random.between(-0.1, 1.1);
        let ahead = side.engagement_m - travel;
        let found = side.contact_after(side.engagement_m - ahead);
        let expected = pick(&setup, side, intersections(&tip(&setup, ahead)));
        let what = format!("seed {seed}, number {i}: {setup:?} at {ahead}");
        assert_eq!(found.is_some(), expected.is_some(), "{what}: {found:?} {expected:?}");
        if let (Some(found), Some(expected)) = (found, expected) {
            let difference = side.place_rad(&found) - expected;
            let error = (difference - TAU * (difference / TAU).round()).abs();
            assert!(error <= TOLERANCE, "{what}: off by {error:e}");
            tally.in_contact += 1;
            tally.snapped += u64::from(side.snaps);
        }
    }
    tally
}

fn compare_all(count: u64, make: impl Fn(&mut Random) -> Setup + Copy + Send) -> Tally {
    std::thread::scope(|scope| {
        let share = |i| count / THREADS + u64::from(i < count % THREADS);
        let work = (0..THREADS).map(|i| scope.spawn(move || compare(i, share(i), make)));
        let work: Vec<_> = work.collect();
        work.into_iter().map(|thread| thread.join().unwrap()).fold(Tally::default(), |sum, part| {
            Tally {
                in_contact: sum.in_contact + part.in_contact,
                snapped: sum.snapped + part.snapped,
            }
        })
    })
}

#[test]
fn a_hundred_thousand_random_geometries_have_the_same_contacts() {
    let tally = compare_all(GEOMETRIES, Random::setup);
    // Ten in twelve positions lie between the first touch and the release.
    assert!(tally.in_contact > GEOMETRIES * 4 / 5, "{tally:?}");
    assert!(tally.snapped > 1000, "{tally:?}");
}

#[test]
fn a_body_off_the_middle_or_yawed_has_the_same_contacts() {
    let tally = compare_all(20_000, |random| {
        let mut setup = random.setup();
        let half_width = 0.5 * setup.channel.width_m;
        setup.pose = Pose {
            offset_m: half_width * random.between(-0.5, 0.5),
            yaw_rad: random.between(-0.5, 0.5),
        };
        setup
    });
    assert!(tally.in_contact > 5000, "{tally:?}");
}
