//! HTML reports of a batch of trials and of a calibration, with the command that reproduces them.
//!
//! A file needs no network: it contains the style, the script and the plotting library (plotly.js,
//! MIT), and a content security policy forbids all else. Text from files (names, conditions, notes,
//! messages) is escaped in HTML (`markup`); in the JSON of the numbers, `<` becomes `\u003c`.

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

/// The maximum number of traces: a report should stay readable, and below 10 MB.
const MOST_TRACES: usize = 100;

/// The content of a report. Times are in s on each log's clock, all else in SI units.
#[derive(Clone, Debug)]
pub struct Report<'a> {
    pub heading: Heading<'a>,
    /// Results in the manifest's order, with a thinned trace of each log to be plotted.
    pub trials: &'a [TrialResult],
    /// Trials that could not be evaluated: file and reason.
    pub failed: &'a [(String, String)],
    pub conditions: &'a [ConditionRow],
    pub phases: &'a [(String, PhaseProfile)],
    pub settings: &'a [(String, String)],
    /// Name and content of the calibration file; `None` for logs without sensors.
    pub calibration: Option<(&'a str, &'a CalibrationFile)>,
    /// Length of the robot, m, if known; used to shade entry and exit.
    pub robot_length_m: Option<f64>,
    pub channel_length_m: f64,
    pub inputs: &'a [Input],
    /// Rows in the windows with an unreliable reading; `None` without forces.
    pub doubtful: Option<OutlierTable>,
    pub warnings: &'a [String],
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Input {
    /// Its role: "log", "manifest", "calibration", "profile".
    pub role: String,
    pub path: String,
    pub bytes: u64,
    pub checksum: String,
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct OutlierTable {
    pub rows: Vec<OutlierRow>,
    pub count: usize,
    /// True if the rows were omitted from the evaluation.
    pub left_out: bool,
}

#[derive(Clone, Debug, PartialEq)]
pub struct OutlierRow {
    pub file: String,
    pub line: u64,
    pub what: String,
}

impl OutlierTable {
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
    fn of(&self, quantity: Quantity, per: Per) -> Vec<&ConditionRow> {
        let is_wanted = |row: &&ConditionRow| row.quantity == quantity && row.per == per;
        self.conditions.iter().filter(is_wanted).collect()
    }

    fn reference(&self) -> Option<&str> {
        self.conditions.iter().find_map(|row| Some(&*row.difference.as_ref()?.reference))
    }

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
