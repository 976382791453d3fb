//! What is converted, how, and to which columns of which kind of file.

use std::path::Path;

use crate::workflow::selection::RowFilter;
use calibration::Calibration;
use forces::ForceOptions;
use forces::payload::CarriedLoad;
use log_file::{Log, ReadOptions};
use shell_data::wrench::{Axes, Axis, PerAxis};

/// What is done to the readings of a log.
#[derive(Clone, Debug)]
pub struct ConvertOptions {
    /// Which rows are written.
    pub rows: RowFilter,
    /// How readings become forces.
    pub forces: ForceOptions,
    /// What the sensor carries, which is taken off before tare and low-pass.
    pub load: Option<CarriedLoad>,
    /// What is written of every frame.
    pub columns: TableColumns,
    /// The highest reading that the converter can give, in counts: a reading there, or at zero, is
    /// saturated. `None` to leave saturation unflagged.
    pub full_scale: Option<f64>,
}

impl ConvertOptions {
    /// Everything that log and calibration have to give, as `shellcal convert` does by default.
    pub fn new(log: &Log, calibration: &Calibration) -> Self {
        // The end of a 12-bit converter, or of a 16-bit one if the calibration has seen more than that.
        let mut ranges = calibration.valid_range.iter().flatten();
        let is_wide = ranges.any(|range| range.max > 4095.0);
        Self {
            rows: if log.repeats_are_stale() { RowFilter::Fresh } else { RowFilter::All },
            forces: ForceOptions::default(),
            load: None,
            columns: TableColumns {
                time: log.has_time(),
                axes: Axis::ALL.map(|axis| calibration.axes.contains(axis)),
                standard_errors: calibration.has_standard_errors(),
                interval: None,
                flags: true,
            },
            full_scale: Some(if is_wide { 65535.0 } else { 4095.0 }),
        }
    }
}

/// A log, and what turns it into wrenches.
#[derive(Clone, Copy)]
pub struct Conversion<'a> {
    /// The log.
    pub log: &'a Log,
    /// The calibration of its sensor.
    pub calibration: &'a Calibration,
    /// What is done.
    pub options: &'a ConvertOptions,
    /// How the log is read.
    pub read: ReadOptions<'a>,
}

/// What is written of every frame, in this order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableColumns {
    /// Time in s.
    pub time: bool,
    /// The axes of the wrench, N and N·m.
    pub axes: PerAxis<bool>,
    /// The standard error of each axis written, N and N·m: that of the frame before filtering.
    pub standard_errors: bool,
    /// The prediction interval of each axis written, N and N·m: the level, between 0 and 1. About
    /// the wrench as written, as wide as that of the frame before filtering.
    pub interval: Option<f64>,
    /// Which channels cannot be trusted: `s3:range` outside the calibrated range, `s3:saturated` at
    /// an end of the converter or on a plateau of its curve, `s3:left-out` not used by the model; empty
    /// when all is well.
    pub flags: bool,
}

impl TableColumns {
    /// The axes that are written.
    pub(super) fn axes(&self) -> Axes {
        Axis::ALL.into_iter().filter(|axis| self.axes[axis.index()]).collect()
    }

    /// Whether standard errors are needed.
    pub(super) fn need_errors(&self) -> bool {
        self.standard_errors || self.interval.is_some()
    }
}

/// A kind of file.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum OutputFormat {
    /// Text.
    #[default]
    Csv,
    /// Parquet.
    Parquet,
    /// MATLAB 5: a variable for each column.
    Matlab,
    /// NumPy: an array of records.
    NumPy,
    /// MCAP for ROS 2: wrenches, and readings, errors and flags as JSON.
    Mcap {
        /// The frame of reference that the wrenches are in.
        frame_id: String,
    },
}

/// What is written besides wrenches, and as what.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OutputPlan {
    /// The kind of file.
    pub format: OutputFormat,
    /// Columns of the log, by place from 0, that are carried along as they stand.
    pub keep: Vec<usize>,
    /// Columns of text likewise, each once.
    pub keep_texts: Vec<usize>,
}

/// A file whose name does not say what it is to be.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{path}` ends in none of {}", EXTENSIONS.map(|(extension, _)| format!("`.{extension}`")).join(", "))]
pub struct UnknownExtension {
    /// The file.
    pub path: String,
}

/// The frame of reference that is named unless another is.
pub const DEFAULT_FRAME_ID: &str = "shell";

const EXTENSIONS: [(&str, OutputFormat); 6] = [
    ("csv", OutputFormat::Csv),
    ("txt", OutputFormat::Csv),
    ("parquet", OutputFormat::Parquet),
    ("mat", OutputFormat::Matlab),
    ("npy", OutputFormat::NumPy),
    ("mcap", OutputFormat::Mcap { frame_id: String::new() }),
];

impl OutputFormat {
    /// What the name of a file says; devices and pipes, which have no such name, get CSV.
    ///
    /// # Errors
    /// [`UnknownExtension`].
    pub fn from_path(path: &Path, frame_id: &str) -> Result<Self, UnknownExtension> {
        let extension = path.extension().map(|it| it.to_string_lossy().to_lowercase());
        let known = EXTENSIONS.into_iter().find(|(known, _)| extension.as_deref() == Some(known));
        match known {
            Some((_, Self::Mcap { .. })) => Ok(Self::Mcap { frame_id: frame_id.to_owned() }),
            Some((_, format)) => Ok(format),
            None if path.starts_with("/dev") => Ok(Self::Csv),
            None => Err(UnknownExtension { path: path.display().to_string() }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_what_their_names_say() {
        let of = |path: &str| OutputFormat::from_path(Path::new(path), "base");
        assert_eq!(of("a/b.CSV"), Ok(OutputFormat::Csv));
        assert_eq!(of("b.parquet"), Ok(OutputFormat::Parquet));
        assert_eq!(of("b.mcap"), Ok(OutputFormat::Mcap { frame_id: "base".to_owned() }));
        assert_eq!(of("/dev/null"), Ok(OutputFormat::Csv));
        for path in ["b", "b.xlsx", "b.feather", ".csv"] {
            let said = of(path).unwrap_err().to_string();
            assert!(said.contains(path) && said.contains("`.parquet`"), "{said}");
        }
    }
}
