//! The meaning of a column by its name, and the load of a line.

use super::load::{Pull, STANDARD_GRAVITY};
use shell_data::hint::{quoted, suggest};
use shell_data::wrench::{Axis, LoadErrors};
use shell_data::{Quantity, Scale, Unit};

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

/// Names without their units, and the quantity that the unit is of.
const NAMES: [(&str, Option<Quantity>, LoadColumn); 26] = [
    ("group", None, LoadColumn::Group),
    ("pose", None, LoadColumn::Group),
    ("label", None, LoadColumn::Group),
    ("mounting", None, LoadColumn::Mounting),
    ("direction", None, LoadColumn::Direction),
    ("notes", None, LoadColumn::Other),
    ("mass", Some(Quantity::Mass), LoadColumn::Mass),
    ("force", Some(Quantity::Force), LoadColumn::Force),
    ("x", Some(Quantity::Length), LoadColumn::Point(0)),
    ("y", Some(Quantity::Length), LoadColumn::Point(1)),
    ("z", Some(Quantity::Length), LoadColumn::Point(2)),
    ("dx", None, LoadColumn::Along(0)),
    ("dy", None, LoadColumn::Along(1)),
    ("dz", None, LoadColumn::Along(2)),
    ("azimuth", Some(Quantity::Angle), LoadColumn::Azimuth),
    ("elevation", Some(Quantity::Angle), LoadColumn::Elevation),
    ("roll", Some(Quantity::Angle), LoadColumn::Roll),
    ("pitch", Some(Quantity::Angle), LoadColumn::Pitch),
    ("yaw", Some(Quantity::Angle), LoadColumn::Yaw),
    ("ax", None, LoadColumn::Accelerometer(0)),
    ("ay", None, LoadColumn::Accelerometer(1)),
    ("az", None, LoadColumn::Accelerometer(2)),
    ("mass_error", Some(Quantity::Mass), LoadColumn::MassError),
    ("force_error", Some(Quantity::Force), LoadColumn::ForceError),
    ("angle_error", Some(Quantity::Angle), LoadColumn::AngleError),
    ("lever_error", Some(Quantity::Length), LoadColumn::LeverError),
];

fn names() -> impl Iterator<Item = (String, Option<Quantity>, LoadColumn)> {
    let of_axis = |axis: Axis| {
        let (quantity, column) = (Quantity::of_axis(axis), LoadColumn::Wrench(axis.index()));
        (axis.name().to_lowercase(), Some(quantity), column)
    };
    let named = |(stem, quantity, column): (&str, _, _)| (stem.to_owned(), quantity, column);
    NAMES.into_iter().map(named).chain(Axis::ALL.map(of_axis))
}

const MARKS: [char; 7] = ['_', '-', ' ', '(', ')', '[', ']'];

impl LoadColumn {
    /// Returns meaning and scale to SI units, or a message about the name.
    pub(crate) fn from_name(name: &str) -> Result<(Self, Scale), String> {
        let plain = name.trim().replace([' ', '-'], "_");
        let folded = plain.to_ascii_lowercase();
        if ["plan_", "notes_"].iter().any(|start| folded.starts_with(start)) {
            return Ok((Self::Other, Scale::ONE));
        }
        // The unit follows the longest stem: `mass_error_g`, `Mass error [g]`.
        let rest = |stem: &str| {
            let rest = folded.strip_prefix(stem)?;
            (rest.is_empty() || rest.starts_with(MARKS)).then(|| &plain[stem.len()..])
        };
        let found = names().filter_map(|named| Some((rest(&named.0)?.trim_matches(MARKS), named)));
        match found.max_by_key(|(_, (stem, ..))| stem.len()) {
            Some(("", (_, None, column))) => Ok((column, Scale::ONE)),
            Some((_, (stem, None, _))) => {
                Err(format!("unknown column `{name}`: write `{stem}`, which has no unit"))
            }
            Some((unit, (stem, Some(quantity), column))) => match Unit::parse(unit, quantity) {
                Some(unit) => Ok((column, unit.scale)),
                None => Err(format!("`{name}` needs a unit: write {}", spellings(&stem, quantity))),
            },
            None => Err(format!("unknown column `{name}`{}", hint(&folded))),
        }
    }

