//! `shellcal doctor`: faults and their remedies.

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, ensure};
use board_link::{HandshakeOptions, PortInfo, PortOptions, PortState, Uplink, handshake, ports};
use calibration_file::CalibrationFile;
use console::Color;
use doctor::{
    BoardObservations, Finding, FindingSeverity, check_board, check_port, examine_calibration,
    examine_log,
};
use log_file::Log;
use serde::Serialize;
use shared_proto::{Framing, Protocol};
use table_file::seconds_of_iso;

use super::mapping::{CompanionArgs, EditedArg, MappingArgs};
use super::outputs;
use super::ports::{SerialArgs, first_number, is_port, parse_duration};
use crate::files::InputPath;
use crate::printer::{Outcome, Printer};
use crate::signals;
use crate::tables::counted;

#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  shellcal doctor
  shellcal doctor /dev/ttyUSB0 --calibration calibration.json
  shellcal doctor calibration.json run3.csv --calibration calibration.json")]
pub(crate) struct DoctorArgs {
    /// Ports, logs and calibrations to examine
    #[arg(value_name = "PORT|LOG|CAL")]
    names: Vec<InputPath>,

    /// Calibration that boards and logs should match
    #[arg(long, value_name = "CAL")]
    calibration: Option<InputPath>,

    #[command(flatten)]
    edited: EditedArg,

    #[command(flatten)]
    companions: CompanionArgs,

    /// Duration of listening to a board's stream
    #[arg(long, value_name = "S", default_value = "2", value_parser = parse_duration)]
    listen: Duration,

    #[command(flatten)]
    serial: SerialArgs,

    #[command(flatten)]
    mapping: MappingArgs,
}

#[derive(Debug, Serialize)]
pub(super) struct Examination {
    name: String,
    kind: &'static str,
    findings: Vec<Finding>,
}

impl DoctorArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        let calibration =
            self.calibration.as_ref().map(|path| self.edited.read(path)).transpose()?;
        let (mut examined, mut wrenches) = (Vec::new(), self.companions.wrench_from.iter());
        for path in &self.names {
            let name = path.display().to_string();
            examined.push(if is_port(path) {
                let port = path.to_str().context("the name of a port is text")?;
                examine_board(&self.serial, port, self.listen, calibration.as_ref(), printer)?
            } else if is_document(path)? {
                Examination { name, kind: "calibration", findings: examine_calibration(path, &age) }
            } else {
                let (mapping, read) = (self.mapping.mapping(), self.mapping.read_options());
                let log = match wrenches.next() {
                    Some(wrench) => Log::open_with_companion(path, wrench, &mapping),
                    None => Log::open(path, &mapping),
                };
                let findings = examine_log(log, &read, calibration.as_ref());
                Examination { name, kind: "log", findings }
            });
        }
        ensure!(wrenches.next().is_none(), "`--wrench-from` names more files than there are logs");
        if self.names.is_empty() {
            examined = self.examine_ports()?;
        }
        let count = |severity| {
            let all = examined.iter().flat_map(|one| &one.findings);
            all.filter(|finding| finding.severity == severity).count()
        };
        let (faults, warnings) = (count(FindingSeverity::Fault), count(FindingSeverity::Warning));
        let is_sound = faults + warnings == 0;
        let outcome = printer.decide(faults == 0);
        let report =
            document! { sound: is_sound, faults: faults, warnings: warnings, examined: &examined };
        printer.finish(&report, |printer| {
            examined.iter().for_each(|one| one.print(printer));
            printer.line(match is_sound {
                true => "no problems found".to_owned(),
                false => {
                    format!("{}, {}", counted(faults, "fault"), counted(warnings, "warning"))
                }
            })
        })?;
        Ok(outcome)
    }

    /// Opens the ports of this computer, but does not query them.
    fn examine_ports(&self) -> anyhow::Result<Vec<Examination>> {
        let found = ports()?;
        if found.is_empty() {
            let advice = "plug the adapter in; `shellcal board --simulate` is a board without one";
            let finding = Finding::fault("no-port", "this computer has no serial port", advice);
            let name = "ports".to_owned();
            return Ok(vec![Examination { name, kind: "port", findings: vec![finding] }]);
        }
        let examine = |port: &PortInfo| examine_port(&self.serial, &port.port, |_| Ok(Vec::new()));
        found.iter().map(examine).collect()
    }
}

