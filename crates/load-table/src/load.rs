use std::fmt;

use shell_data::wrench::{Axis, LoadErrors, PerAxis, force_at};

/// Turns a mass into a force, m/s² (CGPM 1901, resolution 2).
pub const STANDARD_GRAVITY: f64 = 9.80665;

#[derive(Clone, Debug, PartialEq)]
pub struct HungLoad {
    pub group: String,
    pub pull: Pull,
    /// Standard errors of a force.
    pub errors: LoadErrors,
    pub mounting: Option<String>,
    /// Line number in the table, from 1.
    pub line: usize,
}

/// A force at a point, or a wrench, in the sensor's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Pull {
    Force {
        /// Magnitude, N.
        force_n: f64,
        /// The mass whose weight the force is, if given.
        mass_kg: Option<f64>,
        /// Point of application, from the sensor's origin, m.
        point_m: [f64; 3],
        /// Unit vector along the force.
        direction: [f64; 3],
    },
    /// A wrench about the sensor's origin, N and N·m.
    Wrench(PerAxis<f64>),
}

impl HungLoad {
    /// Returns the wrench about the origin, N and N·m: `F = force·direction`, `M = point × F`.
    pub fn wrench(&self) -> PerAxis<f64> {
        match self.pull {
            Pull::Wrench(wrench) => wrench,
            Pull::Force { force_n, point_m, direction, .. } => {
                force_at(direction.map(|along| force_n * along), point_m)
            }
        }
    }
}

impl fmt::Display for HungLoad {
    /// Formats the load for a person who hangs weights: `0.5 kg at (30, 0, 40) mm, down`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.pull {
            Pull::Force { force_n, .. } if *force_n == 0.0 => f.write_str("no load"),
            Pull::Force { force_n, mass_kg, point_m, direction } => {
                match mass_kg {
                    Some(mass) => write!(f, "{} kg", short(*mass))?,
                    None => write!(f, "{} N", short(*force_n))?,
                }
                let [x, y, z] = point_m.map(|metres| short(1e3 * metres));
                write!(f, " at ({x}, {y}, {z}) mm, ")?;
                write_direction(f, direction)
            }
            Pull::Wrench(wrench) => {
                let largest = |moment: bool| {
                    let of = Axis::ALL.iter().filter(|axis| axis.is_moment() == moment);
                    of.map(|axis| wrench[axis.index()].abs()).fold(0.0, f64::max)
                };
                let is_loaded =
                    |axis: &&Axis| wrench[axis.index()].abs() > 1e-3 * largest(axis.is_moment());
                let value = |axis: &Axis| {
                    let value = wrench[axis.index()];
                    let sign = if value < 0.0 { '−' } else { '+' };
                    format!("{} {sign}{} {}", axis.name(), short(value.abs()), axis.unit())
                };
                let said: Vec<_> = Axis::ALL.iter().filter(is_loaded).map(value).collect();
                f.write_str(if said.is_empty() { "no load" } else { "" })?;
                f.write_str(&said.join(", "))
            }
        }
    }
}

fn short(value: f64) -> String {
    if value == 0.0 {
        return "0".to_owned();
    }
    let decimals = (3.0 - value.abs().log10().floor()).clamp(0.0, 6.0);
    let text = format!("{value:.*}", decimals as usize);
    match text.contains('.') {
        true => text.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => text,
    }
}

fn write_direction(f: &mut fmt::Formatter<'_>, direction: &[f64; 3]) -> fmt::Result {
    let along = |axis: usize| (1.0 - direction[axis].abs()).abs() < 1e-9;
    match (0..3).find(|&axis| along(axis)) {
        Some(2) => f.write_str(if direction[2] < 0.0 { "down" } else { "up" }),
        Some(axis) => {
            let sign = if direction[axis] < 0.0 { '−' } else { '+' };
            write!(f, "towards {sign}{}", ['x', 'y', 'z'][axis])
        }
        None => {
            let [x, y, z] = direction;
            let azimuth = y.atan2(*x).to_degrees();
            let elevation = z.clamp(-1.0, 1.0).asin().to_degrees();
            write!(f, "azimuth {azimuth:.1}°, elevation {elevation:.1}°")
        }
    }
}
