//! `shellcal live` in a terminal: a pty whose other end plays the user.

use std::fs::{self, File, OpenOptions};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use serialport::{SerialPort, TTYPort};
use system_tests::program::{self, Recording, Running, succeed};

/// A screen that knows the view's sequences: cursor moves and text.
struct Screen {
    cells: Vec<Vec<char>>,
    at: (usize, usize),
    /// The last bytes, which are not a complete sequence or character yet.
    rest: Vec<u8>,
    bytes: Vec<u8>,
}

impl Screen {
    fn new(columns: usize, rows: usize) -> Self {
        let cells = vec![vec![' '; columns]; rows];
        Self { cells, at: (0, 0), rest: Vec::new(), bytes: Vec::new() }
    }

    fn take(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
        self.rest.extend_from_slice(bytes);
        let whole = match std::str::from_utf8(&self.rest) {
            Ok(_) => self.rest.len(),
            Err(error) => error.valid_up_to(),
        };
        let text = String::from_utf8(self.rest[..whole].to_vec()).unwrap();
        let mut used = 0;
        let mut characters = text.char_indices().peekable();
        while let Some((start, character)) = characters.next() {
            if character != '\u{1b}' {
                used = start + character.len_utf8();
                self.put(character);
                continue;
            }
            // ESC [ parameters letter.
            let mut sequence = String::new();
            let is_final = |c: char| c.is_ascii_alphabetic();
            let mut end = None;
            for (at, c) in characters.by_ref() {
                sequence.push(c);
                if is_final(c) {
                    end = Some(at + 1);
                    break;
                }
            }
            let Some(end) = end else { break };
            used = end;
            self.obey(&sequence);
        }
        self.rest.drain(..used);
    }

    fn put(&mut self, character: char) {
        let (row, column) = self.at;
        if let Some(cell) = self.cells.get_mut(row).and_then(|cells| cells.get_mut(column)) {
            *cell = character;
        }
        self.at.1 += 1;
    }

    fn obey(&mut self, sequence: &str) {
        let parameters = sequence.trim_start_matches('[').trim_end_matches(char::is_alphabetic);
        let numbers: Vec<usize> =
            parameters.split(';').map(|number| number.parse().unwrap_or(1)).collect();
        match sequence.chars().last() {
            Some('H') => {
                let column = numbers.get(1).copied().unwrap_or(1);
                self.at = (numbers[0] - 1, column - 1);
            }
            Some('J') => self.cells.iter_mut().flatten().for_each(|cell| *cell = ' '),
            _ => {}
        }
    }

    fn text(&self) -> String {
        let line = |cells: &Vec<char>| cells.iter().collect::<String>().trim_end().to_owned();
        self.cells.iter().map(line).collect::<Vec<_>>().join("\n")
    }

    fn is_styled(&self) -> bool {
        let text = String::from_utf8_lossy(&self.bytes).into_owned();
        let starts = text.match_indices("\u{1b}[").map(|(at, _)| &text[at + 2..]);
        let sequences = starts.filter_map(|rest| {
            let end = rest.find(|c: char| c.is_ascii_alphabetic())?;
            rest[end..].starts_with('m').then(|| rest[..end].to_owned())
        });
        // Sequences that only reset styles do not count.
        let takes_back = |s: &String| ["", "0", "39", "49", "59", "39;49"].contains(&s.as_str());
        sequences.into_iter().any(|sequence| !takes_back(&sequence))
    }
}

struct Terminal {
    user: TTYPort,
    /// Keeps the terminal until the test has read all.
    _program_end: TTYPort,
    child: Child,
    screen: Screen,
    errors: PathBuf,
}

impl Terminal {
    fn start(dir: &Path, arguments: &str, environment: &[(&str, &str)]) -> Self {
        Self::of_size((80, 24), dir, &format!("live {arguments}"), environment)
    }

