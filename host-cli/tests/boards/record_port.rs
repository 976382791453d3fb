//! `shellcal record` over a pty.

use std::fs;
use std::io::{self, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use board_link::CaptureReader;
use log_file::LogError;
use serialport::{SerialPort, TTYPort};
use shared_proto::{Board, Boot, Framing, Packet, ResetCause};
use system_tests::on_the_wire;
use system_tests::program::{self, refused, start, succeed};

use crate::board::{pty, start_before_the_port};
use crate::recording::{assert_rows_are, calibration, column, frame, read_log};

/// Sends frames at 200 Hz, from the opening of the port on.
struct Sender {
    stop: Arc<AtomicBool>,
    /// Number of frames sent, also by earlier senders; and of bytes sent by this one.
    sent: Arc<AtomicU64>,
    bytes: Arc<AtomicU64>,
    thread: JoinHandle<TTYPort>,
}

impl Sender {
    fn start(mut board: TTYPort, first: u64) -> Self {
        let (stop, sent) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU64::new(first)));
        let bytes = Arc::new(AtomicU64::new(0));
        let (stopped, count, length) = (Arc::clone(&stop), Arc::clone(&sent), Arc::clone(&bytes));
        let thread = thread::spawn(move || {
            while !stopped.load(Ordering::Relaxed) {
                let frame = frame(count.load(Ordering::Relaxed));
                if board.write_all(&frame).is_ok() {
                    count.fetch_add(1, Ordering::Relaxed);
                    length.fetch_add(frame.len() as u64, Ordering::Relaxed);
                }
                thread::sleep(Duration::from_millis(5));
            }
            board
        });
        Self { stop, sent, bytes, thread }
    }

    fn sent(&self) -> u64 {
        self.sent.load(Ordering::Relaxed)
    }

    fn wait_for(&self, count: u64) {
        let deadline = Instant::now() + Duration::from_secs(20);
        while self.sent() < count {
            assert!(Instant::now() < deadline, "nobody has opened the port");
            thread::sleep(Duration::from_millis(2));
        }
    }

    fn stop(self) -> TTYPort {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }

    /// Stops, and waits until the program has read all: the file of raw bytes, flushed while it records, has
    /// grown from `length` by the bytes sent.
    fn stop_when_read(self, raw: &Path, length: u64) -> TTYPort {
        let bytes = Arc::clone(&self.bytes);
        let board = self.stop();
        let deadline = Instant::now() + Duration::from_secs(60);
        while captured(raw) < length + bytes.load(Ordering::Relaxed) {
            assert!(Instant::now() < deadline, "not all is read");
            thread::sleep(Duration::from_millis(5));
        }
        board
    }
}

fn captured(raw: &Path) -> u64 {
    let file = BufReader::new(fs::File::open(raw).unwrap());
    io::copy(&mut CaptureReader::new(file).unwrap(), &mut io::sink()).unwrap()
}

fn signal(child: &Child, name: &str) {
    let kill = std::process::Command::new("kill").args([name, &child.id().to_string()]).status();
    assert!(kill.unwrap().success());
}

#[test]
fn ctrl_c_ends_a_recording_with_every_frame_in_it() {
    let dir = tempfile::tempdir().unwrap();
    let (board, port) = pty();
    let child = start(dir.path(), &format!("record {port} -o log.csv --raw raw"));
    let sender = Sender::start(board, 0);
    sender.wait_for(100);
    let sent_count = sender.sent.clone();
    let _board = sender.stop_when_read(&dir.path().join("raw"), 0);
    signal(&child, "-INT");
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let sent = sent_count.load(Ordering::Relaxed);
    assert_rows_are(&read_log(&dir.path().join("log.csv")).unwrap(), 0..sent);
    let said = String::from_utf8(output.stdout).unwrap();
    assert!(said.starts_with(&format!("{sent} frames")) && said.ends_with("nothing lost\n"));
    succeed(dir.path(), "record --replay raw -o again.csv");
    let file = |name| fs::read(dir.path().join(name)).unwrap();
    assert_eq!(file("log.csv"), file("again.csv"));
}

