//! The firmware on an emulated Cortex-M4F, read and set up by the real `shellcal` over a pty.
//!
//! `SHELLCAL_EMULATED_IMAGE` names the image, which `cargo xtask test` builds. No test asserts how long
//! anything takes: the emulated board has a clock of its own.

use std::fs;
use std::path::Path;

use calibration::Calibration;
use calibration_file::CalibrationFile;
use shared_proto::xbee::Mode;
use shell_data::wrench::PerAxis;
use system_tests::emulation::{Memory, PlayedFrame, image};
use system_tests::program::{
    Recording, finish, interrupt, number, run, run_patiently, start, wait_for_rows,
};

use crate::bridge::{BaseStation, EmulatedBoard};

/// Frames of the script. A prime, so that it shares no period with anything.
const SCRIPT: usize = 701;

const READINGS: [&str; 8] = ["s1", "s2", "s3", "s4", "s5", "s6", "s7", "s8"];
const WRENCH: [&str; 6] = ["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"];

/// Dark and lit code of a channel in a frame: readings in the range of the shipped data.
fn played(frame: usize, channel: usize) -> (u16, u16) {
    let dark = (frame * 7 + channel * 31) % 300;
    let lit = dark + 1_300 + (frame * 13 + channel * 401) % 1_200;
    (dark as u16, lit as u16)
}

fn script() -> Vec<PlayedFrame> {
    (0..SCRIPT).map(|frame| std::array::from_fn(|channel| played(frame, channel))).collect()
}

/// What the board is to measure in the frame that it takes as number `frame`.
fn expected(frame: usize) -> [f64; 8] {
    std::array::from_fn(|channel| {
        let (dark, lit) = played(frame % SCRIPT, channel);
        f64::from(lit - dark)
    })
}

/// Wrenches by the host's own arithmetic, in double precision.
fn by_the_host(calibration: &Calibration, frames: &[[f64; 8]]) -> Vec<[f64; 6]> {
    let readings: Vec<Vec<f64>> =
        (0..8).map(|channel| frames.iter().map(|frame| frame[channel]).collect()).collect();
    let mut wrench = PerAxis::default();
    calibration.wrench(&readings, &mut wrench);
    (0..frames.len()).map(|row| wrench.each_ref().map(|axis| axis[row])).collect()
}

fn assert_close(actual: &[[f64; 6]], expected: &[[f64; 6]], tolerance: f64) {
    assert_eq!(actual.len(), expected.len());
    for (row, (actual, expected)) in actual.iter().zip(expected).enumerate() {
        let close = actual.iter().zip(expected).all(|(a, b)| (a - b).abs() <= tolerance);
        assert!(close, "row {row}: {actual:?} {expected:?}");
    }
}

/// A calibration fitted to the shipped data.
fn calibration(dir: &Path) -> Calibration {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data");
    let training = data.join("synthetic-train.csv");
    run(dir, &format!("fit --model cubic {} --output cal.json", training.display()), 0);
    CalibrationFile::read(&dir.join("cal.json")).unwrap().calibration
}

/// Records with `arguments` until so many rows are in the log.
fn record(board: &EmulatedBoard, dir: &Path, arguments: &str, rows: usize) -> Recording {
    let log = dir.join("log.csv");
    _ = fs::remove_file(&log);
    let arguments = format!("record {} --start --as-sampled -o log.csv {arguments}", board.port);
    let child = start(dir, &arguments);
    wait_for_rows(&log, rows);
    interrupt(&child);
    finish(child, &arguments, 0);
    Recording::read(&log)
}

/// Stops the stream, and reads what was on its way: an answer overtakes samples that wait.
fn stop(board: &EmulatedBoard, dir: &Path, framing: &str) -> String {
    run_patiently(dir, &format!("board {} {framing} stop", board.port), 0);
    run_patiently(dir, &format!("board {} {framing} --json status", board.port), 0)
}

