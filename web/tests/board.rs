//! A connection with a board, without a browser: pictures, bytes sent, and logs equal to those of `record`.
#![expect(clippy::unwrap_used, reason = "a test may panic and say why")]

use std::fs;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use board_link::{
    AppendWriter, EVERY_MODULE, FlowControl, PortOptions, RecordOptions, Sinks, Source, Uplink,
    record,
};
use serde_json::{Value, json};
use shared_proto::{Command, Framing, Packet, Sample, Values};
use shellcal_web::{Answer, BoardSession};
use simulation::simulated_board::{BoardSettings, Load, SimulatedBoard};

struct Page {
    session: BoardSession,
    log: Vec<u8>,
    ended: Vec<String>,
    shown: Value,
    boards: Value,
    sent: Vec<u8>,
    now_ms: f64,
}

fn begin(request: Value, files: &[&[u8]]) -> Result<Page, String> {
    let mut whole = json!({
        "name": "the port", "framing": null, "starts": true, "records": true, "logs": 0, "calibration": null,
        "plan": null,
    });
    whole.as_object_mut().unwrap().extend(request.as_object().unwrap().clone());
    let files: Vec<Arc<[u8]>> = files.iter().map(|&bytes| bytes.into()).collect();
    let (session, answer) = BoardSession::begin(whole.to_string().as_bytes(), &files);
    let session = session.ok_or_else(|| answer.document["error"].as_str().unwrap().to_owned())?;
    Ok(Page {
        session,
        log: Vec::new(),
        ended: Vec::new(),
        shown: Value::Null,
        boards: Value::Null,
        sent: serde_json::from_value(answer.document["send"].clone()).unwrap(),
        now_ms: 0.0,
    })
}

impl Page {
    /// Takes a turn; returns the bytes to send, or error and hint.
    fn turn(&mut self, bytes: &[u8], order: Option<&str>, ends: bool) -> Result<Vec<u8>, String> {
        let request = json!({
            "elapsed_ms": self.now_ms, "arrival_ms": self.now_ms, "order": order, "draws": true, "ends": ends,
        });
        let Answer { document, files } = self.session.turn(request.to_string().as_bytes(), bytes);
        for (name, piece) in files {
            assert_eq!(name, "board.csv");
            self.log.extend(piece);
        }
        self.ended
            .extend(serde_json::from_value::<Vec<String>>(document["ended"].clone()).unwrap());
        self.boards = document["boards"].clone();
        let commands: Vec<u8> = serde_json::from_value(document["send"].clone()).unwrap();
        self.sent.extend(&commands);
        if document["error"].is_string() {
            return Err(format!("{}; {}", document["error"], document["hint"]));
        }
        if !document["shown"].is_null() {
            self.shown = document["shown"].clone();
        }
        Ok(commands)
    }

    /// Feeds bytes like a port, in pieces and at the pace of 100 Hz.
    fn hear(&mut self, bytes: &[u8]) -> Result<(), String> {
        for piece in bytes.chunks(97) {
            self.now_ms += 33.0;
            self.turn(piece, None, false)?;
        }
        Ok(())
    }
}

fn frames(from: u16, count: u16, reading: impl Fn(u16) -> u16) -> Vec<u8> {
    let sample = |sequence: u16| Sample {
        sequence,
        clock_us: u32::from(sequence) * 10_000,
        values: Values::Readings([reading(sequence); 8]),
        saturated: 0,
        dropped: 0,
    };
    (from..from + count).flat_map(|n| Packet::Sample(sample(n)).encode().to_vec()).collect()
}

#[test]
fn a_log_equals_that_of_record_byte_for_byte() {
    // Missing frames, some late ones, and noise in between.
    let [one, two, three] =
        [(0, 400), (400, 50), (460, 300)].map(|(from, count)| frames(from, count, |n| 16_000 + n));
    let bytes = [&one[..], &three[..900], b"\x01noise\x00", &two, &three[900..]].concat();
    let dir = tempfile::tempdir().unwrap();
    let [raw, log] = ["raw", "log.csv"].map(|name| dir.path().join(name));
    fs::write(&raw, &bytes).unwrap();
    let sink = Box::new(AppendWriter::create(&log, false).unwrap());
    let sinks = Sinks { log: Some(sink), ..Sinks::default() };
    let mut source = Source::replay(&raw).unwrap();
    record(&mut source, sinks, &RecordOptions::default(), &AtomicBool::new(false), &mut |_| {})
        .unwrap();
    let expected = fs::read(&log).unwrap();
    // The `late` flag depends on when a piece was written: all frames are in one piece, as in a replay.
    let mut page = begin(json!({}), &[]).unwrap();
    page.turn(&bytes, None, false).unwrap();
    page.turn(&[], None, true).unwrap();
    assert_eq!(String::from_utf8(page.log).unwrap(), String::from_utf8(expected).unwrap());
    assert_eq!(page.ended, ["board.csv"]);
}