#[test]
fn a_duration_ends_a_recording() {
    let dir = tempfile::tempdir().unwrap();
    let (board, port) = pty();
    let sender = Sender::start(board, 0);
    succeed(dir.path(), &format!("record {port} -o log.csv --duration 1 --framing cobs"));
    sender.stop();
    let log = read_log(&dir.path().join("log.csv")).unwrap();
    // The first frame is the first that was sent after the port was open, and none is missing.
    let first: u64 = column(&dir.path().join("log.csv"), "index")[0].parse().unwrap();
    assert!(log.rows > 10);
    assert_rows_are(&log, first..first + log.rows as u64);
}

#[test]
fn a_recording_killed_at_any_moment_keeps_all_that_was_written() {
    let kills = 100;
    let moments = (0..kills).map(|i| Duration::from_millis(300 + 2200 * (i * 7 % kills) / kills));
    let moments = Mutex::new(moments.collect::<Vec<_>>());
    thread::scope(|scope| {
        for _ in 0..10 {
            scope.spawn(|| {
                while let Some(moment) = { moments.lock().unwrap().pop() } {
                    kill_after(moment);
                }
            });
        }
    });
}

/// Kills a recording some time after its first row; the recorder's tests show how soon rows come.
fn kill_after(moment: Duration) {
    let dir = tempfile::tempdir().unwrap();
    let (board, port) = pty();
    let path = dir.path().join("log.csv");
    let mut child = start(dir.path(), &format!("record {port} -o log.csv"));
    // The program creates the log once the port is open. Do not send before: if another test's program has
    // inherited the other end, the pty keeps the frames.
    let deadline = Instant::now() + Duration::from_secs(60);
    while !path.exists() {
        assert!(Instant::now() < deadline, "nobody has opened the port");
        thread::sleep(Duration::from_millis(2));
    }
    let sender = Sender::start(board, 0);
    sender.wait_for(1);
    thread::sleep(moment);
    // A row without its end is still being written.
    let written = || fs::read_to_string(&path).unwrap().matches('\n').count().saturating_sub(1);
    while moment > Duration::from_secs(1) && written() == 0 {
        assert!(Instant::now() < deadline, "nothing is written while it records");
        thread::sleep(Duration::from_millis(5));
    }
    let written = written();
    child.kill().unwrap();
    child.wait().unwrap();
    sender.stop();
    match read_log(&path) {
        Ok(log) => {
            assert!(log.rows >= written, "{} rows, {written} were written", log.rows);
            assert_rows_are(&log, 0..log.rows as u64);
        }
        Err(LogError::Empty { .. } | LogError::NoRows { .. }) => assert_eq!(written, 0),
        Err(error) => panic!("{error}"),
    }
}

#[test]
fn an_unplugged_adapter_is_an_error_and_the_log_is_whole() {
    let dir = tempfile::tempdir().unwrap();
    let child = start_before_the_port(dir.path(), "record adapter -o log.csv --raw raw");
    let (board, port) = pty();
    std::os::unix::fs::symlink(&port, dir.path().join("adapter")).unwrap();
    let sender = Sender::start(board, 0);
    sender.wait_for(80);
    let path = dir.path().join("log.csv");
    // A log must keep every frame from its start on.
    let deadline = Instant::now() + Duration::from_secs(60);
    while !path.exists() {
        assert!(Instant::now() < deadline, "nothing is recorded");
        thread::sleep(Duration::from_millis(2));
    }
    let sent = sender.sent.clone();
    drop(sender.stop_when_read(&dir.path().join("raw"), 0));
    let output = child.wait_with_output().unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(error.contains("is gone") && error.contains("--reconnect"), "{error}");
    let log = read_log(&path).unwrap();
    assert_rows_are(&log, 0..sent.load(Ordering::Relaxed));
}

