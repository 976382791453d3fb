//! What the columns of a table are, and the load that a line of them is.

use super::load::{Pull, STANDARD_GRAVITY};
use shell_data::hint::did_you_mean;
use shell_data::wrench::{Axis, LoadErrors};

/// A number that a column holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ColumnQuantity {
    Mass,
    Force,
    /// A coordinate of the point.
    Point(usize),
    /// A coordinate of a vector along the force.
    Along(usize),
    Azimuth,
    Elevation,
    Roll,
    Pitch,
    Yaw,
    /// An axis of an accelerometer at rest.
    Accelerometer(usize),
    /// An axis of the wrench.
    Wrench(usize),
    /// Standard errors.
    MassError,
    ForceError,
    AngleError,
    LeverError,
}

/// What a column is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum LoadColumn {
    Group,
    Mounting,
    Direction,
    /// A number, and what it is multiplied by to be in SI units (angles: radians).
    Number(ColumnQuantity, f64),
    /// Carried along.
    Other,
}

const DEGREE: f64 = std::f64::consts::PI / 180.0;

/// Errors where nothing is stated: what a kitchen scale shows of a mass of some hundred grams, a protractor of a
/// string, and a ruler of a lever.
const USUAL_SHARE: f64 = 0.002;
const USUAL_ANGLE_RAD: f64 = DEGREE;
const USUAL_LEVER_M: f64 = 1e-3;

/// Known names, with what they are.
const NAMES: [(&str, LoadColumn); 42] = {
    use ColumnQuantity as Q;
    use LoadColumn::{Direction, Group, Mounting, Number, Other};
    [
        ("group", Group),
        ("pose", Group),
        ("label", Group),
        ("mounting", Mounting),
        ("direction", Direction),
        ("notes", Other),
        ("mass_kg", Number(Q::Mass, 1.0)),
        ("mass_g", Number(Q::Mass, 1e-3)),
        ("force_n", Number(Q::Force, 1.0)),
        ("force_mn", Number(Q::Force, 1e-3)),
        ("x_m", Number(Q::Point(0), 1.0)),
        ("y_m", Number(Q::Point(1), 1.0)),
        ("z_m", Number(Q::Point(2), 1.0)),
        ("x_cm", Number(Q::Point(0), 1e-2)),
        ("y_cm", Number(Q::Point(1), 1e-2)),
        ("z_cm", Number(Q::Point(2), 1e-2)),
        ("x_mm", Number(Q::Point(0), 1e-3)),
        ("y_mm", Number(Q::Point(1), 1e-3)),
        ("z_mm", Number(Q::Point(2), 1e-3)),
        ("dx", Number(Q::Along(0), 1.0)),
        ("dy", Number(Q::Along(1), 1.0)),
        ("dz", Number(Q::Along(2), 1.0)),
        ("azimuth_deg", Number(Q::Azimuth, DEGREE)),
        ("elevation_deg", Number(Q::Elevation, DEGREE)),
        ("roll_deg", Number(Q::Roll, DEGREE)),
        ("pitch_deg", Number(Q::Pitch, DEGREE)),
        ("yaw_deg", Number(Q::Yaw, DEGREE)),
        ("roll_rad", Number(Q::Roll, 1.0)),
        ("pitch_rad", Number(Q::Pitch, 1.0)),
        ("yaw_rad", Number(Q::Yaw, 1.0)),
        ("ax", Number(Q::Accelerometer(0), 1.0)),
        ("ay", Number(Q::Accelerometer(1), 1.0)),
        ("az", Number(Q::Accelerometer(2), 1.0)),
        ("azimuth_rad", Number(Q::Azimuth, 1.0)),
        ("elevation_rad", Number(Q::Elevation, 1.0)),
        ("mass_error_kg", Number(Q::MassError, 1.0)),
        ("mass_error_g", Number(Q::MassError, 1e-3)),
        ("force_error_n", Number(Q::ForceError, 1.0)),
        ("force_error_mn", Number(Q::ForceError, 1e-3)),
        ("angle_error_deg", Number(Q::AngleError, DEGREE)),
        ("angle_error_rad", Number(Q::AngleError, 1.0)),
        ("lever_error_mm", Number(Q::LeverError, 1e-3)),
    ]
};