    /// Starts a view in a terminal that reports this size; the program's end reports 80 by 24.
    fn of_size(
        (columns, rows): (u16, u16),
        dir: &Path,
        arguments: &str,
        environment: &[(&str, &str)],
    ) -> Self {
        let (mut user, program_end) = TTYPort::pair().unwrap();
        user.set_timeout(Duration::from_millis(10)).unwrap();
        let name = program_end.name().unwrap();
        let open = || OpenOptions::new().read(true).write(true).open(&name).unwrap();
        let errors = dir.join("errors.txt");
        // A separate session, so that this terminal is the view's `/dev/tty`.
        let child = Command::new("setsid")
            .args(["--ctty", "sh", "-c"])
            .arg(format!("stty rows {rows} cols {columns}; exec \"$0\" \"$@\""))
            .arg(program::command(dir).get_program())
            .args(arguments.split_whitespace())
            .current_dir(dir)
            .env("TERM", "xterm-256color")
            .env("LC_ALL", "C.UTF-8")
            .env_remove("NO_COLOR")
            .envs(environment.iter().copied())
            .stdin(Stdio::from(open()))
            .stdout(Stdio::from(open()))
            .stderr(Stdio::from(File::create(&errors).unwrap()))
            .spawn()
            .unwrap();
        let screen = Screen::new(80, 24);
        Self { user, _program_end: program_end, child, screen, errors }
    }

    fn look(&mut self) -> String {
        let mut buffer = [0; 4096];
        if let Ok(count) = self.user.read(&mut buffer) {
            self.screen.take(&buffer[..count]);
        }
        self.screen.text()
    }

    fn wait_for(&mut self, what: &str) {
        self.wait_until(what, |screen| screen.contains(what));
    }

    fn wait_until(&mut self, what: &str, is_so: impl Fn(&str) -> bool) {
        let deadline = Instant::now() + Duration::from_secs(60);
        loop {
            let screen = self.look();
            if is_so(&screen) {
                return;
            }
            let ended = self.child.try_wait().unwrap();
            let said = fs::read_to_string(&self.errors).unwrap();
            assert!(ended.is_none(), "ended without `{what}`: {said}\n{screen}");
            assert!(Instant::now() < deadline, "no `{what}`:\n{screen}");
        }
    }

    fn press(&mut self, key: &str) {
        self.user.write_all(key.as_bytes()).unwrap();
    }

    /// Waits for the end; returns exit code, text after the screen was restored, and screen.
    fn end(mut self) -> (Option<i32>, String, Screen) {
        let deadline = Instant::now() + Duration::from_secs(60);
        let status = loop {
            self.look();
            if let Some(status) = self.child.try_wait().unwrap() {
                break status;
            }
            assert!(Instant::now() < deadline, "it does not end");
        };
        (0..5).for_each(|_| drop(self.look()));
        let text = String::from_utf8_lossy(&self.screen.bytes).into_owned();
        // The sequence that leaves the second screen.
        let after = text.rsplit("\u{1b}[?1049l").next().unwrap_or_default().to_owned();
        let said = after + &fs::read_to_string(&self.errors).unwrap();
        (status.code(), said, self.screen)
    }
}

pub(crate) struct Board {
    _process: Running,
}

impl Board {
    pub(crate) fn start(dir: &Path) -> Self {
        Self::start_at(dir, 1000)
    }

    /// A low rate prevents losses: a pty keeps only some hundred frames for a program that a busy machine delays.
    pub(crate) fn start_at(dir: &Path, rate_hz: u32) -> Self {
        let board = program::start(dir, "board --simulate --symlink board --seed 2");
        let board = Self { _process: Running(board) };
        let deadline = Instant::now() + Duration::from_secs(60);
        while !dir.join("board").exists() {
            assert!(Instant::now() < deadline, "there is no board");
            thread::sleep(Duration::from_millis(10));
        }
        for order in ["sampling --settling 25 --conversions 4", &format!("rate {rate_hz}")] {
            program::run_patiently(dir, &format!("board board {order}"), 0);
        }
        board
    }
}

