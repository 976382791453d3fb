//! `shellcal record --reference`: a scripted sensor beside a simulated board over TCP.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::path::Path;
use std::process::Stdio;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use reference_sensor::rdt::{RdtCommand, RdtRecord};
use reference_sensor::{ft300, page};
use serde_json::Value;
use system_tests::program::{self, Recording, Running};

const WRENCH: [&str; 6] = ["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"];

fn board(dir: &Path) -> (Running, String) {
    let mut command = program::command(dir);
    command.args(["board", "--simulate", "--listen", "127.0.0.1:0", "--duration", "120"]);
    let mut process = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut line = String::new();
    BufReader::new(process.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let port = line.trim().strip_prefix("simulated board on ").unwrap().to_owned();
    (Running(process), port)
}

fn serve_page(listener: &TcpListener) {
    let (mut stream, _) = listener.accept().unwrap();
    let mut request = [0; 1024];
    let length = stream.read(&mut request).unwrap();
    assert!(request[..length].starts_with(b"GET /netftapi2.xml HTTP/1."));
    let settings =
        page::BoxSettings { torque_unit: "N-mm".to_owned(), ..page::BoxSettings::micro() };
    let page = page::write(&settings, 1000, "scripted");
    stream.write_all(format!("HTTP/1.0 200 OK\r\n\r\n{page}").as_bytes()).unwrap();
}

/// A UDP socket, and a listener at the TCP port of the same number.
fn ports() -> (UdpSocket, TcpListener) {
    for _ in 0..100 {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        if let Ok(listener) = TcpListener::bind(socket.local_addr().unwrap()) {
            return (socket, listener);
        }
    }
    panic!("no port is free twice");
}

/// Serves one client: after a greeting, message `n` after `n` periods, from 1. Returns the address.
fn serve_every(
    period_ms: u64,
    greet: impl FnOnce(&mut TcpStream) + Send + 'static,
    message: impl Fn(u64) -> Vec<u8> + Send + 'static,
) -> SocketAddr {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let at = listener.local_addr().unwrap();
    thread::spawn(move || {
        let (mut stream, _) = listener.accept().unwrap();
        greet(&mut stream);
        let started = Instant::now();
        for n in 1.. {
            thread::sleep(Duration::from_millis(period_ms * n).saturating_sub(started.elapsed()));
            if stream.write_all(&message(n)).is_err() {
                break;
            }
        }
    });
    at
}

fn counts(n: u32) -> [i32; 6] {
    let n = n.cast_signed();
    [n * 1000, -n * 1000, 7, 0, 2_000_000, n * 1000]
}

#[derive(Debug, Default)]
struct Done {
    missing: u64,
    late: u64,
    doubled: u64,
    with_status: u64,
    restarts: u64,
}

/// A box at 1 kHz that loses one record in 500, delays and repeats one, and restarts its count.
fn play_box(socket: &UdpSocket, listener: &TcpListener, stop: &AtomicBool) -> Done {
    serve_page(listener);
    let mut request = [0; 64];
    let client = loop {
        let (length, from) = socket.recv_from(&mut request).unwrap();
        match RdtCommand::decode(&request[..length]) {
            Some(RdtCommand::Bias) => {}
            Some(RdtCommand::Start(0)) => break from,
            other => panic!("{other:?}"),
        }
    };
    let send = |record: RdtRecord| socket.send_to(&record.encode(), client).map(drop).unwrap();
    let (started, mut done, mut held) = (Instant::now(), Done::default(), None);
    let mut rdt_sequence = 0;
    for n in 1.. {
        let due = Duration::from_millis(u64::from(n));
        thread::sleep(due.saturating_sub(started.elapsed()));
        if stop.load(Ordering::Relaxed) {
            break;
        }
        rdt_sequence += 1;
        if n == 2250 {
            rdt_sequence = 1;
            done.restarts += 1;
        }
        let status = match n % 1500 {
            0 => 0x8000_0004,
            750 => 8,
            _ => 0,
        };
        let record = RdtRecord { rdt_sequence, ft_sequence: 7 * n, status, counts: counts(n) };
        match n % 500 {
            100 => done.missing += 1,
            200 => held = Some(record),
            203 => {
                send(record);
                held.take().into_iter().for_each(&send);
                done.late += 1;
            }
            300 => {
                send(record);
                send(record);
                done.doubled += 1;
            }
            _ => send(record),
        }
        done.with_status += u64::from(status != 0);
    }
    done
}

/// Starts the box of [`play_box`]; returns its address, and a function that ends it.
fn start_box() -> (SocketAddr, impl FnOnce() -> Done) {
    let (socket, listener) = ports();
    let at = socket.local_addr().unwrap();
    let stop = Arc::new(AtomicBool::new(false));
    let told = Arc::clone(&stop);
    let script = thread::spawn(move || play_box(&socket, &listener, &told));
    let end = move || {
        stop.store(true, Ordering::Relaxed);
        script.join().unwrap()
    };
    (at, end)
}

/// Checks that rows have samples that were sent, at their times; returns the number of such rows.
fn check_rows(log: &Recording, slack_s: f64) -> usize {
    let text = WRENCH.map(|name| log.text(name));
    let (times, number) = (log.numbers("t_s"), log.text("ref_index"));
    let with: Vec<usize> = (0..log.rows()).filter(|row| !text[0][*row].is_empty()).collect();
    let mut offsets = Vec::new();
    for row in &with {
        let value = |axis: usize| text[axis][*row].parse::<f64>().unwrap();
        let n = (value(0) * 1000.0).round();
        let n_s = n / 1000.0;
        assert_eq!([value(0), value(1), value(2), value(3)], [n_s, -n_s, 7e-6, 0.0], "row {row}");
        assert_eq!([value(4), value(5)], [2e-3, n / 1e6], "row {row}");
        assert!(!number[*row].is_empty());
        offsets.push(times[*row] - n_s);
    }
    let mut sorted = offsets.clone();
    sorted.sort_by(f64::total_cmp);
    let middle = sorted[sorted.len() / 2];
    let is_far = |offset: f64| (offset - middle).abs() > slack_s;
    let far: Vec<_> = with.iter().zip(&offsets).filter(|(_, offset)| is_far(**offset)).collect();
    // A busy machine may delay the first samples, from which the clock is estimated.
    assert!(far.len() * 20 <= with.len(), "of {} rows by {middle} s are off: {far:?}", with.len());
    with.len()
}

#[test]
#[ignore = "needs a machine that is not busy"]
fn a_box_that_loses_doubles_delays_and_restarts_is_counted() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let (_board, port) = board(dir);
    let (at, end) = start_box();
    let arguments =
        format!("--json record {port} --start --duration 5 --reference netft:{at},bias -o log.csv");
    let recorded: Value = program::json(dir, &arguments);
    let done = end();
    let reference = &recorded["reference"];
    let count = |name: &str| reference[name].as_u64().unwrap();
    assert!(count("samples") > 3000, "{recorded}");
    // The box goes on for a moment after the recording has ended.
    for (name, done) in [
        ("missing", done.missing),
        ("late", done.late),
        ("duplicates", done.doubled),
        ("with_status", done.with_status),
        ("restarts", done.restarts),
    ] {
        assert!((done.max(1) - 1..=done).contains(&count(name)), "{name}: {done:?} {recorded}");
    }
    assert_eq!(count("restarts"), 1);
    let log = Recording::read(&dir.join("log.csv"));
    assert!(check_rows(&log, 1.6e-3) > 300);
    let status: Vec<&str> = log.text("ref_status");
    assert!(status.iter().all(|word| ["", "0", "8", "2147483652"].contains(word)), "{status:?}");
    let missing: u64 = log.text("ref_missing").iter().filter_map(|it| it.parse::<u64>().ok()).sum();
    assert!(missing <= count("missing"), "{missing}");
    let said = program::run(dir, "info log.csv", 0);
    assert!(said.contains("fx_n") || said.contains("Fx"), "{said}");
}

