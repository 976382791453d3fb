//! `shellcal live --serve` over a bare TCP connection: browsers and other clients.

use std::fs;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use serde_json::Value;
use system_tests::program::{self, Recording, Running, ended, succeed};
use system_tests::random::Random;

/// Timeout of every wait, far longer than any is expected to take.
const PATIENCE: Duration = Duration::from_secs(60);

struct View {
    child: Running,
    said: BufReader<std::process::ChildStdout>,
    /// `127.0.0.1:PORT`.
    at: String,
    token: String,
}

impl View {
    fn start(dir: &Path, arguments: &str) -> Self {
        let mut child = program::command(dir)
            .arg("live")
            .args(arguments.split_whitespace())
            .arg("--serve")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut said = BufReader::new(child.stdout.take().unwrap());
        let mut line = String::new();
        said.read_line(&mut line).unwrap();
        let address = line.trim_end().strip_prefix("live at http://").unwrap_or_else(|| {
            let mut errors = String::new();
            child.stderr.take().unwrap().read_to_string(&mut errors).unwrap();
            panic!("{line}{errors}")
        });
        let (at, token) = address.split_once("/?token=").unwrap();
        let (at, token) = (at.to_owned(), token.to_owned());
        Self { child: Running(child), said, at, token }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.at).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    fn ask(&self, request: impl AsRef<[u8]>) -> String {
        self.try_to_ask(request).unwrap()
    }

    fn try_to_ask(&self, request: impl AsRef<[u8]>) -> io::Result<String> {
        let mut stream = self.connect();
        stream.write_all(request.as_ref())?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer)?;
        Ok(answer)
    }

    fn request(&self, method: &str, path: &str) -> String {
        let Self { at, token, .. } = self;
        format!("{method} {path}?token={token} HTTP/1.1\r\nHost: {at}\r\n\r\n")
    }

    fn post(&self, order: &str) {
        let answer = self.ask(self.request("POST", &format!("/{order}")));
        assert!(answer.starts_with("HTTP/1.1 204 "), "{order}: {answer}");
    }

    fn listen(&self) -> Listener {
        let mut stream = self.connect();
        stream.write_all(self.request("GET", "/events").as_bytes()).unwrap();
        Listener(BufReader::new(stream))
    }

    /// Ends the run with Ctrl-C and exit code 0; returns its last messages.
    fn end(mut self) -> String {
        program::interrupt(&self.child.0);
        let mut said = String::new();
        self.said.read_to_string(&mut said).unwrap();
        let status = self.child.0.wait().unwrap();
        assert_eq!(status.code(), Some(0), "{said}");
        said
    }
}

struct Listener(BufReader<TcpStream>);

impl Listener {
    fn next(&mut self) -> Option<Value> {
        loop {
            let mut line = String::new();
            if self.0.read_line(&mut line).unwrap() == 0 {
                return None;
            }
            if let Some(data) = line.strip_prefix("data: ") {
                return Some(serde_json::from_str(data).unwrap());
            }
        }
    }

    fn wait_until(&mut self, is_so: impl Fn(&Value) -> bool) -> Value {
        let deadline = Instant::now() + PATIENCE;
        loop {
            let event = self.next().expect("events go on");
            if is_so(&event) {
                return event;
            }
            assert!(Instant::now() < deadline, "it never comes: {event}");
        }
    }
}

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data").join(name)
}

fn calibrate(dir: &Path) {
    succeed(
        dir,
        &format!("fit --model cubic {} --output cal.json", data("synthetic-train.csv").display()),
    );
}

fn status(answer: &str) -> &str {
    answer.split(' ').nth(1).unwrap_or(answer)
}

