//! Which columns of a log are what, by their names.

use crate::wrench::{MomentUnit, PerAxis};

/// The columns that a user specified of a log, by their names.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ColumnNames {
    /// The sensor columns, in channel order.
    pub sensors: Option<Vec<String>>,
    /// The wrench columns, of the axes that there are.
    pub wrench: Option<PerAxis<Option<String>>>,
    /// The unit of the moment columns.
    pub moment_unit: Option<MomentUnit>,
    /// The time column.
    pub time: Option<String>,
    /// The unit of the time column.
    pub time_unit: Option<TimeUnit>,
    /// The column of groups.
    pub group: Option<String>,
}

impl ColumnNames {
    /// Whether there is nothing.
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }
}

/// The unit of a time column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TimeUnit {
    /// s
    Second,
    /// ms
    Millisecond,
    /// µs
    Microsecond,
    /// ns
    Nanosecond,
}

impl TimeUnit {
    /// All of them.
    pub const ALL: [Self; 4] =
        [Self::Second, Self::Millisecond, Self::Microsecond, Self::Nanosecond];

    /// How many of this unit make a second.
    pub const fn per_second(self) -> f64 {
        match self {
            TimeUnit::Second => 1.0,
            TimeUnit::Millisecond => 1e3,
            TimeUnit::Microsecond => 1e6,
            TimeUnit::Nanosecond => 1e9,
        }
    }

    /// The symbol of the unit.
    pub const fn symbol(self) -> &'static str {
        match self {
            TimeUnit::Second => "s",
            TimeUnit::Millisecond => "ms",
            TimeUnit::Microsecond => "µs",
            TimeUnit::Nanosecond => "ns",
        }
    }
}