impl LoadColumn {
    /// What a column of this name is, or what is wrong with it.
    pub(crate) fn from_name(name: &str) -> Result<Self, String> {
        let plain = name.trim().to_lowercase().replace([' ', '-'], "_");
        if plain.starts_with("plan_") {
            return Ok(Self::Other);
        }
        if let Some(axis) = Axis::ALL.iter().find(|axis| axis.column() == plain) {
            return Ok(Self::Number(ColumnQuantity::Wrench(axis.index()), 1.0));
        }
        let known = NAMES.iter().find(|(known, _)| *known == plain);
        known.map(|(_, column)| *column).ok_or_else(|| {
            let names = NAMES.iter().map(|(known, _)| *known);
            let hint = did_you_mean(&plain, names.chain(Axis::ALL.map(Axis::column)));
            format!("unknown column `{name}`{hint}")
        })
    }
}

/// The load of a line: `number` gives what a column of it holds, `word` its direction.
pub(crate) fn pull(
    number: impl Fn(ColumnQuantity) -> Option<f64>,
    word: Option<&str>,
) -> Result<Pull, String> {
    let three = |of: fn(usize) -> ColumnQuantity| some_of([0, 1, 2].map(|axis| number(of(axis))));
    let (mass_kg, force_n) = match (number(ColumnQuantity::Mass), number(ColumnQuantity::Force)) {
        (Some(_), Some(_)) => return Err("both a mass and a force".to_owned()),
        (Some(mass), None) => (Some(mass), mass * STANDARD_GRAVITY),
        (None, Some(force)) => (None, force),
        (None, None) => {
            let wrench =
                some_of([0, 1, 2, 3, 4, 5].map(|axis| number(ColumnQuantity::Wrench(axis))));
            let missing = || "no mass, no force and no wrench".to_owned();
            return wrench.map(Pull::Wrench).ok_or_else(missing);
        }
    };
    if force_n < 0.0 {
        return Err("a load below zero: turn its direction around".to_owned());
    }
    let angles = |first, second| some_of([number(first), number(second)]);
    let turned = angles(ColumnQuantity::Roll, ColumnQuantity::Pitch)
        .or_else(|| number(ColumnQuantity::Yaw).map(|_| [0.0, 0.0]));
    let ways = [
        word.map(direction_of_word).transpose()?,
        three(ColumnQuantity::Along),
        angles(ColumnQuantity::Azimuth, ColumnQuantity::Elevation)
            .map(|[azimuth, up]| [up.cos() * azimuth.cos(), up.cos() * azimuth.sin(), up.sin()]),
        // −Rᵀ·z with R = Rz(yaw)·Ry(pitch)·Rx(roll), the sensor's axes in the room; yaw turns about the load.
        turned.map(|[roll, pitch]| {
            [pitch.sin(), -pitch.cos() * roll.sin(), -pitch.cos() * roll.cos()]
        }),
        // At rest it reads what holds it up.
        three(ColumnQuantity::Accelerometer).map(|read| read.map(|value| -value)),
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
    let point_m = three(ColumnQuantity::Point).unwrap_or_default();
    Ok(Pull::Force { force_n, mass_kg, point_m, direction: along.map(|x| x / length) })
}

/// Numbers of which at least one is given, with 0 for the others.
fn some_of<const N: usize>(numbers: [Option<f64>; N]) -> Option<[f64; N]> {
    numbers.iter().any(Option::is_some).then(|| numbers.map(Option::unwrap_or_default))
}

/// The errors that a line states of its load, and those that are usual where it says nothing.
pub(crate) fn errors(
    number: impl Fn(ColumnQuantity) -> Option<f64>,
    pull: &Pull,
) -> Result<LoadErrors, String> {
    use ColumnQuantity::{AngleError, ForceError, LeverError, MassError};
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
