//! `shellcal board`: queries and commands for a board, and their effects on the connection.

use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, bail};
use board_link::{
    Client, Connection, LinkError, PortOptions, board_text, for_board, judge, serial_text,
};
use clap::Subcommand;
use serde_json::json;
use shared_proto::{BoardId, CHANNELS, Command, ResetCause, Stream};

use super::choices::{number_within, one_of};
use super::mapping::EditedArg;
use super::ports::{SerialArgs, first_number};
use crate::files::InputPath;
use crate::printer::{Outcome, Printer};

#[derive(Debug, clap::Args)]
pub(crate) struct BoardArgs {
    /// Serial port [default: the ports of this computer are listed]
    #[arg(value_name = "PORT")]
    port: Option<String>,

    /// Be a board until Ctrl-C: on a wire; with `--framing xbee-ap1` or `xbee-ap2` behind a base station that
    /// answers as Digi's, with `--to` as the address of the board's module
    #[arg(long, conflicts_with_all = ["port", "baud", "flow_control"])]
    simulate: bool,

    /// Serial number of the board, as printed by `identify`, if several boards can hear
    #[arg(long, value_name = "SERIAL", value_parser = parse_serial, conflicts_with = "simulate")]
    board: Option<BoardId>,

    #[command(flatten)]
    serial: SerialArgs,

    #[command(flatten)]
    simulation: super::simulate_board::SimulationArgs,

    #[command(subcommand)]
    action: Option<BoardAction>,
}

#[derive(Debug, Subcommand)]
enum BoardAction {
    /// Print what the board is
    Identify,
    /// Print the state of the board
    Status,
    /// Start streaming
    Start,
    /// Stop streaming
    Stop,
    /// Set the rate of frames
    Rate {
        /// Frames per second
        #[arg(value_name = "HZ", value_parser = number_within(0.001..=1e6, RATE))]
        hz: f64,
    },
    /// Set how a reading is taken
    Sampling {
        /// Conversions to average for each lit and each dark value
        #[arg(long, value_name = "N", required_unless_present = "settling")]
        conversions: Option<u8>,
        /// Settling time after an emitter is switched, µs
        #[arg(long, value_name = "US")]
        settling: Option<u16>,
    },
    /// Stream readings or wrenches converted on the board
    Mode {
        /// Content of the stream
        #[arg(value_parser = one_of(&STREAMS))]
        stream: Stream,
    },
    /// Take the mean wrench of the next frames as zero
    Zero {
        /// Frames to average; 0 removes the zero
        #[arg(long, value_name = "N", default_value_t = 50)]
        frames: u16,
    },
    /// Light each emitter alone; each must raise its own channel and no other. Exit code 1 otherwise
    SelfTest,
    /// Set the baud rate until the board's next reset; it falls back to the old one if the new one is not
    /// heard
    Baud {
        /// Bits per second: 9600 to 1000000, as the board's documentation lists them
        #[arg(value_name = "RATE", value_parser = clap::value_parser!(u32).range(50..))]
        rate: u32,
    },
    /// Start the bootloader of the board's chip, for `stm32flash` on the same wire
    Bootloader,
    /// Upload a calibration, which the board stores
    Upload {
        /// Calibration file of model `physics`, `cubic` or `linear`
        #[arg(value_name = "CAL")]
        calibration: InputPath,

        #[command(flatten)]
        edited: EditedArg,
    },
}

const STREAMS: [(&str, &str, Stream); 2] =
    [("raw", "Readings", Stream::Raw), ("wrench", "Wrenches", Stream::Wrench)];

