//! Screen of a fit: about twelve lines that say what the fit is worth, identical in the terminal,
//! the report, the page and Python.

use super::examination::FaultPlace;
use super::outcome::Outcome;
use super::verdict::{UnseenRows, Verdict};
use least_squares::quality::significant;
use shell_data::dataset::Dataset;
use shell_data::wrench::Axis;
use std::collections::HashSet;

const WIDTH: usize = 100;

const LABEL: usize = 7;

/// The summary of a fit that users see.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Screen {
    /// The verdict: whether to use the fit, or why not.
    pub headline: String,
    /// The headers of the columns in the table of axes.
    pub header: Vec<String>,
    /// A row for each axis.
    pub rows: Vec<Vec<String>>,
    /// Lines about model, test, data, clock, next step and files, each with its label.
    pub notes: Vec<(&'static str, String)>,
}

impl Verdict<'_> {
    /// The screen of the verdict; `files` names the files that were written, if any.
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
            let interval = self.interval.as_ref().ok();
            let half = interval.map(|of| format!("±{}", significant(of.half_width[at], 2)));
            let range = fit.excitation.as_ref().map(|of| {
                let [min, max] =
                    [of.axes[at].min, of.axes[at].max].map(|load| significant(load, 2));
                format!("{min} to {max}")
            });
            let mut row = vec![format!("{} ({})", axis.name(), axis.unit())];
            let spread = self.unseen.as_ref().and_then(|of| of.spread);
            let most = spread.map(|spread| format!(" to {}", significant(spread[at] * errors, 2)));
            row.push(significant(errors, 3) + &most.unwrap_or_default());
            row.push(half.unwrap_or_else(|| "unknown".to_owned()));
            row.extend(test.map(|of| significant(of[at].rms, 3)));
            row.push(range.unwrap_or_else(|| "unknown".to_owned()));
            row
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
        let mut said = match (self.fault(FaultPlace::Test), self.fit.leaks.in_test()) {
            (Some(fault), _) => format!("NOT OK: {fault}"),
            (None, Some(share)) => format!(
                "NOT OK: {:.0} % of it was recorded at poses of the training data: test on other poses",
                100.0 * share
            ),
            (None, None) => format!("OK: {} rows", test.rows),
        };
        let ratio = self.fit.examination.as_ref().and_then(|of| of.test);
        if let Some(of) = ratio.filter(|_| said.starts_with("OK")) {
            let [low, high] = of.interval.map(|bound| significant(bound, 2));
            let ratio = significant(of.ratio, 2);
            said += &format!(", {} errs {ratio} times the error on the left", of.axis.name());
            if of.interval[1].is_finite() {
                said += &format!(" (95 %: {low} to {high})");
            }
        }
        if test.out_of_range_rows > 0 {
            let (outside, rows) = (test.out_of_range_rows, test.rows);
            said += &format!("; {outside} of {rows} rows out of range");
        }
        said
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
    /// The whole screen as lines of text of at most a hundred characters.
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

    /// The headline, wrapped to lines.
    pub fn headlines(&self) -> Vec<String> {
        wrapped("", 0, &self.headline)
    }

    /// The notes, wrapped to lines.
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
