//! `shellcal record`: a log from a port, or from bytes recorded before.

use board_link::recording::protocol_name;
use board_link::{
    AppendWriter, LogSink, RecordOptions, Recorded, RecordedBoard, RecordingProgress, Sinks,
    Source, record,
};
use frame_stream::StreamOptions;
use reference_sensor::ReferenceSource;
use shell_data::wrench::Axis;
use shellcal::workflow::live::clock;

use super::frames::{LiveForceArgs, warn_of_tare};
use super::outputs::ReplacingArgs;
use super::ports::SourceArgs;
use super::quality::by_unit;
use super::stream::{self, StreamToArgs, WaitingArgs};
use crate::files::{InputPath, OutputPath};
use crate::printer::Printer;
use crate::signals;

#[derive(Debug, clap::Args)]
pub(crate) struct RecordArgs {
    /// Serial port; `shellcal board` lists them
    #[arg(value_name = "PORT", required_unless_present = "replay")]
    port: Option<String>,

    /// Read bytes written by `--raw` instead of a port
    #[arg(long, value_name = "RAW", conflicts_with_all = ["port", "duration", "reconnect", "start"])]
    replay: Option<InputPath>,

    /// Log to write; if a base station hears several boards, the log of the first, and one for each other
    /// with the address in its name
    #[arg(long, short, value_name = "LOG", required_unless_present_any = ["raw", "stream"])]
    output: Option<OutputPath>,

    /// Write the bytes as they arrive, for `--replay`
    #[arg(long, value_name = "RAW")]
    raw: Option<OutputPath>,

    #[command(flatten)]
    replacing: ReplacingArgs,

    #[command(flatten)]
    forces: LiveForceArgs,

    #[command(flatten)]
    stream: StreamToArgs,

    /// Leave readings as they were sampled, the channels of a row one after the other within some ms, instead
    /// of interpolating them to one time
    #[arg(long)]
    as_sampled: bool,

    #[command(flatten)]
    reference: ReferenceSensorArg,

    #[command(flatten)]
    waiting: WaitingArgs,

    #[command(flatten)]
    source: SourceArgs,
}

/// The reference sensor of a recording.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct ReferenceSensorArg {
    /// Record a reference sensor in the same log, on the same clock: `netft:HOST[:PORT][,bias]` (ATI Net F/T and boxes
    /// like it), `ft300:PORT` (Robotiq), `lines:COMMAND` or `lines:tcp:HOST:PORT` (CSV or JSON lines of any program,
    /// units in the names)
    #[arg(long, value_name = "SOURCE", requires = "output")]
    pub(super) reference: Option<ReferenceSource>,
}

impl RecordArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        anyhow::ensure!(
            !self.forces.is_given() || self.output.is_some() || self.stream.is_given(),
            "`--calibration` is for a log or a stream: name `--output` or `--stream`"
        );
        anyhow::ensure!(
            self.reference.reference.is_none() || !self.forces.is_given() || self.stream.is_given(),
            "with `--reference` the log has the forces of the reference: `--calibration` is for a `--stream` beside it"
        );
        anyhow::ensure!(
            self.reference.reference.is_none() || self.replay.is_none(),
            "`--reference` records now, and `--replay` reads bytes from before"
        );
        let options = RecordOptions {
            forces: self.forces.read(printer)?,
            as_sampled: self.as_sampled,
            ..self.source.options()?
        };
        self.source.serial.expect_board()?;
        let stop = signals::stop_flag()?;
        let mut source = match (&self.port, &self.replay) {
            (Some(port), _) => Source::port(self.source.serial.port(port), self.waiting.reconnect)?,
            (None, Some(path)) => Source::replay(path)?,
            (None, None) => anyhow::bail!("neither a port nor a file to replay"),
        };
        let writer = |path: &OutputPath| {
            AppendWriter::create(path, self.replacing.overwrite)
                .map(|file| Box::new(file) as Box<dyn LogSink>)
        };
        let forces = options.forces.clone();
        let commands = self.stream.is_given().then(|| stream::commands(printer, None));
        let stream = StreamOptions {
            forces,
            one_time: !self.as_sampled,
            commands: commands.transpose()?,
            ..StreamOptions::default()
        };
        let (watcher, streamed) = self.stream.watch(printer, stream, None)?;
        // Wait for the reference's first sample, so that it precedes the first frame.
        let reference = self.reference.reference.as_ref().map(ReferenceSource::open).transpose()?;
        let options = match reference {
            Some(_) => RecordOptions { forces: None, ..options },
            None => options,
        };
        let sinks = Sinks {
            log: self.output.as_ref().map(writer).transpose()?,
            raw: self.raw.as_ref().map(writer).transpose()?,
            watcher,
            reference,
        };
        let status = printer.status();
        let mut show = |progress: &RecordingProgress| {
            // 80 columns if the terminal does not tell.
            let size = console::Term::stderr().size_checked();
            let width = size.map_or(80, |(_, columns)| usize::from(columns).max(1));
            status.set_message(describe(progress, width));
            status.tick();
        };
        let recorded = record(&mut source, sinks, &options, &stop, &mut show);
        status.finish_and_clear();
        // Finish the stream first, so that the log is reported even if the stream failed.
        let streamed = stream::finish(printer, streamed.as_ref());
        let recorded = recorded?;
        warn_of_tare(options.forces.as_ref(), printer);
        if recorded.boards.len() > 1 && self.forces.is_given() {
            printer.warning(
                "only the first board's log has forces: a calibration is for one sensor; convert the others",
            );
        }
        report(&recorded, printer)?;
        streamed.map(drop)
    }
}

