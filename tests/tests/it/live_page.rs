//! `shellcal live --serve` in a headless browser, on a simulated board.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::Stdio;
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use serde_json::Value;
use simulation::simulated_board::{BoardSettings, Load, SimulatedBoard};
use system_tests::browser::Browser;
use system_tests::chromium;
use system_tests::program::{Recording, Running, command, interrupt, run, run_patiently};

use crate::page_rules::{check_rules, contrast, keep};

/// A board in this process, so that its clock can be compared with the browser's.
struct Board {
    board: SimulatedBoard,
    /// Earliest time at which its clock was zero, ms since 1970.
    from_ms: f64,
}

impl Board {
    fn start(dir: &Path) -> Self {
        let from_ms = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs_f64() * 1e3;
        let board = SimulatedBoard::start(BoardSettings::new(Load::hands(2), 2));
        let board = board.unwrap();
        // A rate that a busy machine can simulate: the board's delay is not under test.
        run_patiently(dir, &format!("board {} rate 100", board.port()), 0);
        Self { board, from_ms }
    }
}

struct Server {
    child: Running,
    address: String,
}

impl Server {
    fn start(dir: &Path, arguments: &str) -> Self {
        let child = command(dir)
            .args(arguments.split_whitespace())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn();
        let mut child = child.unwrap();
        // On a busy machine the check of the board may have something to say before.
        let mut lines = BufReader::new(child.stdout.as_mut().unwrap()).lines().map(Result::unwrap);
        let address = lines.find_map(|line| line.strip_prefix("live at ").map(str::to_owned));
        let address = address.expect("it ends without an address");
        Self { address, child: Running(child) }
    }

    /// Waits for a successful end, since the logs are complete only then.
    fn wait(mut self) {
        let deadline = SystemTime::now() + Duration::from_secs(60);
        while self.child.0.try_wait().unwrap().is_none() {
            assert!(SystemTime::now() < deadline, "it does not end");
            std::thread::sleep(Duration::from_millis(20));
        }
        assert_eq!(self.child.0.wait().unwrap().code(), Some(0));
    }
}

/// Returns the delay of every picture, from the sample of its newest row to its drawing, ms.
fn delays(browser: &mut Browser, board: &Board) -> Vec<f64> {
    let watch = "(() => { window.seen = []; const now = document.getElementById('now'); \
        new MutationObserver(() => window.seen.push([Date.now(), parseFloat(now.textContent)]))\
        .observe(now, { childList: true, characterData: true, subtree: true }); return 0; })()";
    browser.evaluate(watch);
    browser.wait_for("window.seen.length >= 100");
    let seen = browser.evaluate("window.seen");
    let delay = |pair: &Value| {
        let [drawn_ms, time_s] = [0, 1].map(|at| pair[at].as_f64().unwrap());
        drawn_ms - (board.from_ms + 1e3 * time_s)
    };
    let mut delays: Vec<f64> = seen.as_array().unwrap().iter().map(delay).collect();
    delays.sort_by(f64::total_cmp);
    delays
}

/// Distance between the right end of each trace and the displayed value, as a share of the trace's
/// height, from the pixels. Grey is the zero line.
const OFF: &str = "(() => [...document.querySelectorAll('.trace')].map((row) => {\
    const canvas = row.querySelector('canvas'), { width, height } = canvas;\
    const points = canvas.getContext('2d').getImageData(width - 6, 0, 6, height).data;\
    const rows = []; for (let y = 0; y < height; y++) for (let x = 0; x < 6; x++) {\
      const [r, g, b, a] = points.slice(4 * (6 * y + x), 4 * (6 * y + x) + 4);\
      if (a > 100 && Math.max(r, g, b) - Math.min(r, g, b) > 40) { rows.push(y); break; } }\
    const [value, scale] = [row.querySelectorAll('b span')[1], row.querySelectorAll('.quiet')[1]].map((e) => parseFloat(e.textContent.replace('−', '-').replace(/[^-+\\d.]/g, '')));\
    const expected = height * (1 - value / scale) / 2;\
    return rows.length ? Math.max(0, rows[0] - expected, expected - rows[rows.length - 1]) / height : 1; }))()";

