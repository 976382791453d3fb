//! A simulated board over TCP, for systems without ptys.

use std::io::{BufRead, BufReader, Read};
use std::net::TcpStream;
use std::path::Path;
use std::process::Stdio;
use std::time::Duration;

use system_tests::program::{self, Recording, Running};

struct Board {
    _process: Running,
    /// `tcp://…`
    port: String,
}

impl Board {
    fn start(dir: &Path) -> Self {
        let mut command = program::command(dir);
        command.args(["board", "--simulate", "--listen", "127.0.0.1:0", "--duration", "120"]);
        let mut process = command.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut line).unwrap();
        let port = line.trim().strip_prefix("simulated board on ").unwrap().to_owned();
        Self { _process: Running(process), port }
    }
}

#[test]
fn a_board_over_tcp_works_with_board_record_and_doctor() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let board = Board::start(dir);
    let port = &board.port;
    assert!(port.starts_with("tcp://127.0.0.1:") && !port.ends_with(":0"), "{port}");
    let said = program::run_patiently(dir, &format!("board {port} identify"), 0);
    assert!(said.contains("board     simulated"), "{said}");
    program::run_patiently(dir, &format!("record {port} --start --duration 1 --output log.csv"), 0);
    let log = Recording::read(&dir.join("log.csv"));
    // 100 Hz for a second of the host's clock, fewer on a busy machine, and at most a few more.
    assert!((20..=105).contains(&log.rows()), "{}", log.rows());
    assert!(log.numbers("s1").iter().all(|&reading| reading > 0.0 && reading < 4095.0));
    let said = program::run(dir, &format!("doctor {port}"), 0);
    assert!(
        said.contains("can be opened") && said.contains("channels: 8 channels alive"),
        "{said}"
    );

    // The board serves one host at a time, and closes another connection at once.
    let address = port.strip_prefix("tcp://").unwrap();
    let first = TcpStream::connect(address).unwrap();
    // The board looks for its host every 10 ms.
    std::thread::sleep(Duration::from_millis(200));
    let mut second = TcpStream::connect(address).unwrap();
    second.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    assert_eq!(second.read(&mut [0; 16]).unwrap_or(0), 0);
    drop((first, second));
    std::thread::sleep(Duration::from_millis(200));
    program::run_patiently(dir, &format!("board {port} status"), 0);
}

#[test]
fn an_address_without_listener_is_named() {
    let dir = tempfile::tempdir().unwrap();
    // Nothing listens at port 1, one of the system's.
    let said = program::run(dir.path(), "board tcp://127.0.0.1:1 identify", 2);
    assert!(said.contains("cannot open port `tcp://127.0.0.1:1`"), "{said}");
    let said = program::run(dir.path(), "record tcp://nowhere --output log.csv", 2);
    assert!(said.contains("tcp://HOST:PORT"), "{said}");
    assert!(!dir.path().join("log.csv").exists());
    let said = program::run(dir.path(), "doctor tcp://127.0.0.1:1", 1);
    assert!(said.contains("FAULT") && said.contains("tcp://127.0.0.1:1"), "{said}");
}
