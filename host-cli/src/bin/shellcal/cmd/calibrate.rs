//! `shellcal calibrate`: a calibration in one sitting.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use ::report::{Certificate, Heading};
use anyhow::{Context, ensure};
use board_link::{RecordOptions, Sinks, Source};
use calibration::quality::significant;
use calibration_file::{CalibrationFile, Origin};
use live_view::{GuideView, LiveDisplay, LiveRow, LoadGuide};
use load_table::HungLoads;
use log_file::{Log, ReadOptions};
use output_file::{OutputError, Outputs};
use reference_sensor::ReferenceSource;
use shell_data::block::FrameLabel;
use shell_data::wrench::Axes;
use shellcal::workflow::certificate::{budget, intervals};
use shellcal::workflow::check::{CheckedWeights, check_weights};
use shellcal::workflow::fit::FittedLogs;
use shellcal::workflow::gates::Gate;
use shellcal::workflow::live::{Feed, LiveSession, LogSeries};
use shellcal::workflow::remark::Remark;
use shellcal::workflow::report;
use shellcal::workflow::sitting::{
    HeldLoad, Sitting, SittingStage, fit_sitting, held_loads, rest_readings,
};

use super::doctor::examine_board;
use super::fit::hung_loads::warning;
use super::live::{ServeArg, first_free, numbered, recording, show};
use super::mapping::MappingArgs;
use super::outputs;
use super::plan::{RigArgs, UntilArg, read_table};
use super::ports::{SourceArgs, is_port};
use super::quality::print_screen;
use super::record::ReferenceSensorArg;
use crate::files::{InputPath, OutputLocation, create_folder};
use crate::printer::{Outcome, Printer};
use crate::signals;
use crate::tables::counted;

const EXAMPLES: &str = "\
Examples:
  shellcal calibrate /dev/ttyUSB0 --start --rig loads.csv --until 0.1N -o shell-7
  shellcal calibrate /dev/ttyUSB0 --start --box fx=-5..5,fy=-5..5,fz=-8..0 --reference netft:192.168.1.1 -o shell-7
  shellcal calibrate shell-7/session.csv --rig loads.csv -o again

Keys: n goes on to another load, b takes back the last one, q ends; what is recorded is kept";

const LISTEN: Duration = Duration::from_secs(2);

#[derive(Debug, clap::Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct CalibrateArgs {
    /// Serial port; or the log of a sitting, whose loads are taken again one by one
    #[arg(value_name = "PORT|LOG")]
    name: InputPath,

    #[command(flatten)]
    rig: RigArgs,

    #[command(flatten)]
    until: UntilArg,

    #[command(flatten)]
    reference: ReferenceSensorArg,

    /// Folder for the log, the loads, the calibration, its report and its certificate. A sitting that was
    /// ended early goes on in its folder
    #[arg(long, short, value_name = "DIR")]
    output: OutputLocation,

    #[command(flatten)]
    served: ServeArg,

    #[command(flatten)]
    source: SourceArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

const LOADS: &str = "loads.csv";
const CHECK: &str = "check.csv";
const CALIBRATION: &str = "calibration.json";
const REPORT: &str = "report.html";
const CERTIFICATE: &str = "certificate.html";

struct SittingFolder(PathBuf);

impl SittingFolder {
    /// Creates the folder, unless it exists. Its files must not be inputs.
    fn create(path: &Path, printer: &Printer) -> anyhow::Result<Self> {
        create_folder(path)?;
        let folder = Self(path.to_path_buf());
        let files = [LOADS, CHECK, CALIBRATION, REPORT, CERTIFICATE];
        files.iter().try_for_each(|name| printer.files.announce(&folder.file(name)))?;
        Ok(folder)
    }

    fn write(&self, name: &str, text: &str) -> Result<(), OutputError> {
        Outputs::new().write(self.file(name), text.as_bytes())
    }

