//! `shellcal record --replay`: good and bad bytes.

use std::fs;
use std::path::Path;

use calibration_file::CalibrationFile;
use shared_proto::{
    Board, Boot, Framing, Packet, PacketOrigin, ResetCause, Sample, Values, skinproc,
};
use shell_data::wrench::PerAxis;
use system_tests::on_the_wire;
use system_tests::program::{self, ended, refused, succeed};

use crate::recording::{assert_rows_are, calibration, column, read_log, readings, sample, stream};

fn replay(dir: &Path, bytes: &[u8], arguments: &str) -> String {
    fs::write(dir.join("raw"), bytes).unwrap();
    succeed(dir, &format!("record --replay raw -o log.csv --overwrite {arguments}"))
}

#[test]
fn every_framing_is_recognised_and_gives_the_same_log() {
    let dir = tempfile::tempdir().unwrap();
    for (framing, name) in Framing::ALL.into_iter().zip(["cobs", "xbee-ap1", "xbee-ap2"]) {
        let packets = (0..500).map(|index| Packet::Sample(sample(index)));
        let bytes: Vec<u8> = packets.flat_map(|packet| on_the_wire(&packet, framing)).collect();
        let said = replay(dir.path(), &bytes, "");
        let expected =
            format!("500 frames over 4.990 s of the board's time ({name}); nothing lost\n");
        assert_eq!(said, expected);
        assert_rows_are(&read_log(&dir.path().join("log.csv")).unwrap(), 0..500);
    }
}

#[test]
fn a_short_recording_is_recognised_at_its_end() {
    let dir = tempfile::tempdir().unwrap();
    replay(dir.path(), &stream(0..2), "");
    assert_rows_are(&read_log(&dir.path().join("log.csv")).unwrap(), 0..2);
}

#[test]
fn raw_bytes_are_kept_as_they_are_and_replay_to_the_same_log() {
    let dir = tempfile::tempdir().unwrap();
    let mut bytes = b"\x03noise".to_vec();
    bytes.extend(stream(0..300));
    bytes[1000] ^= 0x55;
    replay(dir.path(), &bytes, "--raw copy");
    assert_eq!(fs::read(dir.path().join("copy")).unwrap(), bytes);
    succeed(dir.path(), "record --replay copy -o again.csv");
    let log = |name| fs::read(dir.path().join(name)).unwrap();
    assert_eq!(log("log.csv"), log("again.csv"));
}

#[test]
fn losses_are_marked_where_they_are_and_counted_by_kind() {
    let dir = tempfile::tempdir().unwrap();
    // 3 and 4 are lost, 6 comes after 7, 8 comes twice; the CRC of 10 is damaged.
    let mut bytes = stream([0, 1, 2, 5, 7, 6, 8, 8, 9]);
    let mut damaged = stream([10]);
    // A byte of a reading, behind the zeros whose places COBS keeps.
    damaged[20] ^= 0x02;
    bytes.extend(damaged);
    bytes.extend(stream([11, 12]));
    let said = replay(dir.path(), &bytes, "--json");
    let said: serde_json::Value = serde_json::from_str(&said).unwrap();
    for (kind, count) in [
        ("missing", 3),
        ("gaps", 3),
        ("duplicates", 1),
        ("reordered", 1),
        ("bad_crc", 1),
        ("damaged", 0),
        ("restarts", 0),
        ("frames", 10),
    ] {
        assert_eq!(said[kind], count, "{kind} of {said}");
    }
    let path = dir.path().join("log.csv");
    assert_rows_are(&read_log(&path).unwrap(), [0, 1, 2, 5, 6, 7, 8, 9, 11, 12]);
    assert_eq!(column(&path, "missing"), ["0", "0", "0", "2", "0", "0", "0", "0", "1", "0"]);
    assert_eq!(column(&path, "index"), ["0", "1", "2", "5", "6", "7", "8", "9", "11", "12"]);
    assert!(column(&path, "flags").iter().all(String::is_empty));
}

#[test]
fn sequence_and_clock_unwrap() {
    let dir = tempfile::tempdir().unwrap();
    // Frame numbers wrap after 65,536, and the clock after 71.58 min: both within 70,000 frames of 0.1 s.
    let slow = |index: u64| Sample { clock_us: (index * 100_000) as u32, ..sample(index) };
    let packets = (0..70_000).map(|index| Packet::Sample(slow(index)));
    let bytes: Vec<u8> = packets.flat_map(|packet| on_the_wire(&packet, Framing::Cobs)).collect();
    let said = replay(dir.path(), &bytes, "");
    assert_eq!(said, "70000 frames over 6999.900 s of the board's time (cobs); nothing lost\n");
    let indices = column(&dir.path().join("log.csv"), "index");
    assert!(indices.iter().enumerate().all(|(row, index)| *index == row.to_string()));
}