#[test]
#[ignore = "needs Chromium"]
fn the_page_follows_the_board() {
    let chromium = chromium::find().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    run(dir, "synth train --rows 5000 --output train.csv", 0);
    run(dir, "fit --model cubic train.csv --output cal.json", 0);
    let board = Board::start(dir);
    let port = board.board.port();
    let arguments = format!("live {port} --start --calibration cal.json --output log.csv --serve");
    let server = Server::start(dir, &arguments);
    let mut browser = Browser::start(&chromium, [1400, 900], false);
    browser.visit(&server.address);
    browser.wait_for("document.querySelectorAll('.trace').length === 6 && !document.getElementById('arrows').hidden");
    assert_eq!(browser.evaluate("document.querySelectorAll('.channel').length"), 8);

    let delays = delays(&mut browser, &board);
    let [median, worst] = [delays[50], delays[delays.len() - 1]];
    println!("{median:.0} ms from a sample to its picture (median), {worst:.0} ms at most");
    // The median, since a shared machine may be late. A sample is older than its picture.
    assert!((0.0..200.0).contains(&median), "{delays:?}");

    browser.click("document.querySelector('[data-order=pause]')");
    browser.wait_for("document.getElementById('flags').textContent.includes('PAUSED')");
    browser.wait_for(
        "document.querySelector('[data-order=pause]').getAttribute('aria-pressed') === 'true'",
    );
    let off = browser.evaluate(OFF);
    let off: Vec<f64> = off.as_array().unwrap().iter().map(|off| off.as_f64().unwrap()).collect();
    // The line is 1.5 points wide on canvases of 50 and more.
    assert!(off.len() == 6 && off.iter().all(|&off| off < 0.04), "{off:?}");
    browser.press(" ");
    browser.wait_for("!document.getElementById('flags').textContent.includes('PAUSED')");

    for (order, effect) in [
        ("mark", "document.getElementById('message').textContent.startsWith('mark 1 at')"),
        ("zoom-in", "document.getElementById('from').textContent === '−5 s'"),
        ("zoom-out", "document.getElementById('from').textContent === '−10 s'"),
        ("tare", "document.getElementById('message').textContent.startsWith('taring')"),
        ("untare", "document.getElementById('message').textContent.startsWith('no tare')"),
    ] {
        browser.click(&format!("document.querySelector('[data-order={order}]')"));
        browser.wait_for(effect);
    }
    keep(&browser.screenshot(), "live-1400.png.base64");

    for (width, dark) in [(1400, false), (1024, true), (390, false), (390, true)] {
        let mut other = Browser::start(&chromium, [width, 800], width < 500);
        if dark {
            other.prefer_dark();
        }
        other.visit(&server.address);
        other.wait_for("document.querySelectorAll('.trace').length === 6");
        let beyond = "document.documentElement.scrollWidth - document.documentElement.clientWidth";
        assert_eq!(other.evaluate(beyond), 0, "{width}");
        let cut = "[...document.querySelectorAll('body *')].filter((e) => e.getBoundingClientRect().right > document.documentElement.clientWidth + 0.5).map((e) => e.outerHTML.slice(0, 80))";
        assert_eq!(other.evaluate(cut), Value::Array(Vec::new()), "{width}");
        assert!(contrast(&mut other) > 4.5, "{width}");
        let paper = other.evaluate("getComputedStyle(document.body).backgroundColor");
        assert_eq!(paper == "rgb(255, 255, 255)", !dark);
        check_rules(&mut other);
        keep(&other.screenshot(), &format!("live-{width}-{dark}.png.base64"));
        assert_eq!(other.complaints(), Vec::<String>::new(), "{width}");
    }

    browser.click("document.querySelector('[data-order=record]')");
    browser.wait_for("document.getElementById('message').textContent === 'recorded `log.csv`'");
    interrupt(&server.child.0);
    browser.wait_for("document.getElementById('state').textContent === 'the program has ended'");
    assert_eq!(browser.complaints(), Vec::<String>::new());
    let requests = browser.requests();
    let origin = server.address.split("/?").next().unwrap();
    assert!(requests.iter().all(|request| request.starts_with(origin)), "{requests:?}");

    server.wait();
    let log = Recording::read(&dir.join("log.csv"));
    let index = log.numbers("index");
    assert!(index.len() > 300, "{} rows", index.len());
    assert!(index.windows(2).all(|pair| pair[1] == pair[0] + 1.0), "a frame is lost");
    assert_eq!(log.text("flags").iter().filter(|flags| flags.contains("mark1")).count(), 1);
}

/// Shows a sitting whose force error halves with each load, from 8 N to the limit, 1 N; its upper bound is twice that.
const FOUR_LOADS: &str = "(() => { const picture = { traces: [], channels: [], marks: [], force: null, \
    window_s: 10, time_s: 0, is_paused: false, is_taring: false }; \
    const errors = [10, 11, 12, 13].map((loads, at) => ({ loads, error: [8 / 2 ** at, 0], upper: [16 / 2 ** at, 0] })); \
    const guide = { group: 'a', text: 'a', wrench: [0, 0, 0, 0, 0, 0], number: 14, count: 20, recorded: 13, \
    phase: 'hang', held: 0, remaining_gain: null, errors, limits: [1, null], finding: '' }; \
    liveView(document, async () => true).show({ picture, state: '', recording: null, can_record: false, \
    message: '', guide }); return 0; })()";