    fn file(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    fn logs(&self) -> Vec<PathBuf> {
        let first = self.file("session.csv");
        (1..).map(|number| numbered(&first, number)).take_while(|path| path.exists()).collect()
    }
}

/// A sitting whose table of loads is on disk after every load.
struct KeptSitting<'a> {
    sitting: Sitting,
    folder: &'a SittingFolder,
    failure: Option<OutputError>,
}

impl KeptSitting<'_> {
    fn keep(&mut self) {
        let kept = match self.sitting.table() {
            Some(table) => self.folder.write(LOADS, &table),
            None => {
                let path = self.folder.file(LOADS);
                match std::fs::remove_file(&path) {
                    Err(error) if error.kind() != ErrorKind::NotFound => {
                        Err(OutputError::failed(path, error))
                    }
                    _ => Ok(()),
                }
            }
        };
        self.failure = self.failure.take().or(kept.err());
    }
}

impl LoadGuide for KeptSitting<'_> {
    fn push(&mut self, row: &LiveRow) -> Option<FrameLabel> {
        let held = self.sitting.push(row)?;
        self.keep();
        Some(held)
    }

    fn first_unsettled(&self) -> Option<i64> {
        self.sitting.first_unsettled()
    }

    fn skip(&mut self) {
        self.sitting.skip();
    }

    fn back(&mut self) {
        self.sitting.back();
        self.keep();
    }

    fn view(&self) -> GuideView {
        self.sitting.view()
    }
}