/// A delayed program gets old samples with the times of their measurement.
#[cfg(unix)]
#[test]
#[ignore = "needs a machine that is not busy"]
fn a_recorder_that_was_stopped_takes_no_old_sample_for_a_new_one() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let (_board, port) = board(dir);
    let (at, end) = start_box();
    let arguments = format!("record {port} --start --duration 7 --reference netft:{at} -o log.csv");
    let child = program::start(dir, &arguments);
    program::wait_for_rows(&dir.join("log.csv"), 150);
    let signal = |name: &str| {
        let id = child.id().to_string();
        assert!(std::process::Command::new("kill").args([name, &id]).status().unwrap().success());
    };
    signal("-STOP");
    thread::sleep(Duration::from_millis(1500));
    signal("-CONT");
    program::finish(child, &arguments, 0);
    end();
    let log = Recording::read(&dir.join("log.csv"));
    assert!(check_rows(&log, 2e-3) > 300);
}

#[test]
#[ignore = "needs a machine that is not busy"]
fn an_ft300_at_200_newtons_is_read_whole_and_damage_is_counted() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let (_board, port) = board(dir);
    let greet = |stream: &mut TcpStream| {
        let mut request = [0; 11];
        stream.read_exact(&mut request).unwrap();
        assert_eq!(request, ft300::START);
    };
    let at = serve_every(10, greet, |n| {
        let mut frame = ft300::encode([20_000, -1, 20_000, 250, -250, 20_000]);
        frame[9] ^= if n.is_multiple_of(50) { 4 } else { 0 };
        frame.to_vec()
    });
    let arguments = format!(
        "--json record {port} --start --duration 3 --reference ft300:tcp://{at} -o log.csv"
    );
    let recorded = program::json(dir, &arguments);
    let reference = &recorded["reference"];
    let (damaged, missing) = (&reference["damaged"], &reference["missing"]);
    assert!(damaged.as_u64().unwrap() >= 2 && damaged == missing, "{recorded}");
    let log = Recording::read(&dir.join("log.csv"));
    let fx = log.text("fx_n");
    let with = fx.iter().filter(|value| !value.is_empty()).count();
    assert!(with * 10 > log.rows() * 9, "{with} of {}", log.rows());
    assert!(fx.iter().all(|value| value.is_empty() || *value == "200"), "{fx:?}");
    assert!(log.text("mz_nm").iter().all(|value| value.is_empty() || *value == "20"));
}