/// Returns the distance of the curve of errors from its place at each load, as a share of the height. The curve has the
/// colour of forces, mostly blue. On the logarithmic scale from 16 to 1, 8 is a quarter below the top, 1 at the bottom.
const CURVE_OFF: &str = "(() => { const canvas = document.querySelector('#errors canvas'), { width, height } = canvas; \
    const points = canvas.getContext('2d').getImageData(0, 0, width, height).data; \
    return [0, 1, 2, 3].map((at) => { const x = Math.min(width - 7, Math.max(4, Math.round(width * at / 3) - 1)); \
    const rows = []; \
    for (let y = 0; y < height; y++) { const [r, g, b, a] = points.slice(4 * (width * y + x + 1), 4 * (width * y + x + 1) + 4); \
      if (a > 100 && b - r > 60) rows.push(y); } \
    const middle = rows.reduce((sum, y) => sum + y, 0) / rows.length; \
    return rows.length ? Math.abs(middle / height - (1 + at) / 4) : 1; }); })()";

#[test]
#[ignore = "needs Chromium"]
fn a_sitting_is_led_load_by_load() {
    const LOADS: [(&str, f64, &str); 3] = [
        ("ahead", 1.5, "1.5 N at (0, 0, 0) mm, towards +x"),
        ("astern", -1.5, "1.5 N at (0, 0, 0) mm, towards −x"),
        ("less", 1.0, "1 N at (0, 0, 0) mm, towards +x"),
    ];
    let chromium = chromium::find().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let rig = "group,force_n,x_mm,y_mm,z_mm,direction\nahead,1.5,0,0,0,+x\nastern,1.5,0,0,0,-x\nless,1,0,0,0,+x\n";
    std::fs::write(dir.join("rig.csv"), rig).unwrap();
    let hung = Arc::default();
    let board = Load::Commanded(Arc::clone(&hung));
    let board = SimulatedBoard::start(BoardSettings::new(board, 2)).unwrap();
    let hang = |fx| *hung.lock().unwrap() = [fx, 0.0, 0.0, 0.0, 0.0, 0.0];
    let arguments =
        format!("calibrate {} --start --rig rig.csv --output sitting --serve", board.port());
    let mut server = Server::start(dir, &arguments);
    let mut browser = Browser::start(&chromium, [1024, 800], false);
    browser.visit(&server.address);
    let text = |id: &str| format!("document.getElementById('{id}').textContent");
    browser.wait_for("!document.getElementById('guide').hidden");
    browser.wait_for(&format!("{} === 'hang it'", text("what")));
    let size =
        browser.evaluate("parseFloat(getComputedStyle(document.getElementById('load')).fontSize)");
    assert!(size.as_f64().unwrap() > 40.0, "large type: {size}");
    for count in 1..=LOADS.len() {
        // The load appears a little after the request to hang it.
        browser.wait_for(&format!("{:?}.includes({})", LOADS.map(|(.., said)| said), text("load")));
        let asked = browser.evaluate(&text("load"));
        let (label, fx, _) = *LOADS.iter().find(|(.., said)| asked == *said).unwrap();
        hang(fx);
        browser.wait_for(&format!("{} === 'hold still'", text("what")));
        browser.wait_for(&format!("{} === 'recorded `{label}`'", text("message")));
        browser.wait_for(&format!("{}.includes('{count} recorded')", text("done")));
        hang(0.0);
        if count == 1 {
            keep(&browser.screenshot(), "calibrate-1024.png.base64");
            check_rules(&mut browser);
        }
        browser.wait_for(&format!("{} === 'hang it'", text("what")));
    }
    // Three loads are enough for a look at the page, not for a calibration.
    browser.wait_for(&format!("{}.startsWith('check: ')", text("load")));
    interrupt(&server.child.0);
    assert_eq!(server.child.0.wait().unwrap().code(), Some(1));
    browser.wait_for(&format!("{} === 'the program has ended'", text("state")));
    browser.evaluate(FOUR_LOADS);
    let moments = "document.querySelectorAll('#errors figure')[1]";
    browser.wait_for("!document.querySelector('#errors figure').hidden");
    assert_eq!(browser.evaluate(&format!("{moments}.hidden")), true, "there are none");
    let caption = browser.evaluate("document.querySelector('#errors figcaption').textContent");
    assert_eq!(caption, "error on new poses and 95 %: 8 N after 10 loads, 1 N after 13 loads");
    let off = browser.evaluate(CURVE_OFF);
    let off: Vec<f64> = off.as_array().unwrap().iter().map(|off| off.as_f64().unwrap()).collect();
    // The line is 2 points wide on a canvas of 80.
    assert!(off.len() == 4 && off.iter().all(|&off| off < 0.04), "{off:?}");
    keep(&browser.screenshot(), "calibrate-errors-1024.png.base64");
    assert_eq!(browser.complaints(), Vec::<String>::new());
    let log = Recording::read(&dir.join("sitting/session.csv"));
    let index = log.numbers("index");
    assert!(index.windows(2).all(|pair| pair[1] == pair[0] + 1.0), "a frame is lost");
    for (group, ..) in LOADS {
        let rows = log.text("group").iter().filter(|label| **label == group).count();
        // Two seconds at 100 Hz, minus frames that the view skipped on a busy machine.
        assert!((150..=260).contains(&rows), "{group}: {rows} rows");
    }
}
