//! Writes recordings of the sensor model as CSV, row by row.
//!
//! Decimals are exact: the reference sensor's steps, 1/160 N and 1/32 N·mm, need five and eight of
//! them. So the file holds what the model made, and the same command always makes the same bytes.

use std::io::{self, Write};

use crate::sensor_model::{RecordingKind, SensorSample, SimulatedFrame};
use shell_data::wrench::{Axis, PerAxis};

/// Which columns a log has, in which order and under which names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SyntheticLayout {
    /// `t_s,s1..s8,fx_n..mz_nm`, then `group` (the pose) where there is a load.
    Shellcal,
    /// `Timestamp,Fx,Fy,Fz,Mx,My,Mz,s0..s7`, in N and N·m.
    Peer,
    /// No header; time, eight readings, six wrench columns in N and N·m.
    Training,
}

impl SyntheticLayout {
    /// Writes the line that names the columns, if the layout has one.
    ///
    /// # Errors
    /// Whatever `out` says.
    pub fn write_header(self, out: &mut impl Write, kind: RecordingKind) -> io::Result<()> {
        match self {
            SyntheticLayout::Shellcal => {
                let group = if kind == RecordingKind::Zero { "" } else { ",group" };
                writeln!(out, "t_s{}{}{group}", channels(1), axes(Axis::column))
            }
            SyntheticLayout::Peer => writeln!(out, "Timestamp{}{}", axes(Axis::name), channels(0)),
            SyntheticLayout::Training => Ok(()),
        }
    }

    /// Writes one row.
    ///
    /// # Errors
    /// Whatever `out` says.
    pub fn write_row(
        self,
        out: &mut impl Write,
        kind: RecordingKind,
        sample: &SensorSample,
    ) -> io::Result<()> {
        write!(out, "{:.6}", sample.time_s)?;
        match self {
            SyntheticLayout::Shellcal => {
                write_readings(out, &sample.frame)?;
                write_wrench(out, &sample.wrench)?;
                if kind != RecordingKind::Zero {
                    write!(out, ",{}", sample.pose)?;
                }
            }
            SyntheticLayout::Peer => {
                write_wrench(out, &sample.wrench)?;
                write_readings(out, &sample.frame)?;
            }
            SyntheticLayout::Training => {
                write_readings(out, &sample.frame)?;
                write_wrench(out, &sample.wrench)?;
            }
        }
        writeln!(out)
    }
}

/// Writes the header of a reference's recording: time and wrench.
///
/// # Errors
/// Whatever `out` says.
pub fn write_wrench_header(out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "t_s{}", axes(Axis::column))
}

/// Writes a row of a reference's recording.
///
/// # Errors
/// Whatever `out` says.
pub fn write_wrench_row(
    out: &mut impl Write,
    time_s: f64,
    wrench: &PerAxis<f64>,
) -> io::Result<()> {
    write!(out, "{time_s:.7}")?;
    write_wrench(out, wrench)?;
    writeln!(out)
}

/// Writes the header of a board's log: time and readings.
///
/// # Errors
/// Whatever `out` says.
pub fn write_frame_header(out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "t_s{}", channels(1))
}

/// Writes a row of a board's log; its clock counts µs.
///
/// # Errors
/// Whatever `out` says.
pub fn write_frame(out: &mut impl Write, time_s: f64, frame: &SimulatedFrame) -> io::Result<()> {
    write!(out, "{time_s:.6}")?;
    write_readings(out, frame)?;
    writeln!(out)
}

/// The names of the channels, of which the first has this number, as they go on in a header.
fn channels(first: usize) -> String {
    (first..first + 8).map(|channel| format!(",s{channel}")).collect()
}

/// The names of the axes, as they go on in a header.
fn axes(name: fn(Axis) -> &'static str) -> String {
    Axis::ALL.map(|axis| format!(",{}", name(axis))).concat()
}

fn write_readings(out: &mut impl Write, frame: &SimulatedFrame) -> io::Result<()> {
    frame.readings.iter().try_for_each(|reading| write!(out, ",{reading}"))
}

fn write_wrench(out: &mut impl Write, wrench: &PerAxis<f64>) -> io::Result<()> {
    let [fx, fy, fz, mx, my, mz] = wrench;
    write!(out, ",{fx:.5},{fy:.5},{fz:.5},{mx:.8},{my:.8},{mz:.8}")
}