/// Every sequence number, no loss, and every time a whole period from the first.
fn assert_unbroken(log: &Recording, period_s: f64) {
    let index = log.numbers("index");
    assert!(index.windows(2).all(|pair| pair[1] == pair[0] + 1.0));
    for name in ["missing", "dropped"] {
        assert!(log.numbers(name).iter().all(|&count| count == 0.0), "{name}");
    }
    for flag in ["late", "restart", "saturated"] {
        assert!(log.text("flags").iter().all(|flags| !flags.contains(flag)), "{flag}");
    }
    let times = log.numbers("t_s");
    for (row, time) in times.iter().enumerate() {
        let due = times[0] + row as f64 * period_s;
        assert!((time - due).abs() <= 1e-4, "row {row}: {time} s, due at {due} s");
    }
}

#[test]
#[ignore = "needs the emulated board"]
fn half_a_minute_at_100_hz_is_recorded_whole_and_as_it_was_played() {
    let image = image();
    let dir = tempfile::tempdir().unwrap();
    let calibration = calibration(dir.path());
    let memory = Memory::new().play(&script());
    let board = EmulatedBoard::start(&image, &memory, BaseStation::Transparent, dir.path());
    let identity = run_patiently(dir.path(), &format!("board {} identify", board.port), 0);
    assert!(identity.contains("emulated"), "{identity}");

    let log = record(&board, dir.path(), "--calibration cal.json --no-tare --no-lowpass", 3_001);
    let status = stop(&board, dir.path(), "");
    assert!(log.rows() > 3_000);
    assert_eq!(log.numbers("index")[0], 0.0);
    assert_unbroken(&log, 0.010);
    let readings = log.table(READINGS);
    let frames: Vec<_> = (0..log.rows()).map(expected).collect();
    assert_eq!(readings, frames);
    // The same arithmetic on the same numbers, printed with all digits.
    assert_close(&log.table(WRENCH), &by_the_host(&calibration, &frames), 0.0);
    for name in ["late", "overflowed", "damaged"] {
        assert_eq!(number(&status, name), 0, "{name}");
    }
    assert!(number(&status, "frames") >= log.rows() as u64);
}

#[test]
#[ignore = "needs the emulated board"]
fn commands_change_the_rate_and_upload_what_the_board_then_computes() {
    let image = image();
    let dir = tempfile::tempdir().unwrap();
    let calibration = calibration(dir.path());
    let memory = Memory::new().play(&script());
    for (base, framing) in [
        (BaseStation::Transparent, ""),
        (BaseStation::Api(Mode::Plain), "--framing xbee-ap1"),
        (BaseStation::Api(Mode::Escaped), "--framing xbee-ap2"),
    ] {
        let board = EmulatedBoard::start(&image, &memory, base, dir.path());
        let command = |what: &str, code| {
            run_patiently(dir.path(), &format!("board {} {framing} {what}", board.port), code)
        };
        command("rate 200", 0);
        let log = record(&board, dir.path(), framing, 400);
        let status = stop(&board, dir.path(), framing);
        assert_unbroken(&log, 0.005);
        let frames: Vec<_> = (0..log.rows()).map(expected).collect();
        assert_eq!(log.table(READINGS), frames);
        assert!(status.contains("\"streaming\": false"), "{status}");

        // Stopped is stopped: no frame is taken between two looks.
        let frames = number(&command("--json status", 0), "frames");
        assert_eq!(frames, number(&status, "frames"));

        assert!(command("mode wrench", 2).contains("no calibration"));
        command("upload cal.json", 0);
        command("mode wrench", 0);
        let log = record(&board, dir.path(), framing, 400);
        let first = usize::try_from(frames).unwrap();
        let frames: Vec<_> = (first..first + log.rows()).map(expected).collect();
        assert_unbroken(&log, 0.005);
        // Single precision: sums of terms up to 30 N that round at 2⁻²⁴ of it, 25 times.
        assert_close(&log.table(WRENCH), &by_the_host(&calibration, &frames), 1e-4);
    }
}