fn describe(progress: &RecordingProgress, width: usize) -> String {
    let RecordingProgress { elapsed, rate_hz, frames, bytes, ref losses, .. } = *progress;
    let time = clock(elapsed);
    if !progress.connected {
        return format!("{time}  port is gone, waiting for it; {frames} frames so far");
    }
    match progress.protocol {
        None if bytes == 0 => {
            format!("{time}  nothing arrives; a board streams once it is started")
        }
        None => format!("{time}  {bytes} bytes, no frame so far"),
        Some(protocol) => {
            // In order of importance: the last parts are left out on a narrow terminal.
            let mut parts = Vec::from_iter(progress.wrench.as_deref().map(forces_in_words));
            parts.extend([time, format!("{rate_hz:.1} Hz"), losses.in_words()]);
            parts.extend([format!("{frames} frames"), protocol_name(protocol).to_owned()]);
            while parts.len() > 1 && parts.join("  ").chars().count() > width {
                parts.pop();
            }
            parts.join("  ")
        }
    }
}

fn forces_in_words(wrench: &[(Axis, f64)]) -> String {
    let text = |axis: Axis, value| {
        let decimals = if axis.is_moment() { 3 } else { 2 };
        format!("{} {value:.decimals$}", axis.name())
    };
    by_unit(wrench, text).collect::<Vec<_>>().join("  ")
}

fn report(recorded: &Recorded, printer: &Printer) -> anyhow::Result<()> {
    if recorded.losses.edges_left_out > 0 {
        printer.warning(format!(
            "{} sync edges are not in the log: a row has one, and there was none after them",
            recorded.losses.edges_left_out
        ));
    }
    if let Some(reference) = &recorded.reference {
        if let Some(problem) = &reference.problem {
            printer.warning(format!("the reference ended before the recording: {problem}"));
        }
        if reference.counts.untimed > reference.counts.samples {
            printer.warning(
                "the reference sends several samples at a time: have it flush each line (`python -u`), or send a time",
            );
        }
    }
    if recorded.other_content > 0 {
        printer.warning(format!(
            "{} frames are not in the log: the board changed between readings and wrenches",
            recorded.other_content
        ));
    }
    printer.finish(recorded, |printer| {
        let Recorded { frames, board_time_s, framing, losses, boards, .. } = recorded;
        let (framing, lost) = (framing.unwrap_or("no framing"), losses.in_words());
        printer.line(format!(
            "{frames} frames over {board_time_s:.3} s of the board's time ({framing}); {lost}"
        ));
        if let Some(reference) = &recorded.reference {
            printer.line(format!(
                "reference `{}`: {} samples, {}; {} rows without one; times agree to {:.1} ms",
                reference.source,
                reference.counts.samples,
                reference.counts.in_words(),
                reference.rows_without,
                reference.clock_error_s * 1e3,
            ));
        }
        for RecordedBoard { address, log, frames, losses } in boards {
            let at =
                log.as_ref().map_or_else(String::new, |log| format!(" in `{}`", log.display()));
            printer.line(format!("board {address}: {frames} frames{at}; {}", losses.in_words()));
        }
    })
}
