//! Reports as HTML: of a batch of trials, with its tables, its figures to zoom into, and what it takes to make
//! it again; and of a calibration.
//!
//! A file needs no network: style, program and plotting library (plotly.js, MIT) are in it, and a
//! content security policy forbids everything else. Whatever comes from files (names, conditions,
//! notes, messages) is text: escaped in HTML (`markup`), `<` written `\u003c` in the numbers' JSON.

mod markup;
mod numbers;
mod of_calibration;
mod sections;
mod units;

use calibration_file::CalibrationFile;
pub use markup::Heading;
use markup::{Column, page, table};
pub use of_calibration::{
    CalibrationReport, Certificate, CheckedLoad, Contribution, add_to_plot, plots,
};
use serde::Serialize;
use shell_data::escape;
use trial::{ConditionRow, Per, PhaseProfile, Quantity, TrialResult};

const SCRIPT: &str = include_str!("../assets/report.js");
const PLOTLY: &[u8] = include_bytes!("../assets/plotly-cartesian.min.js.zst");
const PLOTLY_LICENCE: &str = include_str!("../assets/plotly-LICENSE.txt");

/// Traces of so many trials are drawn at most: a report is to stay readable, and below 10 MB.
const MOST_TRACES: usize = 100;

/// What a report says. Times are in s on each log's clock, all else in SI units.
#[derive(Clone, Debug)]
pub struct Report<'a> {
    /// What it is about, and where it comes from.
    pub heading: Heading<'a>,
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
    /// The name and the content of the file that converted the readings; `None` for logs without sensors.
    pub calibration: Option<(&'a str, &'a CalibrationFile)>,
    /// Length of the robot, m, if known: for the shading of entering and leaving.
    pub robot_length_m: Option<f64>,
    /// Length of the channel, m.
    pub channel_length_m: f64,
    /// What went in.
    pub inputs: &'a [Input],
    /// Rows in the windows with a reading that cannot be trusted; `None` without forces.
    pub doubtful: Option<OutlierTable>,
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
    /// As `log_file::checksum` gives it.
    pub checksum: String,
}

/// Rows that are not to be trusted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OutlierTable {
    /// As many of them as are shown.
    pub rows: Vec<OutlierRow>,
    /// All of them.
    pub count: usize,
    /// Whether they were left out.
    pub left_out: bool,
}

/// A row that is not to be trusted.
#[derive(Clone, Debug, PartialEq)]
pub struct OutlierRow {
    /// Its log.
    pub file: String,
    /// Its line, or row of a table.
    pub line: u64,
    /// What is wrong with it.
    pub what: String,
}

impl OutlierTable {
    /// A sentence about them, and a table of the rows.
    fn html(&self, sentence: &str, caption: &str) -> String {
        if self.count == 0 {
            return "<p>None was found.</p>\n".to_owned();
        }
        let columns = [
            Column::text("log", self.rows.iter().map(|row| &row.file)),
            Column::numbers("line", self.rows.iter().map(|row| row.line)),
            Column::long("what", self.rows.iter().map(|row| &row.what)),
        ];
        let caption = match self.rows.len() == self.count {
            true => caption.to_owned(),
            false => format!("The first {} of them", self.rows.len()),
        };
        format!("<p>{}</p>\n{}", escape::markup(sentence), table(&caption, &columns))
    }
}

impl Report<'_> {
    /// The statistics of a quantity over trials or strides.
    fn of(&self, quantity: Quantity, per: Per) -> Vec<&ConditionRow> {
        let is_wanted = |row: &&ConditionRow| row.quantity == quantity && row.per == per;
        self.conditions.iter().filter(is_wanted).collect()
    }

    /// The condition that the others are compared with, if there is one.
    fn reference(&self) -> Option<&str> {
        self.conditions.iter().find_map(|row| Some(&*row.difference.as_ref()?.reference))
    }

    /// The report as the content of an HTML file.
    pub fn html(&self) -> String {
        let plots = numbers::Plots::new(self);
        let data = plots.json();
        let data = escape::script_json(&data);
        let plotly = String::from_utf8(figures::decompressed(PLOTLY)).expect("an asset of text");
        let script = format!(
            r#"<script id="data" type="application/json">{data}</script>
<!-- plotly.js, which follows:
{PLOTLY_LICENCE}-->
<script>{plotly}</script>
<script>
{SCRIPT}</script>
"#
        );
        let script = Some((&*script, "The plots need JavaScript; the tables do not."));
        page(self.heading, &sections::subtitle(self), &sections::of(self, &plots), script)
    }
}
