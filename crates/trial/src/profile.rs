//! Robot profiles: the scales of a robot's telemetry, and its properties.
//!
//! The built-in [`Profile::velociroach`] cites the source of each constant. A document with
//! `base = "velociroach"` lists only the differences from it.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use shell_data::hint::quoted;
use shell_data::telemetry::{COUNTS, Telemetry};
use shell_data::unit::{Quantity, Unit};
use toml::{Spanned, Table, Value};

use super::manifest::{ManifestProblem, parse_toml as parse};

/// Text of the built-in profile, as a template for others.
pub const VELOCIROACH: &str = include_str!("../assets/profiles/velociroach.toml");

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    pub name: String,
    pub telemetry: TelemetryScales,
    /// Telemetry columns that the robot's logs name differently, or have in physical units.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub columns: BTreeMap<String, TelemetryColumn>,
    pub motor: Motor,
    pub robot: Robot,
    pub channel: TrialChannel,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TelemetryScales {
    pub leg_rad_per_count: f64,
    pub gyro_deg_s_per_count: f64,
    pub acceleration_m_s2_per_count: f64,
    pub back_emf_v_per_count: f64,
    pub battery_v_per_count: f64,
    pub duty_counts: f64,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TelemetryColumn {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// `counts`, or `None` for what the log states, or else counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// A leg motor; both motors have the same constants.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    pub resistance_ohm: f64,
    pub torque_constant_nm_per_a: f64,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Robot {
    /// Mass m, shell included, kg.
    pub mass_kg: f64,
    pub gravity_m_s2: f64,
    /// Length, m, if known; figures use it to shade entry and exit.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_m: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrialChannel {
    pub length_m: f64,
}

impl Profile {
    /// The robot of the paper.
    pub fn velociroach() -> Self {
        Self::parse(VELOCIROACH).expect("the built-in profile is tested")
    }

    /// # Errors
    /// [`ManifestProblem`]: not TOML, missing or unknown keys, constants that are not positive, unsuitable units.
    pub fn parse(text: &str) -> Result<Self, ManifestProblem> {
        let has_base = parse::<Table>(text)?.contains_key("base");
        let profile: Self = if has_base { Differences::parse(text)? } else { parse(text)? };
        for (key, column) in &profile.columns {
            check_column(key, column)
                .map_err(|message| ManifestProblem::at_key(text, "columns", key, message))?;
        }
        for (table, constants) in &Table::try_from(&profile).expect("a profile is a document") {
            for (key, value) in constants.as_table().into_iter().flatten() {
                if let Value::Float(value) = *value
                    && !(value > 0.0 && value.is_finite())
                {
                    let message =
                        format!("`{table}.{key}` is `{value}`, expected a positive number");
                    return Err(ManifestProblem::at_key(text, table, key, message));
                }
            }
        }
        Ok(profile)
    }

    /// The name of a telemetry column in its logs, if the profile gives one.
    pub fn column_name(&self, kind: Telemetry) -> Option<&str> {
        self.columns.get(key_of(kind)?)?.name.as_deref()
    }

    /// The unit of a telemetry column as the profile writes it, if it gives one.
    pub fn unit_text(&self, kind: Telemetry) -> Option<&str> {
        self.columns.get(key_of(kind)?)?.unit.as_deref()
    }

    /// Sets the unit of a telemetry column, such as to the one that a log states.
    pub fn set_unit(&mut self, kind: Telemetry, unit: String) {
        if let Some(key) = key_of(kind) {
            self.columns.entry(key.to_owned()).or_default().unit = Some(unit);
        }
    }

    /// The factor from the unit of a column to the SI unit; `None` for counts.
    pub(super) fn unit(&self, kind: Telemetry) -> Option<f64> {
        let (_, _, quantity) = COLUMNS.into_iter().find(|(_, of, _)| *of == kind)?;
        Unit::parse(self.unit_text(kind)?, quantity).map(|unit| unit.scale.to_si(1.0))
    }

    pub(super) fn leg_rad(&self, leg: Telemetry) -> f64 {
        self.unit(leg).unwrap_or(self.telemetry.leg_rad_per_count)
    }
}

type NamedConstants = BTreeMap<Spanned<String>, f64>;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Differences {
    base: Spanned<String>,
    name: Option<String>,
    #[serde(default)]
    columns: BTreeMap<String, TelemetryColumn>,
    #[serde(default)]
    telemetry: NamedConstants,
    #[serde(default)]
    motor: NamedConstants,
    #[serde(default)]
    robot: NamedConstants,
    #[serde(default)]
    channel: NamedConstants,
}

impl Differences {
    fn parse(text: &str) -> Result<Profile, ManifestProblem> {
        let Self { base, name, columns, telemetry, motor, robot, channel } = parse(text)?;
        if base.get_ref() != "velociroach" {
            let message =
                format!("no profile `{}` is built in, only `velociroach`", base.get_ref());
            return Err(ManifestProblem::at(text, base.span().start, message));
        }
        let mut document: Table = parse(VELOCIROACH)?;
        let tables =
            [("telemetry", telemetry), ("motor", motor), ("robot", robot), ("channel", channel)];
        for (table, constants) in tables {
            let Some(Value::Table(of_base)) = document.get_mut(table) else { continue };
            for (key, value) in constants {
                let Some(constant) = of_base.get_mut(key.get_ref()) else {
                    let known = quoted(of_base.keys(), ", ");
                    let message = format!("unknown field `{}`, expected {known}", key.get_ref());
                    return Err(ManifestProblem::at(text, key.span().start, message));
                };
                *constant = Value::Float(value);
            }
        }
        // Every table and key exists in the base, and every value is a number.
        let mut profile: Profile = document
            .try_into()
            .map_err(|error: toml::de::Error| ManifestProblem::at(text, 0, error.to_string()))?;
        profile.name = name.unwrap_or(profile.name);
        profile.columns = columns;
        Ok(profile)
    }
}

impl Motor {
    /// The electrical power drawn by one motor, W: `|d·V·(V − E)/R|` with duty d, battery V and back EMF E.
    pub fn power_w(&self, duty: f64, battery_v: f64, back_emf_v: f64) -> f64 {
        (duty * battery_v * (battery_v - back_emf_v) / self.resistance_ohm).abs()
    }
}

/// The columns that results are computed from, with their keys in a profile.
const COLUMNS: [(&str, Telemetry, Quantity); 13] = [
    ("right_leg", Telemetry::RightLeg, Quantity::Angle),
    ("left_leg", Telemetry::LeftLeg, Quantity::Angle),
    ("right_duty", Telemetry::RightDuty, Quantity::Share),
    ("left_duty", Telemetry::LeftDuty, Quantity::Share),
    ("right_back_emf", Telemetry::RightBackEmf, Quantity::Voltage),
    ("left_back_emf", Telemetry::LeftBackEmf, Quantity::Voltage),
    ("battery", Telemetry::Battery, Quantity::Voltage),
    ("current", Telemetry::Current, Quantity::Current),
    ("right_current", Telemetry::RightCurrent, Quantity::Current),
    ("left_current", Telemetry::LeftCurrent, Quantity::Current),
    ("power", Telemetry::Power, Quantity::Power),
    ("right_power", Telemetry::RightPower, Quantity::Power),
    ("left_power", Telemetry::LeftPower, Quantity::Power),
];

pub fn used_telemetry() -> impl Iterator<Item = (Telemetry, Quantity)> {
    COLUMNS.into_iter().map(|(_, kind, quantity)| (kind, quantity))
}

pub(super) fn key_of(kind: Telemetry) -> Option<&'static str> {
    COLUMNS.into_iter().find(|(_, of, _)| *of == kind).map(|(key, ..)| key)
}

fn check_column(key: &str, column: &TelemetryColumn) -> Result<(), String> {
    let Some((.., quantity)) = COLUMNS.into_iter().find(|(known, ..)| *known == key) else {
        let keys = quoted(COLUMNS.iter().map(|(key, ..)| key), ", ");
        return Err(format!("no column `{key}`, expected one of {keys}"));
    };
    match &column.unit {
        Some(unit) if unit != COUNTS && Unit::parse(unit, quantity).is_none() => Err(format!(
            "`{key}` cannot be in `{unit}`, expected a unit of {} ({}) or `{COUNTS}`",
            quantity.name(),
            quantity.understood()
        )),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_constants_are_the_arithmetic_of_their_sources() {
        let Profile { telemetry, motor, robot, channel, .. } = Profile::velociroach();
        let expected = [
            (telemetry.leg_rad_per_count, 95.8738e-6),
            (telemetry.gyro_deg_s_per_count, 1.0 / 16.384),
            (telemetry.acceleration_m_s2_per_count, 1.0 / 4096.0 * 9.81),
            (telemetry.back_emf_v_per_count, 3.3 / 1024.0 * 47.0 / 15.0),
            (telemetry.battery_v_per_count, 3.3 / 1023.0 * 3.7 / 2.7),
            (telemetry.duty_counts, 4096.0),
            (motor.resistance_ohm, 3.3),
            (motor.torque_constant_nm_per_a, 1.41e-3),
            (robot.mass_kg, 0.087),
            (robot.gravity_m_s2, 9.81),
            (channel.length_m, 0.28),
        ];
        for (found, expected) in expected {
            // The arithmetic rounds up to four times.
            assert!((found / expected - 1.0).abs() < 4.0 * f64::EPSILON, "{found} {expected}");
        }
        let turn = std::f64::consts::TAU / telemetry.leg_rad_per_count;
        // The constant is given with six digits.
        assert!((turn / 65536.0 - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_motor_against_a_worked_example() {
        let motor = Profile::velociroach().motor;
        // Half duty at 4 V with 0.7 V of back EMF: 0.5·3.3/3.3 = 0.5 A on average.
        assert!((motor.power_w(-0.5, 4.0, 0.7) - 2.0).abs() < 1e-15);
    }

    #[test]
    fn a_profile_overrides_values_of_its_base() {
        let text = "base = \"velociroach\"\nname = \"tortoise\"\n[robot]\nmass_kg = 2\n\n\
                    [columns]\nbattery = { name = \"U\", unit = \"mV\" }\n";
        let profile = Profile::parse(text).unwrap();
        let velociroach = Profile::velociroach();
        assert_eq!((profile.name.as_str(), profile.robot.mass_kg), ("tortoise", 2.0));
        assert_eq!(profile.motor, velociroach.motor);
        assert_eq!(profile.robot.length_m, velociroach.robot.length_m);
        assert_eq!(profile.column_name(Telemetry::Battery), Some("U"));
        assert_eq!(profile.unit(Telemetry::Battery), Some(1e-3));
        assert_eq!(profile.unit(Telemetry::RightDuty), None);
        for (old, new, line, message) in [
            ("velociroach", "ostrich", 1, "no profile `ostrich` is built in"),
            ("mass_kg", "mass_g", 4, "unknown field `mass_g`, expected"),
            ("= 2", "= -2", 4, "`robot.mass_kg` is `-2`"),
            ("= 2", "= \"2\"", 4, "invalid type: string"),
            ("[robot]", "[body]", 3, "unknown field `body`"),
            (
                "\"mV\"",
                "\"A\"",
                7,
                "`battery` cannot be in `A`, expected a unit of voltage (V, mV)",
            ),
            ("battery", "batery", 7, "no column `batery`, expected"),
            ("name = \"U\", unit", "units", 7, "unknown field `units`"),
        ] {
            let error = Profile::parse(&text.replace(old, new)).unwrap_err();
            assert!(error.message.contains(message), "{error}");
            assert_eq!(error.position.line, line, "{error}");
        }
    }

    #[test]
    fn faults_of_a_profile_are_reported_with_their_position() {
        let cases = [
            ("mass_kg = 0.087", "mass_g = 87", "unknown field `mass_g`"),
            ("mass_kg = 0.087 ", "mass_kg = 0.0 ", "`robot.mass_kg` is `0`"),
            ("mass_kg = 0.087 ", "mass_kg = nan ", "`robot.mass_kg` is `NaN`"),
            ("mass_kg = 0.087 ", "mass_kg = \"87 g\" ", "invalid type: string"),
        ];
        for (old, new, message) in cases {
            let error = Profile::parse(&VELOCIROACH.replace(old, new)).unwrap_err();
            assert!(error.message.contains(message), "{error}");
            let line =
                1 + VELOCIROACH.lines().position(|line| line.starts_with("mass_kg")).unwrap();
            assert_eq!(error.position.line, line, "{error}");
        }
        let error = Profile::parse(&VELOCIROACH.replace("mass_kg", "# ")).unwrap_err();
        assert!(error.message.contains("missing field `mass_kg`"), "{error}");
        let error = Profile::parse("name = ").unwrap_err();
        assert_eq!(error.position.line, 1);
    }
}