impl CalibrateArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        self.source.serial.expect_board()?;
        let rig = self.rig.table()?;
        let limits = self.until.until.unwrap_or_default();
        let threads = self.mapping.threads.map_or(0, usize::from);
        let sitting = Sitting::new(rig.clone(), limits, threads);
        let folder = SittingFolder::create(&self.output, printer)?;
        let (sitting, logs) = if is_port(&self.name) {
            let sitting = self.resume(sitting, &folder, printer)?;
            let Some(sitting) = self.sit(sitting, &folder, printer)? else {
                return Ok(printer.decide(false));
            };
            (sitting, folder.logs())
        } else {
            ensure!(
                folder.logs().is_empty(),
                "`{}` has a sitting of its own: name another folder for that of a log",
                folder.0.display()
            );
            (self.replay(sitting, &rig, printer)?, vec![self.name.to_path_buf()])
        };
        self.finish(&sitting, &folder, &logs, printer)
    }

    fn open(&self, logs: &[PathBuf]) -> anyhow::Result<Vec<Log>> {
        let mapping = self.mapping.mapping();
        Ok(logs.iter().map(|path| Log::open(path, &mapping)).collect::<Result<_, _>>()?)
    }

    fn resume(
        &self,
        mut sitting: Sitting,
        folder: &SittingFolder,
        printer: &Printer,
    ) -> anyhow::Result<Sitting> {
        let (path, logs) = (folder.file(LOADS), folder.logs());
        if !path.exists() || logs.is_empty() {
            return Ok(sitting);
        }
        let table = read_table(&path.clone().into_os_string().into())?;
        let logs = self.open(&logs)?;
        let measured = self.is_measured(&logs);
        let lines = sitting.lines_of(&table, measured).map_err(|other| {
            let path = path.display();
            anyhow::anyhow!(
                "`{path}`: {other}; go on with the rig of that sitting, or name a new folder"
            )
        })?;
        for (line, held) in held_loads(&logs, &table, measured, &self.mapping.read_options())? {
            // A load that was good enough before may show a fault now that more is known.
            let _ = sitting.record(lines[line], &held);
        }
        let rest = rest_readings(&logs[0], &self.mapping.read_options())?;
        rest.into_iter().for_each(|rest| sitting.set_rest(rest));
        printer.note(format!("going on after {}", counted(sitting.used(), "load")));
        Ok(sitting)
    }

    fn is_measured(&self, logs: &[Log]) -> bool {
        logs.iter().all(Log::has_wrench)
    }

    /// Examines the board, then records loads until the sitting is over; `None` if the board has a fault.
    fn sit(
        &self,
        sitting: Sitting,
        folder: &SittingFolder,
        printer: &Printer,
    ) -> anyhow::Result<Option<Sitting>> {
        let port = self.name.to_str().context("the name of a port is text")?;
        let browser = self.served.open()?;
        let examined = examine_board(&self.source.serial, port, LISTEN, None, printer)?;
        if examined.has_fault() || printer.is_verbose() {
            examined.print(printer);
        }
        if examined.has_fault() {
            return Ok(None);
        }
        let stop = signals::stop_flag()?;
        let reference = self.reference.reference.as_ref().map(ReferenceSource::open).transpose()?;
        ensure!(
            reference.as_ref().is_none_or(|reference| reference.axes.are_all()),
            "a reference of all six axes is needed"
        );
        let feed = Feed::default();
        let path = folder.file("session.csv");
        let mut logs = LogSeries::new(Box::new(move |_| first_free(&path, 1)));
        let sinks = Sinks {
            log: Some(logs.begin()?),
            watcher: Some(Box::new(feed.clone())),
            reference,
            raw: None,
        };
        let options = RecordOptions { labels: true, duration: None, ..self.source.options()? };
        let source = Source::port(self.source.serial.port(port), true)?;
        let frames = recording(source, sinks, options, feed.clone());
        let display = LiveDisplay::new(None, 10.0, Axes::ALL);
        let kept = KeptSitting { sitting, folder, failure: None };
        let mut session =
            LiveSession::new(display, Some(kept), None, feed, Some(logs), port.to_owned());
        let is_over = |session: &LiveSession<KeptSitting<'_>>, elapsed: Duration| {
            let kept = session.guide.as_ref();
            let is_done = kept.is_none_or(|kept| {
                kept.failure.is_some() || kept.sitting.stage() == SittingStage::Over
            });
            let is_late = self.source.duration.is_some_and(|end| elapsed >= end);
            stop.load(Ordering::Relaxed) || is_done || is_late
        };
        let done = Arc::default();
        let ended = show(printer, &mut session, (frames, done), browser, &is_over)?;
        let kept = session.guide.take().context("the sitting has its guide to the end")?;
        kept.failure.map_or(Ok(()), Err)?;
        ended?;
        Ok(Some(kept.sitting))
    }

    fn replay(
        &self,
        mut sitting: Sitting,
        rig: &HungLoads,
        printer: &Printer,
    ) -> anyhow::Result<Sitting> {
        let logs = self.open(&[self.name.to_path_buf()])?;
        let read = self.mapping.read_options();
        let mut rows = Vec::new();
        for (line, held) in held_loads(&logs, rig, self.is_measured(&logs), &read)? {
            if sitting.stage() != SittingStage::Loads {
                break;
            }
            rows.push(take_again(&mut sitting, rig, (line, &held), printer));
        }
        if !printer.json() {
            printer.table(&["load", "", "error N", "95 %", "N·m", "95 %", "finding"], rows);
        }
        Ok(sitting)
    }

    fn finish(
        &self,
        sitting: &Sitting,
        folder: &SittingFolder,
        logs: &[PathBuf],
        printer: &Printer,
    ) -> anyhow::Result<Outcome> {
        let used = counted(sitting.used(), "load");
        let Some(table) = sitting.table().filter(|_| sitting.estimate().is_some()) else {
            printer.note(format!(
                "{used}: too few for a calibration; the same command goes on in `{}`",
                folder.0.display()
            ));
            return Ok(printer.decide(false));
        };
        folder.write(LOADS, &table)?;
        let (table, logs, read) = (parsed(&table)?, self.open(logs)?, self.mapping.read_options());
        let origin = Origin {
            made_by: shellcal::PROGRAM.to_owned(),
            date: outputs::date()?,
            columns: self.mapping.specified(&logs),
            ..Origin::default()
        };
        let (fitted, hung) = fit_sitting(&logs, &table, origin, &read)?;
        folder.write(CALIBRATION, &fitted.file.to_json())?;
        let report = fitted.report(CALIBRATION, &outputs::command_line())?;
        folder.write(REPORT, &report)?;
        let check = match sitting.check_table() {
            None => CheckedWeights { loads: Vec::new(), gate: Gate::default() },
            Some(table) => {
                folder.write(CHECK, &table)?;
                check_weights(&fitted.file, &logs, &parsed(&table)?, None, &read)?
            }
        };
        let calibration = folder.file(CALIBRATION);
        let certificate = certificate(&fitted.file, &calibration, &check, &read)?;
        folder.write(CERTIFICATE, &certificate)?;
        let outcome = printer.judge(&check.gate);
        self.print(sitting, &fitted, &check, printer)?;
        hung.suspicious().for_each(|(load, found)| printer.warning(warning(load, found)));
        for remark in fitted.remarks() {
            if let Remark::Warning(text) = remark {
                printer.warning(text);
            }
        }
        Ok(outcome)
    }

    fn print(
        &self,
        sitting: &Sitting,
        fitted: &FittedLogs,
        check: &CheckedWeights,
        printer: &Printer,
    ) -> anyhow::Result<()> {
        let limits = self.until.until.unwrap_or_default();
        let document = document! {
            folder: &self.output,
            loads: sitting.used(),
            errors: sitting.errors(),
            reached: self.until.until.map(|_| sitting.is_reached()),
            checked: &check.loads,
        };
        printer.finish(&document, |printer| {
            let screen = fitted.fit.verdict().screen(&self.output.display().to_string());
            print_screen(printer, &screen, &Gate::default());
            let used = counted(sitting.used(), "load");
            match check.loads.first() {
                None => printer.line(format!("{used}; no weight was hung as a check")),
                Some(of) if of.off.is_empty() => {
                    printer.line(format!("{used}; the check agrees ({})", of.load));
                }
                Some(of) => {
                    printer.line(format!("{used}; the check ({}) is off in {}", of.load, of.off));
                }
            }
            if limits != [None; 2] && !sitting.is_reached() && !sitting.finding().is_empty() {
                printer.line(sitting.finding());
            }
        })
    }
}

