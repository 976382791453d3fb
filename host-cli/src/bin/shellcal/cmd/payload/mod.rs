//! `shellcal payload`: the payload of a sensor.

pub(in crate::cmd) mod load;

use calibration::quality::fixed;
use calibration::scaling::Scaling;
use calibration::validation::excitation::LONGEST_LEVER_M;
use calibration::{Basis, Calibration, Model};
use calibration_file::payload_file::{PayloadFile, PayloadSource};
use clap::Subcommand;
use forces::RowRule;
use forces::payload::{LEAST_SPREAD, PayloadFit, STANDARD_GRAVITY_M_S2};
use log_file::{ColumnRef, Log, Mapping, Meaning, Wanted};
use shell_data::wrench::{Axes, Axis, PerAxis};
use shellcal::workflow::convert::{
    Conversion, ConvertOptions, OutputFormat, OutputPlan, RecordingFrame, TableColumns, convert,
};
use shellcal::workflow::payload::{FittedPayload, GravityFrom, fit_payload};
use shellcal::workflow::selection::RowFilter;

use self::load::{MotionArgs, MotionColumnArgs};
use crate::cmd::frames::ForceArgs;
use crate::cmd::mapping::{MappingArgs, open_logs};
use crate::cmd::outputs;
use crate::files::{InputPath, OutputPath};
use crate::printer::Printer;

#[derive(Debug, clap::Args)]
pub(crate) struct PayloadArgs {
    #[command(subcommand)]
    action: PayloadAction,
}

#[derive(Debug, Subcommand)]
enum PayloadAction {
    /// Find mass, centre of mass and the sensor's zero from poses at rest
    ///
    /// Needs a log of wrenches with the orientation of each row (`gx gy gz` of gravity in the sensor's frame,
    /// `r11` … `r33`, `qx qy qz qw`), accelerations (`ax ay az`), or both: then the frame, scale and offsets
    /// of the accelerometer are found, too. Every row is a pose, or every label of the group column.
    Fit(PayloadFitArgs),

    /// Subtract weight and inertia of a payload from a log of wrenches
    ///
    /// For a log of readings see `shellcal convert --payload`.
    Subtract(SubtractArgs),
}

impl PayloadArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        match &self.action {
            PayloadAction::Fit(args) => args.run(printer),
            PayloadAction::Subtract(args) => args.run(printer),
        }
    }
}

/// Number of rows without labels above which they are unlikely to be poses.
const MANY_POSES: usize = 500;
/// Spread of directions below which errors are large in any case: this many times the minimum.
const POOR_SPREAD: f64 = 100.0 * LEAST_SPREAD;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal payload fit poses.csv -o payload.json
  shellcal payload fit poses.csv --group pose --gravity 9.82085 -o payload.json")]
pub(crate) struct PayloadFitArgs {
    /// Logs of wrenches at rest
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<InputPath>,

    /// Write the payload (JSON)
    #[arg(long, short, value_name = "PAYLOAD.json")]
    output: Option<OutputPath>,

    #[command(flatten)]
    columns: MotionColumnArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

impl PayloadFitArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let logs = open_logs(&self.logs, ("", &[]), &self.mapping.mapping())?;
        let output = printer.create(self.output.as_ref())?;
        let columns = self.columns.columns(STANDARD_GRAVITY_M_S2);
        let found = fit_payload(&logs, &columns, &self.mapping.read_options())?;
        let paths = self.logs.iter().map(|path| path.to_path_buf());
        let sources = paths.zip(found.rows.iter().copied());
        let file = PayloadFile {
            fit: found.fit,
            accelerometer: found.accelerometer,
            made_by: shellcal::PROGRAM.to_owned(),
            date: outputs::date()?,
            sources: sources.map(|(path, rows)| PayloadSource { path, rows }).collect(),
        };
        output.map(|output| output.commit_with(file.to_json().as_bytes())).transpose()?;
        if printer.json() {
            printer.print(&file.to_json());
        } else {
            print(printer, &found.fit);
        }
        say(printer, &found);
        Ok(())
    }
}

fn print(printer: &Printer, fit: &PayloadFit) {
    let (payload, errors) = (&fit.payload, &fit.standard_errors);
    let row = |name: String, value: f64, error: f64, decimals: usize| {
        vec![name, fixed(value, decimals), fixed(error, decimals)]
    };
    let mut rows = vec![row("mass (kg)".to_owned(), payload.mass_kg, errors.mass_kg, 6)];
    let vectors = [
        ("centre", "mm", payload.centre_m, errors.centre_m, 1e3, 3),
        ("F₀", "N", payload.force_bias_n, errors.force_bias_n, 1.0, 6),
        ("T₀", "N·m", payload.moment_bias_nm, errors.moment_bias_nm, 1.0, 6),
    ];
    for (name, unit, value, error, scale, decimals) in vectors {
        for (axis, label) in ["x", "y", "z"].into_iter().enumerate() {
            let label = format!("{name} {label} ({unit})");
            rows.push(row(label, scale * value[axis], scale * error[axis], decimals));
        }
    }
    printer.table(&["quantity", "value", "standard error"], rows);
    printer.line(format!(
        "{} poses; left over: {:.5} N, {:.6} N·m (RMS)",
        fit.poses, fit.residual_rms_n, fit.residual_rms_nm
    ))
}