impl BoardArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<Outcome> {
        let Some(port) = &self.port else {
            anyhow::ensure!(
                self.action.is_none(),
                "no port is named: `shellcal board PORT ACTION`; `shellcal board` lists the ports"
            );
            return match self.simulate {
                true => self.simulation.run(&self.serial, printer),
                false => super::ports::list(printer),
            }
            .map(Outcome::from);
        };
        anyhow::ensure!(
            !self.simulation.is_given(),
            "`--seed`, `--unit-seed`, `--noise-scale` and `--until-eof` are for `--simulate`"
        );
        let action = self.action.as_ref().context(
            "nothing to do: `shellcal board PORT identify`, `status`, `start`, `stop`, `rate`, `sampling`, `mode`, \
             `zero`, `upload`, `self-test`, `baud` or `bootloader`",
        )?;
        match action {
            BoardAction::Identify => return identify(&mut self.client(port)?, printer),
            BoardAction::Status => return print_status(&mut self.client(port)?, printer),
            BoardAction::SelfTest => return self_test(&mut self.client(port)?, printer),
            BoardAction::Start => self.order(port, [Command::Start])?,
            BoardAction::Stop => self.order(port, [Command::Stop])?,
            BoardAction::Rate { hz } => {
                let period_us = (1e6 / hz).round() as u32;
                self.order(port, [Command::SetPeriod { period_us }])?;
            }
            BoardAction::Sampling { conversions, settling } => {
                let conversions =
                    conversions.map(|conversions| Command::SetOversampling { conversions });
                let settling = settling.map(|settling_us| Command::SetSettling { settling_us });
                self.order(port, conversions.into_iter().chain(settling))?;
            }
            BoardAction::Mode { stream } => self.order(port, [Command::SetStream(*stream)])?,
            BoardAction::Zero { frames } => {
                self.order(port, [Command::Zero { frames: *frames }])?
            }
            BoardAction::Baud { rate } => self.set_baud(port, *rate, printer)?,
            BoardAction::Bootloader => start_bootloader(&mut self.client(port)?, port, printer)?,
            BoardAction::Upload { calibration, edited } => {
                // Read the file before opening the port: an unusable file changes nothing.
                let calibration = for_board(&edited.usable(calibration, printer)?.calibration)?;
                let crc = self.client(port)?.upload(&calibration)?;
                printer.note(format!("the board has kept the calibration, CRC-32 {crc:#010x}"));
            }
        }
        printer.finish(&json!({ "done": true }), |printer| printer.note("done"))?;
        Ok(Outcome::Done)
    }

    fn order(&self, port: &str, commands: impl IntoIterator<Item = Command>) -> anyhow::Result<()> {
        let mut client = self.client(port)?;
        commands.into_iter().try_for_each(|command| client.order(command))?;
        Ok(())
    }

    fn set_baud(&self, port: &str, new: u32, printer: &Printer) -> anyhow::Result<()> {
        let mut client = self.client(port)?;
        let is_tcp = self.serial.port(port).is_tcp();
        anyhow::ensure!(!is_tcp, "`{port}` is a connection over TCP, which has no rate");
        let board = client.identify()?.id();
        match client.order(Command::SetBaud { baud: new }) {
            // If only the answer was lost, the board has the new rate.
            Ok(()) | Err(LinkError::NoAnswer { .. }) => {}
            Err(error) => return Err(error.into()),
        }
        let changed = Instant::now();
        // Two programs cannot open a port at once.
        drop(client);
        let status = |baud| Ok(self.connect(port, baud, Some(board))?.status()?);
        let heard: anyhow::Result<_> = status(new);
        let Err(unheard) = heard else {
            printer.note(format!(
                "the board has {new} baud until its next reset: `--baud {new}` in other commands"
            ));
            return Ok(());
        };
        thread::sleep(TRIAL.saturating_sub(changed.elapsed()));
        let old = self.serial.baud;
        status(old).with_context(|| {
            format!("the board is heard neither at `{new}` baud nor at `{old}`, where it was")
        })?;
        bail!("the board is not heard at `{new}` baud, and is back at `{old}` ({unheard:#})")
    }

    fn client(&self, port: &str) -> anyhow::Result<BoardClient> {
        self.connect(port, self.serial.baud, self.board)
    }

    fn connect(
        &self,
        name: &str,
        baud: u32,
        board: Option<BoardId>,
    ) -> anyhow::Result<BoardClient> {
        self.serial.expect_board()?;
        let uplink = self.serial.uplink().context(
            "the original board has no commands that this program sends; `record` reads it",
        )?;
        let port = PortOptions { baud, ..self.serial.port(name) }.open()?;
        let mut client = Client::new(port, name, uplink, first_number());
        client.board = board;
        Ok(client)
    }
}

fn self_test(client: &mut BoardClient, printer: &Printer) -> anyhow::Result<Outcome> {
    let (mut faults, mut rises) = (Vec::new(), Vec::new());
    for emitter in 0..CHANNELS {
        let rise = client.self_test(emitter as u8)?;
        let (number, steps) = (emitter + 1, rise[emitter]);
        let fault = judge(emitter, &rise).err();
        if fault.is_some() {
            let _ = printer.decide(false);
        }
        if !printer.json() {
            let passes = || {
                format!("emitter {number} raises channel {number} by {steps} steps and no other")
            };
            printer.line(fault.clone().unwrap_or_else(passes));
        }
        faults.extend(fault);
        rises.push(rise);
    }
    if printer.json() {
        printer.document(&json!({ "rise": rises, "faults": faults }))?;
    }
    Ok(printer.decide(faults.is_empty()))
}

