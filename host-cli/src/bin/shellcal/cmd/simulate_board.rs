//! `shellcal board --simulate`: a simulated board until Ctrl-C.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::Context;
use log_file::{Log, LogError, Mapping, ReadOptions, Wanted};
use serde_json::json;
use shared_proto::{Framing, Protocol};
use shell_data::lock::lock;
use shell_data::wrench::{Axes, PerAxis};
use simulation::radio::{Books, Faults};
use simulation::sensor_model::LoadTable;
use simulation::simulated_board::{BaseStation, BoardSettings, Load, SimulatedBoard};

use super::choices::{number_in, numbers};
use super::ports::SerialArgs;
use super::simulated_unit::{NoiseArgs, SeedArgs};
use super::stream::{EndingArgs, each_line};
use crate::files::{InputPath, OutputLocation, is_standard};
use crate::printer::Printer;
use crate::signals;

/// A simulated board
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Simulated board")]
pub(crate) struct SimulationArgs {
    /// Load over time, interpolated linearly between rows and repeated: a log with time and wrench; or `-`: a
    /// line on the standard input, FX,FY,FZ,MX,MY,MZ in N and N·m, is the load until the next [default: 5 s
    /// of rest, then hands]
    #[arg(long, conflicts_with = "port", value_name = "LOG|-")]
    load: Option<InputPath>,

    #[command(flatten)]
    seeds: SeedArgs,

    #[command(flatten)]
    noise: NoiseArgs,

    /// Times after the start at which the sync input rises, s: 2,30.5
    #[arg(long, conflicts_with = "port", value_name = "S,…", value_delimiter = ',', value_parser = number_in(0.0..=1e9, "a time in s after the board's start"))]
    sync: Vec<f64>,

    /// Faults of the radio: shares of packets in `loss`, `duplication`, `reordering` (late by up to 80 ms)
    /// and `bursts=SHARE:PACKETS` of losses, of bytes in `corruption`, and the `delay` of every packet in ms
    #[arg(long, conflicts_with = "port", value_name = "FAULT=VALUE,…", value_parser = parse_faults)]
    radio: Option<Faults>,

    /// Listen on TCP at this address, for one program at a time, as `tcp://HOST:PORT`; port 0 is a free one
    #[arg(long, conflicts_with_all = ["port", "symlink"], value_name = "HOST:PORT")]
    listen: Option<SocketAddr>,

    /// Create a symbolic link to the port, as a fixed name
    #[arg(long, conflicts_with = "port", value_name = "PATH")]
    symlink: Option<OutputLocation>,

    /// End after this many seconds
    #[arg(long, conflicts_with = "port", value_name = "S", value_parser = super::ports::parse_duration)]
    duration: Option<Duration>,

    #[command(flatten)]
    ending: EndingArgs,
}

/// Maximum time that the radio holds packets back, µs.
const HOLD_US: u64 = 80_000;

impl SimulationArgs {
    /// True if an option that only simulated boards have was given.
    pub(crate) fn is_given(&self) -> bool {
        self.seeds.is_given() || self.noise.is_given() || self.ending.until_eof
    }

    pub(crate) fn run(&self, serial: &SerialArgs, printer: &Printer) -> anyhow::Result<()> {
        serial.expect_board()?;
        let base_station = match serial.framing {
            None | Some(Protocol::Packets(Framing::Cobs)) => None,
            Some(Protocol::Packets(Framing::Xbee(mode))) => {
                Some(BaseStation::new(mode, serial.address()))
            }
            Some(Protocol::Original) => {
                anyhow::bail!("a simulated board speaks `cobs`, `xbee-ap1` or `xbee-ap2`")
            }
        };
        let stop = signals::stop_flag()?;
        // Set by lines of the standard input, which may also end the board.
        let commanded = Arc::default();
        let load = match &self.load {
            Some(path) if is_standard(path) => Load::Commanded(Arc::clone(&commanded)),
            Some(path) => Load::Table(read_load(path)?),
            None => Load::hands(self.seeds.seed()),
        };
        if self.ending.until_eof || matches!(load, Load::Commanded(_)) {
            let at_end = self.ending.until_eof.then(|| Arc::clone(&stop));
            each_line("load", printer, at_end, move |line| {
                let wrong = || format!("`{line}` is no load: FX,FY,FZ,MX,MY,MZ in N and N·m");
                *lock(&commanded) = numbers(line).ok_or_else(wrong)?;
                Ok(true)
            })?;
        }
        let settings = BoardSettings {
            load,
            seed: self.seeds.seed(),
            unit_seed: self.seeds.unit_seed(),
            noise_scale: self.noise.scale(),
            faults: self.radio.unwrap_or_default(),
            sync_s: self.sync.clone(),
            base_station,
        };
        let board = match self.listen {
            Some(at) => SimulatedBoard::listen(settings, at)?,
            None => on_a_pty(settings)?,
        };
        let _symlink = self.symlink.as_deref().map(|path| Symlink::make(path, board.port()));
        let _symlink = _symlink.transpose()?;
        printer.finish(&json!({ "port": board.port() }), |printer| {
            printer.line(format!("simulated board on {}", board.port()))
        })?;
        let started = Instant::now();
        let is_over = || self.duration.is_some_and(|duration| started.elapsed() >= duration);
        while !stop.load(Ordering::Relaxed) && !is_over() {
            thread::sleep(Duration::from_millis(20));
        }
        for (way, books) in ["to the host", "to the board"].into_iter().zip(board.books()) {
            let Books { sent, lost, lost_in_bursts, duplicated, held_back, corrupted } = books;
            printer.note(format!(
                "packets {way}: {sent} sent, {lost} lost, {lost_in_bursts} lost in bursts, {duplicated} sent twice, \
                 {held_back} held back, {corrupted} corrupted"
            ));
        }
        Ok(())
    }
}

