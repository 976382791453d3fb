//! A report of trials in a headless browser: without requests, by keyboard, on a phone, on paper.
use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use system_tests::browser::Browser;
use system_tests::chromium;
use system_tests::program::run;

use crate::page_rules::{check_page, check_rules, contrast, keep};

/// Would do harm as markup, or as a tag of the plotting library.
const NASTY: &str = "<img src=x onerror=alert(1)></script><b>";

/// Ten trials in all five conditions.
fn report(dir: &Path) -> PathBuf {
    run(dir, "synth trials trials --per-condition 2", 0);
    run(dir, "synth train --rows 5000 --output train.csv", 0);
    run(dir, "fit --model cubic train.csv --output calibration.json", 0);
    // One more trial, with texts that must be shown literally, and one whose log is missing.
    let log = format!("{}.txt", NASTY.replace('/', "_"));
    fs::copy(dir.join("trials/free-1.txt"), dir.join("trials").join(&log)).unwrap();
    let manifest = fs::read_to_string(dir.join("trials/manifest.csv")).unwrap();
    let (header, rows) = manifest.split_once('\n').unwrap();
    let rows: String = rows.lines().map(|row| format!("{row},\n")).collect();
    let more = format!("\"{log}\",\"{NASTY}\",2.3,7.9,\"{NASTY}\"\nmissing{NASTY},free,1,2,\n");
    fs::write(dir.join("trials/manifest.csv"), format!("{header},notes\n{rows}{more}")).unwrap();
    run(dir, "report trials/manifest.csv --calibration calibration.json --output report.html", 1);
    dir.join("report.html")
}

fn open(chromium: &str, report: &Path, size: [u32; 2], mobile: bool) -> Browser {
    let mut browser = Browser::start(chromium, size, mobile);
    browser.open(report);
    browser.wait_for("document.documentElement.dataset.plots === 'drawn'");
    browser
}

#[test]
#[ignore = "needs Chromium"]
fn a_report_works_in_a_browser() {
    let chromium = chromium::find().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let report = report(dir.path());
    let mut browser = open(&chromium, &report, [1200, 900], false);

    // The effect, six box plots, two phase plots, two plots of the open trial.
    assert_eq!(
        browser.evaluate("document.querySelectorAll('.js-plotly-plot .main-svg').length > 0"),
        true
    );
    let drawn = browser.evaluate("[...document.querySelectorAll('.js-plotly-plot')].filter((p) => p.querySelector('.trace, .boxes, .scatterlayer .lines')).length");
    assert_eq!(drawn, 11);
    // Each is described for users without sight, and none is empty.
    let described = "[...document.querySelectorAll('.plot')].every((p) => p.getAttribute('role') === 'group' && p.getAttribute('aria-label').length > 20)";
    assert_eq!(browser.evaluate(described), true);

    let shown = browser.evaluate("[...document.querySelectorAll('td')].filter((c) => c.textContent.includes('onerror')).length > 0");
    assert_eq!(shown, true);
    assert_eq!(browser.evaluate("document.querySelectorAll('main img, main b').length"), 0);

    let button = "document.querySelector('#forces-0').parentNode.querySelector('.keys button')";
    let visible = "document.querySelector('#forces-0').data[0].visible !== false && document.querySelectorAll('#forces-0 .scatterlayer .trace').length === 4";
    let pressed = format!("{button}.getAttribute('aria-pressed')");
    assert_eq!(browser.evaluate(visible), true);
    browser.click(button);
    browser.wait_for("document.querySelectorAll('#forces-0 .scatterlayer .trace').length === 3");
    assert_eq!(browser.evaluate(&pressed), "false");
    browser.click(button);
    browser.wait_for(visible);

    // The space bar does the same; the button shows the focus.
    browser.evaluate(&format!("{button}.focus()"));
    browser.press(" ");
    browser.wait_for(&format!("{pressed} === 'false'"));
    browser.press("Tab");
    let next = browser.evaluate("document.activeElement.tagName === 'BUTTON' && getComputedStyle(document.activeElement).outlineStyle");
    assert_eq!(next, "solid");

    let range = "document.querySelector('#forces-0')._fullLayout.xaxis.range";
    let before = browser.evaluate(range);
    let by_label = |label: &str| {
        format!(
            "[...document.querySelector('#forces-0').parentNode.querySelectorAll('.keys button')].find((b) => b.textContent === '{label}')"
        )
    };
    browser.click(&by_label("+"));
    let width = |range: &Value| range[1].as_f64().unwrap() - range[0].as_f64().unwrap();
    let zoomed = browser.evaluate(range);
    assert!((width(&zoomed) / width(&before) - 0.5).abs() < 1e-6, "{before} {zoomed}");
    browser.click(&by_label("reset"));
    browser.wait_for(&format!("Math.abs({range}[0] - {}) < 1e-6", before[0]));

    browser.click("document.querySelectorAll('details[data-trial] > summary')[3]");
    browser.wait_for("!!document.querySelector('#forces-3.js-plotly-plot') && !!document.querySelector('#stack-3.js-plotly-plot')");

    assert!(contrast(&mut browser) > 4.5);
    check_rules(&mut browser);

    // Every frame of the trial, with a header.
    browser.evaluate(
        "const make = URL.createObjectURL; URL.createObjectURL = (blob) => { blob.text().then((text) => { window.saved = text; }); return make.call(URL, blob); }; 0",
    );
    browser.click(&by_label("data"));
    browser.wait_for("typeof window.saved === 'string'");
    let saved = browser.evaluate("window.saved");
    let saved = saved.as_str().unwrap();
    assert!(saved.starts_with("t_s,drag_n,lift_n"), "{}", &saved[..60]);
    let frames = browser.evaluate("document.querySelector('#forces-0').data[0].x.length");
    assert_eq!(saved.lines().count() as u64, frames.as_u64().unwrap() + 1);

    keep(&browser.screenshot(), "report.png.base64");
    keep(&browser.print(), "report.pdf.base64");
    assert_eq!(browser.complaints(), Vec::<String>::new());
    assert_eq!(browser.requests(), Vec::<String>::new());
}