fn identify(client: &mut BoardClient, printer: &Printer) -> anyhow::Result<Outcome> {
    let identity = client.identify()?;
    let [major, minor, patch] = identity.firmware;
    let firmware = format!("{major}.{minor}.{patch}");
    let serial = serial_text(&identity.serial);
    let board = board_text(identity.board);
    let max_rate_hz = 1e6 / f64::from(identity.min_period_us);
    let document = json!({
        "board": board, "firmware": firmware, "serial": serial, "max_rate_hz": max_rate_hz,
    });
    printer.finish(&document, |printer| {
        printer.line(format!("board     {board}"));
        printer.line(format!("firmware  {firmware}"));
        printer.line(format!("serial    {serial}"));
        printer.line(format!("fastest   {max_rate_hz} Hz"))
    })?;
    Ok(Outcome::Done)
}

fn print_status(client: &mut BoardClient, printer: &Printer) -> anyhow::Result<Outcome> {
    let status = client.status()?;
    let stream = match status.stream {
        Stream::Raw => "readings".to_owned(),
        Stream::Wrench => "wrenches".to_owned(),
        Stream::Other(code) => format!("stream number {code}"),
    };
    let (cause, last_words) = match status.reset_cause {
        ResetCause::Unspecified => ("an unknown cause".to_owned(), None),
        ResetCause::Other(code) => (format!("cause number {code}"), None),
        cause @ (ResetCause::Panic | ResetCause::Fault) => {
            (format!("{cause:?}").to_lowercase(), Some(client.last_words()?))
        }
        cause => (format!("{cause:?}").to_lowercase(), None),
    };
    let rate_hz = 1e6 / f64::from(status.period_us);
    let calibration = format!("{:#010x}", status.calibration_crc32);
    let document = json!({
        "streaming": status.streaming, "stream": stream, "rate_hz": rate_hz,
        "conversions": status.conversions, "settling_us": status.settling_us,
        "calibration_crc32": status.calibrated.then_some(&calibration),
        "zeroed": status.zeroed, "frames": status.frames, "late": status.late,
        "overflowed": status.overflowed, "damaged": status.damaged,
        "longest_frame_us": status.longest_frame_us, "uptime_s": status.uptime_s,
        "reset_cause": cause, "last_words": last_words, "foreign": status.foreign,
    });
    let streams = if status.streaming { "streams" } else { "stopped;" };
    let calibration = match status.calibrated {
        true if status.zeroed => format!("calibration {calibration}, zeroed"),
        true => format!("calibration {calibration}, not zeroed"),
        false => "no calibration".to_owned(),
    };
    let mut lines = vec![
        format!("{streams} {stream} at {rate_hz} Hz"),
        format!(
            "{} conversions, settling {} µs; longest frame {} µs",
            status.conversions, status.settling_us, status.longest_frame_us
        ),
        calibration,
        format!(
            "{} frames taken, {} late, {} not sent; {} damaged commands, {} for other boards",
            status.frames, status.late, status.overflowed, status.damaged, status.foreign
        ),
        format!("up {} s since a reset by {cause}", status.uptime_s),
    ];
    lines.extend(last_words.map(|words| format!("before it: {words}")));
    printer.finish(&document, |printer| lines.iter().for_each(|line| printer.line(line)))?;
    Ok(Outcome::Done)
}

fn parse_serial(text: &str) -> Result<BoardId, &'static str> {
    let is_serial = text.len() == 24 && text.bytes().all(|digit| digit.is_ascii_hexdigit());
    let number = u128::from_str_radix(text, 16).ok().filter(|_| is_serial);
    let [_, _, _, _, serial @ ..] = number.ok_or("24 hexadecimal digits")?.to_be_bytes();
    Ok(BoardId::from_serial(&serial))
}

/// Error messages for a rate. The command's field for the period in µs limits the range.
const RATE: [&str; 2] = ["a number of frames per second", "a rate from 0.001 to 1000000 Hz"];

type BoardClient = Client<Box<dyn Connection>>;

/// Time that a board allows for proving a new rate, plus the time of a frame under way.
const TRIAL: Duration = Duration::from_millis(3_500);

fn start_bootloader(client: &mut BoardClient, port: &str, printer: &Printer) -> anyhow::Result<()> {
    let started = client.order(Command::Bootloader);
    if let Err(LinkError::NoAnswer { .. }) = started {
        // The command cannot be heard again after the first time.
        printer.note("the board may be in its bootloader: perhaps only its answer was lost");
    }
    started?;
    printer.note(format!(
        "in the bootloader until a reset; to flash: `stm32flash -b 57600 -w FIRMWARE.bin -v -g 0x08000000 \
         {port}`"
    ));
    Ok(())
}
