//! What the name of a column means.
//!
//! Names are compared without case, spaces and punctuation. A unit may follow a name: `fx_n`,
//! `Mx (mN·m)`, `time_us`.

use super::mapping::{LogFormat, TimeUnit};
use shell_data::telemetry::Telemetry;
use shell_data::wrench::Axis;

/// The meaning of a column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// Time.
    Time(TimeUnit),
    /// The readings of this channel, from 0.
    Sensor(usize),
    /// A force or moment, in N and N·m or (`true`) in mN and mN·m.
    Load(Axis, bool),
    /// The group (pose, session, trial) of a row.
    Group,
    /// Telemetry of the robot, in counts as its profile explains them.
    Telemetry(Telemetry),
    /// Nothing that is needed.
    Other,
}

impl Meaning {
    /// What a column is taken for, with the unit that its values are in; `None` if for nothing.
    pub fn in_words(self) -> Option<String> {
        Some(match self {
            Meaning::Time(unit) => format!("time ({})", unit.symbol()),
            Meaning::Sensor(channel) => format!("sensor {}", channel + 1),
            Meaning::Load(axis, false) => format!("{} ({})", axis.name(), axis.unit()),
            // Values are in SI units.
            Meaning::Load(axis, true) => format!("{} ({1}, from m{1})", axis.name(), axis.unit()),
            Meaning::Group => "group".to_owned(),
            Meaning::Telemetry(telemetry) => telemetry.name().to_owned(),
            Meaning::Other => return None,
        })
    }

    /// What a value is divided by to be in SI units. Dividing rounds correctly where multiplying
    /// by the inverse would not.
    pub(crate) fn per_si_unit(self) -> f64 {
        match self {
            Meaning::Time(unit) => unit.per_second(),
            Meaning::Load(_, true) => 1e3,
            _ => 1.0,
        }
    }
}

/// Names of a group column, most wanted first.
pub(super) const GROUPS: [&str; 4] = ["group", "session", "pose", "trial"];

pub(crate) fn meaning_of(name: &str, format: LogFormat) -> Meaning {
    let (stem, unit) = split_unit(name);
    if GROUPS.contains(&plain(name).as_str()) {
        return Meaning::Group;
    }
    if ["t", "time", "timestamp"].contains(&stem.as_str()) {
        let unit = match unit.as_str() {
            "" => Some(default_time_unit(format)),
            "s" | "sec" | "secs" | "second" | "seconds" => Some(TimeUnit::Second),
            "ms" | "msec" | "millis" | "milliseconds" => Some(TimeUnit::Millisecond),
            "us" | "usec" | "µs" | "μs" | "micros" | "microseconds" => {
                Some(TimeUnit::Microsecond)
            }
            "ns" | "nsec" | "nanos" | "nanoseconds" => Some(TimeUnit::Nanosecond),
            _ => None,
        };
        return unit.map_or(Meaning::Other, Meaning::Time);
    }
    if let Some(meaning) = wrench_of(name) {
        return meaning;
    }
    // A reading may be in any unit.
    let name = without_unit(name);
    if let Some(telemetry) = Telemetry::from_name(&name) {
        return Meaning::Telemetry(telemetry);
    }
    match numbered(&name, "sensor").or_else(|| numbered(&name, "s")) {
        Some(channel) => Meaning::Sensor(channel),
        None => Meaning::Other,
    }
}

/// The number after a prefix, if that is all there is.
pub(super) fn numbered(plain_name: &str, prefix: &str) -> Option<usize> {
    let digits = plain_name.strip_prefix(prefix)?;
    digits.parse().ok().filter(|_| (1..=3).contains(&digits.len()))
}

/// An axis of the wrench by its usual name (`fx_n`, `Mx (mN·m)`), or by another: `Tx`, `force_x`,
/// `wrench.torque.z`.
fn wrench_of(name: &str) -> Option<Meaning> {
    let (axis, unit) = axis_and_unit(name, &WRENCH_UNITS)?;
    Some(match (axis.is_moment(), unit.as_str()) {
        (_, "") | (false, "n") | (true, "nm") => Meaning::Load(axis, false),
        (false, "mn") | (true, "mnm" | "nmm") => Meaning::Load(axis, true),
        _ => Meaning::Other,
    })
}

/// Which axis of the wrench a column has in a unit that is not read.
pub(crate) fn axis_of_other_unit(name: &str) -> Option<Axis> {
    let (axis, _) = axis_and_unit(name, &OTHER_UNITS)?;
    (wrench_of(name).is_none_or(|meaning| meaning == Meaning::Other)).then_some(axis)
}

/// An axis and the unit of a name: whatever stands in brackets, or one of `units` at its end.
fn axis_and_unit(name: &str, units: &[&str]) -> Option<(Axis, String)> {
    let (base, unit) = match name.split_once(['(', '[']) {
        Some((base, unit)) => (plain(base), plain(unit)),
        None => match name.trim().rsplit_once(|c: char| !c.is_alphanumeric()) {
            Some((base, unit)) if units.contains(&plain(unit).as_str()) => {
                (plain(base), plain(unit))
            }
            _ => (plain(name), String::new()),
        },
    };
    let base = base.strip_prefix("wrench").unwrap_or(&base);
    let base = base.strip_prefix("wrench").unwrap_or(base);
    let is_named = |axis: &Axis| {
        let letter = axis.name().to_ascii_lowercase().split_off(1);
        let kinds: &[&str] = match axis.is_moment() {
            false => &["f", "force"],
            true => &["m", "t", "moment", "torque"],
        };
        kinds.iter().any(|kind| base.strip_prefix(kind) == Some(&letter))
    };
    Some((Axis::ALL.into_iter().find(is_named)?, unit))
}

/// Units of forces and moments that are read.
const WRENCH_UNITS: [&str; 5] = ["n", "mn", "nm", "mnm", "nmm"];

/// Units that others write after a name, and that are not read.
const OTHER_UNITS: [&str; 16] = [
    "lbf", "lb", "lbs", "ozf", "kgf", "gf", "kg", "g", "kn", "lbfin", "lbin", "inlb", "ftlb",
    "lbft", "kgcm", "ncm",
];

/// The robot's telemetry counts µs; a time column that does not say is in s.
pub(super) fn default_time_unit(format: LogFormat) -> TimeUnit {
    match format {
        LogFormat::Telemetry | LogFormat::Console => TimeUnit::Microsecond,
        _ => TimeUnit::Second,
    }
}

/// Whether a name ends in a unit.
pub(super) fn names_a_unit(name: &str) -> bool {
    !split_unit(name).1.is_empty()
}

/// `Mx (mN·m)` into `mx` and `mnm`.
pub(super) fn split_unit(name: &str) -> (String, String) {
    let name = name.trim();
    let stem = name.split(|c: char| !c.is_alphanumeric()).next().unwrap_or_default();
    (plain(stem), plain(&name[stem.len()..]))
}

/// A name as far as the unit in brackets, letters and digits only.
pub(super) fn without_unit(name: &str) -> String {
    plain(name.split(['(', '[']).next().unwrap_or(name))
}

/// Letters and digits only, in lower case.
pub(super) fn plain(name: &str) -> String {
    name.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}
