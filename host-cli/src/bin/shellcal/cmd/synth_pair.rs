//! `shellcal synth pair`: one session on two clocks.

use std::io::Write;

use simulation::sensor_model::{Pair, PairSettings};
use simulation::synthetic_log::{FRAME_HEADER, WRENCH_HEADER, write_frame, write_wrench_row};

use super::limits::RowLimit;
use crate::files::OutputPath;
use crate::printer::Printer;

/// One session recorded on two clocks, with known offset and skew
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct PairArgs {
    /// The reference's recording: t_s,fx_n..mz_nm
    #[arg(value_name = "REFERENCE")]
    reference: OutputPath,

    /// The board's log: t_s,s1..s8
    #[arg(value_name = "LOG")]
    log: OutputPath,

    /// What the reference's clock shows when the board's shows 0
    #[arg(long, value_name = "S", default_value_t = 12.3456789, allow_negative_numbers = true)]
    offset: f64,

    /// How much faster the reference's clock runs
    #[arg(long, value_name = "PPM", default_value_t = 50.0, allow_negative_numbers = true)]
    skew: f64,

    /// How long the board records
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    duration: f64,

    /// The reference starts as much earlier and stops as much later
    #[arg(long, value_name = "S", default_value_t = 5.0, allow_negative_numbers = true)]
    margin: f64,

    /// Rows per second of the reference
    #[arg(long, value_name = "HZ", default_value_t = 10_000.0)]
    reference_rate: f64,

    /// Frames per second of the board
    #[arg(long, value_name = "HZ", default_value_t = 1000.0)]
    rate: f64,

    /// Share of the board's frames that get lost, from 0 to 1
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    loss: f64,

    /// Nothing touches the shell
    #[arg(long)]
    no_load: bool,

    /// Which session: its loads, noise, light and mounting
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,

    /// Which unit: its springs, reflectors and gains
    #[arg(long, value_name = "N", default_value_t = 1)]
    unit_seed: u64,

    /// Factor on all random noise; 0 for none
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    noise_scale: f64,

    #[command(flatten)]
    limit: RowLimit,

    /// Write offset, skew and all else that is known, as JSON
    #[arg(long, value_name = "FILE")]
    truth: Option<OutputPath>,
}

impl PairArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let settings = PairSettings {
            seed: self.seed,
            unit_seed: self.unit_seed,
            loaded: !self.no_load,
            duration_s: self.duration,
            margin_s: self.margin,
            reference_rate_hz: self.reference_rate,
            board_rate_hz: self.rate,
            offset_s: self.offset,
            skew: 1e-6 * self.skew,
            loss: self.loss,
            noise_scale: self.noise_scale,
        };
        let pair = Pair::new(settings)?;
        let board = self.duration * self.rate;
        self.limit.check(board.max((self.duration + 2.0 * self.margin) * self.reference_rate))?;
        let (mut reference, mut log) =
            (printer.files.create(&self.reference)?, printer.files.create(&self.log)?);
        let (mut reference_rows, mut log_rows) = (0_u64, 0_u64);
        writeln!(reference, "{WRENCH_HEADER}")?;
        for (time_s, wrench) in pair.reference() {
            write_wrench_row(&mut reference, time_s, &wrench)?;
            reference_rows += 1;
        }
        writeln!(log, "{FRAME_HEADER}")?;
        for (time_s, frame) in pair.board()? {
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
            reference_rows: reference_rows,
            log_rows: log_rows,
            settings: settings,
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
