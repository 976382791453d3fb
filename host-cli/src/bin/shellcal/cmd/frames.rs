//! Options of every command that applies a calibration: the frames of a log to use, and the processing of
//! readings to forces, also in live streams.

use std::sync::Arc;

use board_link::recording::LiveForces;
use forces::{DEFAULT_TARE_FRAMES, ForceOptions, LowPass, RowRule, TareRule};
use log_file::Log;
use shellcal::workflow::selection::{RowFilter, TimeWindow};

use super::mapping::EditedArg;
use crate::files::InputPath;
use crate::printer::Printer;

const TARING: &str = "Taring";
const FILTERING: &str = "Filtering";

/// The zero that is subtracted from forces.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct TareArgs {
    /// Subtract the mean wrench of the first N frames [default: 50], not counting duplicate rows; or, with
    /// `rests`, a zero interpolated linearly between stationary intervals (in live streams, the zero of the last
    /// one)
    #[arg(long, value_name = "N|rests", group = "tares", value_parser = parse_tare)]
    tare: Option<TareRule>,

    /// Subtract nothing
    #[arg(long, group = "tares")]
    no_tare: bool,
}

/// Low-pass filter of the forces.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct LowPassArgs {
    /// Cutoff of the Butterworth low-pass, in Hz; it is causal in live streams [default: 10, if the rate is
    /// above 20 Hz]
    #[arg(long, value_name = "HZ")]
    lowpass: Option<f64>,

    /// Do not filter
    #[arg(long, conflicts_with = "lowpass")]
    no_lowpass: bool,

    /// Number of poles of the low-pass [default: 4]
    #[arg(long, value_name = "N")]
    order: Option<usize>,
}

/// Processing of readings to forces.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct ForceArgs {
    #[command(flatten, next_help_heading = TARING)]
    zero: TareArgs,

    /// Subtract the mean wrench between two times, in s on the log's clock
    #[arg(long, value_name = "START:END", group = "tares", help_heading = TARING, value_parser = parse_window)]
    tare_time: Option<TimeWindow>,

    #[command(flatten, next_help_heading = FILTERING)]
    low_pass: LowPassArgs,

    /// Filter forward only: forces are delayed, by about 40 ms at 10 Hz [default: forward and backward,
    /// without delay, -6 dB at the cutoff]
    #[arg(long, help_heading = FILTERING)]
    causal: bool,

    /// Rows per second, for the low-pass [default: one over the median period of the first 50 rows]
    #[arg(long, value_name = "HZ", help_heading = FILTERING)]
    rate: Option<f64>,
}

impl ForceArgs {
    /// The options; `rule` selects processing by row, as in the lab's notebooks, or by time.
    pub(crate) fn options(&self, rule: RowRule) -> ForceOptions {
        let TareArgs { tare, no_tare } = self.zero;
        let LowPassArgs { lowpass, no_lowpass, order } = self.low_pass;
        let usual = LowPass::default();
        let low_pass = LowPass {
            cutoff_hz: lowpass.unwrap_or(usual.cutoff_hz),
            order: order.unwrap_or(usual.order),
            zero_phase: !self.causal && rule == RowRule::Time,
        };
        let options = ForceOptions {
            tare: match (self.tare_time, tare) {
                _ if no_tare => TareRule::Untared,
                (Some(window), _) => TareRule::Between(window.start_s, window.end_s),
                (None, tare) => tare.unwrap_or(TareRule::First(DEFAULT_TARE_FRAMES)),
            },
            low_pass: (!no_lowpass).then_some(low_pass),
            low_pass_is_optional: lowpass.is_none(),
            rate_hz: self.rate,
            rule,
        };
        if low_pass.zero_phase { options } else { options.with_delay(true) }
    }

    /// The options for a sensor whose zero is known: nothing is subtracted unless requested.
    pub(crate) fn options_without_tare(&self, rule: RowRule) -> ForceOptions {
        let options = self.options(rule);
        match (self.zero.tare, self.tare_time) {
            (None, None) => ForceOptions { tare: TareRule::Untared, ..options },
            _ => options,
        }
    }
}

pub(crate) fn describe_forces(forces: &ForceOptions) -> String {
    let low_pass = forces.low_pass.map_or("none".to_owned(), |low_pass| low_pass.to_string());
    format!("forces: tare {}; low-pass {low_pass}", forces.tare)
}

