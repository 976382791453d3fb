//! Two simulated boards behind one base station in API mode.

use std::io::{ErrorKind, Read, Write};
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use serialport::{SerialPort, TTYPort};
use shared_proto::xbee::{Address, ApiFrame, Deframer, Mode};
use simulation::sensor_model::LoadTable;
use simulation::simulated_board::{BoardSettings, Load, SimulatedBoard};
use system_tests::program::{Recording, finish, interrupt, run, start, wait_for_rows};

const ADDRESSES: [u16; 2] = [0x2052, 0x2053];
const BROADCAST: u16 = 0xFFFF;

/// 57,600 baud would not carry both boards.
const BAUD: u32 = 115_200;
const READINGS: [&str; 8] = ["s1", "s2", "s3", "s4", "s5", "s6", "s7", "s8"];

/// A board under a constant force, without noise: its readings change only by warm-up and creep.
fn board(unit_seed: u64, fz_n: f64) -> TTYPort {
    let load = LoadTable::new([(0.0, [0.0, 0.0, fz_n, 0.0, 0.0, 0.0])]).unwrap();
    let settings =
        BoardSettings { unit_seed, noise_scale: 0.0, ..BoardSettings::new(Load::Table(load), 1) };
    let board = SimulatedBoard::start(settings).unwrap();
    let port = serialport::new(board.port(), 57_600).timeout(Duration::from_millis(5));
    TTYPort::open(&port).unwrap()
}

/// A base station and the radio modules of the boards. The modules may cut a stream of bytes at any
/// point.
fn coordinator(mode: Mode, boards: [TTYPort; 2]) -> String {
    let (mut station, host) = TTYPort::pair().unwrap();
    station.set_timeout(Duration::from_millis(5)).unwrap();
    let name = host.name().unwrap();
    let mut to_boards: Vec<TTYPort> =
        boards.iter().map(|board| board.try_clone_native().unwrap()).collect();
    let (sender, packets) = std::sync::mpsc::channel::<(u16, Vec<u8>)>();
    for (mut board, address) in boards.into_iter().zip(ADDRESSES) {
        let sender = sender.clone();
        thread::spawn(move || {
            let mut bytes = [0; 41];
            loop {
                match board.read(&mut bytes) {
                    Ok(count) => sender.send((address, bytes[..count].to_vec())).unwrap(),
                    Err(error) if error.kind() == ErrorKind::TimedOut => {}
                    Err(error) => panic!("{error}"),
                }
            }
        });
    }
    let mut from_host = station.try_clone_native().unwrap();
    thread::spawn(move || {
        let (mut deframer, mut bytes) = (Deframer::new(mode), [0; 256]);
        loop {
            let Ok(count) = from_host.read(&mut bytes) else {
                thread::sleep(Duration::from_millis(2));
                continue;
            };
            deframer.feed(&bytes[..count], |frame| {
                let ApiFrame::Transmit { to: Address::Short(to), payload, .. } = frame else {
                    panic!("{frame:?}")
                };
                for (board, address) in to_boards.iter_mut().zip(ADDRESSES) {
                    if to == address || to == BROADCAST {
                        board.write_all(payload).unwrap();
                    }
                }
            });
        }
    });
    thread::spawn(move || {
        let _kept_open = host;
        let mut free_at = Instant::now();
        for (address, payload) in packets {
            let rssi = Some(40 + (address - ADDRESSES[0]) as u8);
            let from = Address::Short(address);
            let frame = ApiFrame::Receive { from, rssi, payload: &payload };
            let bytes = frame.encode(mode).unwrap();
            // At the pace of the line, ten bits per byte.
            thread::sleep(free_at.saturating_duration_since(Instant::now()));
            free_at =
                free_at.max(Instant::now()) + Duration::from_secs(10) * bytes.len() as u32 / BAUD;
            let mut rest = &bytes[..];
            while !rest.is_empty() {
                match station.write(rest) {
                    Ok(count) => rest = &rest[count..],
                    Err(_) => thread::sleep(Duration::from_millis(2)),
                }
            }
        }
    });
    name
}

/// Returns the only readings of a log whose frames have all arrived.
fn only_readings(path: &Path, rssi: f64) -> [f64; 8] {
    let log = Recording::read(path);
    let index = log.numbers("index");
    assert!(index.windows(2).all(|pair| pair[1] == pair[0] + 1.0), "{}", path.display());
    assert_eq!(index[0], 0.0);
    assert!(log.numbers("missing").iter().all(|&missing| missing == 0.0));
    assert!(log.numbers("rssi_dbm").iter().all(|&dbm| dbm == rssi));
    let readings = log.table(READINGS);
    // Warm-up and creep shift readings by some steps in this time.
    for row in &readings {
        let near = row.iter().zip(&readings[0]).all(|(a, b)| (a - b).abs() <= 25.0);
        assert!(near, "{row:?} among {:?}", readings[0]);
    }
    readings[0]
}

#[test]
fn two_boards_behind_one_base_station_are_two_logs() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let port = coordinator(Mode::Escaped, [board(1, 1.0), board(2, -1.0)]);
    let refused = run(dir, &format!("board {port} --framing xbee-ap2 rate 150"), 2);
    assert!(refused.contains("2 boards answer"), "{refused}");
    // `simulated  2`, in hexadecimal digits.
    let serial: String = b"simulated  2".iter().map(|byte| format!("{byte:02x}")).collect();
    run(dir, &format!("board {port} --framing xbee-ap2 --board {serial} rate 50"), 0);
    // A command sent to a board's address is received by no other board.
    let identity = run(dir, &format!("board {port} --framing xbee-ap2 --to 0x2053 identify"), 0);
    assert!(identity.contains(&serial), "{identity}");

    let arguments = format!("record {port} --framing xbee-ap2 --start -o log.csv");
    let child = start(dir, &arguments);
    wait_for_rows(&dir.join("log.csv"), 200);
    let other = ADDRESSES.map(|address| dir.join(format!("log-{address:04x}.csv")));
    let other = other.iter().find(|path| path.exists()).expect("a log of the other board");
    wait_for_rows(other, 100);
    interrupt(&child);
    let said = finish(child, &arguments, 0);
    assert!(said.contains("board 2052: ") && said.contains("board 2053: "), "{said}");
    assert!(said.contains(other.file_name().unwrap().to_str().unwrap()), "{said}");
    let other_is_second = other.ends_with("log-2053.csv");
    let (rssi, other_rssi) = if other_is_second { (-40.0, -41.0) } else { (-41.0, -40.0) };
    let first = only_readings(&dir.join("log.csv"), rssi);
    let second = only_readings(other, other_rssi);
    assert!(first.iter().zip(second).any(|(a, b)| (a - b).abs() > 100.0), "one board twice");
}