#[test]
fn a_board_is_named_started_shown_and_stopped() {
    let board = SimulatedBoard::start(BoardSettings::new(Load::hands(2), 2)).unwrap();
    let options = PortOptions {
        port: board.port().to_owned(),
        baud: 57_600,
        flow_control: FlowControl::None,
    };
    let mut port = options.open().unwrap();
    let mut page = begin(json!({ "framing": "cobs" }), &[]).unwrap();
    port.write_all(&page.sent).unwrap();
    let (began, mut buffer) = (Instant::now(), [0; 4096]);
    let is_shown =
        |page: &Page| page.shown["picture"]["time_s"].as_f64().is_some_and(|time_s| time_s > 2.0);
    while !is_shown(&page) || page.boards[0].is_null() {
        // A limit for a broken board, not an expected duration.
        assert!(began.elapsed() < Duration::from_secs(120), "{} {}", page.shown, page.boards);
        let count = port.read(&mut buffer).unwrap_or(0);
        page.now_ms = began.elapsed().as_secs_f64() * 1e3;
        let commands = page.turn(&buffer[..count], None, false).unwrap();
        port.write_all(&commands).unwrap();
    }
    assert_eq!(page.boards[0]["board"], "simulated");
    assert_eq!(page.shown["recording"], "board.csv");
    assert_eq!(page.shown["picture"]["channels"].as_array().unwrap().len(), 8);
    assert!(page.shown["state"].as_str().unwrap().starts_with("cobs"), "{}", page.shown["state"]);
    let commands = page.turn(&[], None, true).unwrap();
    port.write_all(&commands).unwrap();
    // After the stop command, no data follow the pending frames.
    let (mut silent, stopped) = (0, Instant::now());
    while silent < 20 {
        assert!(stopped.elapsed() < Duration::from_secs(120), "it goes on");
        silent = if port.read(&mut buffer).unwrap_or(0) == 0 { silent + 1 } else { 0 };
    }
    let text = String::from_utf8(page.log).unwrap();
    // Two seconds at 100 Hz, half of which a busy machine may lose.
    assert!(text.lines().count() > 100, "{text}");
    assert!(text.starts_with("t_s,s1,"), "{text}");
}

#[test]
fn loads_that_are_held_are_labelled_while_a_log_is_made_and_ended() {
    let plan = b"group,force_n,x_mm,y_mm,z_mm,direction\nahead,1.5,0,0,0,+x\nastern,1.5,0,0,0,-x\n";
    let mut page = begin(json!({ "plan": { "name": "plan.csv", "file": 0 } }), &[plan]).unwrap();
    // No load, a load for 5 s, none for 3 s, another.
    let noise = |n: u16| [16_000, 16_016, 15_984][usize::from(n % 3)];
    let load = |n: u16| match n {
        300..800 => noise(n) + 4000,
        1100.. => noise(n) - 4000,
        _ => noise(n),
    };
    page.hear(&frames(0, 1700, load)).unwrap();
    assert_eq!(page.shown["guide"]["phase"], "done", "{}", page.shown["guide"]);
    page.turn(&[], Some("record"), false).unwrap();
    assert_eq!(page.shown["message"], "recorded `board.csv`");
    page.now_ms += 500.0;
    page.turn(&[], None, false).unwrap();
    assert_eq!(page.ended, ["board.csv"]);
    let text = String::from_utf8(page.log.clone()).unwrap();
    for label in ["ahead", "astern"] {
        let held = text.lines().filter(|line| line.contains(label)).count();
        // 2 s at 100 Hz, plus the ends.
        assert!((195..=260).contains(&held), "{label}: {held} rows");
    }
    page.turn(&[], None, true).unwrap();
    assert_eq!(page.ended, ["board.csv"], "a log ends once");
}

#[test]
fn impossible_requests_are_refused_and_received_frames_kept() {
    let refused = |request, files: &[&[u8]]| begin(request, files).map(drop).unwrap_err();
    assert_eq!(refused(json!({ "framing": "morse" }), &[]), "there is no framing `morse`");
    let plan = json!({ "plan": { "name": "plan.csv", "file": 0 } });
    let fault = refused(plan, &[b"group,mass\na,b\n"]);
    assert!(fault.starts_with("`plan.csv`: line "), "{fault}");
    let calibration = json!({ "calibration": { "name": "cal.json", "file": 0 } });
    assert!(refused(calibration, &[b"{}"]).starts_with("`cal.json`: "));

    let mut page = begin(json!({}), &[]).unwrap();
    let noise: Vec<u8> = (0..3000_u32).map(|n| (n * n % 251) as u8 + 1).collect();
    page.turn(&noise, None, false).unwrap();
    page.now_ms = 4000.0;
    let error = page.turn(&noise, None, false).unwrap_err();
    assert!(error.contains("no valid frame") && error.contains("--baud"), "{error}");
    assert_eq!((page.log.len(), page.ended.len()), (0, 0), "there is nothing to keep");
    let uplink = Uplink { framing: Framing::Cobs, to: EVERY_MODULE };
    assert!(page.sent.ends_with(&uplink.encode(1, None, Command::Stop)), "the board streams on");

    let mut page = begin(json!({}), &[]).unwrap();
    assert!(page.turn(&[], None, true).unwrap_err().contains("nothing arrived"));
}
