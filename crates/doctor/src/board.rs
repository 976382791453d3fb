//! Checks of a board, based on its answers and a short part of its stream.

use calibration::Calibration;
use shared_proto::{CHANNELS, Identity, Protocol, ResetCause, Status, Stream, crc32};
use shell_data::block::Block;

use crate::channels::{ENOUGH_FRAMES, check_channels, identical_in, outside, without_consequences};
use crate::{Finding, percent};
use board_link::recording::{BoardFrame, Losses, Measured, protocol_name};
use board_link::{Handshake, Heard, LinkError, StreamPart, for_board, serial_text};
use log_file::summary::LogSummary;

#[derive(Clone, Copy, Debug)]
pub struct BoardObservations<'a> {
    pub handshake: &'a Handshake,
    /// Requested speed, bits per second.
    pub baud: u32,
    pub protocol: Protocol,
    /// Expected calibration, and the label in it.
    pub calibration: Option<(&'a Calibration, Option<&'a str>)>,
    /// The firmware version that comes with this program.
    pub firmware: [u8; 3],
}

/// A radio loses a packet now and then; above this share, gaps become visible.
const FEW_LOST: f64 = 1e-3;

/// Above this share, losses are a fault.
const MANY_LOST: f64 = 1e-2;

/// Largest relative error of a rate: a quartz is accurate to some 10⁻⁴, a period in whole µs to 10⁻³ at 1 kHz.
const RATE_ERROR: f64 = 0.01;

pub fn check_board(facts: &BoardObservations<'_>) -> Vec<Finding> {
    let mut findings = heard(facts);
    let Heard::Board { .. } = facts.handshake.heard else { return findings };
    if let Some(trouble) = &facts.handshake.trouble {
        findings.push(answerless(trouble));
        return findings;
    }
    let Handshake { identity, status, stream, .. } = facts.handshake;
    identity.iter().for_each(|identity| check_identity(identity, facts, &mut findings));
    status.iter().for_each(|status| check_status(status, facts, &mut findings));
    match stream {
        Some(Ok(part)) => check_stream(part, facts, &mut findings),
        Some(Err(error)) => {
            let advice = "switch the board off and on; if it stays silent, flash it with `cargo xtask flash`";
            findings.push(Finding::fault("no-frames", error.to_string(), advice));
        }
        None => {}
    }
    without_consequences(&mut findings);
    findings
}

fn heard(facts: &BoardObservations<'_>) -> Vec<Finding> {
    let asked = facts.baud;
    match facts.handshake.heard {
        Heard::Silence => vec![Finding::fault(
            "silent",
            "not a byte arrives, at any speed",
            "check the board's supply, that TX goes to RX, and that the radios have one channel and \
             network; the original board streams once it is started",
        )],
        Heard::Noise { bytes } => vec![Finding::fault(
            "noise",
            format!("{bytes} bytes arrive, and at no speed is there a frame in them"),
            "check the ground wire and the voltage of the line; another device may be on this port",
        )],
        Heard::Board { baud, protocol } => {
            let name = protocol_name(protocol);
            let mut findings = Vec::new();
            if baud != asked {
                let seen = format!("the board is heard at {baud} baud, not at {asked}");
                let advice = format!("give `--baud {baud}`, or set the radio to {asked}");
                findings.push(Finding::fault("baud", seen, advice));
            }
            // The original board needs no framing option.
            let is_told = protocol == Protocol::Original;
            if protocol != facts.protocol && !is_told {
                let asked = protocol_name(facts.protocol);
                let seen = format!("the base station frames bytes as `{name}`, not as `{asked}`");
                let advice = format!("give `--framing {name}`, or set its parameter AP");
                findings.push(Finding::fault("framing", seen, advice));
            }
            if findings.is_empty() {
                findings.push(Finding::fine("link", format!("{baud} baud, framing `{name}`")));
            }
            findings
        }
    }
}

