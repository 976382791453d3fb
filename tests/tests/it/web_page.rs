//! The page that fits and converts, in a headless browser: it gives what the program gives, byte for byte, and works
//! for who uses a keyboard, a phone, or a dark screen.

use std::fs;
use std::path::{Path, PathBuf};

use system_tests::browser::Browser;
use system_tests::program::run;
use system_tests::random::{Random, damage};
use system_tests::{chromium, real_recording};

use crate::page_rules::{check_page, check_rules, keep};

/// Names the page, which `cargo xtask test` builds.
const PAGE: &str = "SHELLCAL_WEB_PAGE";

fn open([width, height]: [u32; 2], dark: bool) -> Browser {
    let chromium = chromium::find().unwrap();
    let mut browser = Browser::start(&chromium, [width, height], width < 500);
    if dark {
        browser.prefer_dark();
    }
    browser.open(Path::new(&std::env::var_os(PAGE).unwrap()));
    browser.wait_for("document.documentElement.dataset.ready === 'true'");
    browser
}

fn by_id(id: &str) -> String {
    format!("document.getElementById('{id}')")
}

/// Waits until all files are examined.
fn wait_for_files(browser: &mut Browser, count: usize) {
    browser.wait_for(&format!(
        "document.querySelectorAll('.file').length === {count} && logs.every((log) => log.answer)"
    ));
}

fn choose(browser: &mut Browser, id: &str, value: &str) {
    browser.evaluate(&format!(
        "(() => {{ const of = document.getElementById('{id}'); of.value = '{value}'; \
         of.dispatchEvent(new Event('change')); }})()"
    ));
}

/// Clicks, and waits for the result.
fn work(browser: &mut Browser, button: &str) {
    browser.evaluate("document.getElementById('status').textContent = ''; 0");
    browser.click(&by_id(button));
    browser.wait_for("document.getElementById('status').textContent !== ''");
    assert_eq!(browser.evaluate("document.getElementById('status').textContent"), "Done.");
}

fn saved(browser: &mut Browser, name: &str) -> String {
    let bytes = browser.save(&format!("document.querySelector('[download=\"{name}\"]')"), name);
    String::from_utf8(bytes).unwrap()
}

/// The lines of a calibration whose bits do not depend on the processor: all but those of [`digits`], and date and
/// checksum, which are new in each file.
fn exact(text: &str) -> String {
    let is_new =
        |line: &str| line.starts_with("  \"date\": ") || line.starts_with("  \"checksum\": ");
    let lines = split(text).0.into_iter().filter(|line| !is_new(line));
    lines.collect::<Vec<_>>().join("\n")
}

/// The numbers of the lines that come from factorisations by faer, which sums as the processor's vectors are wide:
/// conditions and covariances.
fn digits(text: &str) -> Vec<Vec<f64>> {
    let numbers = |line: &str| -> Vec<f64> {
        line.split([',', '[', ']', ':', ' ']).filter_map(|word| word.parse().ok()).collect()
    };
    split(text).1.into_iter().map(numbers).collect()
}

fn split(text: &str) -> (Vec<&str>, Vec<&str>) {
    let mut in_covariance = false;
    text.lines().partition(|line| {
        in_covariance = line.starts_with("  \"covariance\": ") || in_covariance && *line != "  },";
        !in_covariance && !line.trim_start().starts_with("\"condition\": ")
    })
}

fn check_same_calibration(found: &str, expected: &str, name: &str) {
    assert!(exact(found) == exact(expected), "{name}: another calibration");
    let [found, expected] = [found, expected].map(digits);
    assert_eq!(found.len(), expected.len(), "{name}");
    assert!(expected.iter().flatten().count() > 2, "{name}");
    for (found, expected) in found.iter().zip(&expected) {
        let largest = expected.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
        assert_eq!(found.len(), expected.len(), "{name}");
        // Rounding errors times the condition of the features, of which these have at most some thousands.
        let is_near = |(found, expected): (&f64, &f64)| (found - expected).abs() <= 1e-9 * largest;
        assert!(found.iter().zip(expected).all(is_near), "{name}: {found:?}, {expected:?}");
    }
}

