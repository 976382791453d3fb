//! Writes recordings of the sensor model as CSV, row by row.
//!
//! Decimals are exact: the reference sensor's steps, 1/160 N and 1/32 N·mm, need five and eight of
//! them. So the file holds what the model made, and the same command always makes the same bytes.

use std::io::{self, Write};

use crate::sensor_model::{Kind, Sample};
use crate::wrench::Axis;

/// Which columns a log has, in which order and under which names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// `t_s,s1..s8,fx_n..mz_nm`, then `group` (the pose) where there is a load.
    Shellcal,
    /// `Timestamp,Fx,Fy,Fz,Mx,My,Mz,s0..s7`, in N and N·m.
    Peer,
    /// No header; time, eight readings, six wrench columns in N and N·m.
    Training,
}

impl Layout {
    /// Writes the line that names the columns, if the layout has one.
    ///
    /// # Errors
    /// Whatever `out` says.
    pub fn write_header(self, out: &mut impl Write, kind: Kind) -> io::Result<()> {
        match self {
            Layout::Shellcal => {
                write!(out, "t_s")?;
                for channel in 1..=8 {
                    write!(out, ",s{channel}")?;
                }
                for axis in Axis::ALL {
                    write!(out, ",{}", axis.column())?;
                }
                writeln!(out, "{}", if kind == Kind::Zero { "" } else { ",group" })
            }
            Layout::Peer => {
                write!(out, "Timestamp")?;
                for axis in Axis::ALL {
                    write!(out, ",{}", axis.name())?;
                }
                for channel in 0..8 {
                    write!(out, ",s{channel}")?;
                }
                writeln!(out)
            }
            Layout::Training => Ok(()),
        }
    }

    /// Writes one row.
    ///
    /// # Errors
    /// Whatever `out` says.
    pub fn write_row(self, out: &mut impl Write, kind: Kind, sample: &Sample) -> io::Result<()> {
        write!(out, "{:.6}", sample.time_s)?;
        match self {
            Layout::Shellcal => {
                write_readings(out, sample)?;
                write_wrench(out, sample)?;
                if kind != Kind::Zero {
                    write!(out, ",{}", sample.pose)?;
                }
            }
            Layout::Peer => {
                write_wrench(out, sample)?;
                write_readings(out, sample)?;
            }
            Layout::Training => {
                write_readings(out, sample)?;
                write_wrench(out, sample)?;
            }
        }
        writeln!(out)
    }
}

fn write_readings(out: &mut impl Write, sample: &Sample) -> io::Result<()> {
    sample.frame.readings.iter().try_for_each(|reading| write!(out, ",{reading}"))
}

fn write_wrench(out: &mut impl Write, sample: &Sample) -> io::Result<()> {
    let [fx, fy, fz, mx, my, mz] = sample.wrench;
    write!(out, ",{fx:.5},{fy:.5},{fz:.5},{mx:.8},{my:.8},{mz:.8}")
}