fn calibrate(dir: &Path) {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data");
    let train = data.join("synthetic-train.csv");
    succeed(dir, &format!("fit --model cubic {} --output cal.json", train.display()));
}

const RIG: [(&str, [f64; 6]); 4] = [
    ("ahead", [1.5, 0.0, 0.0, 0.0, 0.0, 0.0]),
    ("astern", [-1.5, 0.0, 0.0, 0.0, 0.0, 0.0]),
    ("aport", [0.0, 1.5, 0.0, 0.0, 0.0, 0.0]),
    ("down", [0.0, 0.0, -2.0, 0.0, 0.0, 0.0]),
];

#[test]
fn a_sitting_that_is_killed_goes_on_with_the_loads_that_are_left() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let rig: String = RIG
        .iter()
        .map(|(label, load)| format!("{label},{}\n", load.map(|x| x.to_string()).join(",")))
        .collect();
    fs::write(dir.join("rig.csv"), format!("group,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n{rig}"))
        .unwrap();
    let mut board = program::command(dir)
        .args("board --simulate --load - --symlink board --seed 2".split_whitespace())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut hand = board.stdin.take().unwrap();
    let _board = Running(board);
    let mut hang = |load: [f64; 6]| {
        writeln!(hand, "{}", load.map(|x| x.to_string()).join(",")).unwrap();
    };
    let deadline = Instant::now() + Duration::from_secs(60);
    while !dir.join("board").exists() {
        assert!(Instant::now() < deadline, "there is no board");
        thread::sleep(Duration::from_millis(10));
    }
    let arguments = "calibrate board --start --rig rig.csv --output sitting";
    let mut recorded = Vec::new();
    for ends_killed in [true, false] {
        let mut view = Terminal::of_size((80, 24), dir, arguments, &[]);
        for _ in 0..2 {
            view.wait_for(": hang it");
            let is_asked = |view: &mut Terminal, label: &str| {
                view.look().contains(&format!("`{label}`: hang it"))
            };
            let (label, load) =
                *RIG.iter().find(|(label, _)| is_asked(&mut view, label)).expect("a load is asked");
            assert!(!recorded.contains(&label), "{label} again");
            hang(load);
            view.wait_for(&format!("recorded `{label}`"));
            recorded.push(label);
            hang([0.0; 6]);
        }
        if ends_killed {
            // Rows wait for labels for some seconds: a kill loses those.
            program::wait_for_rows(&dir.join("sitting/session.csv"), 1500);
            view.child.kill().unwrap();
            view.child.wait().unwrap();
            let kept = fs::read_to_string(dir.join("sitting/loads.csv")).unwrap();
            assert!(recorded.iter().all(|label| kept.contains(label)), "{kept}");
            continue;
        }
        view.press("q");
        let (code, said, _) = view.end();
        assert_eq!(code, Some(1), "{said}");
        assert!(said.contains("4 loads: too few for a calibration"), "{said}");
    }
    let rows = |name: &str, label: &str| {
        let log = Recording::read(&dir.join("sitting").join(name));
        log.text("group").iter().filter(|of| **of == label).count()
    };
    for (at, label) in recorded.iter().enumerate() {
        let log = if at < 2 { "session.csv" } else { "session-2.csv" };
        // Two seconds at 100 Hz, less rows written before a busy machine found the pose.
        assert!((50..=260).contains(&rows(log, label)), "{label}: {} rows", rows(log, label));
    }
}

