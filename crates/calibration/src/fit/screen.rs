//! The screen: a summary of a fit in about twelve lines, identical in the terminal, the report, the web page and
//! Python. The screen of a test has the same rows and words.

use super::examination::{FaultPlace, TestRatio};
use super::outcome::Outcome;
use super::verdict::{FrameInterval, UnseenRows, Verdict};
use least_squares::quality::significant;
use shell_data::dataset::Dataset;
use shell_data::wrench::Axis;
use std::collections::HashSet;

const WIDTH: usize = 100;

const LABEL: usize = 7;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Screen {
    /// Verdict: how to use the fit, or the reason not to use it.
    pub headline: String,
    pub header: Vec<String>,
    pub rows: Vec<Vec<String>>,
    /// Labelled lines about model, test, data, clock, next step and files.
    pub notes: Vec<(&'static str, String)>,
}

impl Verdict<'_> {
    /// Creates the screen. `files` names the files that were written.
    pub fn screen(&self, files: &str) -> Screen {
        let (fit, test) = (self.fit, self.fit.test().quality());
        let error = match &self.unseen {
            Some(of) => of.on.header(),
            None => "error on training rows".to_owned(),
        };
        let mut header = vec!["axis".to_owned(), error, "95 % of frames".to_owned()];
        header.extend(test.map(|_| "error on your test".to_owned()));
        header.push("calibrated range".to_owned());
        let row = |axis: Axis| {
            let at = axis.index();
            let errors = self.unseen.as_ref().map_or(fit.train[at].rms, |of| of.rms[at]);
            let spread = self.unseen.as_ref().and_then(|of| of.spread).map_or(1.0, |of| of[at]);
            // The share of held-out rows within the interval is shown with `--verbose`.
            let interval =
                self.interval.as_ref().ok().map(|of| FrameInterval { held: None, ..*of });
            let range = fit.excitation.as_ref().map(|of| [of.axes[at].min, of.axes[at].max]);
            let test = test.map(|of| of[at].rms);
            axis_row(axis, Some((errors, spread)), interval.as_ref(), test, range)
        };
        let mut notes = vec![("model", self.model_words())];
        notes.extend(test.map(|_| ("test", self.test_words())));
        notes.push(("data", self.data_words()));
        notes.extend(self.clock_words().map(|words| ("clock", words)));
        notes.push(("next", self.next_words()));
        notes.extend((!files.is_empty()).then(|| ("files", files.to_owned())));
        Screen {
            headline: self.headline(),
            header,
            rows: self.axes.iter().map(row).collect(),
            notes,
        }
    }

    fn model_words(&self) -> String {
        let name = self.fit.calibration.name();
        let judged = match &self.unseen {
            Some(of) => of.on.words(),
            None => "not judged: nothing was held out".to_owned(),
        };
        let interval = self.interval.as_ref().err();
        let interval = interval.map(|reason| format!("; no 95 % interval: {reason}"));
        let prefix = match (self.reasons_of_model().first(), &self.unseen) {
            (Some(reason), _) => format!("NOT OK, {reason}: "),
            (None, Some(_)) => "OK: ".to_owned(),
            (None, None) => String::new(),
        };
        format!("{prefix}{name}, {judged}{}", interval.unwrap_or_default())
    }

    fn test_words(&self) -> String {
        let test = self.fit.test();
        let ratio = self.fit.examination.as_ref().and_then(|of| of.test);
        let counts = [test.rows, test.out_of_range_rows];
        let leak = self.fit.leaks.in_test();
        test_words(self.fault(FaultPlace::Test), leak, counts, ratio.as_ref())
    }

    fn data_words(&self) -> String {
        let fit = self.fit;
        let faults = fit.examination.iter().flat_map(|of| &of.faults);
        let faults: Vec<&str> = faults
            .filter(|fault| fault.place == FaultPlace::Data)
            .map(|fault| fault.text.as_str())
            .collect();
        if let [first, more @ ..] = &faults[..] {
            let more = match more.len() {
                0 => String::new(),
                1 => format!("; {}", more[0]),
                more => format!("; and {more} more (--verbose)"),
            };
            return format!("NOT OK: {first}{more}");
        }
        let mut said = format!("OK: {} rows", fit.rows);
        if fit.rows_of_logs.len() > 1 {
            said += &format!(" of {} files", fit.rows_of_logs.len());
        }
        said += &match days(&fit.used) {
            0 => String::new(),
            1 => " of one day".to_owned(),
            days => format!(" of {days} days"),
        };
        if fit.skipped_rows > 0 {
            said += &format!(", {} bad rows left out", fit.skipped_rows);
        }
        said
    }

    fn clock_words(&self) -> Option<String> {
        match &self.fit.dynamics {
            Outcome::NotAsked => None,
            Outcome::NotPossible(reason) => {
                Some(format!("no lag or memory searched for: {reason}"))
            }
            Outcome::Found(found) => Some(found.words()),
        }
    }
}

