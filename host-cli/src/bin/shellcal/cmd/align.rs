//! `shellcal align`: alignment of a reference's recording and a board log into one training log.

use alignment::{Aligned, ClockMap, LeftOut, Options};
use anyhow::Context;
use figures::match_figure;
use log_file::{ColumnRef, FORMATS, Log, LogFormat, Mapping, TIME_UNITS, TimeUnit, parse_column};
use shellcal::workflow::align::{WrittenRows, align_logs, write_training};
use shellcal::workflow::remark::used_rows;
use shellcal::workflow::selection::RowFilter;

use super::choices::{number_in, one_of};
use super::frames::FrameArgs;
use super::mapping::MappingArgs;
use super::outputs::FigureArgs;
use crate::files::{InputPath, OutputPath};
use crate::printer::{Outcome, Printer};

#[derive(Debug, clap::Args)]
pub(crate) struct AlignArgs {
    /// Recording of the reference sensor: time and six wrench columns, plain or gzip
    #[arg(value_name = "REFERENCE")]
    reference: InputPath,

    /// Log of the board: time and readings, plain or gzip
    #[arg(value_name = "LOG")]
    log: InputPath,

    /// Write the training log to a file [default: standard output]
    #[arg(long, short, value_name = "FILE")]
    output: Option<OutputPath>,

    #[command(flatten)]
    figure: FigureArgs,

    /// Time that the board averages a frame over, in s; the reference is averaged likewise
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = number_in(0.0..=1.0, "expected a time from 0 to 1 s"))]
    averaging: f64,

    /// Column of the reference (name or position) with a signal whose edges the board also recorded, in
    /// `sync_s`; the clocks then follow from the edges
    #[arg(long, value_name = "COLUMN", value_parser = parse_column)]
    sync: Option<ColumnRef>,

    #[command(flatten)]
    frames: FrameArgs,

    /// Format of the reference file [default: detected]
    #[arg(long, value_name = "FORMAT", value_parser = one_of(&FORMATS), help_heading = "Reading the reference")]
    reference_format: Option<LogFormat>,

    /// Time column of the reference: name or position
    #[arg(long, value_name = "COLUMN", value_parser = parse_column, help_heading = "Reading the reference")]
    reference_time: Option<ColumnRef>,

    /// Unit of that column, overriding its name
    #[arg(long, value_name = "UNIT", value_parser = one_of(&TIME_UNITS), help_heading = "Reading the reference")]
    reference_time_unit: Option<TimeUnit>,

    #[command(flatten)]
    mapping: MappingArgs,
}

const NO_PICTURE: &str = "the clocks are by edges, and the loads do not match: leave out `--plot`";

/// Difference between the clocks by edges and by loads, s, above which a warning is due: averaging or
/// filtering on the board delays its loads, but not its edges.
const APART_S: f64 = 2e-3;

/// Share of the readings explained by a match, below which a warning is due.
const POOR: f64 = 0.9;