fn examine_port(
    serial: &SerialArgs,
    port: &str,
    ask: impl FnOnce(PortOptions) -> anyhow::Result<Vec<Finding>>,
) -> anyhow::Result<Examination> {
    let options = serial.port(port);
    let state = PortState::new(&options, Path::new("/"));
    let mut findings = check_port(&state);
    if state.refusal.is_none() {
        findings.extend(ask(options)?);
    }
    Ok(Examination { name: port.to_owned(), kind: "port", findings })
}

pub(super) fn examine_board(
    serial: &SerialArgs,
    port: &str,
    listen: Duration,
    calibration: Option<&CalibrationFile>,
    printer: &Printer,
) -> anyhow::Result<Examination> {
    examine_port(serial, port, |options| {
        let seconds = listen.as_secs_f64();
        printer.note(format!("asking `{port}`, then listening for {seconds} s"));
        ask_board(serial, options, listen, calibration)
    })
}

fn ask_board(
    serial: &SerialArgs,
    port: PortOptions,
    listen: Duration,
    calibration: Option<&CalibrationFile>,
) -> anyhow::Result<Vec<Finding>> {
    let stop = signals::stop_flag()?;
    let protocol = serial.framing.unwrap_or(Protocol::Packets(Framing::Cobs));
    let baud = port.baud;
    let options = HandshakeOptions {
        port,
        uplink: Uplink {
            framing: protocol.framing().unwrap_or(Framing::Cobs),
            to: serial.address(),
        },
        listen,
        number: first_number(),
    };
    let handshake = handshake(&options, &stop)?;
    let label = calibration.and_then(|file| file.origin.sensor_serial.as_deref());
    Ok(check_board(&BoardObservations {
        handshake: &handshake,
        baud,
        protocol,
        calibration: calibration.map(|file| (&file.calibration, label)),
        firmware: firmware::VERSION,
    }))
}

impl Examination {
    /// True if a finding makes results wrong or impossible.
    pub(super) fn has_fault(&self) -> bool {
        self.findings.iter().any(|finding| finding.severity == FindingSeverity::Fault)
    }

    pub(super) fn print(&self, printer: &Printer) {
        printer.line(&self.name);
        for finding in &self.findings {
            let (mark, color) = match finding.severity {
                FindingSeverity::Fine => ("ok", Color::Green),
                FindingSeverity::Warning => ("warning", Color::Yellow),
                FindingSeverity::Fault => ("FAULT", Color::Red),
            };
            let seen = format!("{}: {}", finding.check, finding.seen);
            printer.tinted(&format!("  {mark:7}  "), Some(color), &seen);
            if let Some(advice) = &finding.advice {
                printer.line(format!("  {:7}  → {advice}", ""));
            }
        }
    }
}

/// True if a file is a JSON document, as calibrations are.
fn is_document(path: &Path) -> anyhow::Result<bool> {
    let cannot = || format!("cannot read `{}`", path.display());
    // Check before opening: opening a pipe waits for its writer.
    let kind = std::fs::metadata(path).with_context(cannot)?.file_type();
    ensure!(kind.is_file() || kind.is_dir(), "{}: it is not a regular file", cannot());
    let mut head = Vec::new();
    let file = File::open(path).with_context(cannot)?;
    file.take(256).read_to_end(&mut head).with_context(cannot)?;
    let head = head.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(&head);
    Ok(head.iter().find(|byte| !byte.is_ascii_whitespace()) == Some(&b'{'))
}

/// The age of a date in days; `None` if it is not a date.
fn age(date: &str) -> Option<f64> {
    let now = seconds_of_iso(&outputs::date().ok()?)?;
    Some((now - seconds_of_iso(date)?) / 86_400.0)
}
