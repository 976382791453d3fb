use crate::by_axis;
use crate::wrench::{MomentUnit, PerAxis};

/// Column names that a user specified for a log.
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct ColumnNames {
    /// Names in channel order.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensors: Option<Vec<String>>,
    #[serde(default, skip_serializing_if = "Option::is_none", with = "by_axis::option")]
    pub wrench: Option<PerAxis<Option<String>>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub moment_unit: Option<MomentUnit>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub time_unit: Option<TimeUnit>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub group: Option<String>,
    /// Units that the log does not state, by name: an axis, `force`, `moment`, `time`, or a column.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub units: Vec<(String, String)>,
}

impl ColumnNames {
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum TimeUnit {
    #[serde(rename = "s")]
    Second,
    #[serde(rename = "ms")]
    Millisecond,
    #[serde(rename = "µs")]
    Microsecond,
    #[serde(rename = "ns")]
    Nanosecond,
}

impl TimeUnit {
    pub const ALL: [Self; 4] =
        [Self::Second, Self::Millisecond, Self::Microsecond, Self::Nanosecond];

    pub const fn per_second(self) -> f64 {
        [1.0, 1e3, 1e6, 1e9][self as usize]
    }

    pub const fn symbol(self) -> &'static str {
        ["s", "ms", "µs", "ns"][self as usize]
    }
}
