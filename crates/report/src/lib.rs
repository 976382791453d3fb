//! Reports as HTML: of a batch of trials, with its tables, its figures to zoom into, and what it takes to make
//! it again; and of a calibration.
//!
//! A file needs no network: style, program and plotting library (plotly.js, MIT) are in it, and a
//! content security policy forbids everything else. Whatever comes from files (names, conditions,
//! notes, messages) is text: escaped in HTML (`markup`), `<` written `\u003c` in the numbers' JSON.

mod content;
mod markup;
mod numbers;
mod of_calibration;
mod outliers;
mod page;
mod sections;
mod units;

use content::MOST_TRACES;
pub use content::{CalibrationFacts, CalibrationSource, Heading, Input, Report};
pub use markup::figure;
pub use of_calibration::{
    CalibrationReport, Certificate, CheckedLoad, Contribution, EvaluationType,
};
pub use outliers::{OutlierRow, OutlierTable};
use page::page;
use shell_data::escape;
use trial::{ConditionRow, Per, Quantity};

const SCRIPT: &str = include_str!("../assets/report.js");
const PLOTLY: &[u8] = include_bytes!("../assets/plotly-cartesian.min.js.zst");
const PLOTLY_LICENCE: &str = include_str!("../assets/plotly-LICENSE.txt");

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
        let numbers = numbers::ReportNumbers::new(self);
        let data = serde_json::to_string(&numbers).expect("numbers and text are always JSON");
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
        page(self.heading, &sections::subtitle(self), &sections::of(self, &numbers), script)
    }
}
