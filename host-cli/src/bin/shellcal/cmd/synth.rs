//! `shellcal synth`: recordings made from physics.

use std::io::Write;

use clap::Subcommand;
use simulation::sensor_model::{RecordingKind, RecordingSettings, SensorRecording};
use simulation::synthetic_log::SyntheticLayout;

use super::choices::one_of;
use super::limits::RowLimit;
use super::partial_output::OpenOutput;
use super::synth_pair::PairArgs;
use super::synth_trial::{SynthTrialArgs, TrialsArgs};
use crate::files::OutputPath;
use crate::printer::Printer;

#[derive(Debug, clap::Args)]
pub(crate) struct SynthArgs {
    #[command(subcommand)]
    kind: KindArgs,
}

#[derive(Debug, Subcommand)]
enum KindArgs {
    /// Hand-like loads on every axis, to calibrate on
    Train(RecordingArgs),
    /// Other loads on the same unit, to test a calibration on
    Test(RecordingArgs),
    /// No load: noise and drift
    Zero(RecordingArgs),
    Pair(PairArgs),
    Trial(Box<SynthTrialArgs>),
    Trials(TrialsArgs),
}

#[derive(Clone, Debug, clap::Args)]
struct RecordingArgs {
    /// Rows to make (default: 77522 for train, 19932 for test, 5000 for zero)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    rows: Option<u64>,

    /// Rows per second
    #[arg(long, value_name = "HZ", default_value_t = 100.0, allow_negative_numbers = true)]
    rate: f64,

    /// Which recording: its loads, noise, light and mounting
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    /// Which unit: its springs, reflectors and gains
    #[arg(long, value_name = "N", default_value_t = 1)]
    unit_seed: u64,

    /// Time of the first row
    #[arg(long, value_name = "S", default_value_t = 0.0, allow_negative_numbers = true)]
    start_time: f64,

    /// Factor on all random noise; 0 for none
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0, allow_negative_numbers = true)]
    noise_scale: f64,

    /// Resolution of the board's converter, 8 to 16
    #[arg(long, value_name = "BITS", default_value_t = 12)]
    adc_bits: u32,

    /// Springs without creep and hysteresis: a calibration can follow them exactly
    #[arg(long)]
    elastic: bool,

    #[command(flatten)]
    limit: RowLimit,

    /// Columns and their names
    #[arg(long, value_parser = one_of(&LAYOUTS), default_value = "shellcal")]
    layout: SyntheticLayout,

    /// File to write (default: standard output)
    #[arg(long, short, value_name = "FILE")]
    output: Option<OutputPath>,
}

/// Layouts of recordings.
const LAYOUTS: [(&str, &str, SyntheticLayout); 3] = [
    (
        "shellcal",
        "t_s,s1..s8,fx_n..mz_nm,group (the pose; not in zero-load recordings)",
        SyntheticLayout::Shellcal,
    ),
    ("peer", "Timestamp,Fx..Mz,s0..s7", SyntheticLayout::Peer),
    ("training", "No header; time, eight readings, six wrench columns", SyntheticLayout::Training),
];

impl SynthArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        match &self.kind {
            // The paper's sizes; for noise, less than a minute.
            KindArgs::Train(args) => args.run(RecordingKind::Training, 77_522, printer),
            KindArgs::Test(args) => args.run(RecordingKind::Test, 19_932, printer),
            KindArgs::Pair(args) => args.run(printer),
            KindArgs::Trial(args) => args.run(printer),
            KindArgs::Trials(args) => args.run(printer),
            KindArgs::Zero(args) => args.run(RecordingKind::Zero, 5_000, printer),
        }
    }
}

impl RecordingArgs {
    fn run(&self, kind: RecordingKind, default_rows: u64, printer: &Printer) -> anyhow::Result<()> {
        let rows = self.rows.unwrap_or(default_rows);
        self.limit.check(rows as f64)?;
        let recording = SensorRecording::new(RecordingSettings {
            kind,
            rate_hz: self.rate,
            start_time_s: self.start_time,
            seed: self.seed,
            unit_seed: self.unit_seed,
            noise_scale: self.noise_scale,
            adc_bits: self.adc_bits,
            elastic: self.elastic,
        })?;
        let mut out = OpenOutput::for_rows(self.output.as_ref(), printer)?;
        /// Rows between two looks at the progress bar, and bytes in such a stretch, about.
        const STRETCH: u64 = 1024;
        const ROW_BYTES: u64 = 100;
        let layout = self.layout;
        let progress = printer.progress("making rows", rows.saturating_mul(ROW_BYTES));
        let mut text = layout.header(kind).as_bytes().to_vec();
        let (mut bytes, mut rows_saturated) = (0, 0);
        for (row, sample) in (1..=rows).zip(recording) {
            layout.write_row(&mut text, kind, &sample)?;
            rows_saturated += u64::from(sample.frame.saturated != 0);
            if row % STRETCH == 0 {
                out.write_all(&text)?;
                bytes += text.len() as u64;
                text.clear();
                progress.inc(STRETCH * ROW_BYTES);
            }
        }
        out.write_all(&text)?;
        bytes += text.len() as u64;
        progress.finish_and_clear();
        out.finish()?;
        let Some(path) = &self.output else { return Ok(()) };
        let summary = document! {
            file: path,
            rows: rows,
            bytes: bytes,
            rows_saturated: rows_saturated,
            seed: self.seed,
            unit_seed: self.unit_seed,
        };
        printer.finish(&summary, |printer| {
            printer.note(format!("{rows} synthetic rows in `{}`", path.display()));
            Ok(())
        })
    }
}
