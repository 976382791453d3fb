//! Writes trials of the virtual robot as the lab's tools do.

use std::io::{self, Write};

use crate::virtual_robot::telemetry::{COLUMNS, TELEMETRY_COLUMNS};
use crate::virtual_robot::{TelemetryRow, TrialSettings};

/// Which columns a trial's log has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrialLayout {
    /// Telemetry text with everything.
    Full,
    /// Telemetry text without the readings: from before the shell.
    WithoutSensors,
    /// `t_s,s1..s8`, as `shellcal record` writes: from the board alone.
    WithoutTelemetry,
}

/// Writes the header of a telemetry text: free text, then the names of the columns.
///
/// # Errors
/// Whatever `out` says.
pub fn write_telemetry_header(
    out: &mut impl Write,
    settings: &TrialSettings,
    sensors: bool,
) -> io::Result<()> {
    let TrialSettings { condition, stride_hz, seed, .. } = settings;
    writeln!(out, "%  SYNTHETIC: a trial of shellcal's virtual robot, no recording")?;
    writeln!(out, "%  Stride Frequency         = [{stride_hz}, {stride_hz}]")?;
    writeln!(out, "%  Condition                = {}", condition.name)?;
    writeln!(out, "%  Seed                     = {seed}")?;
    writeln!(out, "% Columns: ")?;
    let [robot, sensor] = COLUMNS;
    writeln!(out, "% {robot}{}", if sensors { sensor } else { "" })
}

/// Writes a row of a telemetry text.
///
/// # Errors
/// Whatever `out` says.
pub fn write_telemetry_row(
    out: &mut impl Write,
    row: &TelemetryRow,
    sensors: bool,
) -> io::Result<()> {
    let shown = if sensors { row } else { &row[..TELEMETRY_COLUMNS] };
    writeln!(out, "{}", shown.iter().map(i64::to_string).collect::<Vec<_>>().join(","))
}