#[test]
#[ignore = "needs a machine that is not busy"]
fn lines_of_a_program_are_read_with_their_units() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let (_board, port) = board(dir);
    let greet = |stream: &mut TcpStream| {
        stream.write_all(b"time_ms,seq,Fz (mN),Mx [N mm]\n").unwrap();
    };
    let at = serve_every(5, greet, |n| match n % 100 {
        0 => Vec::new(),
        _ => format!("{},{n},{},250\n", 70_000 + 5 * n, 5 * n).into_bytes(),
    });
    let arguments =
        format!("--json record {port} --start --duration 3 --reference lines:tcp:{at} -o log.csv");
    let recorded = program::json(dir, &arguments);
    assert!(recorded["reference"]["missing"].as_u64().unwrap() >= 4, "{recorded}");
    let log = Recording::read(&dir.join("log.csv"));
    let header = std::fs::read_to_string(dir.join("log.csv")).unwrap();
    let header = header.lines().next().unwrap().to_owned();
    assert!(header.contains(",s8,fz_n,mx_nm,index,") && !header.contains("fx_n"), "{header}");
    let (fz, times) = (log.text("fz_n"), log.numbers("t_s"));
    let mut offsets: Vec<f64> = fz
        .iter()
        .zip(&times)
        .filter(|(fz, _)| !fz.is_empty())
        .map(|(fz, time)| time - fz.parse::<f64>().unwrap())
        .collect();
    assert!(offsets.len() * 10 > log.rows() * 8, "{} of {}", offsets.len(), log.rows());
    offsets.sort_by(f64::total_cmp);
    let (low, high) = (offsets[offsets.len() / 20], offsets[offsets.len() * 19 / 20]);
    // An offset may be up to half a period of the reference too early or too late.
    assert!(high - low <= 8e-3, "{low} to {high}");
    assert!(log.text("mx_nm").iter().all(|value| value.is_empty() || *value == "0.25"));
}

#[cfg(unix)]
#[test]
fn a_program_is_started_and_ended() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let (_board, port) = board(dir);
    let script = "echo fx_lbf,fy_n; while true; do echo 2,-1; sleep 0.01; done";
    let mut command = program::command(dir);
    command.args(["record", &port, "--start", "--duration", "4", "-o", "log.csv", "--reference"]);
    let output = command.arg(format!("lines:{script}")).output().unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success() && said.contains("reference `lines:"), "{output:?}");
    let log = Recording::read(&dir.join("log.csv"));
    let fx = log.text("fx_n");
    assert!(fx.iter().filter(|value| **value == "8.896443230521").count() > 50, "{fx:?}");
}

#[test]
fn a_missing_reference_is_an_error_with_a_hint() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let (_board, port) = board(dir);
    // Nothing listens at port 1, which is reserved for the system.
    let said =
        program::refused(dir, &format!("record {port} -o a.csv --reference lines:tcp:127.0.0.1:1"));
    assert!(said.contains("cannot open the reference") && said.contains("hint: "), "{said}");
    let said =
        program::refused(dir, &format!("record {port} -o a.csv --reference netft:127.0.0.1:1"));
    assert!(said.contains("cannot get `netftapi2.xml`") && said.contains("hint: "), "{said}");
    let said =
        program::refused(dir, &format!("record {port} -o a.csv --reference ft300:/dev/none"));
    assert!(said.contains("/dev/none"), "{said}");
    let said = program::refused(dir, &format!("record {port} -o a.csv --reference sensor"));
    assert!(said.contains("`lines:COMMAND`"), "{said}");
    if cfg!(unix) {
        let said =
            program::refused(dir, &format!("record {port} -o a.csv --reference lines:false"));
        assert!(said.contains("the program ended") && said.contains("hint: "), "{said}");
    }
}

#[test]
#[ignore = "needs a Python with packages that read tables and bags"]
fn a_bota_sensor_is_read_by_its_own_driver() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let (_board, port) = board(dir);
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../python/examples/bota_lines.py");
    let python = program::python();
    let python = Path::new(python.get_program()).display();
    let mut command = program::command(dir);
    command.args(["--json", "record", &port, "--start", "--duration", "3", "-o", "log.csv"]);
    let source = format!("lines:exec {python} {} dummy", script.display());
    let output = command.args(["--reference", &source]).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let recorded: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(recorded["reference"]["samples"].as_u64().unwrap() > 15, "{recorded}");
    let log = Recording::read(&dir.join("log.csv"));
    let fz = log.text("fz_n");
    let fz: Vec<f64> = fz.iter().filter_map(|value| value.parse().ok()).collect();
    // The dummy sends 3 N and noise.
    assert!(fz.len() > 100 && fz.iter().all(|fz| (fz - 3.0).abs() < 1.0), "{fz:?}");
}
