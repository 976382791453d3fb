//! What is converted, and how.

use super::columns::Columns;
use crate::workflow::payload::CarriedLoad;
use crate::workflow::selection::RowFilter;
use calibration::Calibration;
use forces::ForceOptions;
use log_file::{Log, ReadOptions};

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
    pub columns: Columns,
    /// The highest reading that the converter can give, in counts: a reading there, or at zero, is
    /// saturated. `None` to leave saturation unflagged.
    pub full_scale: Option<f64>,
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
