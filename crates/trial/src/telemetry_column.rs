//! Columns of telemetry by the keys that profiles have for them, and the units that they may be in.

use std::f64::consts::{PI, TAU};

use serde::{Deserialize, Serialize};
use shell_data::hint::quoted;
use shell_data::telemetry::Telemetry;

/// How the logs of a robot have a column of telemetry.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TelemetryColumn {
    /// Its name, if that does not say what it is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Its unit, if it is not in counts.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// Units, and how much of the SI unit each is.
type Units = &'static [(&'static str, f64)];

const ANGLE: Units = &[("rad", 1.0), ("deg", PI / 180.0), ("rev", TAU)];
const SHARE: Units = &[("1", 1.0), ("%", 0.01)];
const VOLTAGE: Units = &[("V", 1.0), ("mV", 1e-3)];
const CURRENT: Units = &[("A", 1.0), ("mA", 1e-3)];
const POWER: Units = &[("W", 1.0), ("mW", 1e-3)];

/// The columns that results are computed from.
const COLUMNS: [(&str, Telemetry, Units); 13] = [
    ("right_leg", Telemetry::RightLeg, ANGLE),
    ("left_leg", Telemetry::LeftLeg, ANGLE),
    ("right_duty", Telemetry::RightDuty, SHARE),
    ("left_duty", Telemetry::LeftDuty, SHARE),
    ("right_back_emf", Telemetry::RightBackEmf, VOLTAGE),
    ("left_back_emf", Telemetry::LeftBackEmf, VOLTAGE),
    ("battery", Telemetry::Battery, VOLTAGE),
    ("current", Telemetry::Current, CURRENT),
    ("right_current", Telemetry::RightCurrent, CURRENT),
    ("left_current", Telemetry::LeftCurrent, CURRENT),
    ("power", Telemetry::Power, POWER),
    ("right_power", Telemetry::RightPower, POWER),
    ("left_power", Telemetry::LeftPower, POWER),
];

/// The key of a column in a profile, if it has one.
pub(super) fn key_of(kind: Telemetry) -> Option<&'static str> {
    COLUMNS.into_iter().find(|(_, of, _)| *of == kind).map(|(key, ..)| key)
}

impl TelemetryColumn {
    /// How much of the SI unit its unit is, as a column of this kind.
    pub(super) fn unit_in_si(&self, kind: Telemetry) -> Option<f64> {
        let (_, _, units) = COLUMNS.into_iter().find(|(_, of, _)| *of == kind)?;
        let unit = self.unit.as_deref()?;
        units.iter().find(|(name, _)| *name == unit).map(|(_, si)| *si)
    }
}

/// Checks what a profile says of the column `key`; what is wrong is said in words.
pub(super) fn check_column(key: &str, column: &TelemetryColumn) -> Result<(), String> {
    let Some((_, kind, units)) = COLUMNS.into_iter().find(|(known, ..)| *known == key) else {
        let keys = quoted(COLUMNS.iter().map(|(key, ..)| key), ", ");
        return Err(format!("no column `{key}`, expected one of {keys}"));
    };
    match &column.unit {
        Some(unit) if column.unit_in_si(kind).is_none() => {
            let units = quoted(units.iter().map(|(unit, _)| unit), " or ");
            Err(format!("`{key}` cannot be in `{unit}`, expected {units}"))
        }
        _ => Ok(()),
    }
}
