//! Against an independent finder of contacts: the quartic of a tip on an ellipse, in the tangent of
//! half the beam's angle, its roots by bisection in double-double arithmetic.
#![expect(clippy::unwrap_used, reason = "helpers of tests")]

mod quartic;

use beam_channel::{Beam, Model, Pose, Setup, Side, Wall};
use quartic::{Tip, furthest_forward};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

const GEOMETRIES: u64 = 100_000;

/// Of `φ`, in rad.
const TOLERANCE: f64 = 1e-12;

/// Where `s` has a maximum or a minimum the place of the tip hangs on its travel by a square root; a
/// travel that is right to rounding, `4·2⁻⁵²` of the greatest length in it, says no more than this.
const ROUNDING: f64 = 4.0 * f64::EPSILON;

struct Random(ChaCha8Rng);

impl Random {
    fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Over decades.
    fn scale(&mut self, low: f64, high: f64) -> f64 {
        self.between(low.ln(), high.ln()).exp()
    }

    /// Needles along and across, circles, beams much shorter and longer than the body, grazing and
    /// nearly jammed.
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
        // Neither quite nothing nor quite all.
        let depth = depth.clamp(1e-6 * deepest, (1.0 - 1e-6) * deepest);
        setup.channel.width_m = 2.0 * (semi_width_m - depth);
        setup
    }
}

/// The tip as the finder is to see it.
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

/// The widest interval in which the tip may lie if the travel is right to rounding, as a tolerance.
fn tolerance(setup: &Setup, side: &Side, travel: f64) -> f64 {
    let size = setup.ellipse.semi_length_m.max(side.travel_m()).max(setup.beam.length_m);
    let place = |travel: f64| {
        let travel = travel.clamp(0.0, side.travel_m());
        side.contact_after(travel).map(|contact| side.place_rad(&contact))
    };
    let around = [-1.0, 1.0].map(|sign| place(travel + sign * ROUNDING * size));
    match around {
        [Some(before), Some(after)] => TOLERANCE + (after - before).abs(),
        _ => TOLERANCE,
    }
}

/// How many of `count` geometries were in contact; fails where the finder finds otherwise.
fn compare(seed: u64, count: u64) -> u64 {
    let mut random = Random::new(seed);
    let mut touched = 0;
    for i in 0..count {
        let setup = random.setup();
        let model = Model::new(&setup).unwrap();
        let side = model.side(Wall::Left).unwrap();
        // Somewhat more than the way on which they touch.
        let travel = side.travel_m() * random.between(-0.1, 1.1);
        let ahead = side.engagement_m() - travel;
        let found = side.contact(ahead);
        let expected = furthest_forward(&tip(&setup, ahead));
        let near_an_end = [0.0, side.travel_m()]
            .iter()
            .any(|end| (travel - end).abs() < 1e-12 * setup.ellipse.semi_length_m.max(travel));
        if near_an_end {
            continue;
        }
        let what = format!("seed {seed}, number {i}: {setup:?} at {ahead}");
        assert_eq!(found.is_some(), expected.is_some(), "{what}: {found:?} {expected:?}");
        if let (Some(found), Some(expected)) = (found, expected) {
            touched += 1;
            let error = (side.place_rad(&found) - expected).abs();
            let tolerance = tolerance(&setup, side, travel);
            assert!(error <= tolerance, "{what}: off by {error:e} of {tolerance:e}");
        }
    }
    touched
}

#[test]
fn a_hundred_thousand_random_geometries_have_the_same_contacts() {
    let threads = std::thread::available_parallelism().map_or(1, usize::from) as u64;
    let touched: u64 = std::thread::scope(|scope| {
        let share = |i| GEOMETRIES / threads + u64::from(i < GEOMETRIES % threads);
        let work: Vec<_> =
            (0..threads).map(|i| scope.spawn(move || compare(i, share(i)))).collect();
        work.into_iter().map(|thread| thread.join().unwrap()).sum()
    });
    // Ten in twelve.
    assert!(touched > GEOMETRIES * 4 / 5, "{touched}");
}
