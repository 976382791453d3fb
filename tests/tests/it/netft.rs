//! `shellcal stream --to netft`: programs that read ATI's Net F/T boxes get a board's forces.

use std::collections::HashMap;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::Duration;

use reference_sensor::page::{self, BoxSettings};
use reference_sensor::rdt::{BUFFERED, RECORD_SIZE, RdtCommand, RdtRecord};
use serde_json::Value;
use system_tests::program::{
    Recording, command, finish, interrupt, json, python, run, run_patiently, start,
};

use crate::simulated_board::Board;

const AXES: [&str; 6] = ["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"];

fn calibration(dir: &Path) {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data");
    let training = data.join("synthetic-train.csv");
    run(dir, &format!("fit {} --model cubic --output cal.json", training.display()), 0);
}

fn serve(dir: &Path, arguments: &str) -> (Child, SocketAddr) {
    let mut program = command(dir);
    program.args(format!("stream {arguments} -o rows.jsonl --to netft:0").split_whitespace());
    let mut child = program.stdin(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
    let address = lines.by_ref().find_map(|line| {
        let line = line.unwrap();
        let (_, after) = line.split_once("Net F/T at ")?;
        Some(after.split(' ').next().unwrap().parse().unwrap())
    });
    // Later messages need a listener.
    std::thread::spawn(move || lines.for_each(drop));
    (child, address.unwrap())
}

fn streamed(dir: &Path) -> HashMap<u32, [i64; 6]> {
    let text = fs::read_to_string(dir.join("rows.jsonl")).unwrap();
    let counts = |line: &str| {
        let row: Value = serde_json::from_str(line).unwrap();
        let counts = AXES.map(|axis| (row[axis].as_f64().unwrap() * 1e6).round() as i64);
        (row["index"].as_i64().unwrap() as u32, counts)
    };
    text.lines().map(counts).collect()
}

struct Client(UdpSocket);

impl Client {
    fn connect(to: SocketAddr) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(to).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        Self(socket)
    }

    fn ask(&self, command: RdtCommand) {
        self.0.send(&command.encode()).unwrap();
    }

    fn datagram(&self) -> Vec<RdtRecord> {
        let mut bytes = [0; BUFFERED * RECORD_SIZE];
        let length = self.0.recv(&mut bytes).unwrap();
        RdtRecord::decode_all(&bytes[..length]).unwrap()
    }

    fn next(&self) -> RdtRecord {
        let records = self.datagram();
        assert_eq!(records.len(), 1);
        records[0]
    }
}

#[test]
fn a_client_gets_the_rows_to_a_count_also_after_a_bias() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    calibration(dir);
    let board = Board::start(dir, "--seed 3");
    let (child, address) =
        serve(dir, "board --start --calibration cal.json --no-tare --no-lowpass");
    let client = Client::connect(address);
    client.ask(RdtCommand::Start(0));
    let plain: Vec<RdtRecord> = (0..100).map(|_| client.next()).collect();
    assert!(plain.iter().zip(1..).all(|(record, number)| record.rdt_sequence == number));
    assert!(plain.iter().all(|record| record.status == 0), "{plain:?}");
    client.ask(RdtCommand::Bias);
    for _ in 0..20 {
        client.next();
    }
    let biased: Vec<RdtRecord> = (0..50).map(|_| client.next()).collect();
    client.ask(RdtCommand::Stop);
    client.ask(RdtCommand::StartBuffered(1));
    let buffered = std::iter::repeat_with(|| client.datagram()).find(|it| it.len() > 1).unwrap();
    assert_eq!((buffered.len(), buffered[0].rdt_sequence), (BUFFERED, 1));
    // As an old client asks, under any name of this machine.
    let mut page = String::new();
    let mut stream = TcpStream::connect(address).unwrap();
    stream.write_all(b"GET /netftapi2.xml HTTP/1.0\r\nHost: box.lab\r\n\r\n").unwrap();
    stream.read_to_string(&mut page).unwrap();
    assert_eq!(page::read(&page), Ok(BoxSettings::micro()));
    assert!(page.contains("<comrdtrate>100<") || page.contains("<comrdtrate>99<"), "{page}");
    interrupt(&child);
    finish(child, "stream", 0);
    board.end();
    let rows = streamed(dir);
    for record in &plain {
        assert_eq!(record.counts.map(i64::from), rows[&record.ft_sequence]);
    }
    // The bias is one measured load, the same for all.
    let off = |record: &RdtRecord| -> [i64; 6] {
        let row = rows[&record.ft_sequence];
        std::array::from_fn(|axis| row[axis] - i64::from(record.counts[axis]))
    };
    let bias = off(&biased[0]);
    assert!(rows.values().any(|row| *row == bias), "{bias:?}");
    assert!(biased.iter().chain(&buffered).all(|record| off(record) == bias));
}

