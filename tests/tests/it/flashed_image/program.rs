//! The real `shellcal` on the flashed board's line.

use board_link::for_board;
use calibration_file::CalibrationFile;
use shared_proto::xbee::Mode;
use shell_data::wrench::PerAxis;
use std::path::Path;
use system_tests::flashed::Model;
use system_tests::program::{
    Recording, finish, interrupt, number, run, run_patiently, start, wait_for_rows,
};

use super::host::{crc_of, played};
use super::wires::{code, expected};
use crate::bridge::{BaseStation, EmulatedBoard};

const READINGS: [&str; 8] = ["s1", "s2", "s3", "s4", "s5", "s6", "s7", "s8"];
const WRENCH: [&str; 6] = ["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"];

fn start_board(model: &Model, base: BaseStation, dir: &Path) -> EmulatedBoard {
    let script = played(53, code);
    EmulatedBoard::start(base, |address| {
        let mut command = model.command(&script, dir);
        command.args(["--connect", &address.to_string()]);
        command
    })
}

#[test]
#[ignore = "needs the flashed image"]
fn shellcal_sets_the_board_up_and_records_it_whole() {
    let model = &Model::find();
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let board = start_board(model, BaseStation::Api(Mode::Escaped), dir);
    let identify = format!("board {} --framing xbee-ap2 identify", board.port);
    assert!(run_patiently(dir, &identify, 0).contains("skinproc"));

    let board = start_board(model, BaseStation::Transparent, dir);
    let command =
        |what: &str, code| run_patiently(dir, &format!("board {} {what}", board.port), code);
    assert!(command("identify", 0).contains("skinproc"));
    command("sampling --settling 100", 0);
    command("rate 125", 0);
    // 5,818 bytes per second carry 162 samples of readings or 131 of wrenches.
    command("sampling --conversions 4 --settling 30", 0);
    assert!(command("rate 400", 2).contains("Hz would do"));

    let log = dir.join("log.csv");
    let arguments = format!("record {} --start --as-sampled -o log.csv", board.port);
    let child = start(dir, &arguments);
    wait_for_rows(&log, 300);
    interrupt(&child);
    finish(child, &arguments, 0);
    let log = Recording::read(&log);
    // The board sends sixteenths of a converter step.
    let frames: Vec<_> =
        (0..log.rows()).map(|i| expected(i % 53).map(|counts| f64::from(counts) / 16.0)).collect();
    assert_eq!(log.table(READINGS), frames);
    let index = log.numbers("index");
    assert!(index.windows(2).all(|pair| pair[1] == pair[0] + 1.0));

    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data");
    run(
        dir,
        &format!(
            "fit --model cubic {} --output cal.json",
            data.join("synthetic-train.csv").display()
        ),
        0,
    );
    command("upload cal.json", 0);
    let calibration = CalibrationFile::read(&dir.join("cal.json")).unwrap().calibration;
    let crc = crc_of(&for_board(&calibration).unwrap());
    assert!(command("--json status", 0).contains(&format!("{crc:#010x}")));

    command("mode wrench", 0);
    let frames: usize = number(&command("--json status", 0), "frames").try_into().unwrap();
    let arguments = format!("record {} --start -o wrench.csv", board.port);
    let child = start(dir, &arguments);
    wait_for_rows(&dir.join("wrench.csv"), 200);
    interrupt(&child);
    finish(child, &arguments, 0);
    let log = Recording::read(&dir.join("wrench.csv"));
    let readings: Vec<Vec<f64>> = (0..8)
        .map(|channel| {
            let reading = |row| f64::from(expected((frames + row) % 53)[channel]) / 16.0;
            (0..log.rows()).map(reading).collect()
        })
        .collect();
    let mut by_the_host = PerAxis::default();
    calibration.wrench(&readings, &mut by_the_host);
    for (name, by_the_host) in WRENCH.into_iter().zip(&by_the_host) {
        for (row, (wrench, by_the_host)) in log.numbers(name).iter().zip(by_the_host).enumerate() {
            // Single precision: 25 sums of terms of up to about 100 N, each rounded at 2⁻²⁴.
            assert!(
                (wrench - by_the_host).abs() < 1e-3,
                "{name}, row {row}: {wrench} {by_the_host}"
            );
        }
    }
}