#[test]
fn an_adapter_that_comes_back_goes_on_in_the_same_log() {
    let dir = tempfile::tempdir().unwrap();
    let link = dir.path().join("adapter");
    let child =
        start_before_the_port(dir.path(), "record adapter -o log.csv --raw raw --reconnect");
    let raw = dir.path().join("raw");
    let (board, port) = pty();
    std::os::unix::fs::symlink(&port, &link).unwrap();
    let sender = Sender::start(board, 0);
    sender.wait_for(80);
    let board = sender.stop_when_read(&raw, 0);
    let length = captured(&raw);
    // Open the new pty before the old one is closed, so that it does not get the old name.
    let (again, port) = pty();
    drop(board);
    fs::remove_file(&link).unwrap();
    std::os::unix::fs::symlink(&port, &link).unwrap();
    let sender = Sender::start(again, 1000);
    sender.wait_for(1060);
    let sent = sender.sent.clone();
    let _board = sender.stop_when_read(&raw, length);
    signal(&child, "-TERM");
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let path = dir.path().join("log.csv");
    let indices: Vec<u64> =
        column(&path, "index").iter().map(|index| index.parse().unwrap()).collect();
    let after = indices.iter().position(|&index| index >= 1000).unwrap();
    assert!(after >= 80);
    let expected = (0..after as u64).chain(1000..sent.load(Ordering::Relaxed));
    assert_rows_are(&read_log(&path).unwrap(), expected);
    assert_eq!(column(&path, "missing")[after], (1000 - after).to_string());
}

#[test]
fn ports_that_cannot_be_opened_are_distinguished() {
    let dir = tempfile::tempdir().unwrap();
    let error = refused(dir.path(), "record /dev/no-such-port -o log.csv");
    assert!(error.contains("there is no port `/dev/no-such-port`"), "{error}");
    assert!(error.contains("`shellcal board` lists the ports"), "{error}");
    let (_board, port) = pty();
    let _held = serialport::new(&port, 57_600).open().unwrap();
    let error = refused(dir.path(), &format!("record {port} -o log.csv --duration 5"));
    assert!(error.contains("is in use by another program"), "{error}");
    fs::write(dir.path().join("file"), "no port").unwrap();
    let error = refused(dir.path(), "board file identify");
    assert!(error.contains("cannot open port `file`"), "{error}");
    assert!(!dir.path().join("log.csv").exists());
    assert_eq!(program::output(dir.path(), "board").status.code(), Some(0));
}

#[test]
fn a_silent_port_and_a_wrong_baud_rate_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let (mut board, port) = pty();
    let error = refused(dir.path(), &format!("record {port} -o log.csv --duration 0.3"));
    assert!(error.contains("nothing arrived") && error.contains("--start"), "{error}");
    let child = start(dir.path(), &format!("record {port} -o log.csv"));
    let began = Instant::now();
    let mut state = 7_u32;
    let noise = thread::spawn(move || {
        while began.elapsed() < Duration::from_secs(5) {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let _ = board.write_all(&state.to_le_bytes());
            thread::sleep(Duration::from_millis(5));
        }
    });
    let output = child.wait_with_output().unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(error.contains("no valid frame") && error.contains("--baud"), "{error}");
    assert!(!dir.path().join("log.csv").exists());
    noise.join().unwrap();
}

#[test]
fn a_stopped_board_is_reported() {
    let dir = tempfile::tempdir().unwrap();
    let (mut board, port) = pty();
    let child = start(dir.path(), &format!("record {port} -o log.csv --duration 1.5"));
    let boot = Boot { board: Board::Simulated, firmware: [1, 2, 3], cause: ResetCause::Power };
    let announcement = on_the_wire(&Packet::Boot(boot), Framing::Cobs);
    let began = Instant::now();
    while began.elapsed() < Duration::from_secs(1) {
        let _ = board.write_all(&announcement);
        thread::sleep(Duration::from_millis(50));
    }
    let output = child.wait_with_output().unwrap();
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(error.contains("sends no frames") && error.contains("--start"), "{error}");
    assert!(!dir.path().join("log.csv").exists());
}

