//! Forces and moments that do not follow gravity, and an exchange of axes that explains them.

use super::PayloadPose;
use super::fit::{PayloadFit, fit};
use super::vector::{Vector, dot, mean, subtract};
use shell_data::wrench::Axis;

/// Residuals above this share of the scatter over poses are doubtful.
const DOUBTED: f64 = 0.5;
/// Residuals above this share start a search for another interpretation of the columns.
const SUSPECTED: f64 = 0.1;
/// Another interpretation must reduce the residual below this share.
const CURED: f64 = 1.0 / 3.0;
/// Residual moments matter if they exceed those of the weight at this lever arm, m.
const LEVER_M: f64 = 0.005;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOver {
    pub rms: f64,
    pub scatter: f64,
}

impl LeftOver {
    pub fn of_forces(fit: &PayloadFit, poses: &[PayloadPose]) -> Self {
        Self { rms: fit.residual_rms_n, scatter: scatter(poses, 0) }
    }

    pub fn of_moments(fit: &PayloadFit, poses: &[PayloadPose]) -> Self {
        Self { rms: fit.residual_rms_nm, scatter: scatter(poses, 3) }
    }

    pub fn is_doubtful(&self) -> bool {
        self.rms > DOUBTED * self.scatter
    }

    pub fn is_suspected(&self) -> bool {
        self.rms > SUSPECTED * self.scatter
    }

    /// Returns true if another interpretation of the columns, with this residual, is the right one.
    pub fn is_cured_by(&self, rms: f64) -> bool {
        rms < CURED * self.rms
    }
}

fn scatter(poses: &[PayloadPose], first: usize) -> f64 {
    let part = |pose: &PayloadPose| -> Vector { std::array::from_fn(|i| pose.wrench[first + i]) };
    let middle = mean(poses.iter().map(part));
    let squares = poses.iter().map(|pose| subtract(part(pose), middle));
    (squares.map(|off| dot(off, off)).sum::<f64>() / (3 * poses.len()) as f64).sqrt()
}

/// A permutation of moments: for each axis the source axis, and true if its sign flips.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MomentExchange([(usize, bool); 3]);

impl MomentExchange {
    fn of(&self, [x, y, z]: Vector) -> Vector {
        self.0.map(|(axis, is_negative)| {
            let value = [x, y, z][axis];
            if is_negative { -value } else { value }
        })
    }

    fn changes(&self) -> usize {
        (0..3).filter(|&axis| self.0[axis] != (axis, false)).count()
    }

    /// All exchanges except the identity, with the fewest changes first.
    fn all() -> Vec<Self> {
        let orders = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [2, 1, 0], [1, 2, 0], [2, 0, 1]];
        let signed = |order: [usize; 3]| {
            let with = move |signs: usize| {
                Self(std::array::from_fn(|axis| (order[axis], signs >> axis & 1 == 1)))
            };
            (0..8).map(with)
        };
        let mut all: Vec<Self> = orders.into_iter().flat_map(signed).collect();
        all.retain(|one| one.changes() > 0);
        all.sort_by_key(Self::changes);
        all
    }
}

impl std::fmt::Display for MomentExchange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let name = |axis: usize| Axis::ALL[3 + axis].name();
        let changed: Vec<usize> = (0..3).filter(|&axis| self.0[axis] != (axis, false)).collect();
        if let [a, b] = changed[..]
            && self.0[a] == (b, false)
            && self.0[b] == (a, false)
        {
            return write!(f, "exchanging {} and {}", name(a), name(b));
        }
        let taken = changed.iter().map(|&axis| {
            let (from, is_negative) = self.0[axis];
            format!("{} from {}{}", name(axis), if is_negative { "−" } else { "" }, name(from))
        });
        write!(f, "taking {}", taken.collect::<Vec<_>>().join(", "))
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MomentDoubt {
    pub left: LeftOver,
    /// The exchange that explains the moments, and its residual, N·m.
    pub cure: Option<(MomentExchange, f64)>,
}

/// Returns a doubt if moments do not follow gravity, with an exchange of axes that explains them, if any.
pub fn moment_doubt(found: &PayloadFit, poses: &[PayloadPose]) -> Option<MomentDoubt> {
    let left = LeftOver::of_moments(found, poses);
    if !left.is_suspected() {
        return None;
    }
    let exchanged = |exchange: MomentExchange| {
        let pose = |pose: &PayloadPose| {
            let [fx, fy, fz, mx, my, mz] = pose.wrench;
            let [mx, my, mz] = exchange.of([mx, my, mz]);
            PayloadPose { wrench: [fx, fy, fz, mx, my, mz], ..*pose }
        };
        let poses: Vec<PayloadPose> = poses.iter().map(pose).collect();
        fit(&poses).ok().map(|fit| (exchange, fit.residual_rms_nm))
    };
    let all = MomentExchange::all().into_iter().filter_map(exchanged);
    // Among equal residuals, `min_by` keeps the exchange with the fewest changes.
    let best = all.min_by(|(_, a), (_, b)| a.total_cmp(b));
    let cure = best.filter(|(_, rms)| left.is_cured_by(*rms));
    let matters =
        left.is_doubtful() && left.rms > LEVER_M * found.payload.mass_kg * found.gravity_m_s2;
    (cure.is_some() || matters).then_some(MomentDoubt { left, cure })
}

#[cfg(test)]
mod tests {
    use super::super::Payload;
    use super::*;

    fn poses(exchange: MomentExchange) -> Vec<PayloadPose> {
        let payload = Payload {
            mass_kg: 0.6,
            centre_m: [0.02, -0.01, 0.05],
            force_bias_n: [0.0; 3],
            moment_bias_nm: [0.0; 3],
        };
        let pose = |i: u32| {
            let (a, b) = (0.9 * f64::from(i), 2.3 * f64::from(i));
            let gravity_m_s2 =
                [a.cos() * b.cos(), a.cos() * b.sin(), a.sin()].map(|value| 9.81 * value);
            let [fx, fy, fz, mx, my, mz] = payload.load(gravity_m_s2);
            let [mx, my, mz] = exchange.of([mx, my, mz]);
            PayloadPose { wrench: [fx, fy, fz, mx, my, mz], gravity_m_s2 }
        };
        (0..12).map(pose).collect()
    }

    #[test]
    fn an_exchange_of_moments_is_named() {
        let right = poses(MomentExchange([(0, false), (1, false), (2, false)]));
        assert_eq!(moment_doubt(&fit(&right).unwrap(), &right), None);
        for (exchange, words) in [
            (MomentExchange([(0, false), (2, false), (1, false)]), "exchanging My and Mz"),
            (MomentExchange([(0, true), (1, false), (2, false)]), "taking Mx from −Mx"),
            (MomentExchange([(1, false), (0, true), (2, false)]), "taking Mx from −My, My from Mx"),
        ] {
            let poses = poses(exchange);
            let doubt = moment_doubt(&fit(&poses).unwrap(), &poses).unwrap();
            let (cure, rms) = doubt.cure.unwrap();
            assert_eq!(cure.to_string(), words);
            // Numbers without noise: only rounding errors of moments below 1 N·m remain.
            assert!(rms < 1e-12, "{rms}");
        }
    }
}
