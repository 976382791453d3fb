//! `cargo xtask emulate`: runs the flashed image on its microcontroller's model, on a pty.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use shared_proto::CHANNELS;
use system_tests::flashed::PlayedFrame;

use crate::firmware;
use crate::image::Board;
use crate::steps::{self, workspace};

#[derive(Debug, clap::Args)]
pub(crate) struct EmulateArgs {
    /// Recording to play, over and over: CSV with columns s1 to s8, in steps of the 12-bit converter
    #[arg(long, value_name = "CSV", default_value = "calibration-data/synthetic-test.csv")]
    play: PathBuf,

    /// Board whose image runs
    #[arg(long, value_enum, default_value = "skinproc")]
    board: Board,
}

const DARK: u16 = 100;

pub(crate) fn run(args: &EmulateArgs) -> Result<()> {
    let frames = read(&workspace().join(&args.play))?;
    args.board.build()?;
    let model = firmware::model(args.board)?;
    println!("it plays {} frames of {}", frames.len(), args.play.display());
    let mut command = model.command(&frames, &steps::scratch("emulation")?);
    steps::run("the modelled board", command.arg("--pty"))
}

fn read(path: &Path) -> Result<Vec<PlayedFrame>> {
    let text = std::fs::read_to_string(path);
    let text = text.with_context(|| format!("cannot read `{}`", path.display()))?;
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap_or_default().split(',').map(str::trim).collect();
    let position = |channel| header.iter().position(|column| *column == format!("s{channel}"));
    let positions: Option<Vec<usize>> = (1..=CHANNELS).map(position).collect();
    let positions =
        positions.with_context(|| format!("`{}`: no columns `s1` to `s8`", path.display()))?;
    let frames = lines.enumerate().map(|(i, line)| {
        let fields: Vec<&str> = line.split(',').collect();
        frame(&fields, &positions)
            .with_context(|| format!("`{}`, line {}: not eight readings", path.display(), i + 2))
    });
    let frames = frames.collect::<Result<Vec<_>>>()?;
    ensure!(!frames.is_empty(), "`{}` has no rows", path.display());
    Ok(frames)
}

/// Returns the codes from which the board measures these readings.
fn frame(fields: &[&str], positions: &[usize]) -> Option<PlayedFrame> {
    let mut frame = PlayedFrame::default();
    for (codes, &position) in frame.iter_mut().zip(positions) {
        let reading: f64 = fields.get(position)?.trim().parse().ok()?;
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