/// Rows of a log that count as frames.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct FrameArgs {
    /// Use every row, even if telemetry repeats a frame until the sensor gives the next one
    #[arg(long, conflicts_with = "fresh")]
    all_rows: bool,

    /// Use only rows whose readings differ from the previous row's [default for telemetry]
    #[arg(long = "skip-repeats", alias = "fresh")]
    fresh: bool,
}

impl FrameArgs {
    pub(crate) fn is_given(&self) -> bool {
        self.all_rows || self.fresh
    }

    pub(crate) fn rows(&self, log: &Log) -> RowFilter {
        match (self.all_rows, self.fresh) {
            (true, _) => RowFilter::All,
            (_, true) => RowFilter::Fresh,
            _ if log.repeats_are_stale() => RowFilter::Fresh,
            _ => RowFilter::All,
        }
    }
}

pub(crate) fn parse_tare(text: &str) -> Result<TareRule, String> {
    match text.parse() {
        _ if text == "rests" => Ok(TareRule::Rests { causal: false }),
        Ok(frames) if frames > 0 => Ok(TareRule::First(frames)),
        _ => Err("expected a number of frames, 1 or more, or `rests`".to_owned()),
    }
}

/// Parses `START:END` in s; either may be left out.
pub(crate) fn parse_window(text: &str) -> Result<TimeWindow, String> {
    let expected = || "expected `START:END` in s".to_owned();
    let (start, end) = text.split_once(':').ok_or_else(expected)?;
    let second = |text: &str, open: f64| match text.trim() {
        "" => Ok(open),
        number => number.parse().map_err(|_| expected()),
    };
    let window = TimeWindow {
        start_s: second(start, f64::NEG_INFINITY)?,
        end_s: second(end, f64::INFINITY)?,
    };
    let is_forward = window.start_s <= window.end_s;
    is_forward.then_some(window).ok_or_else(|| "it ends before it starts".to_owned())
}

/// Processing of readings to forces
#[derive(Debug, clap::Args)]
pub(crate) struct LiveForceArgs {
    /// Calibration, to add forces to the readings
    #[arg(long, value_name = "CAL")]
    calibration: Option<InputPath>,

    #[command(flatten)]
    zero: TareArgs,

    #[command(flatten)]
    low_pass: LowPassArgs,

    #[command(flatten)]
    edited: EditedArg,
}

impl LiveForceArgs {
    pub(crate) fn is_given(&self) -> bool {
        self.calibration.is_some()
    }

    /// Reads the calibration, and prints a note of the options; `None` without a calibration.
    pub(crate) fn read(&self, printer: &Printer) -> anyhow::Result<Option<LiveForces>> {
        let Some(path) = &self.calibration else {
            let (TareArgs { tare, no_tare }, low_pass) = (self.zero, self.low_pass);
            let LowPassArgs { lowpass, no_lowpass, order } = low_pass;
            anyhow::ensure!(
                tare.is_none() && lowpass.is_none() && order.is_none() && !no_tare && !no_lowpass,
                "tare and low-pass are of forces: name a calibration with `--calibration`"
            );
            return Ok(None);
        };
        let file = self.edited.usable(path, printer)?;
        let trained =
            file.origin.diagnostics.and_then(|trained| Some((trained.train, trained.excitation?)));
        let forces = ForceArgs {
            zero: self.zero,
            low_pass: self.low_pass,
            causal: true,
            ..ForceArgs::default()
        };
        let options = forces.options(RowRule::Time);
        printer.note(describe_forces(&options));
        let calibration = file.calibration;
        Ok(Some(LiveForces { calibration, options, trained, tare_doubt: Arc::default() }))
    }
}

/// Prints a warning if the shell was loaded during the tare of a recording.
pub(crate) fn warn_of_tare(forces: Option<&LiveForces>, printer: &Printer) {
    if let Some(doubt) = forces.and_then(|forces| forces.tare_doubt.get()) {
        printer.warning(format!("{doubt}; unload the shell and start again"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_are_two_times_in_order() {
        assert_eq!(parse_window("0.5:2"), Ok(TimeWindow { start_s: 0.5, end_s: 2.0 }));
        assert_eq!(parse_window("3:").unwrap().end_s, f64::INFINITY);
        for text in ["", "1", "2:1", "a:b", "1:NaN", "1:2:3"] {
            assert!(parse_window(text).is_err(), "{text}");
        }
    }
}
