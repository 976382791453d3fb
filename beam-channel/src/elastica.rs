//! A beam clamped at its base that bends along its length: Euler's elastica, pushed at tip or face.
//!
//! The force `P` acts at the friction angle to the body's normal. With the angle `χ` from the
//! reversed force to the beam and the length `s` along it, `EI·χ'' = −P·sin χ`, a pendulum: from
//! `χ₀` at the clamp to `χ_L` at the tip, where the curvature is zero. With `k = sin(χ_L/2)`,
//! `k·sin u = sin(χ/2)` (Love, *Mathematical Theory of Elasticity*, 4th ed., §262)
//!
//! ```text
//! λ = L·√(P/EI) = K(k) − F(u₀, k)
//! x = S·cos χ₀ − C·sin χ₀,     S = 2k·cos u₀/λ,
//! y = C·cos χ₀ + S·sin χ₀,     C = 2·(E(k) − E(u₀, k))/λ − 1,
//! ```
//!
//! in beam lengths, with `y` along the straight beam. If a body has pushed the tip aside to `y`, only `χ_L` is unknown:
//! one root per position.
//!
//! A plate that bends far touches with its face, tangent to the body, at a length `σ < L` along it, and is straight
//! beyond. Its turn is then known. So `x` and `y` follow in units of `σ`, and `σ` from `y`, without a search for a
//! root.
//!
//! A table holds reach and force as functions of `z`, smooth between changes of tip and face.

use core::f64::consts::PI;

use libm::{atan2, cos, sin, sqrt};

use crate::bending::{Bending, PIECES, Piece, Series, TERMS, node};
use crate::bisection::turn;
use crate::path::Path;

/// Number of positions on a contact's path at which the body's travel is computed.
const PLACES: usize = 64;

/// A beam whose contact is at one position.
struct Bent {
    reach: f64,
    push: f64,
    is_on_tip: bool,
}

#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Failure {
    Locked,
    /// The beam springs off the body.
    Released,
    /// The body presses the beam's face against the line of the bases.
    Flattened,
}

impl Bending {
    /// Computes the table of a path, with contact at the face if `with_face`. Fails if the beam locks or is flattened.
    pub(crate) fn new(path: &Path, friction: f64, with_face: bool) -> Result<Self, Failure> {
        let place = |i: usize| path.last() * i as f64 / PLACES as f64;
        let at = |z: f64| bent(path, friction, with_face, z);
        let (mut travels, mut count) = ([0.0; PLACES], 1);
        let mut lies_against_body = false;
        let (mut changes, mut before) = ([f64::INFINITY; PIECES - 1], true);
        while count < PLACES {
            match at(place(count)) {
                Ok(bent) => {
                    let bar = path.position(place(count));
                    travels[count] = bar.travel - bar.reach_m + bent.reach;
                    let is_on_tip =
                        bent.is_on_tip || !with_face && travels[count] < travels[count - 1];
                    lies_against_body |= !is_on_tip;
                    if with_face && is_on_tip != before {
                        let is_as_before = |z| match at(z) {
                            Ok(bent) if bent.is_on_tip == before => 1.0,
                            _ => -1.0,
                        };
                        if let Some(change) = changes.iter_mut().find(|change| change.is_infinite())
                        {
                            *change = turn(is_as_before, place(count - 1), place(count));
                        }
                        before = is_on_tip;
                    }
                    count += 1;
                }
                Err(Failure::Released) => break,
                Err(failure) => return Err(failure),
            }
        }
        let most = (1..count).reduce(|a, b| if travels[b] > travels[a] { b } else { a });
        let most = most.ok_or(Failure::Locked)?;
        let rise = |i: &usize| travels[*i] - travels[*i - 1];
        let slowest = (1..=most).reduce(|a, b| if rise(&b) < rise(&a) { b } else { a });
        let falls = slowest.filter(|i| rise(i) < 0.0);
        let end = place((most + 1).min(count - 1));
        let landmarks = [falls.map_or(0.0, place), place(most.saturating_sub(1)), end];
        let mut start = 0.0;
        let mut piece = |change: f64| {
            let range = [start, change.min(end)];
            let mut values = [[0.0; 2]; TERMS];
            for (i, value) in values.iter_mut().enumerate() {
                let z = range[0] + (range[1] - range[0]) * node(i);
                let bent = at(z)?;
                *value = [bent.reach / z, bent.push / z];
            }
            let series = |of: usize| Series::through(&values.map(|value| value[of]), range);
            start = range[1];
            Ok(Piece { end: start, reach: series(0), push: series(1) })
        };
        let mut pieces = [piece(changes[0])?; PIECES];
        for i in 1..PIECES {
            pieces[i] = pieces[i - 1];
            if pieces[i].end < end {
                pieces[i] = piece(*changes.get(i).unwrap_or(&end))?;
            }
        }
        Ok(Self { landmarks, pieces, lies_against_body: lies_against_body && !with_face })
    }
}