    const fn is_of_direction(self) -> bool {
        use LoadColumn::{Accelerometer, Along, Azimuth, Direction, Elevation, Pitch, Roll, Yaw};
        matches!(
            self,
            Direction | Along(_) | Azimuth | Elevation | Roll | Pitch | Yaw | Accelerometer(_)
        )
    }

    /// All names of a column, or of those that mean the same the first: `` `x_mm`, `x_cm` ``.
    fn names(self) -> String {
        let named = names().find(|(.., column)| *column == self);
        let (stem, quantity, _) = named.expect("every column has a name");
        quantity.map_or_else(|| format!("`{stem}`"), |quantity| spellings(&stem, quantity))
    }
}

/// The names that a quantity can have: `` `x_mm`, `x_cm` ``.
fn spellings(stem: &str, quantity: Quantity) -> String {
    let units = quantity.understood().split(", ");
    let name = |unit: &str| format!("{stem}_{}", unit.replace('·', "").to_lowercase());
    quoted(units.map(name), " or ")
}

/// Suggests names like a mistyped one, of the quantity that its unit is of.
fn hint(name: &str) -> String {
    let (stem, unit) = name.rsplit_once('_').unwrap_or((name, ""));
    let has_unit = Unit::is_spelled(unit);
    let stem = if has_unit { stem } else { name };
    let is_like = |quantity: Option<Quantity>| match quantity {
        Some(quantity) => !has_unit || Unit::parse(unit, quantity).is_some(),
        None => !has_unit,
    };
    let known: Vec<_> = names().filter(|(_, quantity, _)| is_like(*quantity)).collect();
    let meant = suggest(stem, known.iter().map(|(known, ..)| known.as_str()));
    match known.iter().find(|(known, ..)| Some(known.as_str()) == meant) {
        Some((stem, Some(quantity), _)) => {
            format!(", did you mean one of {}?", spellings(stem, *quantity))
        }
        Some((stem, None, _)) => format!(", did you mean `{stem}`?"),
        None => format!("; a column that is only copied is named `notes` or `notes_{name}`"),
    }
}

/// The numbers of a line, its direction in words, and the columns of the table.
pub(crate) struct Line<'a> {
    pub(crate) columns: &'a [(LoadColumn, Scale)],
    pub(crate) numbers: Vec<(LoadColumn, f64)>,
    pub(crate) word: Option<&'a str>,
}

/// The column at fault, if a single one is, and a message.
pub(crate) type Fault = (Option<LoadColumn>, String);