#[test]
fn a_restart_is_marked_and_time_goes_on() {
    let dir = tempfile::tempdir().unwrap();
    let mut bytes = stream(0..100);
    let boot = Boot { board: Board::SkinProc, firmware: [0, 1, 0], cause: ResetCause::Watchdog };
    let second = PacketOrigin { start: 1, ..PacketOrigin::default() };
    bytes.extend(Packet::Boot(boot).encode_from(second).iter());
    let fresh = |index: u64| Sample { clock_us: (index * 10_000) as u32, ..sample(index) };
    for index in 0..50 {
        bytes.extend(Packet::Sample(fresh(index)).encode_from(second).iter());
    }
    let said = replay(dir.path(), &bytes, "");
    assert!(said.ends_with("; 1 restarts\n"), "{said}");
    let path = dir.path().join("log.csv");
    let log = read_log(&path).unwrap();
    assert_eq!(log.rows, 150);
    assert!(log.time_s.is_sorted());
    let flags = column(&path, "flags");
    let restarts: Vec<_> = (0..150).filter(|&row| flags[row] == "restart").collect();
    assert_eq!(restarts, [100]);
    assert!(column(&path, "index").iter().enumerate().all(|(row, i)| *i == row.to_string()));
}

/// A CRC of 16 bits lets one damaged frame in 65,536 pass.
#[test]
fn a_frame_that_contradicts_its_neighbours_has_no_effect() {
    let dir = tempfile::tempdir().unwrap();
    let wrong = Sample { clock_us: 36_400_000, ..sample(50) };
    let other_run = PacketOrigin { start: 9, ..PacketOrigin::default() };
    let mut bytes = stream(0..50);
    bytes.extend(on_the_wire(&Packet::Sample(wrong), Framing::Cobs));
    bytes.extend(stream(50..80));
    bytes.extend(Packet::Sample(sample(80)).encode_from(other_run).iter());
    bytes.extend(stream(80..100));
    let said = replay(dir.path(), &bytes, "");
    assert!(said.ends_with("; 2 damaged\n"), "{said}");
    assert_rows_are(&read_log(&dir.path().join("log.csv")).unwrap(), 0..100);
}

#[test]
fn two_boards_behind_a_transparent_base_station_are_two_logs() {
    let dir = tempfile::tempdir().unwrap();
    let frame = |index: u64, board: u16| {
        let clock_us = sample(index).clock_us + 1_826_000_000 * u32::from(board % 2);
        let sample = Sample { clock_us, values: Values::Readings([board; 8]), ..sample(index) };
        Packet::Sample(sample).encode_from(PacketOrigin { board, start: board }).to_vec()
    };
    let bytes: Vec<u8> = (0..500)
        .flat_map(|index| [0x2052, 0xA7C1].map(|board| frame(index, board)))
        .flatten()
        .collect();
    let said = replay(dir.path(), &bytes, "");
    assert!(
        said.contains("board 2052: 500 frames") && said.contains("board a7c1: 500 frames"),
        "{said}"
    );
    assert!(!said.contains("restarts") && !said.contains("missing"), "{said}");
    for (name, board) in [("log.csv", 0x2052_u16), ("log-a7c1.csv", 0xA7C1)] {
        let log = read_log(&dir.path().join(name)).unwrap();
        assert_eq!(log.rows, 500, "{name}");
        assert!(
            log.readings[0].iter().all(|&reading| reading == f64::from(board) / 16.0),
            "{name}"
        );
    }
}

#[test]
fn dropped_frames_and_saturated_readings_are_in_the_log() {
    let dir = tempfile::tempdir().unwrap();
    let dropped = [254_u8, 254, 1, 1];
    let packets = dropped.iter().zip(0..).map(|(&dropped, index)| {
        Packet::Sample(Sample { dropped, saturated: 0b1000_0100, ..sample(index) })
    });
    let bytes: Vec<u8> = packets.flat_map(|packet| on_the_wire(&packet, Framing::Cobs)).collect();
    let said = replay(dir.path(), &bytes, "");
    assert!(said.ends_with("; 3 dropped on the board\n"), "{said}");
    let path = dir.path().join("log.csv");
    assert_eq!(column(&path, "dropped"), ["254", "254", "1", "1"]);
    assert_eq!(column(&path, "flags")[0], "s3:saturated s8:saturated");
}

