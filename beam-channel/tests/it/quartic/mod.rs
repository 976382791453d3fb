//! The contact of a beam's tip as a root of a polynomial, found without the crate under test.
//!
//! With `t = tan(θ/2)` the tip is at `x = u + L·2t/(1 + t²)`, `y = g + L·2t²/(1 + t²)`. Inserted
//! into the ellipse's equation and multiplied by `(1 + t²)²`, that is a quartic in `t`. Its roots
//! are found between those of its derivative, and so on.

mod double_double;

use double_double::Wide;

/// A beam and the body, seen from its wall: x forward of the body's middle, y towards the wall.
pub(crate) struct Tip {
    pub(crate) semi_length: f64,
    pub(crate) semi_width: f64,
    pub(crate) beam: f64,
    /// Distance from the body's middle to the unbent tip.
    pub(crate) gap: f64,
    /// Forward distance from the body's middle to the base.
    pub(crate) ahead: f64,
    /// Yaw towards the wall, rad.
    pub(crate) yaw: f64,
}

type Polynomial = Vec<Wide>;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Intersection {
    /// Position on the ellipse, rad from the nose towards the wall, from −π to π.
    pub(crate) phi: f64,
    /// Forward distance from the base, over the length of the beam.
    pub(crate) forward: f64,
}

/// Returns the intersections of the ellipse with the circle about the base, on the forward side.
pub(crate) fn intersections(tip: &Tip) -> Vec<Intersection> {
    let wide = Wide::from;
    let two = wide(2.0);
    let (ahead, gap, beam) = (wide(tip.ahead), wide(tip.gap), wide(tip.beam));
    let x = [ahead, two * beam, ahead];
    let y = [gap, wide(0.0), gap + two * beam];
    // The tip in the body's frame, times the length of `(cos, sin)`, which rounding moves off one.
    let (sin, cos) = (wide(tip.yaw.sin()), wide(tip.yaw.cos()));
    let along: Polynomial = (0..3).map(|i| cos * x[i] + sin * y[i]).collect();
    let across: Polynomial = (0..3).map(|i| cos * y[i] - sin * x[i]).collect();
    let one = [wide(1.0), wide(0.0), wide(1.0)];
    let (rx, ry) = (wide(tip.semi_length), wide(tip.semi_width));
    let turn = sin * sin + cos * cos;
    let [rx2, ry2] = [rx * rx, ry * ry];
    let parts = [(&along[..], ry2), (&across[..], rx2), (&one[..], wide(0.0) - rx2 * ry2 * turn)];
    let mut quartic = vec![wide(0.0); 5];
    for (factor, scale) in parts {
        for i in 0..3 {
            for j in 0..3 {
                quartic[i + j] = quartic[i + j] + scale * factor[i] * factor[j];
            }
        }
    }
    let intersection = |t: Wide| {
        let square = wide(1.0) + t * t;
        let position = |parts: &[Wide]| (parts[0] + t * (parts[1] + t * parts[2])) / square;
        let (along, across) = (position(&along), position(&across));
        let phi = f64::from(across / ry).atan2(f64::from(along / rx));
        Intersection { phi, forward: f64::from(two * t / square) }
    };
    roots(&quartic).into_iter().map(intersection).collect()
}

fn roots(polynomial: &[Wide]) -> Vec<Wide> {
    if polynomial.len() < 2 {
        return Vec::new();
    }
    let derivative: Polynomial =
        (1..polynomial.len()).map(|i| Wide::from(i as f64) * polynomial[i]).collect();
    let mut ends = vec![Wide::from(0.0)];
    ends.extend(roots(&derivative));
    ends.push(bound(polynomial));
    let mut found = Vec::new();
    for pair in ends.windows(2) {
        found.extend(bisect(polynomial, pair[0], pair[1]));
    }
    found
}

/// Cauchy's bound: no root is greater than `1 + max |a_i/a_n|`.
fn bound(polynomial: &[Wide]) -> Wide {
    let size = |value: &Wide| f64::from(*value).abs();
    let (leading, rest) = polynomial.split_last().unwrap();
    let greatest = rest.iter().map(size).fold(0.0, f64::max);
    Wide::from(1.0 + greatest / size(leading).max(1e-300)).min(Wide::from(1e12))
}

fn value(polynomial: &[Wide], t: Wide) -> Wide {
    polynomial.iter().rev().fold(Wide::from(0.0), |sum, &coefficient| sum * t + coefficient)
}

fn bisect(polynomial: &[Wide], mut low: Wide, mut high: Wide) -> Option<Wide> {
    let positive = |t| f64::from(value(polynomial, t)) > 0.0;
    let sign = positive(low);
    if positive(high) == sign {
        return None;
    }
    for _ in 0..150 {
        let middle = Wide::from(0.5) * (low + high);
        if f64::from(high - low) <= 1e-26 * f64::from(middle) {
            break;
        }
        if positive(middle) == sign {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(low)
}
