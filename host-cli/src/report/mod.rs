//! A report of a batch of trials: one HTML file with its tables, its figures to zoom into, and what
//! it takes to make it again.
//!
//! The file needs no network: style, program and plotting library (plotly.js, MIT) are in it, and a
//! content security policy forbids everything else. Whatever comes from files (names, conditions,
//! notes, messages) is text: escaped in HTML (`markup`), `<` written `\u003c` in the numbers' JSON.

mod content;
mod markup;
mod numbers;
mod sections;
mod units;

use flate2::read::GzDecoder;

pub use content::{CalibrationFacts, CalibrationSource, Input, MOST_TRACES, Report};
pub(crate) use markup::figure;
use markup::{escape, script_json};

const STYLE: &str = include_str!("../../assets/report/report.css");
const SCRIPT: &str = include_str!("../../assets/report/report.js");
/// Compressed, as it would be an eighth of the program otherwise.
const PLOTLY: &[u8] = include_bytes!("../../assets/report/plotly-cartesian.min.js.gz");
const PLOTLY_LICENCE: &str = include_str!("../../assets/report/plotly-LICENSE.txt");

impl Report<'_> {
    /// The report as the content of an HTML file.
    pub fn html(&self) -> String {
        let numbers = numbers::ReportNumbers::of(self);
        let data = script_json(&numbers);
        let title = escape(self.title);
        let body = sections::body(self, &numbers);
        let made_by = escape(self.made_by);
        let plotly = std::io::read_to_string(GzDecoder::new(PLOTLY)).expect("an asset of text");
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
<script>{plotly}</script>
<script>
{SCRIPT}</script>
</body>
</html>
"#
        )
    }
}
