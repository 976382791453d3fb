//! Options of a conversion: processing, columns, and the format of the output.

use std::path::Path;
use std::str::FromStr;

use crate::workflow::WorkflowError;
use crate::workflow::selection::RowFilter;
use calibration::Calibration;
use calibration::dynamics::ReferenceLag;
use calibration::memory::TimeBase;
use forces::payload::CarriedLoad;
use forces::{ForceOptions, FrameChange};
use log_file::{Log, ReadOptions};
use shell_data::Converter;
use shell_data::wrench::Axes;

#[derive(Clone, Debug)]
pub struct ConvertOptions {
    pub rows: RowFilter,
    pub forces: ForceOptions,
    /// The load that the sensor carries, subtracted before tare and low-pass.
    pub load: Option<CarriedLoad>,
    /// Changes of the frame of reference, applied in order.
    pub frame: Vec<FrameChange>,
    pub columns: TableColumns,
    /// The ends of the converter's range, at which a reading is saturated. `None` to leave saturation unflagged.
    pub converter: Option<Converter>,
}

impl ConvertOptions {
    /// Options for all columns that log and calibration provide, the default of `shellcal convert`.
    pub fn new(log: &Log, calibration: &Calibration) -> Self {
        Self {
            rows: if log.repeats_are_stale() { RowFilter::Fresh } else { RowFilter::All },
            forces: ForceOptions::default(),
            load: None,
            frame: Vec::new(),
            columns: TableColumns {
                time: log.has_time() || calibration.lag.is_some_and(is_by_row),
                axes: calibration.axes,
                standard_errors: calibration.has_standard_errors(),
                interval: None,
                flags: true,
            },
            converter: calibration.converter(None),
        }
    }

    /// Returns true if the column of time holds shifted row numbers instead: the log has no time, and the
    /// calibration has a lag in rows.
    pub(super) fn numbers_rows(&self, log: &Log, calibration: &Calibration) -> bool {
        self.columns.time && !log.has_time() && calibration.lag.is_some_and(is_by_row)
    }
}

fn is_by_row(lag: ReferenceLag) -> bool {
    lag.time_base == TimeBase::Rows
}

#[derive(Clone, Copy)]
pub struct Conversion<'a> {
    pub log: &'a Log,
    pub calibration: &'a Calibration,
    pub options: &'a ConvertOptions,
    pub read: ReadOptions<'a>,
}

/// The columns written for every frame, in this order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableColumns {
    /// Time, s. For a log without time, the number of the row, if the calibration has a lag in rows.
    pub time: bool,
    /// Axes of the wrench, N and N·m.
    pub axes: Axes,
    /// The standard error of each axis written, N and N·m, of the frame before filtering.
    pub standard_errors: bool,
    /// Level of the prediction interval of each axis written (N and N·m), between 0 and 1. The interval is
    /// centred on the wrench as written and has the width for the frame before filtering.
    pub interval: Option<f64>,
    /// Channels that cannot be trusted: `s3:range` outside the calibrated range, `s3:saturated` at an end of
    /// the converter's range, `s3:insensitive` on a plateau of its curve, `s3:left-out` not used by the
    /// model; empty if there are none.
    pub flags: bool,
}

