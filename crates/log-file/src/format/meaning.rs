//! The meaning of a column by its name.
//!
//! Names are compared without case, spaces and punctuation. A unit may follow the name, in brackets or after
//! any separator: `fx_n`, `Mx (mN·m)`, `time_us`, `Fz-lbf`.

use super::column_name::plain;
use super::mapping::{LogFormat, TimeUnit};
use shell_data::telemetry::Telemetry;
use shell_data::unit::{Quantity, Scale, Unit, is_letter};
use shell_data::wrench::Axis;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Meaning {
    /// Time, with the scale to s.
    Time(Scale),
    /// The readings of a channel, from 0.
    Sensor(usize),
    /// Force or moment, with the scale to N or N·m.
    Load(Axis, Scale),
    /// The group (pose, session, trial) of a row.
    Group,
    /// Robot telemetry, whose unit or scale of counts may be in the robot's profile.
    Telemetry(Telemetry),
    /// A column that is added to the time: its date, or a fraction of its seconds.
    TimePart,
    Other,
}

impl Meaning {
    /// Returns `None` for an unused column.
    pub fn in_words(self) -> Option<String> {
        Some(match self {
            Meaning::Time(_) => "time".to_owned(),
            Meaning::Sensor(channel) => format!("sensor {}", channel + 1),
            Meaning::Load(axis, _) => axis.name().to_owned(),
            Meaning::Group => "group".to_owned(),
            Meaning::Telemetry(telemetry) => telemetry.name().to_owned(),
            Meaning::TimePart => "added to time".to_owned(),
            Meaning::Other => return None,
        })
    }

    pub(crate) fn scale(self) -> Scale {
        match self {
            Meaning::Time(scale) | Meaning::Load(_, scale) => scale,
            _ => Scale::ONE,
        }
    }

    /// Returns the quantity, if the unit of the values matters.
    pub(crate) fn quantity(self) -> Option<Quantity> {
        match self {
            Meaning::Time(_) => Some(Quantity::Time),
            Meaning::Load(axis, _) => Some(Quantity::of_axis(axis)),
            _ => None,
        }
    }

    /// Returns the same meaning for values in another unit.
    pub(crate) fn scaled(self, scale: Scale) -> Self {
        match self {
            Meaning::Time(_) => Meaning::Time(scale),
            Meaning::Load(axis, _) => Meaning::Load(axis, scale),
            other => other,
        }
    }
}

/// The unit that a log states for a column.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum StatedUnit {
    #[default]
    None,
    Known(Unit),
    Unknown(String),
}

impl StatedUnit {
    pub(super) fn new(text: &str, quantity: Quantity) -> Self {
        match Unit::parse(text, quantity) {
            _ if text.trim().is_empty() => Self::None,
            Some(unit) => Self::Known(unit),
            None => Self::Unknown(text.trim().to_owned()),
        }
    }

    pub fn known(&self) -> Option<&Unit> {
        if let Self::Known(unit) = self { Some(unit) } else { None }
    }
}

impl From<TimeUnit> for StatedUnit {
    fn from(unit: TimeUnit) -> Self {
        let scale = Scale::per_si(unit.per_second());
        Self::Known(Unit { symbol: unit.symbol().to_owned(), scale })
    }
}

/// Names of a group column, in order of preference.
pub(super) const GROUPS: [&str; 4] = ["group", "session", "pose", "trial"];

/// The meaning of a name, and the unit in it.
pub fn meaning_of(name: &str, format: LogFormat) -> (Meaning, StatedUnit) {
    if GROUPS.contains(&plain(name).as_str()) {
        return (Meaning::Group, StatedUnit::None);
    }
    if let Some((meaning, unit)) = measured(name, format) {
        let scale = unit.known().map_or(meaning.scale(), |unit| unit.scale);
        return (meaning.scaled(scale), unit);
    }
    // A reading may have any unit, which is ignored; that of telemetry is read with the robot's profile.
    let name = without_unit(name);
    let meaning = match Telemetry::from_name(&name) {
        Some(telemetry) => Meaning::Telemetry(telemetry),
        None => match numbered(&name, "sensor").or_else(|| numbered(&name, "s")) {
            Some(channel) => Meaning::Sensor(channel),
            None => Meaning::Other,
        },
    };
    (meaning, StatedUnit::None)
}

