//! What must be known of a log before its frames can be converted: the tare and the rate.

use super::{ConvertError, ConvertOptions, TareWindow};
use crate::workflow::sampling::{Rate, Sampling};
use crate::workflow::selection::{Stop, by_column};
use calibration::Calibration;
use calibration::uncertainty::Tare;
use log_file::{Log, ReadOptions, Wanted};
use shell_data::block::Block;
use shell_data::wrench::PerAxis;

/// What is known before the frames are converted.
#[derive(Debug, Default)]
pub(super) struct Survey {
    pub(super) tare: Option<Tare>,
    pub(super) tare_result: Option<TareResult>,
    pub(super) rate: Option<Rate>,
}

/// What was taken as unloaded.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct TareResult {
    /// Number of frames.
    pub frames: usize,
    /// Time of the first, s; `None` if the log has no time.
    pub start_s: Option<f64>,
    /// Time of the last, s.
    pub end_s: Option<f64>,
    /// Their mean wrench, which was subtracted, N and N·m.
    #[serde(serialize_with = "by_column")]
    pub wrench: PerAxis<f64>,
}

/// Reads as much of the log as the tare and the filter need.
pub(super) fn survey(
    log: &Log,
    calibration: &Calibration,
    options: &ConvertOptions,
    read: &ReadOptions<'_>,
) -> Result<Survey, ConvertError> {
    let path = || log.path().display().to_string();
    let needs_rate = options.low_pass.is_some_and(|low_pass| low_pass.rate_hz.is_none());
    if needs_rate && !log.has_time() {
        return Err(ConvertError::NoRate { path: path(), reason: "it has no time column" });
    }
    if options.tare == TareWindow::Untared && !needs_rate {
        return Ok(Survey::default());
    }
    let by_time = matches!(options.tare, TareWindow::Time(_));
    let time = log.has_time() || by_time;
    let wanted = Wanted { readings: true, time, ..Wanted::default() };
    let mut tare = TareSearch::new(options.tare);
    let mut sampling = Sampling::new();
    let result = log.read(
        &wanted,
        read,
        |block| {
            options.rows.select(block);
            std::mem::take(block)
        },
        |block| {
            if needs_rate {
                sampling.add(&block.time_s);
            }
            tare.look_at(calibration, block);
            if tare.is_done && !needs_rate { Err(Stop::Enough) } else { Ok(()) }
        },
    );
    match result {
        Ok(_) | Err(Stop::Enough) => {}
        Err(Stop::Failed(error)) => return Err(error),
    }
    let rate = if needs_rate {
        let reason = "time does not move on between its frames";
        Some(sampling.rate().ok_or_else(|| ConvertError::NoRate { path: path(), reason })?)
    } else {
        None
    };
    let (tare, tare_result) = tare.finish(path)?.unzip();
    Ok(Survey { tare, tare_result, rate })
}

/// The tare, as far as the log has been read.
struct TareSearch {
    window: TareWindow,
    is_done: bool,
    /// Sums over frames of features and wrench.
    found: Option<Tare>,
    found_s: Option<(f64, f64)>,
    frames_seen: usize,
    seen_s: Option<(f64, f64)>,
}

impl TareSearch {
    fn new(window: TareWindow) -> Self {
        let is_done = window == TareWindow::Untared;
        Self { window, is_done, found: None, found_s: None, frames_seen: 0, seen_s: None }
    }

    fn look_at(&mut self, calibration: &Calibration, mut block: Block) {
        if self.is_done {
            return;
        }
        self.frames_seen += block.rows;
        extend(&mut self.seen_s, &block.time_s);
        let keep: Vec<bool> = match self.window {
            TareWindow::Untared => return,
            TareWindow::First(frames) => {
                let missing = frames - self.found.as_ref().map_or(0, |found| found.frames);
                self.is_done = block.rows >= missing;
                (0..block.rows).map(|row| row < missing).collect()
            }
            TareWindow::Time(window) => {
                let end = block.time_s.iter().position(|&time| time > window.end_s);
                self.is_done = end.is_some();
                let before_end = end.unwrap_or(block.rows);
                let within = |(row, &time)| row < before_end && window.contains(time);
                block.time_s.iter().enumerate().map(within).collect()
            }
        };
        block.retain_rows(&keep);
        extend(&mut self.found_s, &block.time_s);
        let Some(tare) = calibration.tare(&block.readings) else { return };
        self.found = Some(match self.found.take() {
            None => tare,
            Some(found) => mean_of_both(&found, &tare),
        });
    }

    fn finish(self, path: impl Fn() -> String) -> Result<Option<(Tare, TareResult)>, ConvertError> {
        let found = self.found.as_ref().map_or(0, |tare| tare.frames);
        match self.window {
            TareWindow::Untared => return Ok(None),
            TareWindow::First(wanted) if found < wanted => {
                return Err(ConvertError::TareFrames { path: path(), wanted, found });
            }
            TareWindow::Time(window) if found == 0 => {
                let (first, last) = self.seen_s.unwrap_or((f64::NAN, f64::NAN));
                return Err(ConvertError::TareTime { path: path(), window, first, last });
            }
            TareWindow::First(_) | TareWindow::Time(_) => {}
        }
        let result = |tare: &Tare| TareResult {
            frames: tare.frames,
            start_s: self.found_s.map(|(start, _)| start),
            end_s: self.found_s.map(|(_, end)| end),
            wrench: tare.wrench,
        };
        Ok(self.found.as_ref().map(|tare| (tare.clone(), result(tare))))
    }
}

fn extend(span: &mut Option<(f64, f64)>, times: &[f64]) {
    if let (Some(&first), Some(&last)) = (times.first(), times.last()) {
        *span = Some((span.map_or(first, |(start, _)| start), last));
    }
}

/// The mean over the frames of two tares.
fn mean_of_both(a: &Tare, b: &Tare) -> Tare {
    let frames = a.frames + b.frames;
    let share = b.frames as f64 / frames as f64;
    let mean = |a: f64, b: f64| a + (b - a) * share;
    Tare {
        frames,
        features: a.features.iter().zip(&b.features).map(|(&a, &b)| mean(a, b)).collect(),
        wrench: std::array::from_fn(|axis| mean(a.wrench[axis], b.wrench[axis])),
    }
}