#[test]
fn a_kilohertz_is_shown_and_recorded_whole_under_any_input() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    calibrate(dir);
    let _board = Board::start(dir);
    let mut view =
        Terminal::start(dir, "board --start --calibration cal.json --output log.csv", &[]);
    view.wait_for("nothing lost");
    for part in ["Fx", "Mz", "N·m", "sd ", "s8", "top", "side", "REC log.csv", "q quit", "Hz"] {
        view.wait_for(part);
    }
    // The scale of time, and a picture that stops while frames are recorded.
    view.press("-");
    view.wait_for("-20 s");
    view.press("+");
    view.press("+");
    view.wait_for("-5 s");
    view.press("m");
    view.wait_for("mark 1 at");
    view.press("t");
    view.wait_for("taring what is shown");
    view.press(" ");
    view.wait_for("PAUSED");
    // Without the header, which shows the number of frames.
    let still = |screen: &str| screen.lines().skip(1).take(20).collect::<Vec<_>>().join("\n");
    // The header is drawn first: once it has changed again, the picture below it is complete.
    for _ in 0..3 {
        let first = |screen: &str| screen.lines().next().map(str::to_owned);
        let header = first(&view.look());
        view.wait_until("more frames", |screen| first(screen) != header);
    }
    let paused = still(&view.look());
    let rows = |log: &str| fs::read_to_string(dir.join(log)).unwrap().lines().count();
    let wait_for_rows = |view: &mut Terminal, log: &str, wanted: usize| {
        let deadline = Instant::now() + Duration::from_secs(60);
        while rows(log) < wanted {
            view.look();
            assert!(Instant::now() < deadline, "`{log}` does not grow");
        }
    };
    let before = rows("log.csv");
    wait_for_rows(&mut view, "log.csv", before + 1500);
    assert_eq!(still(&view.look()), paused);
    view.press(" ");
    view.press("r");
    view.wait_for("recorded `log.csv`");
    view.press("r");
    view.wait_for("recording to `log-2.csv`");
    view.press("m");
    view.wait_for("mark 2 at");
    wait_for_rows(&mut view, "log-2.csv", 1000);
    view.press("q");
    let (code, said, _) = view.end();
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("0 frames not shown"), "{said}");
    assert!(said.contains("recorded `log-2.csv`") && said.contains("mark 2 at"), "{said}");
    for (log, mark) in [("log.csv", "mark1"), ("log-2.csv", "mark2")] {
        let log = Recording::read(&dir.join(log));
        let index = log.numbers("index");
        assert!(index.len() > 500, "{} rows", index.len());
        // A board whose line is blocked drops frames and counts them, modulo 256. Frames dropped before they are
        // numbered leave no gap in the numbers; frames dropped on the way to the line do.
        let dropped = log.numbers("dropped");
        for (index, dropped) in index.windows(2).zip(dropped.windows(2)) {
            let by_board = (dropped[1] - dropped[0]).rem_euclid(256.0);
            let lost = index[1] - index[0] - 1.0;
            assert!(lost == 0.0 || lost == by_board, "{lost} frames are lost after {}", index[0]);
        }
        let marked = log.text("flags").iter().filter(|flags| flags.contains("mark")).count();
        assert_eq!(marked, 1);
        let at = log.text("flags").iter().position(|flags| flags.contains(mark)).unwrap();
        // The marked row is the first that was not yet written at the time on the screen, or one up to half a
        // second later. The time has a resolution of 1 ms.
        let time_s = log.numbers("t_s")[at];
        let name = format!("{} at ", mark.replace("mark", "mark "));
        let told = said.split(&name).nth(1).unwrap().split(' ').next().unwrap();
        let told_s: f64 = told.parse().unwrap();
        assert!((told_s - 0.0005..told_s + 0.5).contains(&time_s), "{time_s}: {said}");
    }
}

#[test]
fn a_log_is_played_with_and_without_colour() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    calibrate(dir);
    let log = Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data/synthetic-test.csv");
    let log = log.display().to_string();
    let play = |options: &str, environment: &[(&str, &str)]| {
        let arguments = format!("{log} --speed 100 --calibration cal.json {options}");
        let mut view = Terminal::start(dir, &arguments, environment);
        view.wait_for("played to its end");
        view.wait_for("side");
        view.press("q");
        let (code, said, screen) = view.end();
        assert_eq!(code, Some(0), "{said}");
        assert!(said.contains("800 frames"), "{said}");
        screen
    };
    assert!(play("", &[]).is_styled());
    assert!(!play("", &[("NO_COLOR", "1")]).is_styled());
    assert!(!play("--color never", &[]).is_styled());
    assert!(play("--color always", &[("NO_COLOR", "1")]).is_styled());
    // A terminal that knows ASCII only.
    let ascii = play("", &[("LC_ALL", "C")]);
    assert!(ascii.text().is_ascii(), "{}", ascii.text());
}

