//! `cargo xtask pictures`: the pictures of README, and the diagram of the crates. The figure of a
//! calibration and the diagram have the same bytes on every machine, so they are compared; pages in
//! browsers differ.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use system_tests::browser::Browser;
use system_tests::chromium;
use system_tests::program::Running;

use crate::layers;
use crate::steps::{build_shellcal, run, scratch, workspace};

const FIGURE: &str = "fit.svg";
const LIVE: &str = "live.png";
const CRATES: &str = "crates.svg";

pub(crate) fn make() -> Result<()> {
    let folder = workspace().join("docs/pictures");
    fs::create_dir_all(&folder)?;
    fs::write(folder.join(CRATES), layers::draw()?)?;
    let shellcal = build_shellcal()?;
    let calibration = draw_fit(&shellcal, &folder.join(FIGURE))?;
    let chromium = chromium::find().context("no Chromium: `cargo xtask setup` installs one")?;
    photograph_live(&shellcal, &calibration, &chromium, &folder.join(LIVE))
}

pub(crate) fn check() -> Result<()> {
    compare(CRATES, layers::draw()?.as_bytes())?;
    let made = scratch("pictures")?.join(FIGURE);
    draw_fit(&build_shellcal()?, &made)?;
    compare(FIGURE, &fs::read(&made)?)
}

fn compare(name: &str, made: &[u8]) -> Result<()> {
    let committed = workspace().join("docs/pictures").join(name);
    let same = fs::read(&committed)? == made;
    ensure!(same, "`{}` is out of date: run `cargo xtask pictures`", committed.display());
    Ok(())
}

/// Runs README's fit of the shipped data, which draws `figure`; returns its calibration.
fn draw_fit(shellcal: &Path, figure: &Path) -> Result<PathBuf> {
    let calibration = scratch("pictures")?.join("calibration.json");
    let mut fit = Command::new(shellcal);
    fit.current_dir(workspace().join("calibration-data"));
    fit.args(["fit", "synthetic-train.csv", "--test", "synthetic-test.csv", "--quiet"]);
    fit.arg("--output").arg(&calibration).arg("--plot").arg(figure);
    run("figure of the calibration", &mut fit)?;
    Ok(calibration)
}

/// Plays the shipped test log in the live view and saves a picture of its page.
fn photograph_live(
    shellcal: &Path,
    calibration: &Path,
    chromium: &str,
    picture: &Path,
) -> Result<()> {
    let mut live = Command::new(shellcal);
    live.current_dir(workspace().join("calibration-data"));
    live.args(["live", "synthetic-test.csv", "--calibration"]).arg(calibration);
    live.args(["--no-tare", "--speed", "4", "--window", "60", "--serve"]);
    let mut server = Running(live.stdin(Stdio::null()).stdout(Stdio::piped()).spawn()?);
    let mut line = String::new();
    BufReader::new(server.0.stdout.as_mut().context("no output")?).read_line(&mut line)?;
    let address = line.trim_end().strip_prefix("live at ").with_context(|| line.clone())?;
    let mut browser = Browser::start(chromium, [1100, 700], false);
    browser.visit(address);
    browser.wait_for("parseFloat(document.getElementById('now').textContent) > 62");
    browser.click("document.querySelector('[data-order=pause]')");
    browser.wait_for("document.getElementById('flags').textContent.includes('PAUSED')");
    let mut decode = Command::new("base64");
    decode.arg("--decode").stdin(Stdio::piped()).stdout(fs::File::create(picture)?);
    let mut decode = decode.spawn().context("`base64` is missing")?;
    decode.stdin.take().context("no input")?.write_all(browser.screenshot().as_bytes())?;
    ensure!(decode.wait()?.success(), "no picture of the live view");
    eprintln!("    {}", picture.display());
    Ok(())
}
