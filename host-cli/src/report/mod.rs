//! A report of a batch of trials: one HTML file with its tables, its figures to zoom into, and what
//! it takes to make it again.
//!
//! The file needs no network: style, program and plotting library (plotly.js, MIT) are in it, and a
//! content security policy forbids everything else. Whatever comes from files (names, conditions,
//! notes, messages) is text: escaped in HTML (`markup`), `<` written `\u003c` in the numbers' JSON.

mod markup;
mod numbers;
mod sections;

use serde::Serialize;

use crate::calibration_file::CalibrationFile;
use crate::trial::{ConditionRow, PhaseProfile, TrialResult};
use markup::{escape, script_json};

/// Traces of so many trials are drawn at most: a report is to stay readable, and below 10 MB.
pub const MOST_TRACES: usize = 100;

const STYLE: &str = include_str!("../../assets/report/report.css");
const SCRIPT: &str = include_str!("../../assets/report/report.js");
const PLOTLY: &str = include_str!("../../assets/report/plotly-cartesian.min.js");
const PLOTLY_LICENCE: &str = include_str!("../../assets/report/plotly-LICENSE.txt");

/// What a report says. Times are in s on each log's clock, all else in SI units.
#[derive(Clone, Debug)]
pub struct Report<'a> {
    /// What it is about.
    pub title: &'a str,
    /// Program and version.
    pub made_by: &'a str,
    /// When, in UTC, RFC 3339.
    pub date: &'a str,
    /// The command line that makes it again.
    pub command: &'a str,
    /// The results, in the manifest's order, with a thinned trace of the log where one is to be drawn.
    pub trials: &'a [TrialResult],
    /// Trials that could not be evaluated: file, and why.
    pub failed: &'a [(String, String)],
    /// The statistics by condition, in the order in which conditions are to be shown.
    pub conditions: &'a [ConditionRow],
    /// Drag and lift over a stride, by condition.
    pub phases: &'a [(String, PhaseProfile)],
    /// How trials were evaluated: name and value.
    pub settings: &'a [(String, String)],
    /// The calibration and its file's name; `None` for logs without sensors.
    pub calibration: Option<(&'a str, &'a CalibrationFile)>,
    /// Length of the robot, m, if known: for the shading of entering and leaving.
    pub robot_length_m: Option<f64>,
    /// Length of the channel, m.
    pub channel_length_m: f64,
    /// What went in.
    pub inputs: &'a [Input],
    /// Warnings that are not of one trial.
    pub warnings: &'a [String],
}

/// A file that went in.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Input {
    /// What it was used as: "log", "manifest", "calibration", "profile".
    pub role: String,
    /// The file as it was named.
    pub path: String,
    /// Its size.
    pub bytes: u64,
    /// As [`log_file::checksum`] gives it.
    pub checksum: String,
}

impl Report<'_> {
    /// The report as the content of an HTML file.
    pub fn html(&self) -> String {
        let numbers = numbers::Numbers::of(self);
        let data = script_json(&numbers);
        let title = escape(self.title);
        let body = sections::body(self, &numbers);
        let made_by = escape(self.made_by);
        format!(
            r#"<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'">
<meta name="generator" content="{made_by}">
<link rel="icon" href="data:,">
<title>{title}</title>
<style>
{STYLE}</style>
</head>
<body>
{body}
<script id="data" type="application/json">{data}</script>
<!-- plotly.js, which follows:
{PLOTLY_LICENCE}-->
<script>{PLOTLY}</script>
<script>
{SCRIPT}</script>
</body>
</html>
"#
        )
    }
}