/// Recognises a time or an axis of the wrench by its name, with or without a unit.
fn measured(name: &str, format: LogFormat) -> Option<(Meaning, StatedUnit)> {
    if let Some((base, unit)) = in_brackets(name) {
        let meaning = quantity_named(base, format)?;
        let unit = StatedUnit::new(unit, meaning.quantity()?);
        // `T (°C)` is a temperature.
        let is_time = plain(base) != "t" || !matches!(unit, StatedUnit::Unknown(_));
        return is_time.then_some((meaning, unit));
    }
    if let Some(meaning) = quantity_named(name, format) {
        return Some((meaning, StatedUnit::None));
    }
    let of_capitals = || {
        capitals(name).find_map(|(base, unit)| {
            let meaning = quantity_named(base, format)?;
            let unit = Unit::parse(unit, meaning.quantity()?)?;
            Some((meaning, StatedUnit::Known(unit)))
        })
    };
    let of_suffix = suffixes(name).find_map(|(base, suffix)| {
        let meaning = quantity_named(base, format)?;
        let quantity = meaning.quantity()?;
        if let Some(unit) = Unit::parse(suffix, quantity) {
            return Some((meaning, StatedUnit::Known(unit)));
        }
        // A moment in N or a force in N·m is a mistake; a suffix that is not a unit is part of the name.
        let is_load = |of| quantity != Quantity::Time && Unit::parse(suffix, of).is_some();
        [Quantity::Force, Quantity::Moment]
            .into_iter()
            .any(is_load)
            .then(|| (meaning, StatedUnit::Unknown(suffix.to_owned())))
    });
    of_suffix.or_else(of_capitals)
}

/// Returns the unit of a quantity in a name: the text in brackets, or a unit after a separator.
pub(super) fn unit_in_name(name: &str, quantity: Quantity) -> StatedUnit {
    if let Some((_, unit)) = in_brackets(name) {
        return StatedUnit::new(unit, quantity);
    }
    let parts = suffixes(name).chain(capitals(name)).map(|(_, suffix)| suffix);
    // The `1` of `duty_1` is a number.
    let parts = parts.filter(|suffix| suffix.contains(is_letter));
    let unit = parts.filter_map(|suffix| Unit::parse(suffix, quantity)).next();
    unit.map_or(StatedUnit::None, StatedUnit::Known)
}

fn in_brackets(name: &str) -> Option<(&str, &str)> {
    let (base, unit) = name.split_once(['(', '[', '{'])?;
    // The brackets of `force[0]` hold an index.
    if unit.trim_end_matches(']').bytes().all(|byte| byte.is_ascii_digit()) {
        return None;
    }
    // A remark may follow: `Fx (N); RAW`, `Fx (N) filtered`.
    let rest = |at: usize| {
        unit[at + 1..].trim_start().starts_with(|c: char| c.is_alphabetic() || c == ';')
    };
    let end = unit.find([')', ']', '}']).filter(|&at| rest(at)).unwrap_or(unit.len());
    Some((base, unit[..end].trim_end().trim_end_matches([')', ']', '}'])))
}

/// Splits a name at each of its separators.
pub(super) fn suffixes(name: &str) -> impl Iterator<Item = (&str, &str)> {
    let cuts = name.match_indices(|c: char| !c.is_alphanumeric() && c != '°');
    cuts.map(|(at, mark)| (name[..at].trim(), name[at + mark.len()..].trim()))
        .map(|(base, unit)| (base, unit.strip_prefix("in ").unwrap_or(unit)))
        .filter(|(base, unit)| !base.is_empty() && !unit.is_empty())
}

