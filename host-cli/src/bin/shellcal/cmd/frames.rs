//! The flags of every command that applies a calibration: which frames of a log are used.

use std::path::Path;

use log_file::Log;
use shellcal::workflow::selection::{Rows, TimeWindow};

use crate::printer::Printer;

/// Which rows of a log count as frames.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct FrameArgs {
    /// Use every row, also where telemetry repeats a frame until the sensor gives the next
    #[arg(long, conflicts_with = "fresh")]
    all_rows: bool,

    /// Use only rows whose readings differ from those of the row before [default for telemetry]
    #[arg(long)]
    fresh: bool,
}

impl FrameArgs {
    pub(crate) fn rows(&self, log: &Log) -> Rows {
        match (self.all_rows, self.fresh) {
            (true, _) => Rows::All,
            (_, true) => Rows::Fresh,
            _ if log.repeats_are_stale() => Rows::Fresh,
            _ => Rows::All,
        }
    }
}

/// Says how many rows were used and why.
pub(crate) fn note_rows(
    printer: &mut Printer,
    log: &Path,
    used: Rows,
    [rows, repeated, skipped]: [u64; 3],
) {
    let mut text = match used {
        Rows::Fresh => format!(
            "{}: {} of {rows} rows used, {repeated} repeat the frame before",
            log.display(),
            rows - repeated
        ),
        Rows::All => {
            format!("{}: {rows} rows used, {repeated} repeat the row before", log.display())
        }
    };
    if skipped > 0 {
        text += &format!(", {skipped} bad rows left out");
    }
    printer.note(text);
}

/// `START:END` in s; either may be left out.
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
    if window.start_s <= window.end_s {
        Ok(window)
    } else {
        Err("it ends before it starts".to_owned())
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