/// Times and forces of a table, without what comes from the covariance.
fn forces(table: &str) -> Vec<Vec<&str>> {
    table.lines().map(|line| line.split(',').take(7).collect()).collect()
}

/// A folder with the calibration of some logs by the program: of the first, tested on the others.
fn fit_by_program(files: &[PathBuf], model: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let names: Vec<_> = files.iter().map(|file| name_of(file)).collect();
    for (file, name) in files.iter().zip(&names) {
        fs::copy(file, dir.path().join(name)).unwrap();
    }
    let test = match &names[1..] {
        [] => String::new(),
        tests => format!("--test {}", tests.join(" ")),
    };
    run(&dir, &format!("fit {} --model {model} {test} -o by-program.json", names[0]), 0);
    dir
}

fn name_of(file: &Path) -> &str {
    file.file_name().unwrap().to_str().unwrap()
}

/// Fits to the first of some files and tests on the others, in the page and by the program; returns the page and the
/// folder of the program.
fn compare_fits(files: &[PathBuf], model: &str) -> (Browser, tempfile::TempDir) {
    let dir = fit_by_program(files, model);
    let mut browser = open([1200, 900], false);
    browser.choose(&by_id("files"), files);
    wait_for_files(&mut browser, files.len());
    choose(&mut browser, "model", model);
    work(&mut browser, "fit");
    let expected = fs::read_to_string(dir.path().join("by-program.json")).unwrap();
    check_same_calibration(&saved(&mut browser, "calibration.json"), &expected, name_of(&files[0]));
    (browser, dir)
}

/// Converts the last of some files in the page, with the calibration that it made and with that of the program.
fn compare_forces(browser: &mut Browser, dir: &Path, files: &[PathBuf]) {
    let last = name_of(files.last().unwrap());
    run(dir, &format!("convert by-program.json {last} -o forces.csv"), 0);
    let expected = fs::read_to_string(dir.join("forces.csv")).unwrap();
    browser.choose(&by_id("files"), &[dir.join("by-program.json")]);
    wait_for_files(browser, files.len() + 1);
    let table = format!("{}.wrench.csv", last.rsplit_once('.').unwrap().0);
    let mut convert = |calibration: &str| {
        choose(browser, "calibration", calibration);
        choose(browser, "log", &(files.len() - 1).to_string());
        work(browser, "convert");
        saved(browser, &table)
    };
    assert!(forces(&convert("0")) == forces(&expected), "{last}: other forces");
    assert!(convert("1") == expected, "{last}: another table with the calibration of the program");
}

fn check_quiet(mut browser: Browser) {
    assert_eq!(browser.complaints(), Vec::<String>::new());
    assert_eq!(browser.requests(), Vec::<String>::new());
}

fn shipped(name: &str) -> PathBuf {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data").join(name);
    file.canonicalize().unwrap()
}

#[test]
#[ignore = "needs Chromium and the page"]
fn the_page_gives_the_bits_that_the_program_gives() {
    let files = [shipped("synthetic-train.csv"), shipped("synthetic-test.csv")];
    let (mut browser, dir) = compare_fits(&files, "cubic");
    compare_forces(&mut browser, dir.path(), &files);
    check_quiet(browser);
}

#[test]
#[ignore = "needs Chromium, the page and the recordings"]
fn the_page_gives_the_bits_that_the_program_gives_of_recordings() {
    let files = [real_recording("skinproc/behavior4_2Hz.csv")];
    let (mut browser, dir) = compare_fits(&files, "cubic");
    compare_forces(&mut browser, dir.path(), &files);
    check_quiet(browser);
    // Its clock jumps, across which nothing is converted by default.
    check_quiet(
        compare_fits(&[real_recording("others/photointerrupters/poses.csv")], "quadratic").0,
    );
}

