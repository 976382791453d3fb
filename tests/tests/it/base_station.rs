//! The simulated XBee at the host, as this program and Digi's own library see it.

use std::path::Path;
use std::thread;

use serde_json::Value;
use shared_proto::{Command, Decoder, Event, Framing, Packet};
use system_tests::program::{Recording, json, python, run, run_patiently};

use crate::simulated_board::Board;

const SERIAL: &str = "0013A20041000002";

/// Returns the frames of a log, all of which must be there, and their signal strength in dBm.
fn unbroken(path: &Path) -> (usize, Vec<f64>) {
    let log = Recording::read(path);
    let index = log.numbers("index");
    assert!(index.windows(2).all(|pair| pair[1] == pair[0] + 1.0), "{index:?}");
    (index.len(), log.numbers("rssi_dbm"))
}

#[test]
fn boards_are_recorded_in_both_modes_with_either_address() {
    for framing in ["xbee-ap1", "xbee-ap2"] {
        for address in ["0x2052", SERIAL, "0xFFFF"] {
            let dir = tempfile::tempdir().unwrap();
            let dir = dir.path();
            let board = Board::start(dir, &format!("--framing {framing} --to {address}"));
            run_patiently(dir, &format!("board board --framing {framing} start"), 0);
            let said = json(dir, "--json record board -o log.csv --duration 4");
            // The first checksum with an escape shows the mode. One in 64 has one, so one in 500 recordings of some
            // 400 frames has none. Each of its frames then means the same in both modes.
            if said["framing"] != framing {
                assert_eq!((framing, &said["framing"]), ("xbee-ap2", &"xbee-ap1".into()), "{said}");
                assert_eq!(said["damaged"], 0, "{said}");
            }
            // Losses count from the first frame: those before it were sent before the port was opened.
            assert_eq!(said["missing"], 0, "{said}");
            let (rows, strengths) = unbroken(&dir.join("log.csv"));
            assert!(rows > 100 && strengths.iter().all(|&dbm| dbm == -40.0), "{rows} rows");
            board.end();
        }
    }
}

#[test]
fn a_command_reaches_the_module_that_it_names_and_no_other() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let board = Board::start(dir, "--framing xbee-ap2 --to 0x2052");
    for address in ["0x2052", SERIAL, "0xFFFF"] {
        let said = run_patiently(
            dir,
            &format!("board board --framing xbee-ap2 --to {address} identify"),
            0,
        );
        assert!(said.contains("board     simulated"), "{said}");
    }
    let other = "board board --framing xbee-ap2 --to 0013A20041000003 identify";
    assert!(run(dir, other, 2).contains("no answer to"));
    board.end();
    let said = run(dir, "board --simulate --framing original", 2);
    assert!(said.contains("a simulated board speaks `cobs`, `xbee-ap1` or `xbee-ap2`"), "{said}");
    let said = run(dir, "board board --to 0013A2004100000G identify", 2);
    assert!(said.contains("an address is 0x0000 to 0xFFFF, or a serial number"), "{said}");
}

/// Opens the base station, reads its parameters and the board's, starts the board and hears its frames.
const DIGI: &str = r#"
import json, sys, time
from digi.xbee.devices import Raw802Device, RemoteRaw802Device, RemoteXBeeDevice, XBeeDevice
from digi.xbee.models.address import XBee64BitAddress
port, serial, start, stop, count = sys.argv[1:4] + [sys.argv[4], int(sys.argv[5])]
names = ["AP", "HV", "VR", "SH", "SL", "MY", "ID", "CH", "CE", "DH", "DL", "BD", "PL"]
heard = []
for kind, far in (Raw802Device, RemoteRaw802Device), (XBeeDevice, RemoteXBeeDevice):
    base = kind(port, 57600)
    # A busy machine answers late.
    base.set_sync_ops_timeout(30)
    base.open()
    board = far(base, x64bit_addr=XBee64BitAddress.from_hex_string(serial))
    found = {name: base.get_parameter(name).hex() for name in names}
    found["protocol"], found["role"] = base.get_protocol().name, base.get_role().name
    found["name"], found["of the board"] = base.get_node_id(), board.get_parameter("NI").decode()
    base.set_node_id("bench 3")
    found["renamed"] = base.get_parameter("NI").decode()
    base.set_node_id("BASE")
    frames = []
    base.add_data_received_callback(lambda message: frames.append(message.data.hex()))
    base.send_data(board, bytes.fromhex(start))
    deadline = time.monotonic() + 300
    while len(frames) < count:
        if time.monotonic() > deadline:
            sys.exit(f"{len(frames)} of {count} frames in 300 s")
        time.sleep(0.05)
    base.send_data(board, bytes.fromhex(stop))
    base.close()
    heard.append({"parameters": found, "frames": frames})
