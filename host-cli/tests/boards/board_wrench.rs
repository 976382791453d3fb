//! Wrenches computed by the board, compared with the host's.

use std::path::Path;

use board_link::for_board;
use calibration::physics::Inversion;
use calibration::{Calibration, Kind};
use calibration_file::CalibrationFile;
use firmware::Converter;
use shared_proto::{CHANNELS, COUNTS_PER_LSB};
use system_tests::{program, real_recording};

const DATA: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../calibration-data");

fn fit(arguments: &str) -> Calibration {
    let dir = tempfile::tempdir().unwrap();
    let arguments = format!("fit {arguments} --model physics -o cal.json");
    program::succeed(dir.path(), &arguments);
    CalibrationFile::read(&dir.path().join("cal.json")).unwrap().calibration
}

/// Returns every `step`-th frame of a log of whole readings, eight columns from `first` on.
fn frames(log: &Path, first: usize, step: usize) -> Vec<[u16; CHANNELS]> {
    let text = std::fs::read_to_string(log).unwrap();
    let frame = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        std::array::from_fn(|channel| fields[first + channel].parse().unwrap())
    };
    text.lines().skip(1).step_by(step).map(frame).collect()
}

/// Returns the largest difference between board and host on an axis, in standard errors, over the
/// frames of which the host uses every channel.
fn worst(calibration: &Calibration, frames: &[[u16; CHANNELS]]) -> f64 {
    let Kind::Physics(host) = &calibration.kind else { panic!("not the physics model") };
    let mut board = Converter::new(for_board(calibration).unwrap());
    let column = |channel: usize| frames.iter().map(|frame| f64::from(frame[channel])).collect();
    let columns: Vec<Vec<f64>> = (0..CHANNELS).map(column).collect();
    // The board has no shared factors.
    let expected = Inversion::new(&host.model().without_factors()).estimates(&columns);
    let (mut worst, mut compared) = (0.0_f64, 0);
    for (position, frame) in frames.iter().enumerate() {
        let expected = expected.row(position);
        if expected.flags.left_out != 0 {
            continue; // that is left to the host
        }
        compared += 1;
        let found = board.convert(&frame.map(|reading| reading * COUNTS_PER_LSB), 0);
        for (axis, &found) in found.iter().enumerate() {
            let off = (f64::from(found) - expected.wrench[axis]).abs();
            worst = worst.max(off / expected.standard_errors[axis]);
        }
    }
    assert!(compared > frames.len() * 9 / 10);
    worst
}

/// In standard errors. The host stops within a thousandth of the minimum, the board within a small part of a
/// hundredth, with variances of an earlier step. Rounding, 2⁻²⁴ of a reading, is 10⁻⁵ of its noise.
const TOLERANCE: f64 = 0.01;

#[test]
fn the_board_inverts_the_physics_model_as_the_host_does() {
    let data = Path::new(DATA);
    let calibration = fit(&data.join("synthetic-train.csv").display().to_string());
    let worst = worst(&calibration, &frames(&data.join("synthetic-test.csv"), 1, 1));
    assert!(worst < TOLERANCE, "{worst}");
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn the_board_inverts_a_real_sensor_as_the_host_does() {
    let poses = real_recording("others/photointerrupters/poses.csv");
    let calibration = fit(&format!("{} --group pose", poses.display()));
    let worst = worst(&calibration, &frames(&poses, 7, 5));
    assert!(worst < TOLERANCE, "{worst}");
}