/// Consoles on a serial port do not report a size.
#[test]
fn a_terminal_of_unknown_size_is_taken_for_80_by_24() {
    let dir = tempfile::tempdir().unwrap();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data");
    let arguments = format!("{} --speed 100", data.join("synthetic-test.csv").display());
    let mut view = Terminal::of_size((0, 0), dir.path(), &format!("live {arguments}"), &[]);
    view.wait_for("played to its end");
    view.wait_for("q quit");
    view.press("q");
    let (code, said, _) = view.end();
    assert_eq!(code, Some(0), "{said}");
}

#[test]
fn inputs_that_cannot_be_shown_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let said = program::refused(dir.path(), "live /dev/no-such-port");
    assert!(said.contains("needs a terminal"), "{said}");
    let refused = |arguments: &str, why: &str| {
        let (code, said, _) = Terminal::start(dir.path(), arguments, &[]).end();
        assert_eq!(code, Some(2), "{said}");
        assert!(said.contains(why), "{said}");
    };
    refused("/dev/no-such-port", "there is no port");
    refused("none.csv", "cannot read `none.csv`");
    fs::write(dir.path().join("three.csv"), "t_s,s1,s2,s3\n0,1,2,3\n1,1,2,3\n").unwrap();
    refused("three.csv", "has 3 channels");
}

/// Prints the share of a core, the growth of memory, and lost frames over `SHELLCAL_LIVE_SECONDS`:
/// `cargo test -p shellcal --test boards figures_of_a_live_view -- --ignored --nocapture`.
#[test]
#[ignore = "a measurement, which takes three minutes or as long as it is told"]
fn figures_of_a_live_view() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    calibrate(dir);
    let _board = Board::start(dir);
    let seconds = std::env::var("SHELLCAL_LIVE_SECONDS");
    let seconds: u64 = seconds.map_or(180, |seconds| seconds.parse().unwrap());
    let options = "board --start --calibration cal.json --output log.csv --duration";
    let mut view = Terminal::start(dir, &format!("{options} {}", seconds + 10), &[]);
    view.wait_for("nothing lost");
    let proc = PathBuf::from(format!("/proc/{}", view.child.id()));
    let memory_kb = || {
        let status = fs::read_to_string(proc.join("status")).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
        line.trim().trim_end_matches(" kB").trim().parse::<u64>().unwrap()
    };
    let cpu_s = || {
        let stat = fs::read_to_string(proc.join("stat")).unwrap();
        let fields: Vec<&str> = stat.rsplit(") ").next().unwrap().split(' ').collect();
        // Fields 14 and 15, in ticks of 10 ms.
        (fields[11].parse::<f64>().unwrap() + fields[12].parse::<f64>().unwrap()) / 100.0
    };
    let (began, at_first) = (Instant::now(), cpu_s());
    while began.elapsed() < Duration::from_secs(seconds) {
        view.look();
        if began.elapsed().as_secs() % 20 == 0 {
            println!("{:3} s: {} kB", began.elapsed().as_secs(), memory_kb());
            let next = began.elapsed() + Duration::from_secs(1);
            while began.elapsed() < next {
                view.look();
            }
        }
    }
    let share = (cpu_s() - at_first) / began.elapsed().as_secs_f64();
    println!("{:.1} % of a core, {} kB", 100.0 * share, memory_kb());
    let (code, said, _) = view.end();
    println!("{said}");
    assert_eq!(code, Some(0));
    let index = Recording::read(&dir.join("log.csv")).numbers("index");
    assert!(index.windows(2).all(|pair| pair[1] == pair[0] + 1.0), "a frame is lost");
}
