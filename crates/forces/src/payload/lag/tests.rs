//! Lags of simulated recordings, with and without contact.

use super::*;
use shell_data::random::{Purpose, RandomStream};
use std::f64::consts::{PI, TAU};

const PAYLOAD: Payload =
    Payload { mass_kg: 0.5, centre_m: [0.0; 3], force_bias_n: [0.0; 3], moment_bias_nm: [0.0; 3] };
const LENGTH_S: f64 = 20.0;

/// The carrier of a sensor: a hand or an arm, or a robot that walks at some 5 strides/s.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mover {
    Slow,
    Arm,
    Legs,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Touch {
    Nothing,
    /// 10 to 50 ms long, one or two a second.
    Taps,
    /// Half a second to two seconds long.
    Pushes,
    /// The ground, for half of each stride.
    Stance,
    /// Noise of up to some 4 Hz, all the time.
    Rubbing,
    /// An object that follows every motion with a delay of 30 ms.
    Following,
}

/// A smooth random function of mean square 1: a sum of sines, each with its frequency, Hz, and random phase.
struct Wander(Vec<(f64, f64)>);

impl Wander {
    fn new(highest_hz: f64, random: &mut RandomStream) -> Self {
        let sine =
            |i| ((f64::from(i) + random.uniform()) / 12.0 * highest_hz, TAU * random.uniform());
        Self((0..12).map(sine).collect())
    }

    fn at(&self, time_s: f64) -> f64 {
        let sines = self.0.iter().map(|(hz, phase)| (TAU * hz * time_s + phase).sin());
        sines.sum::<f64>() / 6.0_f64.sqrt()
    }
}

struct Walk {
    mover: Mover,
    wander: [Wander; 3],
    gait: [Wander; 2],
}

impl Walk {
    fn new(mover: Mover, random: &mut RandomStream) -> Self {
        Self {
            mover,
            wander: from_fn(|_| Wander::new(if mover == Mover::Arm { 3.0 } else { 0.7 }, random)),
            gait: from_fn(|_| Wander::new(0.4, random)),
        }
    }

    fn angle(&self, time_s: f64) -> f64 {
        5.0 * TAU * time_s + 0.6 * self.gait[0].at(time_s)
    }

    fn gravity(&self, time_s: f64) -> Vector {
        let [x, y, z] = from_fn(|axis| self.wander[axis].at(time_s));
        if self.mover != Mover::Legs {
            return [2.0 * x, y, 1.5 * z - 9.81];
        }
        let (angle, high) = (self.angle(time_s), 1.0 + 0.15 * self.gait[1].at(time_s));
        let sway = [
            1.5 * high * angle.sin() + 0.7 * (2.0 * angle + 0.4).sin(),
            0.8 * (angle + 1.0).sin(),
            2.5 * high * (2.0 * angle + 0.9).sin() + 0.8 * (4.0 * angle).sin(),
        ];
        [0.5 * x + sway[0], 0.5 * y + sway[1], 0.3 * z + sway[2] - 9.81]
    }
}

/// A contact force with a scale of 3 N; the load itself has about 1 N RMS.
fn contact(kind: Touch, walk: &Walk, times: &[f64], random: &mut RandomStream) -> Vec<Vector> {
    let mut forces = vec![[0.0; 3]; times.len()];
    let direction = |random: &mut RandomStream| {
        let draw: Vector = from_fn(|_| random.normal());
        scaled(draw, 1.0 / norm(draw))
    };
    let mut add = |force: Vector, shape: &dyn Fn(f64) -> f64| {
        for (sum, &time) in forces.iter_mut().zip(times) {
            (0..3).for_each(|axis| sum[axis] += force[axis] * shape(time));
        }
    };
    let mut from = 0.5;
    match kind {
        Touch::Nothing => {}
        Touch::Taps => {
            while from < LENGTH_S {
                let length = random.between(0.01, 0.05);
                let force = scaled(direction(random), random.between(1.0, 9.0));
                add(force, &|time| (PI * ((time - from) / length).clamp(0.0, 1.0)).sin());
                from += random.between(0.3, 1.0);
            }
        }
        Touch::Pushes => {
            while from < LENGTH_S {
                let (length, edge) = (random.between(0.5, 2.0), random.between(0.05, 0.2));
                let force = scaled(direction(random), random.between(1.0, 9.0));
                let rise = |time: f64| (time / edge).clamp(0.0, 1.0);
                add(force, &|time| rise(time - from).min(rise(from + length - time)));
                from += length + random.between(0.3, 1.5);
            }
        }
        Touch::Stance => {
            let strength: Vec<f64> = (0..200).map(|_| 1.0 + 0.2 * random.normal()).collect();
            let height = |time| {
                let turns = walk.angle(time) / TAU + 10.0;
                strength[turns as usize] * (TAU * turns).sin().max(0.0)
            };
            add([0.9, 0.3, 3.0], &height);
        }
        Touch::Rubbing => {
            for axis in 0..3 {
                let wander = Wander::new(4.0, random);
                add(from_fn(|of| if of == axis { 3.0 } else { 0.0 }), &|time| wander.at(time));
            }
        }
        Touch::Following => {
            for axis in 0..3 {
                let force = from_fn(|of| if of == axis { 0.3 } else { 0.0 });
                add(force, &|time| walk.gravity(time - 0.03)[axis]);
            }
        }
    }
    forces
}