impl AlignArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        // Units of time and wrench apply to the reference, others to the board log.
        let all = self.mapping.mapping();
        let (of_time, of_wrench) = all.units.iter().cloned().partition(|(key, _)| key == "time");
        let reference = Mapping {
            format: self.reference_format,
            wrench: all.wrench.clone(),
            moment_unit: all.moment_unit,
            units: of_wrench,
            time: self.reference_time.clone(),
            time_unit: self.reference_time_unit,
            ..Mapping::default()
        };
        let reference = Log::open(&self.reference, &reference)?;
        let mapping =
            Mapping { wrench: None, moment_unit: None, group: None, units: of_time, ..all };
        let log = Log::open(&self.log, &mapping)?;
        let mut output = printer.create_or_stdout(self.output.as_ref())?;
        let plot = self.figure.create(printer)?;

        let rows = self.frames.rows(&log);
        let repeats_are_stale = rows == RowFilter::Fresh;
        let options = Options { exposure_s: self.averaging, repeats_are_stale, edges: None };
        let larger = if reference.bytes() > log.bytes() { &reference } else { &log };
        let logs = printer.scan(larger, self.mapping.read_options(), |read| {
            align_logs(&reference, &log, options, self.sync.as_ref(), &read)
        });
        let (aligned, [reference_read, log_read]) = match logs {
            Err(error) if error.is_refusal() => {
                printer.error(&error.into());
                return Ok(printer.decide(false));
            }
            logs => logs?,
        };

        let counts = [log_read.rows, log_read.repeated_rows, log_read.skipped_rows];
        printer.remarks([used_rows(&self.log, rows, counts)]);
        if reference_read.skipped_rows > 0 {
            let (path, skipped) = (self.reference.display(), reference_read.skipped_rows);
            printer.note(format!("{path}: {skipped} bad rows left out"));
        }
        note_left_out(printer, "reference", &aligned.reference_left_out);
        note_left_out(printer, "log", &aligned.board_left_out);
        let rows = write_training(&aligned, &mut output)?;
        if let Some(plot) = plot {
            let quality = aligned.quality.as_ref().context(NO_PICTURE)?;
            let ClockMap { offset_s, skew, pivot_s, .. } = aligned.clock;
            let name = self.log.file_name().unwrap_or_default().to_string_lossy();
            let skew_ppm = 1e6 * skew;
            let title =
                format!("{name}: offset {offset_s:.6} s at {pivot_s:.3} s, skew {skew_ppm:.2} ppm");
            plot.draw(|size| match_figure(size, &title, quality))?;
        }
        output.commit()?;
        self.report(printer, &aligned, rows)?;
        Ok(Outcome::Done)
    }

    fn report(&self, printer: &Printer, found: &Aligned, rows: WrittenRows) -> anyhow::Result<()> {
        let (clock, quality) = (&found.clock, found.quality.as_ref());
        if rows.uncovered > 0 {
            printer.note(format!(
                "{} rows left out: the reference has no undisturbed value at their time",
                rows.uncovered
            ));
        }
        if let Some(quality) = quality.filter(|quality| quality.explained < POOR) {
            printer.warning(format!(
                "the aligned reference explains only {:.0} % of the readings; is something else \
                 moving the shell?",
                100.0 * quality.explained
            ));
        }
        self.report_edges(printer, found);
        if printer.json() {
            return printer.document(&document! {
                reference: &self.reference,
                log: &self.log,
                output: &self.output,
                // t_reference = t_log + offset_s + skew · (t_log − pivot_s).
                clock, rows,
                skew_ppm: 1e6 * clock.skew,
                // Edges of a sync signal, if the clock is based on them.
                edges?: found.edges.as_ref(),
                // Absent if the loads do not match and the clock is based on edges.
                ..loads: quality.map(|quality| document! {
                    quality.{explained, explained_elsewhere, spring_delay_s, search_explained},
                    residual_counts: &quality.residual_counts,
                    white_offset_se_s: quality.white_se[0],
                    white_skew_se: quality.white_se[1],
                    search_second_best: quality.search_ratio,
                }),
                reference_left_out: found.reference_left_out,
                log_left_out: found.board_left_out,
            });
        }
        let offset = format!("offset at {:.3} s (ms)", clock.pivot_s);
        let table = [
            (offset, 1e3 * clock.offset_s, 1e3 * clock.offset_se_s, 4),
            ("skew (ppm)".to_owned(), 1e6 * clock.skew, 1e6 * clock.skew_se, 3),
        ];
        let table = table.map(|(name, value, error, decimals)| {
            vec![name, format!("{value:.decimals$}"), format!("{error:.decimals$}")]
        });
        let explained = match quality {
            Some(quality) => format!(
                "{} rows; the aligned reference explains {:.2} % of the readings; the second-best \
                 offset scores {:.0} % of the best",
                rows.written,
                100.0 * quality.explained,
                100.0 * quality.search_ratio
            ),
            None => format!("{} rows; the loads do not match by themselves", rows.written),
        };
        if self.output.is_none() {
            // Standard output has the rows, so print to stderr.
            for row in table {
                printer.note(format!("{}: {} ± {}", row[0], row[1], row[2]));
            }
            printer.note(explained);
            return Ok(());
        }
        printer.table(&["reference minus log", "estimate", "standard error"], table);
        printer.line(explained);
        Ok(())
    }

    fn report_edges(&self, printer: &Printer, aligned: &Aligned) {
        let Some(column) = &self.sync else { return };
        let Some(edges) = &aligned.edges else {
            printer.warning(format!(
                "`{column}` and `sync_s` have no edges for both recordings: the clocks are by the loads"
            ));
            return;
        };
        let told = if edges.told_by_loads { "; the loads tell which is which" } else { "" };
        printer.note(format!(
            "the clocks are by {} edges, of {} of the reference and {} of the board, which are off by {:.1} µs (RMS){told}",
            edges.matched,
            edges.reference,
            edges.board,
            1e6 * edges.residual_s
        ));
        let Some(loads) = edges.by_loads else {
            printer.note("the loads by themselves do not say how the clocks stand");
            return;
        };
        let apart_s = loads.offset_at_s(aligned.clock.pivot_s) - aligned.clock.offset_s;
        let error_s = loads.offset_se_at_s(aligned.clock.pivot_s);
        let said = format!(
            "by the loads alone the offset is {:+.3} ms from that (standard error {:.3} ms)",
            1e3 * apart_s,
            1e3 * error_s
        );
        match apart_s.abs() > APART_S.max(5.0 * error_s) {
            true => printer.warning(said),
            false => printer.note(said),
        }
    }
}

fn note_left_out(printer: &Printer, what: &str, left_out: &LeftOut) {
    let LeftOut { not_finite, not_later, repeated, saturated } = *left_out;
    for (count, why) in [
        (not_finite, "left out, not finite"),
        (not_later, "left out, not later than the row before"),
        (repeated, "left out, duplicates of the previous row"),
        (saturated, "not matched, at the end of the range"),
    ] {
        if count > 0 {
            printer.note(format!("{what}: rows {why}: {count}"));
        }
    }
}