/// The effect comes first, the tables fit, and one that does not shows that it continues.
#[test]
#[ignore = "needs Chromium"]
fn a_report_answers_first_and_cuts_nothing_without_a_cue() {
    let chromium = chromium::find().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    run(dir, "synth trials trials", 0);
    run(dir, "synth train --rows 5000 --output train.csv", 0);
    run(dir, "fit --model cubic train.csv --output calibration.json", 0);
    let report = "report trials/manifest.csv --calibration calibration.json --reference free --output report.html";
    run(dir, report, 0);
    let report = dir.join("report.html");
    assert!(fs::metadata(&report).unwrap().len() < 4_000_000);
    for (width, dark) in [(1400, false), (1024, true), (390, false)] {
        let mut browser = Browser::start(&chromium, [width, 900], width < 500);
        if dark {
            browser.prefer_dark();
        }
        browser.open(&report);
        browser.wait_for("document.documentElement.dataset.plots === 'drawn'");
        assert_eq!(browser.evaluate("document.querySelector('main h2').id"), "effect");
        let effect = browser.evaluate("document.querySelector('section').innerText");
        let effect = effect.as_str().unwrap();
        assert!(effect.contains("drag energy (mJ)") && effect.contains(" ± "), "{effect}");
        assert!(effect.contains("Drag energy per trial differs from that of free"), "{effect}");
        // Shadows at the sides of a table's box show that it is wider.
        let cut = "[...document.querySelectorAll('.table')].filter((t) => t.scrollWidth > t.clientWidth + 1 && !getComputedStyle(t).backgroundImage.includes('gradient')).length";
        assert_eq!(browser.evaluate(cut), 0);
        let wider = "[...document.querySelectorAll('section > .table')].filter((t) => t.scrollWidth > t.clientWidth + 1).map((t) => t.getAttribute('aria-label')).join()";
        if width >= 1000 {
            assert_eq!(browser.evaluate(wider), "", "{width}");
        }
        check_page(&mut browser, width);
        let paper = browser.evaluate("getComputedStyle(document.body).backgroundColor");
        assert_eq!(paper == "rgb(255, 255, 255)", !dark);
        keep(&browser.screenshot(), &format!("report-{width}.png.base64"));
        assert_eq!(browser.complaints(), Vec::<String>::new());
    }
}

