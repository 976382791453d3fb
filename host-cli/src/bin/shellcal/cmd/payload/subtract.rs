//! `shellcal payload subtract`: a payload taken off a log of wrenches.
//!
//! A reference sensor is one whose six channels are the axes: what holds for readings, `convert` does.

use calibration::scaling::Scaling;
use calibration::{Basis, Calibration, Model};
use calibration_file::payload_file::PayloadFile;
use forces::RowRule;
use log_file::{ColumnRef, Log, Mapping, Meaning, Wanted};
use shell_data::wrench::{Axes, Axis, PerAxis};
use shellcal::workflow::convert::{
    Conversion, ConvertOptions, OutputFormat, OutputPlan, RecordingFrame, TableColumns, convert,
};
use shellcal::workflow::selection::RowFilter;

use super::load::MotionArgs;
use crate::cmd::frames::ForceArgs;
use crate::cmd::mapping::MappingArgs;
use crate::cmd::partial_output::OpenOutput;
use crate::files::{InputPath, OutputPath};
use crate::printer::Printer;

/// Channels of a wrench.
const AXES: usize = Axis::ALL.len();

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal payload subtract payload.json wrench.csv -o contact.csv
  shellcal payload subtract payload.json wrench.csv --motion accelerations.csv --lowpass 20 -o contact.csv")]
pub(crate) struct SubtractArgs {
    /// Payload file
    #[arg(value_name = "PAYLOAD")]
    payload: InputPath,

    /// A log of time and wrench
    #[arg(value_name = "LOG")]
    log: InputPath,

    /// Write the wrench that is left: .csv, .parquet, .mat, .npy or .mcap [default:
    /// standard output, as CSV]
    #[arg(long, short, value_name = "FILE")]
    output: Option<OutputPath>,

    #[command(flatten)]
    motion: MotionArgs,

    #[command(flatten)]
    forces: ForceArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

impl SubtractArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        if printer.json() && self.output.is_none() {
            anyhow::bail!("`--json` needs `--output`: the table would go to the same place");
        }
        let format = match &self.output {
            Some(path) => OutputFormat::from_path(path, &RecordingFrame::default())?,
            None => OutputFormat::Csv,
        };
        let file = PayloadFile::read(&self.payload)?;
        let mapping = self.mapping.mapping();
        let (log, calibration) = wrench_log(&self.log, mapping.clone())?;
        let read = self.mapping.read_options();
        let load = self.motion.load(&file, &log, &calibration, &read, &mapping)?;
        let options = ConvertOptions {
            rows: RowFilter::All,
            forces: self.forces.options_without_tare(RowRule::Time),
            load: Some(load),
            columns: TableColumns {
                time: true,
                axes: Axes::ALL,
                standard_errors: false,
                interval: None,
                flags: false,
            },
            full_scale: None,
        };
        let plan = OutputPlan { format, ..OutputPlan::default() };
        let mut out = OpenOutput::create(self.output.as_ref(), printer)?;
        let (calibration, options) = (&calibration, &options);
        let summary = printer.scan(&log, read, |read| {
            let conversion = Conversion { log: &log, calibration, options, read };
            convert(&conversion, &plan, &mut out, None)
        })?;
        out.finish()?;
        self.motion.report(printer, &log, &summary);
        if printer.json() {
            printer.document(&summary)?;
        }
        Ok(())
    }
}

/// A log of wrenches as one of readings, and the calibration that makes the one of the other.
fn wrench_log(path: &InputPath, mapping: Mapping) -> anyhow::Result<(Log, Calibration)> {
    let log = Log::open(path, &mapping)?;
    log.require(&Wanted { time: true, wrench: true, ..Wanted::default() })?;
    log.require_axes(Axes::ALL)?;
    let mut columns: PerAxis<(usize, f64)> = Default::default();
    for (position, column) in log.columns().iter().enumerate() {
        if let Meaning::Load(axis, is_milli) = column.meaning {
            columns[axis.index()] = (position, if is_milli { 1e-3 } else { 1.0 });
        }
    }
    let sensors = columns.map(|(position, _)| ColumnRef::Position(position + 1)).to_vec();
    let as_readings = Mapping { sensors: Some(sensors), wrench: None, ..mapping };
    let model = Model { basis: Basis::Linear, intercept: false, channels: AXES, memory: 0 };
    let row = |from: usize| -> PerAxis<f64> {
        std::array::from_fn(|to| if from == to { columns[from].1 } else { 0.0 })
    };
    let coefficients = (0..AXES).map(row).collect();
    let calibration = Calibration::new(model, Scaling::identity(AXES), coefficients);
    Ok((Log::open(path, &as_readings)?, calibration))
}