fn bent(path: &Path, friction: f64, with_face: bool, z: f64) -> Result<Bent, Failure> {
    let contact = path.position(z);
    let (across, along) =
        (contact.out + friction * contact.back, contact.back - friction * contact.out);
    let clamp = atan2(across, along);
    let bent = |tip: Tip, length: f64, is_on_tip: bool| {
        let root = tip.root_of_force * path.beam / length;
        let push = root * root / sqrt(across * across + along * along);
        Bent { reach: length * tip.reach, push, is_on_tip }
    };
    let by_tip = match half_turn_of(clamp, 1.0 - contact.rise / path.beam) {
        Ok(half_turn) => {
            let (sin, cos) = (sin(2.0 * half_turn), cos(2.0 * half_turn));
            // The beam meets the surface from outside, if only the tip touches.
            let is_on_tip = sin * contact.out < cos * contact.back;
            if is_on_tip || !with_face {
                return Ok(bent(tip(clamp, half_turn), path.beam, is_on_tip));
            }
            Failure::Locked
        }
        Err(Failure::Locked) if with_face => Failure::Locked,
        Err(failure) => return Err(failure),
    };
    if contact.rise >= path.beam {
        return Err(Failure::Flattened);
    }
    let half_turn = 0.5 * atan2(contact.back, contact.out);
    if half_turn <= 0.0 || half_turn >= half_turns(clamp)[1] {
        return Err(by_tip);
    }
    let tip = tip(clamp, half_turn);
    let length = (path.beam - contact.rise) / tip.height;
    // Up to rounding at the change from tip to face.
    match length > 0.0 && length < path.beam * (1.0 + 1e-6) {
        true => Ok(bent(tip, length, false)),
        false => Err(by_tip),
    }
}

/// Returns half the least turn (a straight or buckled beam) and half the largest (a beam along the force).
fn half_turns(clamp: f64) -> [f64; 2] {
    let [least, most] = [(-clamp).max(0.0), 0.5 * (PI - clamp)].map(|turn| turn.max(1e-12));
    [least, most * (1.0 - 1e-9)]
}

fn half_turn_of(clamp: f64, height: f64) -> Result<f64, Failure> {
    let [least, most] = half_turns(clamp);
    if tip(clamp, most).height > height {
        return Err(Failure::Locked);
    }
    if tip(clamp, least).height < height {
        return Err(Failure::Released);
    }
    Ok(turn(|half_turn| tip(clamp, half_turn).height - height, least, most))
}

/// The tip of a beam of length one, and `λ`.
#[derive(Clone, Copy)]
struct Tip {
    height: f64,
    reach: f64,
    root_of_force: f64,
}

/// Returns the tip of a beam turned by `χ_L − χ₀`, twice `half_turn`; the force is at the angle `χ₀` to the clamp.
fn tip(clamp: f64, half_turn: f64) -> Tip {
    let (low, low_cos) = (sin(0.5 * clamp), cos(0.5 * clamp));
    // k² − sin²(χ₀/2), without cancellation.
    let rest = sqrt((sin(half_turn) * sin(clamp + half_turn)).max(f64::MIN_POSITIVE));
    let modulus = low * low + rest * rest;
    // K − F(u₀) = F(w) with tan w·tan u₀ = 1/k', and E(k) − E(u₀) accordingly (DLMF 19.11).
    let sine = (rest / (sqrt(modulus) * low_cos)).min(1.0);
    let (mut first, mut second) = incomplete(sine, modulus);
    if low < 0.0 {
        let complete = incomplete(1.0, modulus);
        (first, second) = (2.0 * complete.0 - first, 2.0 * complete.1 - second);
    }
    let along = 2.0 * (second - low * rest / low_cos) / first - 1.0;
    let across = 2.0 * rest / first;
    let (sin, cos) = (sin(clamp), cos(clamp));
    Tip {
        height: along * cos + across * sin,
        reach: across * cos - along * sin,
        root_of_force: first,
    }
}

/// Returns Legendre's incomplete integrals of both kinds for the sine of an angle up to 90° and
/// `k²`, by Carlson's duplication (Numerical Algorithms 10, 1995, 13–26), with shared steps.
fn incomplete(sine: f64, modulus: f64) -> (f64, f64) {
    let square = sine * sine;
    // The integrals would be infinite if both were zero.
    let [mut x, mut y] = [1.0 - square, 1.0 - modulus * square].map(|value| value.max(1e-30));
    let mut z = 1.0;
    let (mut sum, mut share) = (0.0, 1.0);
    loop {
        let mean = (x + y + z) / 3.0;
        let differences = [x, y, z].map(|value| 1.0 - value / mean);
        // The truncation error of the series is the sixth power of this.
        if !differences.iter().any(|difference| difference.abs() >= 1e-3) {
            let [dx, dy, dz] = differences;
            let (e2, e3) = (dx * dy - dz * dz, dx * dy * dz);
            let first =
                (1.0 - e2 / 10.0 + e3 / 14.0 + e2 * e2 / 24.0 - 3.0 * e2 * e3 / 44.0) / sqrt(mean);
            let mean = (x + y + 3.0 * z) / 5.0;
            let [dx, dy] = [x, y].map(|value| 1.0 - value / mean);
            let dz = -(dx + dy) / 3.0;
            let (e2, e3) = (dx * dy - 6.0 * dz * dz, (3.0 * dx * dy - 8.0 * dz * dz) * dz);
            let (e4, e5) = (3.0 * (dx * dy - dz * dz) * dz * dz, dx * dy * dz * dz * dz);
            let series = 1.0 - 3.0 * e2 / 14.0 + e3 / 6.0 + 9.0 * e2 * e2 / 88.0
                - 3.0 * e4 / 22.0
                - 9.0 * e2 * e3 / 52.0
                + 3.0 * e5 / 26.0;
            let third = 3.0 * sum + share * series / (mean * sqrt(mean));
            return (sine * first, sine * (first - modulus * square * third / 3.0));
        }
        let (a, b, c) = (sqrt(x), sqrt(y), sqrt(z));
        let shift = a * b + b * c + c * a;
        sum += share / (c * (z + shift));
        share *= 0.25;
        [x, y, z] = [x, y, z].map(|value| 0.25 * (value + shift));
    }
}