#[test]
fn wrenches_of_the_board_are_a_log_of_wrenches() {
    let dir = tempfile::tempdir().unwrap();
    let wrench = [1.0, -0.5, 0.25, 0.001, 0.0, -0.125];
    let packets = (0..20)
        .map(|index| Packet::Sample(Sample { values: Values::Wrench(wrench), ..sample(index) }));
    let bytes: Vec<u8> = packets.flat_map(|packet| on_the_wire(&packet, Framing::Cobs)).collect();
    replay(dir.path(), &bytes, "");
    let log = read_log(&dir.path().join("log.csv")).unwrap();
    assert_eq!(log.rows, 20);
    for (column, value) in log.wrench.iter().zip(wrench) {
        assert!(column.iter().all(|&read| read == f64::from(value)));
    }
    calibration(dir.path());
    let error = refused(dir.path(), "record --replay raw -o f.csv --calibration cal.json");
    assert!(error.contains("the board streams wrenches") && error.contains("mode raw"), "{error}");
}

#[test]
fn forces_beside_the_readings_equal_those_of_the_calibration() {
    let dir = tempfile::tempdir().unwrap();
    let path = calibration(dir.path());
    let calibration = CalibrationFile::read(&path).unwrap().calibration;
    replay(dir.path(), &stream(0..40), "--calibration cal.json");
    let log = read_log(&dir.path().join("log.csv")).unwrap();
    let columns: Vec<Vec<f64>> =
        (0..8).map(|c| (0..40).map(|index| readings(index)[c]).collect()).collect();
    let mut wrench = PerAxis::default();
    calibration.wrench(&columns, &mut wrench);
    assert_eq!(log.wrench, wrench);
    let flags = column(&dir.path().join("log.csv"), "flags");
    for (row, mask) in calibration.out_of_range(&columns).into_iter().enumerate() {
        for channel in 0..8 {
            let flagged = flags[row].contains(&format!("s{}:range", channel + 1));
            assert_eq!(flagged, mask >> channel & 1 == 1);
        }
    }
}

#[test]
fn forces_are_tared_on_the_first_frames_which_are_flagged() {
    let dir = tempfile::tempdir().unwrap();
    let path = calibration(dir.path());
    let calibration = CalibrationFile::read(&path).unwrap().calibration;
    fs::write(dir.path().join("raw"), stream(0..40)).unwrap();
    let record = "record --replay raw -o log.csv --calibration cal.json --tare 10 --no-lowpass";
    let (_, said) = ended(dir.path(), record, 0);
    // The readings are far outside those of the training data.
    assert!(said.contains("the frames of the tare are loaded"), "{said}");
    let log = read_log(&dir.path().join("log.csv")).unwrap();
    let columns: Vec<Vec<f64>> =
        (0..8).map(|c| (0..40).map(|index| readings(index)[c]).collect()).collect();
    let mut wrench = PerAxis::default();
    calibration.wrench(&columns, &mut wrench);
    for (logged, wrench) in log.wrench.iter().zip(wrench) {
        assert_eq!(logged[..10], wrench[..10]);
        let zero = wrench[..10].iter().sum::<f64>() / 10.0;
        for (logged, wrench) in logged[10..].iter().zip(&wrench[10..]) {
            // Rounding of a mean and a difference of numbers up to 1e6, far outside the training data.
            assert!((logged - (wrench - zero)).abs() < 1e-9 * wrench.abs().max(zero.abs()));
        }
    }
    let flags = column(&dir.path().join("log.csv"), "flags");
    for (row, flags) in flags.iter().enumerate() {
        assert_eq!(flags.contains("untared"), row < 10, "{row}");
    }
}

#[test]
fn the_original_board_is_read_too() {
    let dir = tempfile::tempdir().unwrap();
    let scan = |i: u32| skinproc::Scan {
        readings: std::array::from_fn(|c| ((i * 37 + c as u32 * 501) % 4095) as u16 + 1),
        clock_us: i * 5_493,
    };
    let bytes: Vec<u8> = (0..200).flat_map(|i| scan(i).encode()).collect();
    let said = replay(dir.path(), &bytes, "");
    assert!(said.starts_with("200 frames") && said.contains("(original)"), "{said}");
    let path = dir.path().join("log.csv");
    let log = read_log(&path).unwrap();
    for row in 0..200 {
        let scan = scan(row as u32);
        assert_eq!(log.time_s[row], f64::from(scan.clock_us) / 1e6);
        for (column, reading) in log.readings.iter().zip(scan.readings) {
            assert_eq!(column[row], f64::from(reading));
        }
        let full = (0..8).filter(|&c| scan.readings[c] == 4095).count();
        assert_eq!(column(&path, "flags")[row].matches(":saturated").count(), full);
    }
}

