//! `shellcal synth`: recordings generated from physics; `synth pair` generates one session on two clocks.

use std::io::Write;

use clap::Subcommand;
use simulation::sensor_model::{
    Pair, PairSettings, RecordingKind, RecordingSettings, SensorRecording,
};
use simulation::synthetic_log::{
    FRAME_HEADER, SyntheticLayout, WRENCH_HEADER, write_frame, write_wrench_row,
};

use super::choices::one_of;
use super::simulated_unit::{NoiseArgs, SeedArgs, WrittenArg};
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
    /// Number of rows (default: 77522 for train, 19932 for test, 5000 for zero)
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    rows: Option<u64>,

    /// Rows per second
    #[arg(long, value_name = "HZ", default_value_t = 100.0, allow_negative_numbers = true)]
    rate: f64,

    #[command(flatten)]
    seeds: SeedArgs,

    #[command(flatten)]
    noise: NoiseArgs,

    /// Springs without creep and hysteresis, which a calibration can follow exactly
    #[arg(long)]
    elastic: bool,

    /// Names and contents of the columns
    #[arg(long, value_parser = one_of(&LAYOUTS), default_value = "shellcal")]
    layout: SyntheticLayout,

    #[command(flatten)]
    written: WrittenArg,
}

const ADC_BITS: u32 = 12;

/// The reference of a pair starts this much earlier than the board and stops this much later, s.
const MARGIN_S: f64 = 5.0;

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
            // The sizes of the paper; for noise, less than a minute.
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
        check_rows(rows as f64)?;
        let recording = SensorRecording::new(RecordingSettings {
            kind,
            rate_hz: self.rate,
            start_time_s: 0.0,
            seed: self.seeds.seed(),
            unit_seed: self.seeds.unit_seed(),
            noise_scale: self.noise.scale(),
            adc_bits: ADC_BITS,
            elastic: self.elastic,
        })?;
        let mut out = printer.create_or_stdout(self.written.output.as_ref())?;
        let layout = self.layout;
        let progress = printer.count("making rows", rows);
        let mut text = layout.header(kind).into_bytes();
        let (mut bytes, mut rows_saturated) = (0, 0);
        for sample in recording.take(rows as usize) {
            layout.write_row(&mut text, kind, &sample)?;
            rows_saturated += u64::from(sample.frame.saturated != 0);
            out.write_all(&text)?;
            bytes += text.len();
            text.clear();
            progress.inc(1);
        }
        progress.finish_and_clear();
        out.commit()?;
        let Some(path) = &self.written.output else { return Ok(()) };
        let summary = document! {
            file: path,
            rows, bytes, rows_saturated,
            seed: self.seeds.seed(),
            unit_seed: self.seeds.unit_seed(),
        };
        printer.finish(&summary, |printer| {
            printer.note(format!("{rows} synthetic rows in `{}`", path.display()));
        })
    }
}

/// One session recorded on two clocks, with known offset and skew
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct PairArgs {
    /// The reference's recording: t_s,fx_n..mz_nm
    #[arg(value_name = "REFERENCE")]
    reference: OutputPath,

    /// The board's log: t_s,s1..s8
    #[arg(value_name = "LOG")]
    log: OutputPath,

    /// Reading of the reference's clock when the board's is 0
    #[arg(long, value_name = "S", default_value_t = 12.3456789, allow_negative_numbers = true)]
    offset: f64,

    /// Skew: how much faster the reference's clock runs
    #[arg(long, value_name = "PPM", default_value_t = 50.0, allow_negative_numbers = true)]
    skew: f64,

    /// Duration of the board's recording
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    duration: f64,

    /// Rows per second of the reference
    #[arg(long, value_name = "HZ", default_value_t = 10_000.0)]
    reference_rate: f64,

    /// Frames per second of the board
    #[arg(long, value_name = "HZ", default_value_t = 1000.0)]
    rate: f64,

    /// Share of the board's frames that are lost, from 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    loss: f64,

    /// Leave the shell unloaded
    #[arg(long)]
    no_load: bool,

    #[command(flatten)]
    seeds: SeedArgs,

    #[command(flatten)]
    noise: NoiseArgs,

    /// Write offset, skew and all other true values, as JSON
    #[arg(long, value_name = "FILE")]
    truth: Option<OutputPath>,
}

impl PairArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let settings = PairSettings {
            seed: self.seeds.seed(),
            unit_seed: self.seeds.unit_seed(),
            loaded: !self.no_load,
            duration_s: self.duration,
            margin_s: MARGIN_S,
            reference_rate_hz: self.reference_rate,
            board_rate_hz: self.rate,
            offset_s: self.offset,
            skew: 1e-6 * self.skew,
            loss: self.loss,
            noise_scale: self.noise.scale(),
        };
        let pair = Pair::new(settings)?;
        let board = self.duration * self.rate;
        check_rows(board.max((self.duration + 2.0 * MARGIN_S) * self.reference_rate))?;
        let (mut reference, mut log) =
            (printer.files.create(&self.reference)?, printer.files.create(&self.log)?);
        let (mut reference_rows, mut log_rows) = (0_u64, 0_u64);
        writeln!(reference, "{WRENCH_HEADER}")?;
        for (time_s, wrench) in pair.reference() {
            write_wrench_row(&mut reference, time_s, &wrench)?;
            reference_rows += 1;
        }
        writeln!(log, "{FRAME_HEADER}")?;
        for (time_s, frame) in pair.board() {
            write_frame(&mut log, time_s, &frame)?;
            log_rows += 1;
        }
        log.flush()?;
        reference.commit()?;
        log.commit()?;
        let truth = document! {
            // t_reference = t_log · (1 + skew) + offset_s.
            offset_s: self.offset,
            skew_ppm: self.skew,
            reference_rows, log_rows, settings,
        };
        if let Some(path) = &self.truth {
            let mut text = serde_json::to_vec_pretty(&truth)?;
            text.push(b'\n');
            printer.files.write(path, &text)?;
        }
        printer.finish(&truth, |printer| {
            printer.line(format!(
                "{reference_rows} synthetic rows in `{}`, {log_rows} in `{}`: offset {} s, \
                 skew {} ppm",
                self.reference.display(),
                self.log.display(),
                self.offset,
                self.skew
            ))
        })
    }
}

/// Maximum number of rows, some GB: a typing error must not fill the disk.
const MOST_ROWS: f64 = 1e7;

pub(super) fn check_rows(rows: f64) -> anyhow::Result<()> {
    anyhow::ensure!(
        rows <= MOST_ROWS,
        "{rows:e} rows were asked for, at most {MOST_ROWS:e} are made"
    );
    Ok(())
}
