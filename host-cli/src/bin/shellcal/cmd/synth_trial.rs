//! `shellcal synth trial` and `synth trials`: runs of the virtual robot through the channel.

use shellcal::workflow::synthetic_trials::{MANIFEST, truth_json, write_log, write_set};
use simulation::synthetic_log::TrialLayout;
use simulation::virtual_robot::{ChannelForces, TrialSettings, VirtualTrial};

use super::choices::one_of;
use super::simulated_unit::{SeedArgs, WrittenArg};
use crate::files::{OutputLocation, OutputPath};
use crate::printer::Printer;

/// One trial of a virtual robot in the channel, with known true values
///
/// Leg motion, drag and lift of the condition, the legs' shaking, battery and motors; telemetry at 1 kHz in
/// the lab's format, with fresh sensor readings at 100 Hz. `synth train` makes the training log of the same
/// unit.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal synth trial --condition '3 cm' --output run.txt --truth run.truth.json
  shellcal synth trial --stride-frequency 1 --missing 0.1 --output run.txt")]
pub(super) struct SynthTrialArgs {
    /// Channel that the robot runs through, by its largest deflection
    #[arg(long, value_parser = one_of(&ChannelForces::PAPER.map(|of| (of.name, "", of))), value_name = "NAME", default_value = "3 cm")]
    condition: ChannelForces,

    #[command(flatten)]
    common: CommonArgs,

    /// Share of missing rows, from 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    missing: f64,

    /// Leave out the sensors' columns
    #[arg(long, conflicts_with = "no_telemetry")]
    no_sensors: bool,

    /// Leave out the telemetry: only frames of the board, as CSV
    #[arg(long)]
    no_telemetry: bool,

    /// Write the true value of every result, as JSON
    #[arg(long, value_name = "FILE")]
    truth: Option<OutputPath>,

    #[command(flatten)]
    written: WrittenArg,
}

/// An example set: trials in all five conditions, their true values, and a manifest for `shellcal batch`
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "Example:
  shellcal synth trials trials
  shellcal synth train --output train.csv
  shellcal fit train.csv --output calibration.json
  shellcal batch trials/manifest.csv --calibration calibration.json")]
pub(super) struct TrialsArgs {
    /// Directory to write into; created if it does not exist
    #[arg(value_name = "DIR")]
    directory: OutputLocation,

    /// Trials in each condition
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    per_condition: u64,

    #[command(flatten)]
    common: CommonArgs,
}

#[derive(Clone, Debug, clap::Args)]
struct CommonArgs {
    /// Strides per second
    #[arg(long, value_name = "HZ", default_value_t = 13.0)]
    stride_frequency: f64,

    #[command(flatten)]
    seeds: SeedArgs,
}

impl CommonArgs {
    fn settings(&self, condition: ChannelForces) -> TrialSettings {
        TrialSettings {
            unit_seed: self.seeds.unit_seed(),
            stride_hz: self.stride_frequency,
            ..TrialSettings::new(condition, self.seeds.seed())
        }
    }
}

impl SynthTrialArgs {
    pub(super) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let condition = self.condition;
        let trial = VirtualTrial::new(TrialSettings {
            missing: self.missing,
            ..self.common.settings(condition)
        })?;
        let layout = match (self.no_sensors, self.no_telemetry) {
            (true, _) => TrialLayout::WithoutSensors,
            (_, true) => TrialLayout::WithoutTelemetry,
            _ => TrialLayout::Full,
        };
        let truth = trial.truth();
        if let Some(path) = &self.truth {
            printer.files.write(path, &truth_json(&truth))?;
        }
        let mut out = printer.create_or_stdout(self.written.output.as_ref())?;
        let rows = write_log(&mut out, &trial, layout)?;
        out.commit()?;
        let Some(path) = &self.written.output else { return Ok(()) };
        let made = document! { file: path, rows: rows, truth: &truth };
        printer.finish(&made, |printer| {
            printer.line(format!(
                "{rows} synthetic rows in `{}`: {}, in the channel from {} s to {} s, {} strides",
                path.display(),
                condition.name,
                truth.t_enter_s,
                truth.t_exit_s,
                truth.strides.len()
            ))
        })
    }
}

impl TrialsArgs {
    pub(super) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let base = self.common.settings(ChannelForces::PAPER[0]);
        let count = self.per_condition * ChannelForces::PAPER.len() as u64;
        const BYTES: u64 = 1_000_000;
        let bar = printer.progress("making trials", count * BYTES);
        let trials = write_set(&printer.files, &self.directory, base, self.per_condition, |done| {
            bar.set_position(done * BYTES)
        });
        bar.finish_and_clear();
        let trials = trials?;
        let manifest = self.directory.join(MANIFEST).display().to_string();
        let rows: u64 = trials.iter().map(|trial| trial.rows).sum();
        let line = format!("{count} synthetic trials, {rows} rows; manifest `{manifest}`");
        let made = document! { manifest: manifest, trials: trials };
        printer.finish(&made, |printer| printer.line(line))
    }
}
