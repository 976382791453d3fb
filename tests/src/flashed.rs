//! The flashed image on its microcontroller's model: a Python program (`firmware/emulation`) that
//! executes orders, one JSON object per line, and reports after each the bytes sent and the board's
//! state, always the same.
#![expect(clippy::unwrap_used, reason = "a test may panic and say why")]

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{ChildStdin, ChildStdout, Command, Stdio};

use serde_json::{Value, json};
use shared_proto::CHANNELS;

use crate::program::Running;

/// Dark and lit code of every channel.
pub type PlayedFrame = [(u16, u16); CHANNELS];

pub const IMAGE: &str = "SHELLCAL_FLASHED_IMAGE";

pub const PYTHON: &str = "SHELLCAL_MODEL_PYTHON";

pub const SERIAL: [u8; 12] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];

#[derive(Clone, Debug)]
pub struct Model {
    /// Name of the board in the model.
    pub board: &'static str,
    pub image: PathBuf,
    pub python: PathBuf,
}

impl Model {
    /// Returns the model that `cargo xtask test` has set up, or panics.
    pub fn find() -> Self {
        let path = |name: &str| std::env::var_os(name).map(PathBuf::from).unwrap();
        Self { board: "skinproc", image: path(IMAGE), python: path(PYTHON) }
    }

    /// Returns the Nucleo-G491RE's model, whose image is in the same folder.
    pub fn find_nucleo() -> Self {
        let Self { image, python, .. } = Self::find();
        let board = "nucleo-g491re";
        Self { board, image: image.with_file_name(board), python }
    }

    /// Returns the command without the serial line's destination. A file in `dir` holds the codes.
    pub fn command(&self, played: &[PlayedFrame], dir: &Path) -> Command {
        let mut command = Command::new(&self.python);
        let program = Path::new(env!("CARGO_MANIFEST_DIR")).join("../firmware/emulation");
        command.current_dir(program).args(["-B", "-m", "stm32", "--board", self.board]);
        command.arg(&self.image);
        if !played.is_empty() {
            let codes = played.iter().flatten().flat_map(|(dark, lit)| [dark, lit]);
            let bytes: Vec<u8> = codes.flat_map(|code| code.to_le_bytes()).collect();
            let file = dir.join("script.bin");
            std::fs::write(&file, bytes).unwrap();
            command.args([OsString::from("--script"), file.into_os_string()]);
        }
        command
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct Report {
    pub sent: Vec<u8>,
    pub on: bool,
    /// Causes of resets since the last report.
    pub resets: Vec<String>,
    /// Sectors erased and double words written in all.
    pub operations: u64,
    pub instructions: u64,
    /// Greatest depth of the stack so far, bytes.
    pub stack: u32,
    /// Simulated time since the board was created.
    pub time_s: f64,
    pub pulls: [String; 3],
    /// Simulated time at which the board's clock was 0.
    pub clock_zero_s: f64,
    pub rate: f64,
    pub rom: Option<Rom>,
}

/// State in which the bootloader in ROM was entered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rom {
    pub stack_pointer: u32,
    pub vectors: u32,
    pub interrupts_on: u32,
    /// Registers that differ from their reset state, by address.
    pub changed: BTreeMap<String, u32>,
}

impl Rom {
    fn read(report: &Value) -> Self {
        let number = |value: &Value| value.as_u64().unwrap() as u32;
        let changed = report["changed"].as_object().unwrap().iter();
        Self {
            stack_pointer: number(&report["stack_pointer"]),
            vectors: number(&report["vectors"]),
            interrupts_on: number(&report["interrupts_on"]),
            changed: changed.map(|(address, value)| (address.clone(), number(value))).collect(),
        }
    }
}

pub const ROM_STACK: u32 = 0x2000_2F40;

#[derive(Debug)]
pub struct FlashedBoard {
    _process: Running,
    orders: ChildStdin,
    reports: BufReader<ChildStdout>,
}

impl FlashedBoard {
    pub fn start(model: &Model, played: &[PlayedFrame], dir: &Path) -> Self {
        let mut command = model.command(played, dir);
        let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let orders = child.stdin.take().unwrap();
        let reports = BufReader::new(child.stdout.take().unwrap());
        Self { _process: Running(child), orders, reports }
    }

    fn order(&mut self, order: &Value) -> Report {
        writeln!(self.orders, "{order}").unwrap();
        let mut line = String::new();
        self.reports.read_line(&mut line).unwrap();
        let report: Value = serde_json::from_str(&line)
            .unwrap_or_else(|_| panic!("the model has no report to {order}"));
        let hex = report["sent"].as_str().unwrap().as_bytes();
        let byte = |pair: &[u8]| u8::from_str_radix(str::from_utf8(pair).unwrap(), 16).unwrap();
        let text = |value: &Value| value.as_str().unwrap().to_owned();
        Report {
            sent: hex.chunks(2).map(byte).collect(),
            on: report["on"].as_bool().unwrap(),
            resets: report["resets"].as_array().unwrap().iter().map(text).collect(),
            operations: report["operations"].as_u64().unwrap(),
            instructions: report["instructions"].as_u64().unwrap(),
            stack: report["stack"].as_u64().unwrap() as u32,
            time_s: report["time_s"].as_f64().unwrap(),
            pulls: ["PA10", "PA11", "PA15"].map(|pin| text(&report["pulls"][pin])),
            clock_zero_s: report["clock_zero_s"].as_f64().unwrap(),
            rate: report["rate"].as_f64().unwrap(),
            rom: report["rom"].as_object().map(|_| Rom::read(&report["rom"])),
        }
    }

    pub fn run(&mut self, time_s: f64) -> Report {
        self.order(&json!({ "run": time_s }))
    }

    pub fn send(&mut self, bytes: &[u8]) {
        let hex: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        self.order(&json!({ "send": hex }));
    }

    /// Sets the level: `low` lets the board send, `high` blocks it, `open` means that no wire is connected.
    pub fn set_cts(&mut self, level: &str) {
        self.order(&json!({ "cts": level }));
    }

    /// Schedules rising edges after these times, s.
    pub fn drive_edges(&mut self, delays_s: &[f64]) -> Report {
        self.order(&json!({ "edges": delays_s }))
    }

    /// Sets the rate of the line's other end only, baud.
    pub fn set_rate(&mut self, baud: f64) {
        self.order(&json!({ "rate": baud }));
    }

    /// Makes the light flicker with an amplitude in converter steps.
    pub fn set_flicker(&mut self, steps: f64, hz: f64) {
        self.order(&json!({ "flicker": [steps, hz] }));
    }

    /// Sets the stack pointer, as deeply nested calls would.
    pub fn set_stack(&mut self, address: u32) {
        self.order(&json!({ "stack": address }));
    }

    /// Makes conversions never end, from now on.
    pub fn kill_converter(&mut self) {
        self.order(&json!({ "converter": false }));
    }

    /// Cuts the power at a flash operation: `nothing`, `some bits`, `unreadable` or `complete`.
    pub fn cut_power(&mut self, operation: u64, outcome: &str) {
        self.order(&json!({ "cut": [operation, outcome] }));
    }

    pub fn restore_power(&mut self) {
        self.order(&json!({ "power": true }));
    }

    /// Opens a branch, which [`Self::leave_branch`] undoes.
    pub fn open_branch(&mut self) {
        self.order(&json!({ "branch": true }));
    }

    pub fn leave_branch(&mut self) {
        self.order(&json!({ "leave": true }));
    }

    /// Continues at an address, as after a damaged return address.
    pub fn jump(&mut self, address: u32) {
        self.order(&json!({ "jump": address }));
    }
}
