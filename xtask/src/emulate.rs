//! `cargo xtask emulate`: the emulated board on a pty, in real time, for anyone to play with.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::Stdio;

use anyhow::{Context, Result, bail};
use shared_proto::CHANNELS;
use system_tests::emulation::{Memory, PlayedFrame, QEMU};

use crate::emulator;
use crate::image::Image;
use crate::steps::{self, workspace};
use crate::toolchain;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Recording to play, over and over: CSV with columns s1 to s8, in steps of the 12-bit converter
    #[arg(long, value_name = "CSV", default_value = "calibration-data/synthetic-test.csv")]
    play: PathBuf,
}

/// What the converter sees with the emitter off, in steps.
const DARK: u16 = 100;

pub(crate) fn run(args: &Args) -> Result<()> {
    let frames = read(&workspace().join(&args.play))?;
    let toolchain = toolchain::set_up()?;
    emulator::set_up()?;
    let image = Image::Emulated.build(&toolchain)?;
    let dir = steps::scratch("emulation")?;
    let mut qemu = Memory::new().play(&frames).start(&image, &dir)?;
    qemu.args(["-serial", "pty"]).stdin(Stdio::null()).stdout(Stdio::piped());
    let mut board = qemu.spawn().with_context(|| format!("cannot start {QEMU}"))?;
    let output = board.stdout.take().context("no word from QEMU")?;
    // QEMU says where the serial port is; the rest is what the firmware says.
    for line in BufReader::new(output).lines() {
        let line = line?;
        match line.strip_prefix("char device redirected to ").and_then(|it| it.split(' ').next()) {
            Some(port) => introduce(port, frames.len(), &args.play),
            None => println!("{line}"),
        }
    }
    let status = board.wait()?;
    if !status.success() {
        bail!("the emulated board has ended: {status}");
    }
    Ok(())
}

fn introduce(port: &str, frames: usize, play: &Path) {
    println!("the emulated board is on {port}, playing {frames} frames of {}", play.display());
    println!("ask it:     shellcal board {port} identify");
    println!("record it:  shellcal record {port} --start --duration 10 --output log.csv");
    println!("Ctrl-C ends it");
}

/// The frames of a recording.
fn read(path: &Path) -> Result<Vec<PlayedFrame>> {
    let text = std::fs::read_to_string(path);
    let text = text.with_context(|| format!("cannot read `{}`", path.display()))?;
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let mut places = [0; CHANNELS];
    for (channel, place) in places.iter_mut().enumerate() {
        let name = format!("s{}", channel + 1);
        let found = header.iter().position(|column| column.trim() == name);
        *place = found.with_context(|| format!("`{}`: no column `{name}`", path.display()))?;
    }
    let frames = lines.enumerate().map(|(i, line)| {
        let fields: Vec<&str> = line.split(',').collect();
        frame(&fields, &places)
            .with_context(|| format!("`{}`, line {}: not eight readings", path.display(), i + 2))
    });
    let frames = frames.collect::<Result<Vec<_>>>()?;
    if frames.is_empty() {
        bail!("`{}` has no rows", path.display());
    }
    Ok(frames)
}

/// The codes that make the board measure these readings.
fn frame(fields: &[&str], places: &[usize; CHANNELS]) -> Option<PlayedFrame> {
    let mut frame = PlayedFrame::default();
    for (codes, &place) in frame.iter_mut().zip(places) {
        let reading: f64 = fields.get(place)?.trim().parse().ok()?;
        if !(0.0..4096.0).contains(&reading) {
            return None;
        }
        *codes = (DARK, (DARK + reading.round() as u16).min(4095));
    }
    Some(frame)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_become_codes_above_the_dark_one() {
        let fields = ["0.1", "1000", "7.6", "3", "4", "5", "6", "7", "4090", "x"];
        let expected = [1100, 108, 103, 104, 105, 106, 107, 4095].map(|lit| (DARK, lit));
        assert_eq!(frame(&fields, &[1, 2, 3, 4, 5, 6, 7, 8]), Some(expected));
        assert_eq!(frame(&fields, &[1, 2, 3, 4, 5, 6, 7, 9]), None);
        assert_eq!(frame(&fields[..5], &[1, 2, 3, 4, 5, 6, 7, 8]), None);
    }
}
