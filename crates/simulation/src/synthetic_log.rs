//! Writes recordings as CSV, and trials in the lab's format; or returns rows in memory.
//!
//! Decimals are exact: the reference sensor's steps, 1/160 N and 1/32 N·mm, need five and eight.
//! The file holds the model's values, in the same bytes every time.

use std::io::{self, Write};

use crate::sensor_model::{
    RecordingKind, RecordingSettings, SensorRecording, SensorSample, SimulatedFrame,
};
use crate::virtual_robot::telemetry::{COLUMNS, TELEMETRY_COLUMNS};
use crate::virtual_robot::{TelemetryRow, TrialSettings};
use shell_data::block::Block;
use shell_data::wrench::{Axis, PerAxis};

pub const FRAME_HEADER: &str = "t_s,s1,s2,s3,s4,s5,s6,s7,s8";

pub const WRENCH_HEADER: &str = "t_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SyntheticLayout {
    /// `t_s,s1..s8,fx_n..mz_nm`, then `group` (the pose) for loaded recordings.
    Shellcal,
    /// `Timestamp,Fx,Fy,Fz,Mx,My,Mz,s0..s7`, in N and N·m.
    Peer,
    /// No header; time, eight readings, six wrench columns in N and N·m.
    Training,
}

impl SyntheticLayout {
    pub fn header(self, kind: RecordingKind) -> String {
        let group = if kind == RecordingKind::Zero { "" } else { ",group" };
        match self {
            Self::Shellcal => format!("{FRAME_HEADER}{}{group}\n", &WRENCH_HEADER["t_s".len()..]),
            Self::Peer => "Timestamp,Fx,Fy,Fz,Mx,My,Mz,s0,s1,s2,s3,s4,s5,s6,s7\n".to_owned(),
            Self::Training => String::new(),
        }
    }

    pub fn write_row(
        self,
        out: &mut impl Write,
        kind: RecordingKind,
        sample: &SensorSample,
    ) -> io::Result<()> {
        let SensorSample { time_s, frame, wrench, pose } = sample;
        write!(out, "{time_s:.6}")?;
        if self == Self::Peer {
            write_wrench(out, wrench)?;
            write_readings(out, frame)?;
        } else {
            write_readings(out, frame)?;
            write_wrench(out, wrench)?;
        }
        if self == Self::Shellcal && kind != RecordingKind::Zero {
            write!(out, ",{pose}")?;
        }
        writeln!(out)
    }
}

pub fn write_wrench_row(
    out: &mut impl Write,
    time_s: f64,
    wrench: &PerAxis<f64>,
) -> io::Result<()> {
    write!(out, "{time_s:.7}")?;
    write_wrench(out, wrench)?;
    writeln!(out)
}

/// Writes a frame with six decimals of its time, since the clock counts µs.
pub fn write_frame(out: &mut impl Write, time_s: f64, frame: &SimulatedFrame) -> io::Result<()> {
    write!(out, "{time_s:.6}")?;
    write_readings(out, frame)?;
    writeln!(out)
}

fn write_readings(out: &mut impl Write, frame: &SimulatedFrame) -> io::Result<()> {
    frame.readings.iter().try_for_each(|reading| write!(out, ",{reading}"))
}

fn write_wrench(out: &mut impl Write, wrench: &PerAxis<f64>) -> io::Result<()> {
    let [fx, fy, fz, mx, my, mz] = wrench;
    write!(out, ",{fx:.5},{fy:.5},{fz:.5},{mx:.8},{my:.8},{mz:.8}")
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrialLayout {
    Full,
    /// Telemetry text without readings, as in logs from before the shell.
    WithoutSensors,
    /// `t_s,s1..s8`, as `shellcal record` writes from the board alone.
    WithoutTelemetry,
}

/// Writes the header of a telemetry text: free text, then the names of the columns.
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

pub fn write_telemetry_row(
    out: &mut impl Write,
    row: &TelemetryRow,
    sensors: bool,
) -> io::Result<()> {
    let shown = if sensors { row } else { &row[..TELEMETRY_COLUMNS] };
    writeln!(out, "{}", shown.iter().map(i64::to_string).collect::<Vec<_>>().join(","))
}

/// Rows per block, about as many as in the log reader.
const BLOCK_ROWS: usize = 6_000;

/// The first `rows` rows that `shellcal synth train` makes by default.
///
/// # Panics
/// Never: these settings are valid.
pub fn training_blocks(rows: usize) -> Vec<Block> {
    let recording = SensorRecording::new(RecordingSettings::new(RecordingKind::Training));
    blocks(recording.expect("valid settings"), rows)
}

pub fn blocks(recording: SensorRecording, rows: usize) -> Vec<Block> {
    let mut samples = recording.take(rows);
    let mut blocks = Vec::new();
    for start in (0..rows).step_by(BLOCK_ROWS) {
        let mut block = Block {
            readings: vec![Vec::new(); 8],
            wrench: vec![Vec::new(); Axis::ALL.len()],
            ..Block::default()
        };
        for sample in samples.by_ref().take(BLOCK_ROWS.min(rows - start)) {
            block.rows += 1;
            for (column, reading) in block.readings.iter_mut().zip(sample.frame.readings) {
                column.push(f64::from(reading));
            }
            for (column, component) in block.wrench.iter_mut().zip(sample.wrench) {
                column.push(component);
            }
        }
        blocks.push(block);
    }
    blocks
}