#[test]
#[ignore = "needs Chromium and the page"]
fn the_page_works_by_keyboard_on_a_phone_and_in_the_dark() {
    for (width, dark) in [(1200, false), (1024, true), (360, false)] {
        let mut browser = open([width, 800], dark);
        check_rules(&mut browser);
        // The first step of a keyboard is past the header, the next to the files.
        browser.press("Tab");
        assert_eq!(browser.evaluate("document.activeElement.hash"), "#main");
        browser.evaluate("document.getElementById('example').focus()");
        browser.press("Enter");
        wait_for_files(&mut browser, 2);
        browser.evaluate("document.getElementById('fit').focus()");
        choose(&mut browser, "model", "linear");
        browser.press("Enter");
        browser.wait_for("document.getElementById('status').textContent === 'Done.'");
        // What is new has the focus.
        assert_eq!(browser.evaluate("document.activeElement.id"), "result-heading");
        assert_eq!(browser.evaluate("document.querySelectorAll('.verdict p').length > 2"), true);
        check_page(&mut browser, width);
        let paper = browser.evaluate("getComputedStyle(document.body).backgroundColor");
        assert_eq!(paper == "rgb(255, 255, 255)", !dark);
        keep(&browser.screenshot(), &format!("web-{width}.png.base64"));
        assert_eq!(browser.complaints(), Vec::<String>::new());
    }
}

#[test]
#[ignore = "needs Chromium and the page"]
fn damaged_files_are_told_one_by_one_and_the_page_stays_alive() {
    let dir = tempfile::tempdir().unwrap();
    fs::copy(shipped("synthetic-zero.csv"), dir.path().join("log.csv")).unwrap();
    run(
        &dir,
        &format!("fit {} --model cubic -o cal.json", shipped("synthetic-test.csv").display()),
        0,
    );
    let mut seeds = vec![PathBuf::from("log.csv"), PathBuf::from("cal.json")];
    for kind in ["parquet", "mat", "npy", "mcap"] {
        run(&dir, &format!("convert cal.json log.csv -o log.{kind}"), 0);
        seeds.push(format!("log.{kind}").into());
    }
    let mut random = Random(1);
    let file = |at: usize| {
        let seed = &seeds[at % seeds.len()];
        let mut bytes = fs::read(dir.path().join(seed)).unwrap();
        (0..=random.below(4)).for_each(|_| damage(&mut bytes, &mut random));
        let path =
            dir.path().join(format!("damaged-{at}")).with_extension(seed.extension().unwrap());
        fs::write(&path, bytes).unwrap();
        path
    };
    let files: Vec<PathBuf> = (0..1000).map(file).collect();
    let mut browser = open([1200, 900], false);
    browser.choose(&by_id("files"), &files);
    wait_for_files(&mut browser, files.len());
    // A kind and what was found, or why it is not read.
    let silent =
        "logs.filter(({ answer: { error, findings } }) => !error && !(findings.length > 0)).length";
    assert_eq!(browser.evaluate(silent), 0);
    let faults = "logs.filter(({ answer: { error } }) => /fault of this page|memory|ended/.test(error ?? '')).length";
    assert_eq!(browser.evaluate(faults), 0);
    browser.click(&by_id("clear"));
    browser.click(&by_id("example"));
    wait_for_files(&mut browser, 2);
    choose(&mut browser, "model", "linear");
    work(&mut browser, "fit");
    assert_eq!(browser.complaints(), Vec::<String>::new());
}

#[test]
#[ignore = "needs Chromium and the page"]
fn a_fit_can_be_cancelled() {
    let mut browser = open([1200, 900], false);
    browser.click(&by_id("example"));
    wait_for_files(&mut browser, 2);
    // In one step, so that the fit cannot have ended before.
    browser.evaluate("fit(); queueMicrotask(cancel); 0");
    browser.wait_for("document.getElementById('status').textContent === 'error: cancelled'");
    choose(&mut browser, "model", "linear");
    work(&mut browser, "fit");
}
