//! The meaning of a column by its name, and the load of a line.

use super::load::{Pull, STANDARD_GRAVITY};
use shell_data::hint::did_you_mean;
use shell_data::wrench::{Axis, LoadErrors};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LoadColumn {
    Group,
    Mounting,
    Direction,
    /// Copied and not interpreted.
    Other,
    Mass,
    Force,
    /// A coordinate of the point of application.
    Point(usize),
    /// A coordinate of a vector along the force.
    Along(usize),
    Azimuth,
    Elevation,
    Roll,
    Pitch,
    Yaw,
    Accelerometer(usize),
    Wrench(usize),
    MassError,
    ForceError,
    AngleError,
    LeverError,
}

const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// Default standard errors: a kitchen scale with some hundred grams (share of the mass), a
/// protractor at a string, a ruler at a lever.
const USUAL_SHARE: f64 = 0.002;
const USUAL_ANGLE_RAD: f64 = DEGREE;
const USUAL_LEVER_M: f64 = 1e-3;

/// Endings of names, with factors to SI units (angles: radians).
type Units = &'static [(&'static str, f64)];

const NO_UNIT: Units = &[("", 1.0)];
const MASS: Units = &[("_kg", 1.0), ("_g", 1e-3)];
const FORCE: Units = &[("_n", 1.0), ("_mn", 1e-3)];
const LENGTH: Units = &[("_m", 1.0), ("_cm", 1e-2), ("_mm", 1e-3)];
const ANGLE: Units = &[("_deg", DEGREE), ("_rad", 1.0)];

const NAMES: [(&str, Units, LoadColumn); 26] = [
    ("group", NO_UNIT, LoadColumn::Group),
    ("pose", NO_UNIT, LoadColumn::Group),
    ("label", NO_UNIT, LoadColumn::Group),
    ("mounting", NO_UNIT, LoadColumn::Mounting),
    ("direction", NO_UNIT, LoadColumn::Direction),
    ("notes", NO_UNIT, LoadColumn::Other),
    ("mass", MASS, LoadColumn::Mass),
    ("force", FORCE, LoadColumn::Force),
    ("x", LENGTH, LoadColumn::Point(0)),
    ("y", LENGTH, LoadColumn::Point(1)),
    ("z", LENGTH, LoadColumn::Point(2)),
    ("dx", NO_UNIT, LoadColumn::Along(0)),
    ("dy", NO_UNIT, LoadColumn::Along(1)),
    ("dz", NO_UNIT, LoadColumn::Along(2)),
    ("azimuth", ANGLE, LoadColumn::Azimuth),
    ("elevation", ANGLE, LoadColumn::Elevation),
    ("roll", ANGLE, LoadColumn::Roll),
    ("pitch", ANGLE, LoadColumn::Pitch),
    ("yaw", ANGLE, LoadColumn::Yaw),
    ("ax", NO_UNIT, LoadColumn::Accelerometer(0)),
    ("ay", NO_UNIT, LoadColumn::Accelerometer(1)),
    ("az", NO_UNIT, LoadColumn::Accelerometer(2)),
    ("mass_error", MASS, LoadColumn::MassError),
    ("force_error", FORCE, LoadColumn::ForceError),
    ("angle_error", ANGLE, LoadColumn::AngleError),
    ("lever_error", LENGTH, LoadColumn::LeverError),
];

impl LoadColumn {
    /// Returns meaning and factor to SI units, or a message about the name.
    pub(crate) fn from_name(name: &str) -> Result<(Self, f64), String> {
        let plain = name.trim().to_lowercase().replace([' ', '-'], "_");
        if plain.starts_with("plan_") {
            return Ok((Self::Other, 1.0));
        }
        let of_units = |(stem, units, column): (&'static str, Units, Self)| {
            units.iter().map(move |(unit, factor)| (format!("{stem}{unit}"), (column, *factor)))
        };
        let axis = |axis: Axis| (axis.column().to_owned(), (Self::Wrench(axis.index()), 1.0));
        let known: Vec<_> =
            NAMES.into_iter().flat_map(of_units).chain(Axis::ALL.map(axis)).collect();
        let found = known.iter().find(|(known, _)| *known == plain);
        found.map(|(_, column)| *column).ok_or_else(|| {
            let hint = did_you_mean(&plain, known.iter().map(|(known, _)| known.as_str()));
            format!("unknown column `{name}`{hint}")
        })
    }
}

