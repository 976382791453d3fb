//! A board without hardware: the firmware's own library in this process, on a pty or over TCP.
//!
//! ```text
//! load ─ SensorModel ─ Instrument ─ firmware (embassy) ─ Radio ─ (BaseStation) ─ pty, TCP ─▶ host
//!                                          ▲                                    │
//!                                          └────────────────────────────────────┘
//! ```
//!
//! Conversions take as long as on the SkinProc board, and the clock shows the same times
//! ([`PacedClock`]). Only the calibration is lost when the process ends.

mod base_station;
mod clock;
mod instrument;
mod line;

pub use base_station::BaseStation;
pub use clock::PacedClock;
pub use instrument::{Load, SimulatedInstrument};

use std::hash::{BuildHasher, Hasher, RandomState};
use std::net::SocketAddr;
use std::sync::{Arc, Mutex};
use std::thread;

use firmware::{
    BoardSetup, LastWords, NoChip, RECORD, Record, Station, Storage, StorageError, VERSION,
};
use shared_proto::{Board, Identity, ResetCause};

use crate::SimulationError;
use crate::radio::{Books, Faults, Radio};
use crate::sensor_model::{SensorModel, SensorParameters};
use clock::SyncScript;
use line::{LineSender, SerialLine, Ways};
use shell_data::lock::lock;

#[derive(Clone, Debug)]
pub struct BoardSettings {
    pub load: Load,
    /// Determines noise, light, temperature and faults.
    pub seed: u64,
    pub unit_seed: u64,
    pub noise_scale: f64,
    /// Faults of the radio, in both directions.
    pub faults: Faults,
    /// Rising edges at the sync input, s after the board's start.
    pub sync_s: Vec<f64>,
    /// The XBee at the host, unless it is transparent.
    pub base_station: Option<BaseStation>,
}

impl BoardSettings {
    /// Sets up a board of unit 1 with its usual noise, on a perfect radio, without edges.
    pub fn new(load: Load, seed: u64) -> Self {
        Self {
            load,
            seed,
            unit_seed: 1,
            noise_scale: 1.0,
            faults: Faults::default(),
            sync_s: Vec::new(),
            base_station: None,
        }
    }
}

#[derive(Debug)]
pub struct SimulatedBoard {
    port: String,
    /// To the host and to the board.
    radios: [Arc<Mutex<Radio>>; 2],
}

impl SimulatedBoard {
    #[cfg(unix)]
    pub fn start(settings: BoardSettings) -> Result<Self, SimulationError> {
        let no_pty = |error| SimulationError(format!("cannot make a pty: {error}"));
        Self::on(settings, |ways| SerialLine::open(ways).map_err(no_pty))
    }

    /// Starts a board on TCP, for one host at a time.
    pub fn listen(settings: BoardSettings, at: SocketAddr) -> Result<Self, SimulationError> {
        let no_socket = |error| SimulationError(format!("cannot listen at {at}: {error}"));
        Self::on(settings, |ways| SerialLine::listen(at, ways).map_err(no_socket))
    }

    fn on(
        settings: BoardSettings,
        line: impl FnOnce(&Ways) -> Result<SerialLine, SimulationError>,
    ) -> Result<Self, SimulationError> {
        let BoardSettings { load, seed, unit_seed, noise_scale, faults, sync_s, base_station } =
            settings;
        let unit = SensorParameters::noisy_unit(unit_seed, noise_scale)?;
        let sensor = SensorModel::new(&unit, seed)?;
        // The two directions fail independently.
        let radio = |way| Radio::new(faults, seed << 1 | way).map(|it| Arc::new(Mutex::new(it)));
        let ways = Ways {
            radios: [radio(0)?, radio(1)?],
            station: base_station.map(|station| Arc::new(Mutex::new(station))),
        };
        let SerialLine { port, packets, receiver } = line(&ways)?;
        thread::spawn(move || {
            let clock = PacedClock::start();
            let front_end = SimulatedInstrument::new(sensor, load, clock.clone());
            let mut sync_input = SyncScript::new(clock.clone(), &sync_s);
            let to_host = (LineSender { packets, clock: clock.clone() }, NoChip);
            let from_host = (receiver, SlotMemory(None));
            let mut record = [0; RECORD];
            let station = Station::new(setup(unit_seed), clock.clone(), &mut record);
            // No watchdog: a stopped process is not a hanging board.
            let next_edge = async || sync_input.next_edge().await;
            clock.run(station.run(front_end, to_host, from_host, next_edge, || {}));
        });
        Ok(Self { port, radios: ways.radios })
    }

    pub fn port(&self) -> &str {
        &self.port
    }

    pub fn books(&self) -> [Books; 2] {
        self.radios.each_ref().map(|radio| lock(radio).books())
    }
}

/// Returns a unit's serial number. Unit 1, the source of the shipped data, has no digits in it.
fn serial(unit_seed: u64) -> [u8; 12] {
    let mut serial = *b"simulated   ";
    if unit_seed != 1 {
        let number = format!("{:>3}", unit_seed % 1000);
        serial[9..].copy_from_slice(number.as_bytes());
    }
    serial
}

fn setup(unit_seed: u64) -> BoardSetup {
    BoardSetup {
        identity: Identity {
            board: Board::Simulated,
            firmware: VERSION,
            serial: serial(unit_seed),
            min_period_us: 1_000,
        },
        // Random, from the seed of the standard library's hashes.
        start: RandomState::new().build_hasher().finish() as u16,
        reset_cause: ResetCause::Power,
        last_words: LastWords::new(),
        conversion_ns: instrument::CONVERSION_NS,
        // The line has no rate, and there is no bootloader for flashing.
        rate: None,
        rates: &[],
        has_bootloader: false,
    }
}

struct SlotMemory(Option<Record>);

impl Storage for SlotMemory {
    fn load(&mut self, record: &mut Record) {
        *record = self.0.unwrap_or([0xFF; RECORD]);
    }

    fn store(&mut self, record: &Record) -> Result<(), StorageError> {
        self.0 = Some(*record);
        Ok(())
    }
}