/// Cells of an axis: error on new rows and the factor by which a new file may increase it, interval of a frame, test
/// error if known, range of the training loads.
pub(super) fn axis_row(
    axis: Axis,
    errors: Option<(f64, f64)>,
    interval: Option<&FrameInterval>,
    test: Option<f64>,
    range: Option<[f64; 2]>,
) -> Vec<String> {
    let (at, unknown) = (axis.index(), || "unknown".to_owned());
    let errors = errors.map(|(rms, spread)| match spread {
        1.0 => significant(rms, 3),
        _ => format!("{} to {}", significant(rms, 3), significant(spread * rms, 2)),
    });
    let frames = interval.map(|of| {
        let held = of.held.map(|held| format!(" holds {:.0} %", 100.0 * held[at]));
        format!("±{}{}", significant(of.half_width[at], 2), held.unwrap_or_default())
    });
    let range = range.map(|range| range.map(|load| significant(load, 2)).join(" to "));
    let mut row = vec![format!("{} ({})", axis.name(), axis.unit())];
    row.extend([errors, frames].map(|cell| cell.unwrap_or_else(unknown)));
    row.extend(test.map(|rms| significant(rms, 3)));
    row.push(range.unwrap_or_else(unknown));
    row
}

/// The line about a test: fault, share recorded at training poses, numbers of rows and of rows out of range, errors
/// relative to the promised ones.
pub(super) fn test_words(
    fault: Option<&str>,
    leak: Option<f64>,
    [rows, outside]: [u64; 2],
    ratio: Option<&TestRatio>,
) -> String {
    let mut said = match (fault, leak) {
        (Some(fault), _) => format!("NOT OK: {fault}"),
        (None, Some(share)) => format!(
            "NOT OK: {:.0} % of it was recorded at poses of the training data: test on other poses",
            100.0 * share
        ),
        (None, None) => match ratio.and_then(TestRatio::doubt) {
            Some(doubt) => format!("NOT KNOWN: {doubt}"),
            None => format!("OK: {rows} rows"),
        },
    };
    if let Some(of) = ratio.filter(|_| said.starts_with("OK")) {
        let [low, high] = of.interval.map(|bound| significant(bound, 2));
        let ratio = significant(of.ratio, 2);
        said += &format!(", {} errs {ratio} times as much as promised", of.axis.name());
        said += &format!(" (95 %: {low} to {high})");
    }
    if outside > 0 {
        said += &format!("; {outside} of {rows} rows out of range");
    }
    said
}

/// Number of days on which rows were recorded, if their times are calendar times.
fn days(data: &Dataset) -> usize {
    const DAY_S: f64 = 86_400.0;
    // Times from 2001 on; a clock that starts with a recording does not run that long.
    const CALENDAR_S: f64 = 1e9;
    let firsts = data.blocks().filter_map(|(_, block)| block.rows.time_s.first());
    let days = firsts.filter(|time| **time > CALENDAR_S).map(|time| (time / DAY_S) as u64);
    days.collect::<HashSet<u64>>().len()
}

impl UnseenRows {
    fn header(&self) -> String {
        match self {
            Self::Test(_) => "error on the test".to_owned(),
            Self::HeldOut { by, .. } => format!("error on new {}", by.plural()),
        }
    }
}

impl Screen {
    /// Lines of at most a hundred characters.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = self.headlines();
        let cells: Vec<&Vec<String>> = std::iter::once(&self.header).chain(&self.rows).collect();
        let width = |column: usize| {
            cells.iter().map(|row| row[column].chars().count()).max().unwrap_or_default()
        };
        let widths: Vec<usize> = (0..self.header.len()).map(width).collect();
        for row in cells {
            let cell = |(at, (text, width)): (usize, (&String, &usize))| match at {
                0 => format!("{text:<width$}"),
                _ => format!("{text:>width$}"),
            };
            let cells: Vec<String> = row.iter().zip(&widths).enumerate().map(cell).collect();
            lines.push(cells.join("  "));
        }
        lines.extend(self.note_lines());
        lines
    }

    pub fn headlines(&self) -> Vec<String> {
        wrapped("", 0, &self.headline)
    }

    pub fn note_lines(&self) -> Vec<String> {
        self.notes.iter().flat_map(|(label, text)| wrapped(label, LABEL, text)).collect()
    }
}

/// Wraps text to lines; the first line begins with the label.
fn wrapped(label: &str, indent: usize, text: &str) -> Vec<String> {
    let mut lines = vec![format!("{label:<indent$}")];
    for word in text.split(' ') {
        let last = lines.last_mut().expect("the first line");
        let is_empty = last.chars().count() == indent;
        if !is_empty && last.chars().count() + 1 + word.chars().count() > WIDTH {
            lines.push(format!("{:indent$}{word}", ""));
        } else {
            let gap = if is_empty { "" } else { " " };
            last.push_str(gap);
            last.push_str(word);
        }
    }
    lines
}
