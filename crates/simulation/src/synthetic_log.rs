//! Writes recordings of the sensor model as CSV, row by row.
//!
//! Decimals are exact: the reference sensor's steps, 1/160 N and 1/32 N·mm, need five and eight of
//! them. So the file holds what the model made, and the same command always makes the same bytes.

use std::io::{self, Write};

use crate::sensor_model::{RecordingKind, SensorSample, SimulatedFrame};
use shell_data::wrench::PerAxis;

/// The header of a board's log: time and readings.
pub const FRAME_HEADER: &str = "t_s,s1,s2,s3,s4,s5,s6,s7,s8";

/// The header of a reference's recording: time and wrench.
pub const WRENCH_HEADER: &str = "t_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm";

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
    /// The line that names the columns, empty if the layout has none.
    pub fn header(self, kind: RecordingKind) -> &'static str {
        match self {
            Self::Shellcal if kind == RecordingKind::Zero => {
                "t_s,s1,s2,s3,s4,s5,s6,s7,s8,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n"
            }
            Self::Shellcal => {
                "t_s,s1,s2,s3,s4,s5,s6,s7,s8,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm,group\n"
            }
            Self::Peer => "Timestamp,Fx,Fy,Fz,Mx,My,Mz,s0,s1,s2,s3,s4,s5,s6,s7\n",
            Self::Training => "",
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

/// Writes a row of a board's log; its clock counts µs.
///
/// # Errors
/// Whatever `out` says.
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