/// Computes the load of a line; `number` returns the value of a column, `word` the direction.
pub(crate) fn pull(
    number: impl Fn(LoadColumn) -> Option<f64>,
    word: Option<&str>,
) -> Result<Pull, String> {
    let three = |of: fn(usize) -> LoadColumn| some_of([0, 1, 2].map(|axis| number(of(axis))));
    let (mass_kg, force_n) = match (number(LoadColumn::Mass), number(LoadColumn::Force)) {
        (Some(_), Some(_)) => return Err("both a mass and a force".to_owned()),
        (Some(mass), None) => (Some(mass), mass * STANDARD_GRAVITY),
        (None, Some(force)) => (None, force),
        (None, None) => {
            let wrench = some_of([0, 1, 2, 3, 4, 5].map(|axis| number(LoadColumn::Wrench(axis))));
            let missing = || "no mass, no force and no wrench".to_owned();
            return wrench.map(Pull::Wrench).ok_or_else(missing);
        }
    };
    if force_n < 0.0 {
        return Err("a load below zero: turn its direction around".to_owned());
    }
    let angles = |first, second| some_of([number(first), number(second)]);
    let turned = angles(LoadColumn::Roll, LoadColumn::Pitch)
        .or_else(|| number(LoadColumn::Yaw).map(|_| [0.0, 0.0]));
    let ways = [
        word.map(direction_of_word).transpose()?,
        three(LoadColumn::Along),
        angles(LoadColumn::Azimuth, LoadColumn::Elevation)
            .map(|[azimuth, up]| [up.cos() * azimuth.cos(), up.cos() * azimuth.sin(), up.sin()]),
        // −Rᵀ·z with R = Rz(yaw)·Ry(pitch)·Rx(roll), the sensor's axes; yaw turns about the load.
        turned.map(|[roll, pitch]| {
            [pitch.sin(), -pitch.cos() * roll.sin(), -pitch.cos() * roll.cos()]
        }),
        // A still accelerometer reads the force that supports it, opposite to gravity.
        three(LoadColumn::Accelerometer).map(|read| read.map(|value| -value)),
    ];
    let mut given = ways.into_iter().flatten();
    let along = given.next().unwrap_or([0.0, 0.0, -1.0]);
    if given.next().is_some() {
        return Err("more than one direction".to_owned());
    }
    let length = along.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length <= 0.0 {
        return Err("a direction of length 0".to_owned());
    }
    let point_m = three(LoadColumn::Point).unwrap_or_default();
    Ok(Pull::Force { force_n, mass_kg, point_m, direction: along.map(|x| x / length) })
}

fn some_of<const N: usize>(numbers: [Option<f64>; N]) -> Option<[f64; N]> {
    numbers.iter().any(Option::is_some).then(|| numbers.map(Option::unwrap_or_default))
}

pub(crate) fn errors(
    number: impl Fn(LoadColumn) -> Option<f64>,
    pull: &Pull,
) -> Result<LoadErrors, String> {
    use LoadColumn::{AngleError, ForceError, LeverError, MassError};
    let force_n = match pull {
        Pull::Force { force_n, .. } => *force_n,
        Pull::Wrench(_) => 0.0,
    };
    let stated = |quantity| match number(quantity) {
        Some(error) if error < 0.0 => Err("an error below zero".to_owned()),
        error => Ok(error),
    };
    let size = match (stated(MassError)?, stated(ForceError)?) {
        (Some(_), Some(_)) => return Err("the error of a mass and that of a force".to_owned()),
        (mass, force) => mass.map(|mass| mass * STANDARD_GRAVITY).or(force),
    };
    Ok(LoadErrors {
        force_n: size.unwrap_or(USUAL_SHARE * force_n),
        angle_rad: stated(AngleError)?.unwrap_or(USUAL_ANGLE_RAD),
        lever_m: stated(LeverError)?.unwrap_or(USUAL_LEVER_M),
    })
}

fn direction_of_word(word: &str) -> Result<[f64; 3], String> {
    match word.replace('−', "-").to_lowercase().as_str() {
        "down" | "-z" => Ok([0.0, 0.0, -1.0]),
        "up" | "+z" | "z" => Ok([0.0, 0.0, 1.0]),
        "+x" | "x" => Ok([1.0, 0.0, 0.0]),
        "-x" => Ok([-1.0, 0.0, 0.0]),
        "+y" | "y" => Ok([0.0, 1.0, 0.0]),
        "-y" => Ok([0.0, -1.0, 0.0]),
        _ => Err(format!("direction `{word}`, expected down, up, +x, -x, +y, -y, +z or -z")),
    }
}