#[test]
fn events_are_the_forces_of_the_log_and_orders_are_obeyed() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    calibrate(dir);
    let log = data("synthetic-test.csv").display().to_string();
    succeed(dir, &format!("convert cal.json {log} --no-tare --no-lowpass --output wrench.csv"));
    let view =
        View::start(dir, &format!("{log} --calibration cal.json --no-tare --no-lowpass --speed 5"));
    let page = view.ask(view.request("GET", "/"));
    let (head, page) = page.split_once("\r\n\r\n").unwrap();
    assert!(head.starts_with("HTTP/1.1 200 OK\r\n"), "{head}");
    let length = format!("Content-Length: {}", page.len());
    let wanted =
        ["text/html; charset=utf-8", "default-src 'none'", "no-referrer", "no-store", &length];
    wanted.iter().for_each(|part| assert!(head.contains(part), "{part}: {head}"));
    // No other site may read anything, and the page loads nothing from any.
    assert!(!head.to_lowercase().contains("access-control"), "{head}");
    assert!(page.contains("new EventSource(") && !page.contains("http"), "{page}");
    let nonce = head.split("script-src 'nonce-").nth(1).unwrap().split('\'').next().unwrap();
    assert!(page.contains(&format!("<script nonce=\"{nonce}\">")), "{page}");

    let mut events = view.listen();
    let event = events.wait_until(|event| event["picture"]["time_s"].as_f64() > Some(6.0));
    let picture = &event["picture"];
    assert_eq!(event["can_record"], false);
    assert_eq!(picture["channels"].as_array().unwrap().len(), 8);
    // Equal to the forces of `convert`, which have a resolution of 1e-6.
    let wrench = Recording::read(&dir.join("wrench.csv"));
    let time_s = picture["time_s"].as_f64().unwrap();
    let row = wrench.numbers("t_s").iter().position(|t| (t - time_s).abs() < 1e-9).unwrap();
    let names = ["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"];
    for (trace, name) in picture["traces"].as_array().unwrap().iter().zip(names) {
        let (shown, converted) = (trace["value"].as_f64().unwrap(), wrench.numbers(name)[row]);
        assert!((shown - converted).abs() < 1e-6, "{name}: {shown}, {converted}");
        let columns = trace["columns"].as_array().unwrap();
        assert_eq!(columns.len(), 400);
        // The newest value is at the right edge, in thousandths of the range.
        let (low, high) =
            (trace["range"][0].as_f64().unwrap(), trace["range"][1].as_f64().unwrap());
        let ends = &columns[399];
        let [least, greatest] =
            [0, 1].map(|end| low + (high - low) * ends[end].as_f64().unwrap() / 1e3);
        let step = (high - low) / 1e3;
        assert!(
            least - step < shown && shown < greatest + step,
            "{name}: {shown} {least} {greatest}"
        );
    }
    view.post("zoom-in");
    events.wait_until(|event| event["picture"]["window_s"] == 5.0);
    view.post("zoom-out");
    view.post("mark");
    let marked = events.wait_until(|event| event["picture"]["marks"][0][0] == 1);
    assert!(marked["message"].as_str().unwrap().starts_with("mark 1 at"), "{marked}");
    view.post("tare");
    events.wait_until(|event| {
        event["picture"]["is_taring"] == false && {
            let fz = event["picture"]["traces"][2]["value"].as_f64().unwrap();
            event["message"].as_str().unwrap().starts_with("taring") && fz.is_finite()
        }
    });
    view.post("untare");
    view.post("record");
    events.wait_until(|event| event["message"] == "a log that is played is not recorded again");
    view.post("pause");
    let paused = events.wait_until(|event| event["picture"]["is_paused"] == true);
    for _ in 0..20 {
        assert_eq!(events.next().unwrap()["picture"], paused["picture"]);
    }
    let rest = thread::spawn(move || {
        let mut rest = String::new();
        events.0.read_to_string(&mut rest).unwrap();
        rest
    });
    let said = view.end();
    assert!(said.contains("mark 1 at") && said.contains("0 frames not shown"), "{said}");
    let rest = rest.join().unwrap();
    assert!(rest.ends_with("event: end\ndata:\n\n"), "{rest}");
}