impl Line<'_> {
    fn number(&self, wanted: LoadColumn) -> Option<f64> {
        self.numbers.iter().find(|(quantity, _)| *quantity == wanted).map(|(_, value)| *value)
    }

    fn need(&self, column: LoadColumn) -> Result<f64, Fault> {
        let is_there = self.columns.iter().any(|(known, _)| *known == column);
        self.number(column).ok_or_else(|| match is_there {
            true => {
                (Some(column), "a load needs this number: write it, also where it is 0".to_owned())
            }
            false => {
                let names = column.names();
                (None, format!("a load needs a column {names}: write it, also where it is 0"))
            }
        })
    }

    /// Numbers that belong together: all or none. A missing one is not taken for 0.
    fn together<const N: usize>(
        &self,
        columns: [LoadColumn; N],
    ) -> Result<Option<[f64; N]>, Fault> {
        if columns.iter().all(|column| self.number(*column).is_none()) {
            return Ok(None);
        }
        let mut found = [0.0; N];
        for (found, column) in found.iter_mut().zip(columns) {
            *found = self.need(column)?;
        }
        Ok(Some(found))
    }

    /// Computes the load.
    pub(crate) fn pull(&self) -> Result<Pull, Fault> {
        let fault = |message: &str| (None, message.to_owned());
        let (mass_kg, force_n) =
            match (self.number(LoadColumn::Mass), self.number(LoadColumn::Force)) {
                (Some(_), Some(_)) => return Err(fault("both a mass and a force")),
                (Some(mass), None) => (Some(mass), mass * STANDARD_GRAVITY),
                (None, Some(force)) => (None, force),
                (None, None) => {
                    let wrench = self.together([0, 1, 2, 3, 4, 5].map(LoadColumn::Wrench))?;
                    let missing = || fault("no mass, no force and no wrench");
                    return wrench.map(Pull::Wrench).ok_or_else(missing);
                }
            };
        if force_n < 0.0 {
            return Err(fault("a load below zero: turn its direction around"));
        }
        let down = [0.0, 0.0, -1.0];
        if force_n == 0.0 {
            // It does not matter where nothing hangs.
            return Ok(Pull::Force { force_n, mass_kg, point_m: [0.0; 3], direction: down });
        }
        let point = [0, 1, 2].map(LoadColumn::Point);
        for column in point {
            self.need(column)?;
        }
        let point_m = self.together(point)?.unwrap_or_default();
        let along = match self.directions()?[..] {
            [] => match self.columns.iter().find(|(column, _)| column.is_of_direction()) {
                Some((column, _)) => {
                    let message = "no direction of this load: write it, also if it is down";
                    return Err((Some(*column), message.to_owned()));
                }
                None => down,
            },
            [along] => along,
            _ => return Err(fault("more than one direction")),
        };
        let length = along.iter().map(|x| x * x).sum::<f64>().sqrt();
        if length <= 0.0 {
            return Err(fault("a direction of length 0"));
        }
        Ok(Pull::Force { force_n, mass_kg, point_m, direction: along.map(|x| x / length) })
    }

    /// All directions that the line gives.
    fn directions(&self) -> Result<Vec<[f64; 3]>, Fault> {
        use LoadColumn::{Accelerometer, Along, Azimuth, Elevation, Pitch, Roll, Yaw};
        let turned = match (self.together([Roll, Pitch])?, self.number(Yaw)) {
            (None, Some(_)) => Some([self.need(Roll)?, self.need(Pitch)?]),
            (turned, _) => turned,
        };
        let ways = [
            self.word.map(direction_of_word).transpose().map_err(|why| (None, why))?,
            self.together([0, 1, 2].map(Along))?,
            self.together([Azimuth, Elevation])?.map(|[azimuth, up]| {
                [up.cos() * azimuth.cos(), up.cos() * azimuth.sin(), up.sin()]
            }),
            // −Rᵀ·z with R = Rz(yaw)·Ry(pitch)·Rx(roll), the sensor's axes; yaw turns about the load.
            turned.map(|[roll, pitch]| {
                [pitch.sin(), -pitch.cos() * roll.sin(), -pitch.cos() * roll.cos()]
            }),
            // A still accelerometer reads the force that supports it, opposite to gravity.
            self.together([0, 1, 2].map(Accelerometer))?.map(|read| read.map(|value| -value)),
        ];
        Ok(ways.into_iter().flatten().collect())
    }

    pub(crate) fn errors(&self, pull: &Pull) -> Result<LoadErrors, Fault> {
        use LoadColumn::{AngleError, ForceError, LeverError, MassError};
        let force_n = match pull {
            Pull::Force { force_n, .. } => *force_n,
            Pull::Wrench(_) => 0.0,
        };
        let stated = |quantity| match self.number(quantity) {
            Some(error) if error < 0.0 => Err((None, "an error below zero".to_owned())),
            error => Ok(error),
        };
        let size = match (stated(MassError)?, stated(ForceError)?) {
            (Some(_), Some(_)) => {
                return Err((None, "the error of a mass and that of a force".to_owned()));
            }
            (mass, force) => mass.map(|mass| mass * STANDARD_GRAVITY).or(force),
        };
        Ok(LoadErrors {
            force_n: size.unwrap_or(USUAL_SHARE * force_n),
            angle_rad: stated(AngleError)?.unwrap_or(USUAL_ANGLE_RAD),
            lever_m: stated(LeverError)?.unwrap_or(USUAL_LEVER_M),
        })
    }
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