fn answerless(trouble: &LinkError) -> Finding {
    let (check, advice) = match trouble {
        LinkError::OtherVersion { .. } => (
            "protocol-version",
            "flash the board with the firmware of this program: `cargo xtask flash`",
        ),
        LinkError::SeveralBoards { .. } => (
            "several-boards",
            "switch the others off, or give `--to` the address of one in API mode",
        ),
        LinkError::NoAnswer { .. } => {
            let seen = format!("frames arrive, but there is {trouble}");
            let advice =
                "check the wire or radio from the host to the board: RX of the board, RTS and CTS";
            return Finding::fault("deaf", seen, advice);
        }
        _ => ("question", "ask again; look at the cable if it happens twice"),
    };
    Finding::fault(check, trouble.to_string(), advice)
}

fn check_identity(identity: &Identity, facts: &BoardObservations<'_>, findings: &mut Vec<Finding>) {
    let text = |version: [u8; 3]| version.map(|part| part.to_string()).join(".");
    let (has, ours) = (text(identity.firmware), text(facts.firmware));
    findings.push(match identity.firmware < facts.firmware {
        true => Finding::warning(
            "firmware",
            format!("the board has firmware {has}, this program comes with {ours}"),
            "flash it with `cargo xtask flash`",
        ),
        false => Finding::fine("firmware", format!("version {has}")),
    });
    // A label that looks like a board's serial number is compared as one.
    let label = facts.calibration.and_then(|(_, label)| label);
    let serial = serial_text(&identity.serial);
    let is_number =
        |label: &&str| label.len() == serial.len() && label.bytes().all(|b| b.is_ascii_hexdigit());
    let other = label.filter(is_number).filter(|label| !label.eq_ignore_ascii_case(&serial));
    if let Some(label) = other {
        let seen = format!("the calibration is of sensor {label}, the board is {serial}");
        let advice = "take the calibration of this sensor, or the sensor of this calibration";
        findings.push(Finding::fault("serial", seen, advice));
    }
}

fn check_status(status: &Status, facts: &BoardObservations<'_>, findings: &mut Vec<Finding>) {
    findings.push(reset(status, facts));
    findings.extend(calibrated(status, facts));
    let Status { late, frames, overflowed, damaged, longest_frame_us, period_us, .. } = *status;
    if late > 0 {
        let seen = format!(
            "{late} of {frames} frames were not taken, because their time had passed; the longest took \
             {longest_frame_us} µs of {period_us}"
        );
        let advice =
            "lower the rate, the conversions or the settling time: `shellcal board PORT rate`";
        findings.push(Finding::warning("late", seen, advice));
    }
    if overflowed > 0 {
        let seen =
            format!("{overflowed} of {frames} frames were not sent, because the line was too slow");
        let advice = "lower the rate, or raise the speed of the line";
        findings.push(Finding::warning("overflow", seen, advice));
    }
    if damaged > 0 {
        let seen = format!("{damaged} commands arrived damaged at the board");
        let advice = "look at the way from the host to the board: the radio's range, the cable";
        findings.push(Finding::warning("uplink", seen, advice));
    }
}

fn reset(status: &Status, facts: &BoardObservations<'_>) -> Finding {
    let words = || match facts.handshake.last_words.as_deref() {
        Some(words) if !words.is_empty() => format!("; before it: {words}"),
        _ => String::new(),
    };
    let when = format!("{} s ago", status.uptime_s);
    match status.reset_cause {
        ResetCause::Panic | ResetCause::Fault => Finding::fault(
            "crash",
            format!("the firmware crashed {when}{}", words()),
            "report it with these words; flash another version if it happens again",
        ),
        ResetCause::Watchdog => Finding::fault(
            "crash",
            format!("the watchdog reset the board {when}"),
            "the firmware hung: report it; flash another version if it happens again",
        ),
        _ => Finding::fine("up", format!("for {} s", status.uptime_s)),
    }
}

fn calibrated(status: &Status, facts: &BoardObservations<'_>) -> Option<Finding> {
    let is_streaming_wrenches = status.stream == Stream::Wrench;
    if !status.calibrated {
        let seen = "the board is to stream wrenches and has no calibration";
        let advice = "`shellcal board PORT upload CAL`, or `mode raw`";
        return is_streaming_wrenches.then(|| Finding::fault("board-calibration", seen, advice));
    }
    let on_board = format!("{:#010x}", status.calibration_crc32);
    let Some((calibration, _)) = facts.calibration else {
        return Some(Finding::fine("board-calibration", format!("CRC-32 {on_board}")));
    };
    let Ok(ours) = for_board(calibration) else { return None };
    let ours = crc32(&ours.to_bytes());
    Some(match ours == status.calibration_crc32 {
        true => Finding::fine("board-calibration", format!("that of the file, CRC-32 {on_board}")),
        false => Finding::fault(
            "board-calibration",
            format!("the board has calibration {on_board}, the file is {ours:#010x}"),
            "`shellcal board PORT upload CAL` puts the file on the board",
        ),
    })
}