#[test]
fn requests_without_token_or_with_another_host_name_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let log = data("synthetic-test.csv").display().to_string();
    let view = View::start(dir.path(), &format!("{log} --speed 20"));
    let View { at, token, .. } = &view;
    assert_eq!(token.len(), 32);
    let ask = |method: &str, target: &str, host: &str| {
        let answer = view.ask(format!("{method} {target} HTTP/1.1\r\nHost: {host}\r\n\r\n"));
        let is_told = answer.contains(token.as_str()) || answer.contains("\ndata:");
        assert!(!is_told, "{answer}");
        answer
    };
    let other = if token.starts_with('0') { "1" } else { "0" };
    let other = format!("{other}{}", &token[1..]);
    for (method, path) in [("GET", "/"), ("GET", "/events"), ("POST", "/pause")] {
        for query in [
            "",
            "?token=",
            "?token",
            "?x=1",
            &format!("?token={other}"),
            &format!("?token={token}0"),
        ] {
            assert_eq!(status(&ask(method, &format!("{path}{query}"), at)), "403", "{path}{query}");
        }
        // Another site's name that resolves to this machine.
        for host in ["evil.example", "evil.example:80", "127.0.0.1.evil.example", ""] {
            let target = format!("{path}?token={token}");
            assert_eq!(status(&ask(method, &target, host)), "421", "{path} {host}");
        }
    }
    let port = at.rsplit(':').next().unwrap();
    for host in
        [at.clone(), format!("localhost:{port}"), format!("[::1]:{port}"), "127.0.0.1".to_owned()]
    {
        assert_eq!(status(&ask("GET", &format!("/?token={token}"), &host)), "200", "{host}");
    }
    let event = view.listen().next().unwrap();
    assert_eq!(event["picture"]["is_paused"], false);
    assert_eq!(event["message"], "");
    assert!(at.starts_with("127.0.0.1:"), "{at}");
    view.end();
}

#[test]
fn malformed_requests_are_refused_and_harmless() {
    let dir = tempfile::tempdir().unwrap();
    let log = data("synthetic-test.csv").display().to_string();
    let view = View::start(dir.path(), &format!("{log} --speed 20"));
    let View { at, token, .. } = &view;
    // A client that never ends its request gets an error after a timeout.
    let mut slow = view.connect();
    slow.write_all(b"GET / HTTP/1.1\r\nHos").unwrap();
    let long = format!("GET / HTTP/1.1\r\nHost: {at}\r\nX: {}\r\n\r\n", "x".repeat(20_000));
    let with = |method: &str, path: &str, headers: &str| {
        format!("{method} {path}?token={token} HTTP/1.1\r\nHost: {at}\r\n{headers}\r\n")
    };
    let cases = [
        ("\r\n\r\n".to_owned(), "400"),
        ("hello\r\n\r\n".to_owned(), "400"),
        (format!("GET /?token={token} HTTP/1.1\r\n\r\n"), "400"),
        (format!("GET /?token={token} HTTP/1.0\r\n\r\n"), "505"),
        (long, "431"),
        (with("GET", "/secret", ""), "404"),
        (with("GET", "/../../etc/passwd", ""), "404"),
        (with("GET", "/mark", ""), "405"),
        (with("POST", "/", ""), "405"),
        (with("POST", "/format-disk", ""), "404"),
        (with("OPTIONS", "/mark", ""), "405"),
        (with("POST", "/mark", "Content-Length: 3\r\n"), "413"),
        (with("POST", "/mark", "Transfer-Encoding: chunked\r\n"), "413"),
        (with("GET", "/", "Host: evil.example\r\n"), "400"),
    ];
    for (request, wanted) in &cases {
        let answer = view.ask(request);
        assert_eq!(status(&answer), *wanted, "{request:.60}: {answer}");
    }
    let mut answer = String::new();
    slow.read_to_string(&mut answer).unwrap();
    assert_eq!(status(&answer), "408", "{answer}");
    let mut random = Random(20);
    for _ in 0..200 {
        let mut bytes = with("GET", "/events", "Accept: */*\r\n").into_bytes();
        for _ in 0..random.below(8) {
            let at = random.below(bytes.len() as u64) as usize;
            bytes[at] = random.bits(8) as u8;
        }
        bytes.truncate(random.below(bytes.len() as u64 + 1) as usize);
        view.connect().write_all(&bytes).unwrap();
    }
    // Clients that left freed their seats. Without a seat, a client is refused and tries again.
    let is_served =
        || view.try_to_ask(with("GET", "/", "")).is_ok_and(|answer| status(&answer) == "200");
    let wait_for_a_seat = || {
        let deadline = Instant::now() + PATIENCE;
        while !is_served() {
            assert!(Instant::now() < deadline, "seats are kept");
        }
    };
    wait_for_a_seat();
    let mut seats = Vec::new();
    while is_served() {
        seats.push(view.listen());
        assert!(seats.len() < 100, "there is no end of seats");
        // A client has its seat once it is answered.
        let mut first = String::new();
        _ = seats.last_mut().unwrap().0.read_line(&mut first);
    }
    drop(seats);
    wait_for_a_seat();
    view.end();
}