#[cfg(unix)]
fn on_a_pty(settings: BoardSettings) -> anyhow::Result<SimulatedBoard> {
    Ok(SimulatedBoard::start(settings)?)
}

#[cfg(not(unix))]
fn on_a_pty(_: BoardSettings) -> anyhow::Result<SimulatedBoard> {
    anyhow::bail!(
        "this system has no virtual ports: use `--listen 127.0.0.1:5000` and the port `tcp://127.0.0.1:5000`"
    )
}

fn read_load(path: &Path) -> anyhow::Result<LoadTable> {
    let log = Log::open(path, &Mapping::default())?;
    log.require_axes(Axes::ALL)?;
    let wanted = Wanted { time: true, wrench: true, ..Wanted::default() };
    let mut rows: Vec<(f64, PerAxis<f64>)> = Vec::new();
    log.read(
        &wanted,
        &ReadOptions::default(),
        |block| {
            let wrench = |row| std::array::from_fn(|axis| block.wrench[axis][row]);
            (0..block.rows).map(|row| (block.time_s[row], wrench(row))).collect::<Vec<_>>()
        },
        |block| {
            rows.extend(block);
            Ok::<_, LogError>(())
        },
    )?;
    LoadTable::new(rows).with_context(|| format!("`{}` is no load", path.display()))
}

struct Symlink(PathBuf);

impl Symlink {
    fn make(path: &Path, port: &str) -> anyhow::Result<Self> {
        // Replace a dangling link, which a killed board leaves behind, and a link to a port like ours, whose
        // number may have been reused.
        let leads_to_port = || {
            let (target, port) = (std::fs::read_link(path), Path::new(port));
            target.is_ok_and(|target| target.parent() == port.parent())
        };
        if path.is_symlink() && (!path.exists() || leads_to_port()) {
            std::fs::remove_file(path).ok();
        }
        link(port, path).with_context(|| format!("cannot make the link `{}`", path.display()))?;
        Ok(Self(path.to_path_buf()))
    }
}

#[cfg(unix)]
fn link(port: &str, path: &Path) -> std::io::Result<()> {
    std::os::unix::fs::symlink(port, path)
}

#[cfg(not(unix))]
fn link(_: &str, _: &Path) -> std::io::Result<()> {
    Err(std::io::ErrorKind::Unsupported.into())
}

impl Drop for Symlink {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.0);
    }
}

/// Parses `loss=0.02,bursts=0.002:10,delay=5`.
fn parse_faults(text: &str) -> Result<Faults, String> {
    let mut faults = Faults { hold_us: HOLD_US, ..Faults::default() };
    for part in text.split(',') {
        let expected = || format!("`{part}` is no fault with its value, such as `loss=0.02`");
        let (name, value) = part.split_once('=').ok_or_else(expected)?;
        let (value, packets) = value.split_once(':').map_or((value, None), |(a, b)| (a, Some(b)));
        let number = |text: &str| text.parse::<f64>().ok().filter(|number| number.is_finite());
        let value = number(value).ok_or_else(expected)?;
        match (name, packets.map(number)) {
            ("loss", None) => faults.loss = value,
            ("duplication", None) => faults.duplication = value,
            ("reordering", None) => faults.reordering = value,
            ("corruption", None) => faults.corruption = value,
            ("delay", None) if (0.0..=10_000.0).contains(&value) => {
                faults.delay_us = (value * 1e3) as u64;
            }
            ("bursts", Some(Some(packets))) => {
                (faults.bursts, faults.burst_packets) = (value, packets);
            }
            _ => return Err(expected()),
        }
    }
    Ok(faults)
}