/// Splits a name where small and capital letters meet: `timeMs`, `forceXmN`. Units of time begin with a small letter.
pub(super) fn capitals(name: &str) -> impl Iterator<Item = (&str, &str)> {
    const TIMES: [(&str, &str); 5] =
        [("Ms", "ms"), ("Us", "us"), ("Ns", "ns"), ("Sec", "s"), ("Seconds", "s")];
    let meets = move |at: usize| {
        let (base, unit) = name.split_at_checked(at)?;
        let (before, first) = (base.chars().last()?, unit.chars().next()?);
        let unit = TIMES.iter().find(|(word, _)| *word == unit).map_or(unit, |(_, unit)| unit);
        (before.is_uppercase() != first.is_uppercase()
            && before.is_alphabetic()
            && first.is_alphabetic())
        .then_some((base, unit))
    };
    (2..name.len()).filter_map(meets)
}

/// Returns the number after a prefix, if nothing else follows.
pub(super) fn numbered(plain_name: &str, prefix: &str) -> Option<usize> {
    let digits = plain_name.strip_prefix(prefix)?;
    digits.parse().ok().filter(|_| (1..=3).contains(&digits.len()))
}

const TIMES: [&str; 5] = ["t", "time", "timestamp", "timestamps", "times"];

/// Recognises a time or wrench axis by a name without a unit: `Fx`, `Tx`, `force_x`, `wrench.torque.z`.
fn quantity_named(name: &str, format: LogFormat) -> Option<Meaning> {
    let name = plain(name);
    if TIMES.contains(&name.as_str()) {
        return Some(Meaning::Time(Scale::per_si(default_time_unit(format).per_second())));
    }
    let name = name.strip_prefix("field").unwrap_or(&name);
    let name = name.strip_prefix("wrench").unwrap_or(name);
    let name = name.strip_prefix("wrench").unwrap_or(name);
    // OpenSim's `ground_force_vx` and `ground_torque_x`.
    let name = name.strip_prefix("ground").unwrap_or(name);
    let is_named = |axis: &Axis| {
        let letter = axis.name().to_ascii_lowercase().split_off(1);
        let kinds: &[&str] = match axis.is_moment() {
            false => &["f", "force", "forcev", "kraft", "fuerza"],
            true => &["m", "t", "moment", "torque", "drehmoment", "couple", "momento"],
        };
        kinds.iter().any(|kind| name.strip_prefix(kind) == Some(&letter))
    };
    let axis = Axis::ALL.into_iter().find(is_named)?;
    Some(Meaning::Load(axis, Scale::ONE))
}

/// Returns the unit of a time column that states none: µs in robot telemetry, s elsewhere.
pub(super) fn default_time_unit(format: LogFormat) -> TimeUnit {
    match format {
        LogFormat::Telemetry | LogFormat::Console => TimeUnit::Microsecond,
        _ => TimeUnit::Second,
    }
}

pub(super) fn split_unit(name: &str) -> (String, String) {
    let name = name.trim();
    let stem = name.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default();
    (plain(stem), plain(&name[stem.len()..]))
}

/// Returns the letters and digits of a name before the unit in brackets.
pub(super) fn without_unit(name: &str) -> String {
    plain(name.split(['(', '[']).next().unwrap_or(name))
}

/// Counts the names that have a meaning.
pub(crate) fn known_names(names: &[String]) -> usize {
    names.iter().filter(|name| meaning_of(name, LogFormat::Csv).0 != Meaning::Other).count()
}

/// Units of readings and other columns of a log.
const OTHER_UNITS: [&str; 22] = [
    "v", "mv", "uv", "µv", "mv/v", "v/v", "a", "ma", "count", "counts", "raw", "lsb", "bits",
    "hex", "hz", "%", "-", "c", "°c", "pa", "bar", "ut",
];

/// Returns true if most of the fields that are not empty are units.
pub(crate) fn are_units(names: &[String]) -> bool {
    let is_unit = |name: &&String| {
        let bare = name.trim_matches(['(', ')', '[', ']']);
        Unit::is_spelled(bare) || OTHER_UNITS.contains(&bare.to_lowercase().as_str())
    };
    let named = names.iter().filter(|name| !name.is_empty());
    5 * named.clone().filter(is_unit).count() >= 3 * named.count()
}
