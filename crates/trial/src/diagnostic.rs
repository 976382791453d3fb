//! What a reader of a trial's results should know about them.

use serde::{Serialize, Serializer};

use super::window::Proposal;
use forces::RowRule;

/// How much a diagnostic matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// How the log was recorded.
    Note,
    /// The results may be worse than they look.
    Warning,
}

const NO_FORCES: &str = "forces and drag energy are left out";
const NO_ENERGY: &str = "electrical energy and specific resistance are left out";

/// Something that a reader of a trial's results should know.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Diagnostic {
    /// Duplicates of the previous frame: telemetry runs faster than the sensor.
    #[error("{repeated} of {rows} rows are duplicates of the previous frame")]
    RepeatedRows {
        /// Rows within the window.
        rows: u64,
        /// Those that bring no new frame.
        repeated: u64,
    },
    /// Rows that never arrived, in the window.
    #[error(
        "about {missing} of {expected} rows are missing; {}",
        match rule {
            RowRule::Time => "all is computed by time, not by row",
            RowRule::Rows => "by row, the filter takes no notice of that",
        }
    )]
    MissingRows {
        /// About how many.
        missing: u64,
        /// How many there would be.
        expected: u64,
        /// What a row stands for.
        rule: RowRule,
    },
    /// Without sensors: no forces, no drag energy.
    #[error("the log has no sensor columns: {NO_FORCES}")]
    NoSensors,
    /// Without a calibration: no forces, no drag energy.
    #[error("no calibration was given: {NO_FORCES}")]
    NoCalibration,
    /// Without these columns of telemetry: no electrical energy, no specific resistance.
    #[error("the log has no {}: {NO_ENERGY}", .0.join(", no "))]
    NoPower(Vec<&'static str>),
    /// The battery reads zero (or less) in some rows of the window: no electrical energy.
    #[error("the battery reads no voltage in {rows} of {of} rows: {NO_ENERGY}")]
    NoBattery {
        /// How many.
        rows: u64,
        /// Of how many.
        of: u64,
    },
    /// The battery reads what no battery of a robot gives: its unit is another than the profile says.
    #[error(
        "the battery reads {reads} in the log, which the profile takes for {battery_v:.3} V: are these \
         volts? then give the profile `battery = {{ unit = \"V\" }}` under `[columns]`; {NO_ENERGY}"
    )]
    BatteryUnit {
        /// The median in the window, as the log has it.
        reads: f64,
        /// What the profile takes that for, V.
        battery_v: f64,
    },
    /// A column of power or current, whose unit the profile does not give.
    #[error(
        "the log has {column}, whose unit is not known: give the profile `{key} = {{ unit = … }}` \
         under `[columns]`; {NO_ENERGY}"
    )]
    NoUnit {
        /// What it is called.
        column: &'static str,
        /// Its key in a profile.
        key: &'static str,
    },
    /// Without the right leg's position: no strides.
    #[error("the log has no right leg position: strides are left out")]
    NoLeg,
    /// The right leg does not complete a turn in the window.
    #[error("the right leg does not complete a turn in the window")]
    NoStride,
    /// The right leg stood still for longer than two strides take: how long at most, s.
    #[error("the right leg stands still for {0:.3} s")]
    StalledLeg(f64),
    /// Frames with a reading outside the range of the training data.
    #[error("{frames} of {of} frames have a reading outside the range of the training data")]
    OutOfRange {
        /// How many in the window.
        frames: u64,
        /// Of how many.
        of: u64,
    },
    /// Frames with a reading at an end of the converter.
    #[error("{frames} of {of} frames have a saturated reading")]
    Saturated {
        /// How many in the window.
        frames: u64,
        /// Of how many.
        of: u64,
    },
    /// The right leg moved while the tare was taken: the shell was hardly at rest.
    #[error(
        "the right leg turns by {turned_rad:.1} rad while the tare is taken, up to {end_s:.3} s"
    )]
    MovingTare {
        /// By how much, rad.
        turned_rad: f64,
        /// When the tare ended, s.
        end_s: f64,
    },
    /// The tare ends after the robot has entered the channel: when, s.
    #[error("the tare ends at {0:.3} s, after the robot has entered the channel")]
    LateTare(f64),
    /// The zero at the end of the log is not that of the tare: by how much, in words.
    #[error("{0}")]
    MovedZero(String),
    /// The calibration carries no covariance: no intervals.
    #[error("the calibration carries no covariance: intervals are left out")]
    NoIntervals,
    /// The rate of the log is too low for the usual low-pass, of this cutoff in Hz: forces are not filtered.
    #[error("the log's rate is too low for a low-pass of {0} Hz: forces are not filtered")]
    Unfiltered(f64),
    /// How many rows of the log could not be read and were left out.
    #[error("{0} bad rows are left out")]
    SkippedRows(u64),
    /// The window was found in the forces.
    #[error(
        "the window was found in the drag: confidence {:.0} %, entry ± {:.3} s, exit ± {:.3} s",
        100.0 * .0.confidence, .0.t_enter_se_s, .0.t_exit_se_s
    )]
    FoundWindow(Proposal),
    /// Something said by whoever made the manifest.
    #[error("{0}")]
    Manifest(String),
}

impl Diagnostic {
    /// How much it matters.
    pub fn severity(&self) -> Severity {
        match self {
            Self::RepeatedRows { .. } | Self::NoIntervals | Self::Manifest(_) => Severity::Note,
            Self::MissingRows { missing, expected, .. } if missing * 100 < *expected => {
                Severity::Note
            }
            Self::FoundWindow(window) if window.is_good() => Severity::Note,
            _ => Severity::Warning,
        }
    }

    /// A short name for scripts.
    pub fn code(&self) -> &'static str {
        match self {
            Self::RepeatedRows { .. } => "repeated_rows",
            Self::MissingRows { .. } => "missing_rows",
            Self::NoSensors => "no_sensors",
            Self::NoCalibration => "no_calibration",
            Self::NoPower(_) => "no_power",
            Self::NoBattery { .. } => "no_battery",
            Self::BatteryUnit { .. } => "battery_unit",
            Self::NoUnit { .. } => "no_unit",
            Self::NoLeg => "no_leg",
            Self::NoStride => "no_stride",
            Self::StalledLeg(_) => "stalled_leg",
            Self::OutOfRange { .. } => "out_of_range",
            Self::Saturated { .. } => "saturated",
            Self::MovingTare { .. } => "moving_tare",
            Self::LateTare(_) => "late_tare",
            Self::MovedZero(_) => "moved_zero",
            Self::NoIntervals => "no_intervals",
            Self::Unfiltered(_) => "unfiltered",
            Self::SkippedRows(_) => "skipped_rows",
            Self::FoundWindow(_) => "found_window",
            Self::Manifest(_) => "manifest",
        }
    }
}

impl Serialize for Diagnostic {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct DiagnosticDocument<'a> {
            severity: Severity,
            code: &'a str,
            text: String,
        }
        DiagnosticDocument { severity: self.severity(), code: self.code(), text: self.to_string() }
            .serialize(serializer)
    }
}