fn check_stream(part: &StreamPart, facts: &BoardObservations<'_>, findings: &mut Vec<Finding>) {
    check_losses(part, findings);
    let frames = in_order(&part.frames);
    let mut summary = LogSummary::default();
    summary.add(&frames);
    let period_us = facts.handshake.status.map(|status| f64::from(status.period_us));
    let interval_us = summary.timing.median_interval_s().map(|interval| interval * 1e6);
    if let (Some(set), Some(found)) = (period_us, interval_us) {
        let seen = format!("{:.2} Hz, set are {:.2} Hz", 1e6 / found, 1e6 / set);
        let advice = "the board cannot keep the rate: `shellcal board PORT rate` sets a lower one";
        findings.push(match (found / set - 1.0).abs() <= RATE_ERROR {
            true => Finding::fine("rate", seen),
            false => Finding::fault("rate", seen, advice),
        });
    }
    let restarts = part.recorded.losses.restarts;
    if restarts > 0 {
        let seen = format!("the board restarted {restarts} times while it was listened to");
        let advice = "look at its supply: `shellcal board PORT status` says why it started";
        findings.push(Finding::fault("restart", seen, advice));
    }
    if !summary.readings.is_empty() && summary.rows < ENOUGH_FRAMES {
        let advice = format!(
            "listen longer with `--listen`: channels are judged from {ENOUGH_FRAMES} frames on"
        );
        findings.push(Finding::warning("short", format!("{} frames", summary.rows), advice));
    }
    let calibration = facts.calibration.map(|(calibration, _)| calibration);
    let calibration = calibration.filter(|of| of.channels() == summary.readings.len());
    let readings = &frames.readings;
    let identical = identical_in(readings, None);
    check_channels((&summary, false), &[], &identical, calibration, findings);
    findings
        .extend(calibration.and_then(|of| outside(of.rows_out_of_range(readings), summary.rows)));
}

fn check_losses(part: &StreamPart, findings: &mut Vec<Finding>) {
    let Losses { missing, bad_crc, damaged, dropped_on_board: dropped, .. } = part.recorded.losses;
    let sent = (part.recorded.frames + missing).max(1) as f64;
    let share = missing as f64 / sent;
    let seen = format!(
        "{missing} of {sent} frames did not arrive ({}), {} packets damaged",
        percent(share),
        bad_crc + damaged
    );
    let advice = "bring the radios nearer, free of metal, or to another channel; over a wire, look at \
                  the ground and the speed";
    findings.push(Finding::graded("losses", share, [FEW_LOST, MANY_LOST], seen, advice));
    if dropped as f64 > FEW_LOST * sent {
        let seen = format!("the board dropped {dropped} frames while it was listened to");
        let advice =
            "its line or its time is too short: lower the rate, or raise the speed of the line";
        findings.push(Finding::fault("dropped", seen, advice));
    }
}

/// Returns the frames in order of index, with readings if all frames have some.
fn in_order(frames: &[BoardFrame]) -> Block {
    let mut ordered: Vec<&BoardFrame> = frames.iter().collect();
    ordered.sort_by_key(|frame| frame.index);
    let mut readings = vec![Vec::new(); CHANNELS];
    for frame in &ordered {
        if let Measured::Readings(values) = frame.measured {
            readings.iter_mut().zip(values).for_each(|(column, value)| column.push(value));
        }
    }
    let has_all = !ordered.is_empty() && readings[0].len() == ordered.len();
    Block {
        rows: ordered.len(),
        time_s: ordered.iter().map(|frame| frame.time_us as f64 / 1e6).collect(),
        readings: if has_all { readings } else { Vec::new() },
        ..Block::default()
    }
}