#[test]
#[ignore = "needs Chromium"]
fn a_report_fits_on_a_phone() {
    let chromium = chromium::find().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let report = report(dir.path());
    let mut browser = open(&chromium, &report, [360, 740], true);
    // Only tables are wider than the screen, and they scroll separately.
    assert_eq!(browser.evaluate("document.documentElement.scrollWidth"), 360);
    let widest = browser.evaluate("Math.max(...[...document.querySelectorAll('.plot .main-svg')].map((p) => p.getBoundingClientRect().right))");
    assert!(widest.as_f64().unwrap() <= 360.0, "{widest}");
    keep(&browser.screenshot(), "phone.png.base64");
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

#[test]
#[ignore = "needs Chromium"]
fn the_report_of_a_calibration_can_be_read_at_any_width() {
    let chromium = chromium::find().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    run(dir, "synth train --rows 5000 --output train.csv", 0);
    run(dir, "synth test --rows 2000 --output test.csv", 0);
    run(dir, "fit train.csv --test test.csv --model auto --report fit.html", 0);
    let report = dir.join("fit.html");
    let size = fs::metadata(&report).unwrap().len();
    assert!(size < 4_000_000, "{size}");
    for (width, dark) in [(1400, false), (1024, true), (390, false)] {
        let mut browser = Browser::start(&chromium, [width, 900], width < 500);
        if dark {
            browser.prefer_dark();
        }
        browser.open(&report);
        let headings =
            browser.evaluate("[...document.querySelectorAll('h2')].map((h) => h.id).join(' ')");
        assert_eq!(headings, "answer limits figure coverage held-out groups model outliers origin");
        // Including clipped content.
        let drawn = browser.evaluate("[...document.querySelectorAll('.drawing svg')].every((s) => s.getBBox().width > 700 && [...s.querySelectorAll('[clip-path]')].every((g) => document.getElementById(g.getAttribute('clip-path').slice(5, -1))?.closest('svg') === s))");
        assert_eq!(drawn, true);
        // Errors, coverage, and held-out rows against load and time.
        assert_eq!(browser.evaluate("document.querySelectorAll('.drawing svg').length"), 4);
        let cut = "[...document.querySelectorAll('.table')].filter((t) => t.scrollWidth > t.clientWidth + 1 && !getComputedStyle(t).backgroundImage.includes('gradient')).map((t) => t.getAttribute('aria-label')).join()";
        assert_eq!(browser.evaluate(cut), "");
        if width >= 1000 {
            let wider = "[...document.querySelectorAll('.table')].filter((t) => t.scrollWidth > t.clientWidth + 1).map((t) => t.getAttribute('aria-label')).join()";
            assert_eq!(browser.evaluate(wider), "", "{width}");
        }
        check_page(&mut browser, width);
        keep(&browser.screenshot(), &format!("fit-{width}.png.base64"));
        assert_eq!(browser.complaints(), Vec::<String>::new());
        assert_eq!(browser.requests(), Vec::<String>::new());
    }
}

#[test]
#[ignore = "needs Chromium"]
fn a_certificate_can_be_read_at_any_width() {
    let chromium = chromium::find().unwrap();
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    run(dir, "synth train --rows 5000 --output train.csv", 0);
    run(dir, "synth zero --rows 2000 --output rest.csv", 0);
    run(dir, "fit train.csv --model cubic --cv --output cal.json", 0);
    run(dir, "report cal.json --certificate --unloaded rest.csv --output certificate.html", 0);
    for (width, dark) in [(1400, true), (390, false)] {
        let mut browser = Browser::start(&chromium, [width, 900], width < 500);
        if dark {
            browser.prefer_dark();
        }
        browser.open(&dir.join("certificate.html"));
        let headings =
            browser.evaluate("[...document.querySelectorAll('h2')].map((h) => h.id).join(' ')");
        assert_eq!(headings, "sensor loads uncertainty origin");
        check_page(&mut browser, width);
        keep(&browser.screenshot(), &format!("certificate-{width}.png.base64"));
        assert_eq!(browser.complaints(), Vec::<String>::new());
        assert_eq!(browser.requests(), Vec::<String>::new());
    }
}