#[test]
fn saturation_and_gaps_are_in_the_status_word() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    calibration(dir);
    let board = Board::start(dir, "--seed 3 --radio loss=0.2");
    let (child, address) =
        serve(dir, "board --start --calibration cal.json --no-tare --no-lowpass");
    let client = Client::connect(address);
    client.ask(RdtCommand::Start(0));
    let records: Vec<RdtRecord> = (0..200).map(|_| client.next()).collect();
    interrupt(&child);
    finish(child, "stream", 0);
    board.end();
    let mut gaps = 0;
    for pair in records.windows(2) {
        let is_gap = pair[1].ft_sequence > pair[0].ft_sequence + 1;
        gaps += u32::from(is_gap);
        assert_eq!(pair[1].status & 8 != 0, is_gap, "{pair:?}");
    }
    assert!(gaps > 5, "{gaps} gaps");
}

#[test]
fn one_board_is_the_reference_of_another() {
    let (dir, other) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (dir, other) = (dir.path(), other.path());
    calibration(other);
    let reference = Board::start(other, "--seed 4");
    let (child, address) =
        serve(other, "board --start --calibration cal.json --no-tare --no-lowpass");
    let board = Board::start(dir, "--seed 3");
    let arguments = format!("--reference netft:{address} --duration 4");
    let said = json(dir, &format!("--json record board --start -o log.csv {arguments}"));
    assert_eq!(said["reference"]["missing"], 0, "{said}");
    interrupt(&child);
    finish(child, "stream", 0);
    board.end();
    reference.end();
    let rows: Vec<[i64; 6]> = streamed(other).into_values().collect();
    let log = Recording::read(&dir.join("log.csv"));
    let columns = AXES.map(|axis| log.text(axis));
    let with: Vec<usize> = (0..log.rows()).filter(|row| !columns[0][*row].is_empty()).collect();
    // On a busy machine records come late, or several at once, of which only the last has a time: each may leave
    // the rows before and after it without a load.
    let count = |name: &str| said["reference"][name].as_u64().unwrap() as usize;
    let excused = 2 * (count("late") + count("untimed"));
    let (rows_with, all) = (with.len() + excused, log.rows());
    assert!(rows_with > 200 && rows_with * 10 > all * 9, "{} of {all} rows: {said}", with.len());
    for row in with {
        let value = |column: &Vec<&str>| column[row].parse::<f64>().unwrap();
        let counts = columns.each_ref().map(|column| (value(column) * 1e6).round() as i64);
        assert!(rows.contains(&counts), "{counts:?} was never sent");
    }
}

const CLIENTS: &str = r#"
import json, sys, time
import pynetft
from NetFT import Sensor
port, seconds, least = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
config = pynetft.Config(sensor_host="127.0.0.1", rdt_port=port, http_port=port,
                        deliver_samples_with_error_status=True)
client = pynetft.Client(config, queue_size=1 << 16)
client.start()
plain, began = [], time.monotonic()
for sample in client.samples(timeout=30):
    plain.append(sample)
    if time.monotonic() - began > seconds and len(plain) > least:
        break
client.bias()
time.sleep(0.5)
biased, began = [], time.monotonic()
for sample in client.samples(timeout=30):
    biased.append(sample)
    if time.monotonic() - began > 1:
        break
biased = biased[-20:]
health = client.health()
assert health.lost_count == health.duplicate_count == health.out_of_order_count == 0, health
assert health.malformed_count == 0 and health.python_queue_dropped_count == 0, health
assert plain[0].force_unit.value == "N" and plain[0].torque_unit.value == "N-m"
for sample in plain[:100]:
    assert all(abs(f * 1e6 - c) < 1e-3 for f, c in zip(sample.wrench, sample.raw_wrench)), sample
