//! The page that fits and converts, in a headless browser: it gives what the program gives, byte for byte, and works
//! for who uses a keyboard, a phone, or a dark screen.

use std::fs;
use std::path::{Path, PathBuf};

use system_tests::browser::Browser;
use system_tests::program::run;
use system_tests::random::{Random, damage};
use system_tests::{chromium, real_recording};

use crate::page_rules::{check_rules, contrast, keep};

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
        "const of_{id} = document.getElementById('{id}'); of_{id}.value = '{value}'; \
         of_{id}.dispatchEvent(new Event('change')); 0"
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

/// A calibration without the day on which it was made.
fn undated(text: &str) -> String {
    let mut is_date = false;
    let lines = text.lines().filter(|line| {
        is_date = line.trim_start().starts_with("\"date\": ");
        !is_date
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Fits to the first of some files, tests on the others, and converts the last, in the page and by the program.
fn compare(files: &[PathBuf], model: &str) {
    let dir = tempfile::tempdir().unwrap();
    let names: Vec<String> =
        files.iter().map(|file| file.file_name().unwrap().to_str().unwrap().to_owned()).collect();
    for (file, name) in files.iter().zip(&names) {
        fs::copy(file, dir.path().join(name)).unwrap();
    }
    let test = match &names[1..] {
        [] => String::new(),
        tests => format!("--test {}", tests.join(" ")),
    };
    run(&dir, &format!("fit {} --model {model} {test} -o calibration.json", names[0]), 0);
    let last = names.last().unwrap();
    run(&dir, &format!("convert calibration.json {last} -o forces.csv"), 0);
    let expected = |name: &str| fs::read_to_string(dir.path().join(name)).unwrap();

    let mut browser = open([1200, 900], false);
    browser.choose(&by_id("files"), files);
    wait_for_files(&mut browser, files.len());
    choose(&mut browser, "model", model);
    work(&mut browser, "fit");
    let calibration = saved(&mut browser, "calibration.json");
    assert_eq!(undated(&calibration), undated(&expected("calibration.json")), "{names:?}");
    choose(&mut browser, "log", &(files.len() - 1).to_string());
    work(&mut browser, "convert");
    let table = format!("{}.wrench.csv", last.rsplit_once('.').unwrap().0);
    assert_eq!(saved(&mut browser, &table), expected("forces.csv"), "{names:?}");
    assert_eq!(browser.complaints(), Vec::<String>::new());
    assert_eq!(browser.requests(), Vec::<String>::new());
}

fn shipped(name: &str) -> PathBuf {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../calibration-data").join(name);
    file.canonicalize().unwrap()
}

#[test]
#[ignore = "needs Chromium and the page"]
fn the_page_gives_the_bytes_that_the_program_gives() {
    compare(&[shipped("synthetic-train.csv"), shipped("synthetic-test.csv")], "cubic");
}

#[test]
#[ignore = "needs Chromium, the page and the recordings"]
fn the_page_gives_the_bytes_that_the_program_gives_of_recordings() {
    compare(&[real_recording("skinproc/behavior4_2Hz.csv")], "cubic");
    compare(&[real_recording("others/photointerrupters/poses.csv")], "quadratic");
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
        let beyond = "document.documentElement.scrollWidth - document.documentElement.clientWidth";
        assert_eq!(browser.evaluate(beyond), 0, "{width}");
        assert!(contrast(&mut browser) > 4.5, "{width}");
        check_rules(&mut browser);
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
    work(&mut browser, "fit");
}