/// Returns the status lines in a terminal with `columns` columns during a recording with forces.
fn live_lines(columns: usize, calibration: &str) -> Vec<String> {
    let dir = tempfile::tempdir().unwrap();
    self::calibration(dir.path());
    succeed(
        dir.path(),
        "fit training.csv --model cubic --wrench fz=fz_n,mx=mx_nm --output two.json",
    );
    let (mut user, program_end) = TTYPort::pair().unwrap();
    user.set_timeout(Duration::from_millis(10)).unwrap();
    let terminal = program_end.name().unwrap();
    let open = || fs::OpenOptions::new().read(true).write(true).open(&terminal).unwrap();
    let (board, port) = pty();
    // Without `--as-sampled` the program first waits for the channels' timing, for up to 120 frames.
    let plain = "--no-tare --as-sampled";
    // A separate session, so that this terminal is the program's.
    let mut child = std::process::Command::new("setsid")
        .args(["--ctty", "sh", "-c"])
        .arg(format!("stty rows 24 cols {columns}; exec \"$0\" \"$@\""))
        .arg(program::command(dir.path()).get_program())
        .args(format!("record {port} -o log.csv --calibration {calibration} {plain}").split(' '))
        .current_dir(dir.path())
        .env("TERM", "xterm-256color")
        .stdin(Stdio::from(open()))
        .stdout(Stdio::null())
        .stderr(Stdio::from(open()))
        .spawn()
        .unwrap();
    let sender = Sender::start(board, 0);
    let (mut shown, mut buffer, mut is_ending) = (Vec::new(), [0; 4096], false);
    let deadline = Instant::now() + Duration::from_secs(60);
    let status = loop {
        if let Ok(count) = user.read(&mut buffer) {
            shown.extend_from_slice(&buffer[..count]);
        }
        // Once a second line has forces, the first is complete.
        if !is_ending && shown.windows(2).filter(|text| text == b"Fz").count() > 1 {
            program::interrupt(&child);
            is_ending = true;
        }
        if let Some(status) = child.try_wait().unwrap() {
            break status;
        }
        assert!(Instant::now() < deadline, "it does not end");
    };
    sender.stop();
    assert!(status.success(), "{}", String::from_utf8_lossy(&shown));
    let text = String::from_utf8_lossy(&shown).into_owned();
    let mut pieces = text.split('\u{1b}');
    let mut plain = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let end = piece.find(|c: char| c.is_ascii_alphabetic()).map_or(piece.len(), |at| at + 1);
        plain.push('\r');
        plain.push_str(&piece[end..]);
    }
    // Leaves out notes: the line begins with a clock or with the forces.
    let lines = plain.split(['\r', '\n']).map(|line| line.trim_end().to_owned());
    lines.filter(|line| line.starts_with(|c: char| c.is_ascii_digit() || c == 'F')).collect()
}

#[test]
fn the_live_line_names_its_axes_and_fits_the_terminal() {
    let forces = |lines: &[String]| lines.iter().rev().find(|line| line.contains("Fz")).cloned();
    for (columns, calibration, expected, others) in [
        (
            200,
            "cal.json",
            &["Hz", "frames", "cobs", "Fx", "Fy", "Fz", "N  Mx", "Mz", "N·m"][..],
            &[][..],
        ),
        (80, "cal.json", &["Fx", "Fy", "Fz", "Mx", "My", "Mz", "N·m"], &["cobs"]),
        (80, "two.json", &["Hz", "Fz", "N  Mx"], &["Fx", "Fy", "My"]),
        (30, "two.json", &["Fz", "Mx"], &["frames"]),
    ] {
        let lines = live_lines(columns, calibration);
        let longest = lines.iter().map(|line| line.chars().count()).max().unwrap_or(0);
        assert!(longest <= columns, "{columns}: {lines:?}");
        let line = forces(&lines).unwrap_or_else(|| panic!("{columns}: no forces in {lines:?}"));
        for text in expected {
            assert!(line.contains(text), "{columns}: no `{text}` in `{line}`");
        }
        for text in others {
            assert!(!line.contains(text), "{columns}: `{text}` in `{line}`");
        }
    }
}