#[test]
fn listeners_that_read_nothing_cost_the_log_no_frame() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    calibrate(dir);
    let _board = crate::live::Board::start_at(dir, 100);
    let view = View::start(dir, "board --start --calibration cal.json --output log.csv");
    // These clients request events but read none, until the system's buffers for them are full.
    let stuck: Vec<_> = (0..3).map(|_| view.listen()).collect();
    let mut events = view.listen();
    let time_s = |event: &Value| event["picture"]["time_s"].as_f64();
    let first = events.wait_until(|event| time_s(event).is_some());
    let from_s = time_s(&first).unwrap();
    let event = events.wait_until(|event| time_s(event) > Some(from_s + 4.0));
    assert_eq!((&event["recording"], &event["can_record"]), (&"log.csv".into(), &true.into()));
    assert!(event["state"].as_str().unwrap().contains("nothing lost"), "{event}");
    view.post("record");
    events.wait_until(|event| event["recording"].is_null());
    view.post("record");
    events.wait_until(|event| event["recording"] == "log-2.csv");
    program::wait_for_rows(&dir.join("log-2.csv"), 400);
    let said = view.end();
    drop(stuck);
    assert!(said.contains("0 frames not shown"), "{said}");
    for log in ["log.csv", "log-2.csv"] {
        let index = Recording::read(&dir.join(log)).numbers("index");
        assert!(index.len() >= 400, "{} rows", index.len());
        assert!(index.windows(2).all(|pair| pair[1] == pair[0] + 1.0), "a frame is lost");
    }
}

#[test]
fn views_that_cannot_be_served_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let log = data("synthetic-test.csv").display().to_string();
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let at = taken.local_addr().unwrap();
    let refused = |arguments: &str, why: &str| {
        let said = program::refused(dir.path(), &format!("live {arguments}"));
        assert!(said.contains(why), "{said}");
    };
    refused(&format!("{log} --serve={at}"), &format!("cannot listen at {at}"));
    refused(&format!("{log} --serve=somewhere"), "invalid value 'somewhere'");
    refused("none.csv --serve", "cannot read `none.csv`");
    let serve = format!("live {log} --serve=0.0.0.0:0 --duration 0.2 --json");
    let (printed, said) = ended(&dir, &serve, 0);
    assert!(said.contains("not encrypted"), "{said}");
    let document: Value = serde_json::from_str(&printed).unwrap();
    let address = document["address"].as_str().unwrap();
    assert!(address.starts_with("http://") && !address.contains("0.0.0.0"), "{address}");
    assert!(fs::read_dir(dir.path()).unwrap().next().is_none());
}