impl TableColumns {
    pub(super) fn need_errors(&self) -> bool {
        self.standard_errors || self.interval.is_some()
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub enum OutputFormat {
    #[default]
    Csv,
    Parquet,
    /// MATLAB 5: one variable per column.
    Matlab,
    /// NumPy: a structured array.
    NumPy,
    /// MCAP for ROS 2: wrenches, and readings, errors and flags as JSON.
    Mcap(RecordingFrame),
}

#[derive(Clone, Debug, PartialEq)]
pub struct RecordingFrame {
    pub id: String,
    /// The pose of this frame in its parent; `None` to write none.
    pub mount: Option<FrameMount>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct FrameMount {
    pub parent: String,
    /// Position x, y, z, m.
    pub position_m: [f64; 3],
    /// Roll, pitch and yaw about the fixed axes x, y, z in this order, rad, as in ROS.
    pub angles_rad: [f64; 3],
}

const BAD_MOUNT: &str = "expected `NAME` or `NAME:X,Y,Z,ROLL,PITCH,YAW` in m and rad";

impl Default for RecordingFrame {
    fn default() -> Self {
        Self { id: DEFAULT_FRAME_ID.to_owned(), mount: None }
    }
}

impl FrameMount {
    /// Rotation as a unit quaternion x, y, z, w (J. Diebel, "Representing Attitude", 2006, eq. 290).
    pub fn quaternion(&self) -> [f64; 4] {
        let [(sr, cr), (sp, cp), (sy, cy)] = self.angles_rad.map(|angle| (angle / 2.0).sin_cos());
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    }
}

impl FromStr for FrameMount {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, &'static str> {
        let (parent, numbers) = text.split_once(':').unwrap_or((text, "0,0,0,0,0,0"));
        let number = |field: &str| field.trim().parse().ok().filter(|it: &f64| it.is_finite());
        let numbers: Vec<f64> =
            numbers.split(',').map(number).collect::<Option<_>>().ok_or(BAD_MOUNT)?;
        let [x, y, z, roll, pitch, yaw] = numbers[..] else { return Err(BAD_MOUNT) };
        if parent.is_empty() {
            return Err(BAD_MOUNT);
        }
        let (position_m, angles_rad) = ([x, y, z], [roll, pitch, yaw]);
        Ok(Self { parent: parent.to_owned(), position_m, angles_rad })
    }
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct OutputPlan {
    pub format: OutputFormat,
    /// Numeric columns of the log to carry along, by position from 0.
    pub keep: Vec<usize>,
    /// Text columns to carry along, each once.
    pub keep_texts: Vec<usize>,
}

pub const DEFAULT_FRAME_ID: &str = "shell";

impl OutputFormat {
    /// Derives the format from the name of a file; devices and pipes, which have no extension, get CSV. Fails with
    /// [`WorkflowError::Refused`].
    pub fn from_path(path: &Path, frame: &RecordingFrame) -> Result<Self, WorkflowError> {
        let extension = path.extension().map(|it| it.to_string_lossy().to_lowercase());
        Ok(match extension.as_deref() {
            Some("csv" | "txt") => Self::Csv,
            Some("parquet") => Self::Parquet,
            Some("mat") => Self::Matlab,
            Some("npy") => Self::NumPy,
            Some("mcap") => Self::Mcap(frame.clone()),
            _ if path.starts_with("/dev") => Self::Csv,
            _ => {
                let known = "`.csv`, `.txt`, `.parquet`, `.mat`, `.npy`, `.mcap`";
                let message = format!("`{}` ends in none of {known}", path.display());
                return Err(WorkflowError::refused(message, None));
            }
        })
    }
}

/// The name of the table for a log: `run3.txt.gz` becomes `run3.wrench.csv`.
pub fn table_name(log: &Path) -> String {
    let name = log.file_name().unwrap_or_default().to_string_lossy();
    let name = name.strip_suffix(".gz").unwrap_or(&name);
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    format!("{stem}.wrench.csv")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mount_is_a_name_with_or_without_a_place() {
        let mount: FrameMount = "base_link".parse().unwrap();
        assert_eq!(
            (mount.parent.as_str(), mount.quaternion()),
            ("base_link", [0.0, 0.0, 0.0, 1.0])
        );
        let mount: FrameMount = "foot:0.1,0,-0.02,0,0,1.5707963267948966".parse().unwrap();
        assert_eq!(mount.position_m, [0.1, 0.0, -0.02]);
        // Quarter turn about z: 1/√2 for z and w.
        let expected = [0.0, 0.0, 0.5_f64.sqrt(), 0.5_f64.sqrt()];
        let found = mount.quaternion();
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-15), "{found:?}");
        for text in ["", ":0,0,0,0,0,0", "base:1,2,3", "base:0,0,0,0,0,nan"] {
            assert_eq!(text.parse::<FrameMount>(), Err(BAD_MOUNT), "{text}");
        }
    }

    #[test]
    fn file_names_decide_the_format() {
        let frame = RecordingFrame { id: "base".to_owned(), mount: None };
        let of = |path: &str| OutputFormat::from_path(Path::new(path), &frame);
        assert_eq!(of("a/b.CSV").unwrap(), OutputFormat::Csv);
        assert_eq!(of("b.parquet").unwrap(), OutputFormat::Parquet);
        assert_eq!(of("b.mcap").unwrap(), OutputFormat::Mcap(frame.clone()));
        assert_eq!(of("/dev/null").unwrap(), OutputFormat::Csv);
        for path in ["b", "b.xlsx", "b.feather", ".csv"] {
            let said = of(path).unwrap_err().to_string();
            assert!(said.contains(path) && said.contains("`.parquet`"), "{said}");
        }
    }

    #[test]
    fn a_table_is_named_after_its_log() {
        let names =
            ["a/run3.txt", "run3.csv.gz", "run", ".hidden"].map(|p| table_name(Path::new(p)));
        assert_eq!(names[..3], ["run3.wrench.csv", "run3.wrench.csv", "run.wrench.csv"]);
    }
}