client.stop()
sensor = Sensor("127.0.0.1")
sensor.sock.connect(("127.0.0.1", port))
single = [sensor.getMeasurement() for _ in range(5)]
sensor.getMeasurements(0)
stream = [sensor.receive() for _ in range(50)]
sensor.send(0)
rows = lambda samples: [[s.ft_sequence, list(s.raw_wrench)] for s in samples]
json.dump({"plain": rows(plain), "biased": rows(biased), "others": single + stream}, sys.stdout)
"#;

const REST: &str =
    "t_s,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n0,0.5,0,-1,0,0.01,0\n600,0.5,0,-1,0,0.01,0\n";

fn counts_of(value: &Value) -> [i64; 6] {
    std::array::from_fn(|axis| value[axis].as_i64().unwrap())
}

#[test]
#[ignore = "needs a Python with packages that read tables and bags"]
fn pynetft_and_netft_read_the_forces_of_a_board() {
    // A busy machine does not keep 1 kHz.
    let rates: &[u32] =
        if std::env::var_os("NETFT_SECONDS").is_some() { &[100, 1000] } else { &[100] };
    for &rate in rates {
        let dir = tempfile::tempdir().unwrap();
        let dir = dir.path();
        calibration(dir);
        fs::write(dir.join("rest.csv"), REST).unwrap();
        // A client begins anew when a reading is out of range, as with a box.
        let board = Board::start(dir, "--seed 3 --load rest.csv");
        if rate > 200 {
            run_patiently(dir, "board board sampling --settling 25 --conversions 4", 0);
            run_patiently(dir, &format!("board board rate {rate}"), 0);
        }
        let (child, address) =
            serve(dir, "board --start --calibration cal.json --no-tare --no-lowpass");
        let port = address.port().to_string();
        let measured = std::env::var("NETFT_SECONDS").ok();
        let seconds = measured.clone().unwrap_or_else(|| "5".to_owned());
        let wanted = 0.8 * f64::from(rate) * seconds.parse::<f64>().unwrap();
        // On a busy machine a client waits for its samples.
        let least = if measured.is_some() { 0.0 } else { wanted }.to_string();
        let read = python().args(["-c", CLIENTS, &port, &seconds, &least]).output().unwrap();
        interrupt(&child);
        finish(child, "stream", 0);
        board.end();
        assert!(read.status.success(), "{}", String::from_utf8_lossy(&read.stderr));
        let read: Value = serde_json::from_slice(&read.stdout).unwrap();
        let rows = streamed(dir);
        let plain = read["plain"].as_array().unwrap();
        assert!(plain.len() as f64 > wanted, "{} of {wanted} at {rate} Hz", plain.len());
        for sample in plain {
            let index = sample[0].as_u64().unwrap() as u32;
            assert_eq!(counts_of(&sample[1]), rows[&index], "{rate} Hz, frame {index}");
        }
        let off: Vec<[i64; 6]> = read["biased"]
            .as_array()
            .unwrap()
            .iter()
            .map(|sample| {
                let (row, counts) =
                    (rows[&(sample[0].as_u64().unwrap() as u32)], counts_of(&sample[1]));
                std::array::from_fn(|axis| row[axis] - counts[axis])
            })
            .collect();
        assert!(off.iter().all(|it| *it == off[0]) && rows.values().any(|row| *row == off[0]));
        let others = read["others"].as_array().unwrap();
        assert_eq!(others.len(), 55);
        for sample in others {
            let counts = counts_of(sample);
            let row: [i64; 6] = std::array::from_fn(|axis| counts[axis] + off[0][axis]);
            assert!(rows.values().any(|it| *it == row), "{rate} Hz: {counts:?} was never sent");
        }
    }
}

#[test]
fn options_of_streams_are_refused_by_other_commands() {
    let dir = tempfile::tempdir().unwrap();
    let child = start(dir.path(), "record tcp://127.0.0.1:1 -o a.csv --to netft");
    let said = finish(child, "record", 2);
    assert!(said.contains("`--to netft` is for `shellcal stream`"), "{said}");
}