fn take_again(
    sitting: &mut Sitting,
    rig: &HungLoads,
    (line, held): (usize, &HeldLoad),
    printer: &Printer,
) -> Vec<String> {
    let load = &rig.loads()[line];
    let started = Instant::now();
    let recorded = sitting.record(line, held);
    let seconds = started.elapsed().as_secs_f64();
    printer.detail(format!("load `{}`: next after {seconds:.3} s", load.group));
    let mut row = vec![load.group.clone(), load.to_string()];
    let point = sitting.errors().last().filter(|_| recorded.is_ok());
    match point {
        Some(point) => {
            row.extend((0..2).flat_map(|at| {
                [point.error[at], point.upper[at]].map(|value| significant(value, 2))
            }))
        }
        None => row.extend(std::iter::repeat_n(String::new(), 4)),
    }
    row.push(sitting.finding().to_owned());
    row
}

fn parsed(table: &str) -> anyhow::Result<HungLoads> {
    HungLoads::parse(table).context("the table of the sitting")
}

fn certificate(
    file: &CalibrationFile,
    path: &Path,
    check: &CheckedWeights,
    read: &ReadOptions<'_>,
) -> anyhow::Result<String> {
    let own = report::input("calibration", path)
        .with_context(|| format!("cannot read `{}`", path.display()))?;
    let certificate = Certificate {
        heading: Heading {
            title: "Certificate of calibration",
            made_by: shellcal::PROGRAM,
            date: &outputs::date()?,
            command: &outputs::command_line(),
        },
        file,
        name: &path.display().to_string(),
        checksum: &own.checksum,
        budget: &budget(file, None, None, read)?,
        intervals: &intervals(file),
        weights: &check.loads,
        not_compared: &[],
    };
    Ok(certificate.html())
}