fn say(printer: &Printer, found: &FittedPayload) {
    let FittedPayload { fit, accelerometer, gravity_from, is_grouped, skipped_rows, .. } = found;
    let (forces, weight_n) = (found.forces_left, fit.payload.mass_kg * fit.gravity_m_s2);
    if forces.is_doubtful() {
        printer.warning(format!(
            "most of the forces do not follow gravity: {:.4} N (RMS) of a weight of {weight_n:.4} N are left over",
            forces.rms
        ));
    }
    let lever_m = fit.payload.centre_m.iter().map(|of| of * of).sum::<f64>().sqrt();
    if lever_m > LONGEST_LEVER_M {
        printer.warning(format!(
            "the centre of mass is {lever_m:.1} m away: moments are probably in mN·m; use `--moment-unit mnm`"
        ));
    }
    if let Some(doubt) = &found.moment_doubt {
        let left = format!(
            "moments do not follow gravity: {:.5} of {:.5} N·m (RMS) are left over",
            doubt.left.rms, doubt.left.scatter
        );
        printer.warning(match (found.moments_upright_nm, &doubt.cure) {
            (Some(rms), _) => {
                format!("{left}; turned from the upright frame to the sensor's, {rms:.5}")
            }
            (None, Some((exchange, rms))) => format!("{left}; {exchange} leaves {rms:.5}"),
            (None, None) => format!("{left}: the centre is not to be believed"),
        });
    }
    if found.is_reaction {
        printer.note("accelerations at rest point along gravity: taken with the other sign");
    }
    if *skipped_rows > 0 {
        printer.note(format!("{skipped_rows} bad rows left out"));
    }
    match (gravity_from, accelerometer) {
        (GravityFrom::Accelerations, _) => printer.note(
            "gravity is from accelerations, its frame from forces; F₀ and T₀ include the accelerometer's \
             offset",
        ),
        (GravityFrom::Orientation, Some(it)) => {
            let [x, y, z] = it.residual_rms_m_s2;
            printer.note(format!(
                "accelerometer: frame, scale and offsets found; left over: {x:.3}, {y:.3}, {z:.3} m/s² (RMS)"
            ));
        }
        (GravityFrom::Orientation, None) => printer.note(
            "no accelerometer, so no inertia is removed: give `ax ay az` in at least six orientations",
        ),
    }
    let rest = fit.spread_rad[1];
    if rest < POOR_SPREAD {
        printer.warning(format!(
            "beside one line gravity turns by {:.1}° only: poses in all directions tell more",
            rest.to_degrees()
        ));
    }
    if !is_grouped && fit.poses > MANY_POSES {
        printer.warning(format!(
            "each of {} rows counts as a pose; if a pose has several rows, name its column with `--group`",
            fit.poses
        ));
    }
}

const AXES: usize = Axis::ALL.len();

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal payload subtract payload.json wrench.csv -o contact.csv
  shellcal payload subtract payload.json wrench.csv --motion accelerations.csv --lowpass 20 -o contact.csv")]
pub(crate) struct SubtractArgs {
    /// Payload file
    #[arg(value_name = "PAYLOAD")]
    payload: InputPath,

    /// Log of time and wrench
    #[arg(value_name = "LOG")]
    log: InputPath,

    /// Write the remaining wrench: .csv, .parquet, .mat, .npy or .mcap [default: standard output, as CSV]
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
        let format = match &self.output {
            Some(path) => OutputFormat::from_path(path, &RecordingFrame::default())?,
            None => OutputFormat::Csv,
        };
        let file = PayloadFile::read(&self.payload)?;
        let mapping = self.mapping.mapping();
        let (log, calibration) = wrench_log(&self.log, mapping.clone())?;
        let read = self.mapping.read_options();
        let load = self.motion.load(&file, &log, &calibration, &read, mapping.time_unit)?;
        let options = ConvertOptions {
            rows: RowFilter::All,
            forces: self.forces.options_without_tare(RowRule::Time),
            load: Some(load),
            frame: Vec::new(),
            columns: TableColumns {
                time: true,
                axes: Axes::ALL,
                standard_errors: false,
                interval: None,
                flags: false,
            },
            converter: None,
        };
        let plan = OutputPlan { format, ..OutputPlan::default() };
        let mut out = printer.create_or_stdout(self.output.as_ref())?;
        let (calibration, options) = (&calibration, &options);
        let summary = printer.scan(&log, read, |read| {
            let conversion = Conversion { log: &log, calibration, options, read };
            convert(&conversion, &plan, &mut out, None)
        })?;
        out.commit()?;
        self.motion.report(printer, &log, &summary);
        printer.finish(&summary, |_| ())
    }
}

/// A log of wrenches as a log of readings, and the calibration that converts these back to wrenches.
fn wrench_log(path: &InputPath, mapping: Mapping) -> anyhow::Result<(Log, Calibration)> {
    let log = Log::open(path, &mapping)?;
    log.require(&Wanted { time: true, wrench: true, ..Wanted::default() })?;
    log.require_axes(Axes::ALL)?;
    let mut columns: PerAxis<(usize, f64)> = Default::default();
    for (position, column) in log.columns().iter().enumerate() {
        if let Meaning::Load(axis, scale) = column.meaning {
            columns[axis.index()] = (position, scale.to_si(1.0));
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