json.dump(heard, sys.stdout)
"#;

/// Frames that each class of the library has to receive.
const COUNT: usize = 1000;

#[test]
#[ignore = "needs a Python with packages that read tables and bags"]
fn the_library_of_digi_opens_the_base_station_and_receives_every_frame() {
    thread::scope(|scope| {
        scope.spawn(|| the_library_of_digi_receives_every_frame("01", "xbee-ap1"));
        scope.spawn(|| the_library_of_digi_receives_every_frame("02", "xbee-ap2"));
    });
}

fn the_library_of_digi_receives_every_frame(mode: &str, framing: &str) {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    // With addresses of 16 bits the library asks the sender for its serial number at each packet. It
    // waits 4 s in vain, in the thread that would read the answer.
    let board = Board::start(dir, &format!("--framing {framing} --to {SERIAL}"));
    let port = dir.join("board").display().to_string();
    let command = |number, command| {
        let packet = Packet::Command { number, to: None, command }.encode();
        packet.iter().map(|byte| format!("{byte:02x}")).collect::<String>()
    };
    let (start, stop) = (command(1, Command::Start), command(2, Command::Stop));
    let arguments = ["-c", DIGI, &port, SERIAL, &start, &stop, &COUNT.to_string()];
    let heard = python().args(arguments).output().unwrap();
    board.end();
    assert!(heard.status.success(), "{}", String::from_utf8_lossy(&heard.stderr));
    let heard: Value = serde_json::from_slice(&heard.stdout).unwrap();
    for heard in heard.as_array().unwrap() {
        let expected = serde_json::json!({
            "AP": mode, "HV": "1744", "VR": "10ef", "SH": "0013a200", "SL": "41000001",
            "MY": "0000", "ID": "3332", "CH": "0c", "CE": "01", "DH": "00000000",
            "DL": "00000000", "BD": "00000006", "PL": "04", "protocol": "RAW_802_15_4",
            "role": "COORDINATOR", "name": "BASE", "of the board": "SHELL",
            "renamed": "bench 3",
        });
        assert_eq!(heard["parameters"], expected);
        let mut decoder = Decoder::new(Framing::Cobs);
        let mut numbers = Vec::new();
        for payload in heard["frames"].as_array().unwrap() {
            let text = payload.as_str().unwrap();
            let digits = |at| u8::from_str_radix(&text[at..at + 2], 16).unwrap();
            let bytes: Vec<u8> = (0..text.len()).step_by(2).map(digits).collect();
            decoder.feed(&bytes, |event| {
                if let Event::Packet(received) = event
                    && let Packet::Sample(sample) = received.packet
                {
                    numbers.push(sample.sequence);
                }
            });
        }
        // About once a second a packet has the board's temperature and supply instead of readings.
        assert!(numbers.len() + 20 > COUNT, "{} frames", numbers.len());
        assert!(numbers.windows(2).all(|pair| pair[1] == pair[0].wrapping_add(1)));
        assert_eq!(decoder.counters.bad_crc + decoder.counters.malformed, 0);
    }
}
