//! Stated loads, and the errors that they may have.

use shell_data::wrench::{LoadErrors, PerAxis, cross, force_at};

/// Number of deviations of a load, in stated errors: one of size, two of direction, three of lever.
pub(super) const OWN: usize = 6;

pub(super) const SHARED: usize = 3;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StatedLoad {
    Wrench(PerAxis<f64>),
    Force {
        force_n: f64,
        direction: [f64; 3],
        /// Point of action, from the sensor's origin, m.
        point_m: [f64; 3],
        errors: LoadErrors,
        /// `None` if no lever offset is fitted.
        mounting: Option<usize>,
    },
}

/// Quantity of a load that may be wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoadQuantity {
    /// Mass or force.
    Size,
    Direction,
    /// Point of action.
    Lever,
}

impl LoadQuantity {
    pub const ALL: [Self; 3] = [Self::Size, Self::Direction, Self::Lever];

    pub(super) fn positions(self) -> std::ops::Range<usize> {
        match self {
            Self::Size => 0..1,
            Self::Direction => 1..3,
            Self::Lever => 3..6,
        }
    }

    pub(super) fn length(self, own: &[f64; OWN]) -> f64 {
        own[self.positions()].iter().map(|x| x * x).sum::<f64>().sqrt()
    }

    /// Median length for standard normal deviations.
    pub(super) fn median(self) -> f64 {
        match self {
            Self::Size => 0.674_490,
            Self::Direction => 1.177_410,
            Self::Lever => 1.538_172,
        }
    }
}

impl StatedLoad {
    /// Stated wrench, N and N·m.
    pub fn wrench(&self) -> PerAxis<f64> {
        self.deviated(&[0.0; OWN], &[0.0; SHARED]).0
    }

    /// Standard error of each axis of the stated wrench, N and N·m.
    pub fn standard_errors(&self) -> PerAxis<f64> {
        let mut squares = PerAxis::default();
        for position in 0..OWN {
            let side = |deviation| {
                let mut own = [0.0; OWN];
                own[position] = deviation;
                self.deviated(&own, &[0.0; SHARED]).0
            };
            let (up, down) = (side(1.0), side(-1.0));
            for axis in 0..6 {
                squares[axis] += (0.5 * (up[axis] - down[axis])).powi(2);
            }
        }
        squares.map(f64::sqrt)
    }

    /// Wrench and direction with these deviations (stated errors) and offset of the mounting (m).
    pub(super) fn deviated(
        &self,
        own: &[f64; OWN],
        offset: &[f64; SHARED],
    ) -> (PerAxis<f64>, [f64; 3]) {
        match *self {
            Self::Wrench(wrench) => (wrench, [0.0; 3]),
            Self::Force { force_n, direction, point_m, errors, .. } => {
                let turn = [own[1], own[2]].map(|angle| angle * errors.angle_rad);
                let direction = turned(direction, turn);
                let force = direction.map(|d| d * own[0].mul_add(errors.force_n, force_n));
                let point = std::array::from_fn(|i| {
                    own[3 + i].mul_add(errors.lever_m, point_m[i] + offset[i])
                });
                (force_at(force, point), direction)
            }
        }
    }

    pub(super) fn mounting(&self) -> Option<usize> {
        if let Self::Force { mounting, .. } = self { *mounting } else { None }
    }
}

/// Turns `d` by two angles, towards two directions perpendicular to it.
fn turned(d: [f64; 3], [first, second]: [f64; 2]) -> [f64; 3] {
    // Perpendicular to the axis along which d is least.
    let least = (0..3).min_by(|&i, &j| d[i].abs().total_cmp(&d[j].abs())).unwrap_or(0);
    let mut axis = [0.0; 3];
    axis[least] = 1.0;
    let across = cross(axis, d);
    let length = across.iter().map(|x| x * x).sum::<f64>().sqrt();
    let across = across.map(|x| x / length);
    let other = cross(d, across);
    let angle = first.hypot(second);
    let share = if angle > 0.0 { libm::sin(angle) / angle } else { 1.0 };
    std::array::from_fn(|i| {
        libm::cos(angle).mul_add(d[i], share * (first * across[i] + second * other[i]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_direction_is_turned_by_the_angle_and_keeps_its_length() {
        let d = [0.6, 0.0, -0.8];
        let turned = turned(d, [0.3, -0.4]);
        let dot = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        // Some roundings of numbers of order 1.
        assert!((dot(turned, turned) - 1.0).abs() < 1e-14);
        assert!((dot(turned, d) - 0.5_f64.cos()).abs() < 1e-14);
    }
}
