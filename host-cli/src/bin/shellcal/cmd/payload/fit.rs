//! `shellcal payload fit`: from poses at rest to what the sensor carries.

use calibration_file::payload_file::{PayloadFile, PayloadSource};
use forces::payload::{LEAST_SPREAD, Payload, PayloadFit, STANDARD_GRAVITY_M_S2};
use shellcal::workflow::payload::{FittedPayload, GravityFrom, fit_payload};

use super::load::MotionColumnArgs;
use crate::cmd::mapping::{MappingArgs, open_logs};
use crate::cmd::origin;
use crate::files::{InputPath, OutputPath};
use crate::printer::Printer;

/// More rows than this that no label puts together are hardly poses.
const MANY_POSES: usize = 500;
/// A spread of directions below this many times the least leaves errors large, whatever they are.
const POOR_SPREAD: f64 = 100.0 * LEAST_SPREAD;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal payload fit poses.csv -o payload.json
  shellcal payload fit poses.csv --group pose --gravity 9.82085 -o payload.json")]
pub(crate) struct PayloadFitArgs {
    /// Logs of wrenches at rest
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<InputPath>,

    /// Write what was found (JSON)
    #[arg(long, short, value_name = "PAYLOAD.json")]
    output: Option<OutputPath>,

    #[command(flatten)]
    columns: MotionColumnArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

impl PayloadFitArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let mapping = self.mapping.mapping();
        let logs = open_logs(&self.logs, ("", &[]), &mapping)?;
        let output = printer.create(self.output.as_ref())?;
        let found = fit_payload(
            &logs,
            &self.columns.columns(STANDARD_GRAVITY_M_S2),
            &self.mapping.read_options(),
        )?;
        let paths = self.logs.iter().map(|path| path.to_path_buf());
        let sources = paths.zip(found.rows.iter().copied());
        let file = PayloadFile {
            fit: found.fit,
            accelerometer: found.accelerometer,
            made_by: shellcal::PROGRAM.to_owned(),
            date: origin::date()?,
            sources: sources.map(|(path, rows)| PayloadSource { path, rows }).collect(),
        };
        if let Some(output) = output {
            output.commit_with(file.to_json().as_bytes())?;
        }
        if printer.json() {
            printer.file(file.to_json().as_bytes())?;
        } else {
            print(printer, &found.fit)?;
        }
        say(printer, &found);
        Ok(())
    }
}

/// The ten numbers with their standard errors.
fn print(printer: &Printer, fit: &PayloadFit) -> anyhow::Result<()> {
    let rows = rows(&fit.payload, &fit.standard_errors).into_iter().map(
        |(name, value, error, decimals)| {
            vec![name, format!("{value:.decimals$}"), format!("{error:.decimals$}")]
        },
    );
    printer.table(&["quantity", "value", "standard error"], rows)?;
    printer.line(format!(
        "{} poses; left over: {:.5} N, {:.6} N·m (RMS)",
        fit.poses, fit.residual_rms_n, fit.residual_rms_nm
    ))
}

/// Name, value, standard error and decimals of each number.
fn rows(payload: &Payload, errors: &Payload) -> Vec<(String, f64, f64, usize)> {
    let mut rows = vec![("mass (kg)".to_owned(), payload.mass_kg, errors.mass_kg, 6)];
    let vectors = [
        ("centre", "mm", payload.centre_m, errors.centre_m, 1e3, 3),
        ("F₀", "N", payload.force_bias_n, errors.force_bias_n, 1.0, 6),
        ("T₀", "N·m", payload.moment_bias_nm, errors.moment_bias_nm, 1.0, 6),
    ];
    for (name, unit, value, error, scale, decimals) in vectors {
        for (axis, label) in ["x", "y", "z"].into_iter().enumerate() {
            let label = format!("{name} {label} ({unit})");
            rows.push((label, scale * value[axis], scale * error[axis], decimals));
        }
    }
    rows
}

/// How it was found, and where that may not suffice.
fn say(printer: &Printer, found: &FittedPayload) {
    let FittedPayload { fit, accelerometer, gravity_from, is_grouped, skipped_rows, .. } = found;
    if *skipped_rows > 0 {
        printer.note(format!("{skipped_rows} bad rows left out"));
    }
    match (gravity_from, accelerometer) {
        (GravityFrom::Accelerations, _) => printer.note(
            "gravity from accelerations alone, their frame from the forces; offsets of the accelerometer are \
             in F₀ and T₀",
        ),
        (GravityFrom::Orientation, Some(it)) => {
            let [x, y, z] = it.residual_rms_m_s2;
            printer.note(format!(
                "accelerometer: frame, scale and offsets found; left over: {x:.3}, {y:.3}, {z:.3} m/s² (RMS)"
            ));
        }
        (GravityFrom::Orientation, None) => printer.note(
            "no accelerometer: inertia cannot be taken off (`ax ay az` in six poses or more that turn \
             gravity in all of space tell its frame)",
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
            "each of {} rows counts as a pose: if poses last for rows, name the column that labels them \
             with `--group`, or standard errors are too small",
            fit.poses
        ));
    }
}
