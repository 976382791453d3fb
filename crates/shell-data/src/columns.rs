//! The columns of a log, by name.

use crate::by_axis;
use crate::wrench::{MomentUnit, PerAxis};

/// The column names that a user specified for a log.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct ColumnNames {
    /// The sensor columns, in channel order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensors: Option<Vec<String>>,
    /// The wrench columns, for the axes that the log has.
    #[serde(default, skip_serializing_if = "Option::is_none", with = "by_axis::option")]
    pub wrench: Option<PerAxis<Option<String>>>,
    /// The unit of the moment columns.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moment_unit: Option<MomentUnit>,
    /// The time column.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<String>,
    /// The unit of the time column.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_unit: Option<TimeUnit>,
    /// The group column.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
    /// Units that the log does not state, by name: an axis, `force`, `moment`, `time`, or a column.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub units: Vec<(String, String)>,
}

impl ColumnNames {
    /// Returns true if no column is specified.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// The unit of a time column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum TimeUnit {
    /// s
    #[serde(rename = "s")]
    Second,
    /// ms
    #[serde(rename = "ms")]
    Millisecond,
    /// µs
    #[serde(rename = "µs")]
    Microsecond,
    /// ns
    #[serde(rename = "ns")]
    Nanosecond,
}

impl TimeUnit {
    /// All units.
    pub const ALL: [Self; 4] =
        [Self::Second, Self::Millisecond, Self::Microsecond, Self::Nanosecond];

    /// Returns the number of these units in a second.
    pub const fn per_second(self) -> f64 {
        [1.0, 1e3, 1e6, 1e9][self as usize]
    }

    /// Returns the symbol of the unit.
    pub const fn symbol(self) -> &'static str {
        ["s", "ms", "µs", "ns"][self as usize]
    }
}