#[test]
fn bytes_without_a_frame_are_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let noise: Vec<u8> = (0..5000_u32).map(|i| (i * i % 251) as u8).collect();
    fs::write(dir.path().join("raw"), noise).unwrap();
    let error = refused(dir.path(), "record --replay raw -o log.csv");
    assert!(error.contains("bytes arrive (5000 so far) but no valid frame"), "{error}");
    assert!(error.contains("try another `--baud`"), "{error}");
    assert!(!dir.path().join("log.csv").exists());

    fs::write(dir.path().join("raw"), stream(0..100)).unwrap();
    let error = refused(dir.path(), "record --replay raw -o log.csv --framing xbee-ap2");
    assert!(error.contains("they are framed `cobs`"), "{error}");

    fs::write(dir.path().join("raw"), b"").unwrap();
    let error = refused(dir.path(), "record --replay raw -o log.csv");
    assert!(error.contains("`raw`: nothing arrived"), "{error}");
    assert!(!dir.path().join("log.csv").exists());
}

fn crc16(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, &byte| {
        (0..8).fold(crc ^ u16::from(byte) << 8, |crc, _| {
            if crc & 0x8000 != 0 { crc << 1 ^ 0x5935 } else { crc << 1 }
        })
    })
}

#[test]
fn a_board_of_another_version_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let mut bytes = Vec::new();
    for number in 1..100_u8 {
        // Version 4, kind 4, mask 0x80. There are no zeros, so COBS only adds a length byte in front.
        let plain = [&[0x44, number, 1][..], &[7; 22]].concat();
        let masked = plain.iter().map(|byte| byte ^ 0x80);
        let mut packet: Vec<u8> = std::iter::once(0x80).chain(masked).collect();
        packet.extend(crc16(&packet).to_le_bytes());
        if packet.contains(&0) {
            continue;
        }
        bytes.push(packet.len() as u8 + 1);
        bytes.extend(packet);
        bytes.push(0);
    }
    fs::write(dir.path().join("raw"), bytes).unwrap();
    let error = refused(dir.path(), "record --replay raw -o log.csv");
    assert!(
        error.contains("speaks version `4` of the protocol, this program version `3`"),
        "{error}"
    );
}

#[test]
fn a_log_that_is_there_is_not_replaced_unasked() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("raw"), stream(0..10)).unwrap();
    fs::write(dir.path().join("log.csv"), "precious").unwrap();
    let error = refused(dir.path(), "record --replay raw -o log.csv");
    assert!(error.contains("--overwrite"), "{error}");
    assert_eq!(fs::read(dir.path().join("log.csv")).unwrap(), b"precious");
    let error = refused(dir.path(), "record --replay raw -o missing/log.csv");
    assert!(error.contains("missing/log.csv"), "{error}");
    let error = refused(dir.path(), "record --replay nothing -o other.csv");
    assert!(error.contains("`nothing`"), "{error}");
    assert_eq!(program::output(dir.path(), "record --replay raw").status.code(), Some(2));
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_a_clear_error_and_the_log_is_whole_up_to_then() {
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("raw"), stream(0..20_000)).unwrap();
    let error = refused(dir.path(), "record --replay raw -o /dev/full");
    assert!(error.contains("cannot write `/dev/full`: No space left"), "{error}");

    // A limit on the size of files, in blocks of 512 or 1024 bytes, replaces a full disk.
    let program = program::command(dir.path()).get_program().to_owned();
    let output = std::process::Command::new("sh")
        .arg("-c")
        .arg("trap '' XFSZ; ulimit -f 900; exec \"$0\" record --replay raw -o log.csv")
        .arg(program)
        .current_dir(dir.path())
        .output()
        .unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(error.contains("cannot write `log.csv`"), "{error}");
    let path = dir.path().join("log.csv");
    assert!(fs::read(&path).unwrap().ends_with(b"\n"));
    let log = read_log(&path).unwrap();
    assert!((1000..20_000).contains(&log.rows), "{}", log.rows);
    assert_rows_are(&log, 0..log.rows as u64);
}