fn run(mover: Mover, kind: Touch, lag_s: f64, seed: u64) -> Option<Lag> {
    let mut random = RandomStream::new(seed, Purpose::Reference, 0);
    let walk = Walk::new(mover, &mut random);
    let clock = |rate: f64| -> Vec<f64> {
        (0..(LENGTH_S * rate) as usize).map(|i| i as f64 / rate).collect()
    };
    let (samples, times) = (clock(250.0), clock(700.0));
    let mut noisy = |value: Vector| value.map(|value| value + 0.05 * random.normal());
    let measured: Vec<Vector> = samples.iter().map(|t| noisy(walk.gravity(t - lag_s))).collect();
    let loads: Vec<Vector> =
        times.iter().map(|t| noisy(scaled(walk.gravity(*t), PAYLOAD.mass_kg))).collect();
    let touch = contact(kind, &walk, &times, &mut random);
    let forces = from_fn(|axis| loads.iter().zip(&touch).map(|(a, b)| a[axis] + b[axis]).collect());
    find_lag(&PAYLOAD, &Motion::new(&samples, &measured).unwrap(), &times, &forces)
}

/// Prints the table of `docs/payload.md`.
#[test]
fn lags_are_found_under_contact_or_said_to_be_uncertain() {
    use Touch::*;
    let lags = [0.0063, -0.0418, 0.0771, 0.0005];
    // Limit on the error, ms: at least twice the printed error, as other random numbers give other errors. Zero if no
    // lag is clear, infinite if only the standard error is checked.
    for (mover, kind, within_ms) in [
        (Mover::Slow, Nothing, 1.0),
        (Mover::Slow, Taps, 3.0),
        (Mover::Slow, Pushes, 3.0),
        (Mover::Slow, Rubbing, 0.0),
        (Mover::Slow, Following, 0.0),
        (Mover::Arm, Nothing, 0.2),
        (Mover::Arm, Taps, 0.3),
        (Mover::Arm, Pushes, 0.3),
        (Mover::Arm, Stance, 1.0),
        (Mover::Arm, Rubbing, 0.0),
        (Mover::Arm, Following, f64::INFINITY),
        (Mover::Legs, Nothing, 0.1),
        (Mover::Legs, Taps, 0.1),
        (Mover::Legs, Pushes, 0.1),
        (Mover::Legs, Stance, 0.3),
        (Mover::Legs, Rubbing, 0.5),
        (Mover::Legs, Following, f64::INFINITY),
    ] {
        let (mut largest_ms, mut found, mut least, mut most) = (0.0_f64, 0, f64::INFINITY, 0.0_f64);
        for (seed, lag_s) in (1..).zip(lags) {
            let Some(lag) = run(mover, kind, lag_s, seed) else { continue };
            let error_s = (lag.lag_s - lag_s).abs();
            // One of 370 normal errors exceeds three standard errors.
            assert!(error_s < 3.0 * lag.standard_error_s, "{mover:?}, {kind:?}: {lag:?}, {lag_s}");
            // Contact that follows the motion must not give a certain lag.
            assert!(kind != Following || !lag.is_certain(), "{lag:?}");
            found += 1;
            largest_ms = largest_ms.max(1e3 * error_s);
            least = least.min(1e3 * lag.standard_error_s);
            most = most.max(1e3 * lag.standard_error_s);
        }
        println!(
            "{mover:?}, {kind:?}: {found} of {}, off by {largest_ms:.2} ms at most, standard errors \
             {least:.2} to {most:.2} ms",
            lags.len()
        );
        assert!(largest_ms <= within_ms, "{mover:?}, {kind:?}: {largest_ms} ms");
        // A push of a hand may hide one of four lags of slow motions.
        assert!((found >= 3) == (within_ms > 0.0), "{mover:?}, {kind:?}: {found}");
    }
    assert_eq!(run(Mover::Arm, Nothing, 0.3, 5), None, "beyond what is looked for");
}

#[test]
fn a_lag_that_may_be_zero_is_taken_for_zero_unless_that_does_not_matter() {
    for (lag_ms, error_ms, taken_ms) in
        [(0.2, 0.4, 0.2), (6.0, 2.5, 6.0), (-6.0, 3.5, 0.0), (1.0, 1.0, 1.0), (1.9, 1.1, 0.0)]
    {
        let lag = Lag { lag_s: 1e-3 * lag_ms, standard_error_s: 1e-3 * error_ms };
        assert_eq!(lag.taken_s(), 1e-3 * taken_ms);
    }
}

#[test]
fn a_run_at_rest_has_no_lag() {
    let mut noise = RandomStream::new(9, Purpose::Reference, 0);
    let times: Vec<f64> = (0..5000).map(|i| f64::from(i) / 500.0).collect();
    let mut rest = || times.iter().map(|_| 0.05 * noise.normal()).collect::<Vec<f64>>();
    let forces = [rest(), rest(), rest()];
    let gravity: Vec<Vector> = rest().iter().map(|noise| [0.1 * noise, 0.0, 9.8]).collect();
    let motion = Motion::new(&times, &gravity).unwrap();
    assert_eq!(find_lag(&PAYLOAD, &motion, &times, &forces), None);
}
