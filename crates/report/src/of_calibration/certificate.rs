//! A certificate: one page to print, in the terms of the GUM (JCGM 100:2008).

use std::fmt::Write;

use super::super::markup::{TableCell, escape, table};
use super::super::page::page;
use super::super::sections::calibration::{scales, sources_table};
use super::super::sections::parts::facts_table;
use super::super::units::ColumnUnit;
use super::super::{CalibrationFacts, Heading};
use super::{LOADS, loads};
use calibration::validation::excitation::Excitation;
use serde::{Serialize, Serializer};
use shell_data::wrench::{Axes, Axis, PerAxis};

/// The coverage factor: 95 % of normal errors.
const COVERAGE: f64 = 2.0;

/// What a certificate says. N and N·m.
#[derive(Clone, Debug)]
pub struct Certificate<'a> {
    /// What it is about, and where it comes from.
    pub heading: Heading<'a>,
    /// The calibration, and what it was made from.
    pub calibration: CalibrationFacts<'a>,
    /// Which loads were calibrated.
    pub excitation: Option<&'a Excitation>,
    /// What the uncertainty consists of.
    pub budget: &'a [Contribution],
    /// What is to be said of the 95 % intervals of single frames.
    pub intervals: &'a str,
    /// Known weights beside what the sensor said of them.
    pub weights: &'a [CheckedLoad],
}

/// A line of an uncertainty budget.
#[derive(Clone, Debug, PartialEq)]
pub struct Contribution {
    /// What makes the wrench uncertain.
    pub source: &'static str,
    /// How its uncertainty was evaluated.
    pub evaluation: EvaluationType,
    /// Where the number comes from, or why there is none.
    pub basis: String,
    /// The standard uncertainty of each axis, if it is known.
    pub standard: Option<PerAxis<f64>>,
    /// Whether another line has it already.
    pub is_part: bool,
}

/// How a standard uncertainty was evaluated (GUM, 3.3.4).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EvaluationType {
    /// From observations.
    TypeA,
    /// From what was known before.
    TypeB,
}

/// A known weight beside what the sensor says.
#[derive(Clone, Debug, Serialize)]
pub struct CheckedLoad {
    /// The label of the weight.
    pub group: String,
    /// The weight in words.
    pub load: String,
    /// What it is, N and N·m.
    pub stated: PerAxis<f64>,
    /// What the sensor says, N and N·m.
    pub measured: PerAxis<f64>,
    /// How far these may differ.
    pub allowed: PerAxis<f64>,
    /// The calibrated axes that differ by more.
    #[serde(serialize_with = "columns")]
    pub off: Axes,
}

fn columns<S: Serializer>(axes: &Axes, serializer: S) -> Result<S::Ok, S::Error> {
    axes.columns().serialize(serializer)
}

impl Certificate<'_> {
    /// The combined standard uncertainty of each axis: the root of the sum of the squares that are known (GUM, 5.1.2).
    pub fn combined(&self) -> PerAxis<f64> {
        let parts = self.budget.iter().filter(|of| !of.is_part).filter_map(|of| of.standard);
        let squares = |axis: usize| parts.clone().map(move |part| part[axis] * part[axis]);
        std::array::from_fn(|axis| squares(axis).fold(0.0, |sum, square| sum + square).sqrt())
    }

    /// The expanded uncertainty of each axis: that times the coverage factor 2 (GUM, 6.2.1).
    pub fn expanded(&self) -> PerAxis<f64> {
        self.combined().map(|u| COVERAGE * u)
    }

    /// The certificate as the content of an HTML file.
    pub fn html(&self) -> String {
        let facts = facts_table("The calibration", &self.calibration.facts);
        let sections = [
            ("sensor", "The sensor and its calibration", facts),
            ("loads", "Loads that were calibrated", self.loads()),
            ("uncertainty", "Uncertainty", self.uncertainty()),
            ("weights", "Check weights", self.checked()),
            ("origin", "Traceability", self.origin()),
        ];
        page(self.heading, &self.heading.made(), &sections, None)
    }

    fn loads(&self) -> String {
        let Some(excitation) = self.excitation else {
            return "<p>The calibration file does not say which loads it was made from.</p>\n"
                .into();
        };
        let rows = loads(excitation, self.calibration.axes);
        table("Loads of the calibration; outside them it is not valid", &LOADS, rows)
    }

    fn uncertainty(&self) -> String {
        let (combined, expanded) = (self.combined(), self.expanded());
        let scales: [ColumnUnit; 2] = scales(|axis| vec![expanded[axis.index()]]);
        let axes: Vec<Axis> = self.calibration.axes.iter().collect();
        let names: Vec<String> =
            axes.iter().map(|axis| scales[axis.index() / 3].name(axis.name())).collect();
        let figures = |values: Option<PerAxis<f64>>| {
            let value = |axis: &Axis| {
                let value = values.map(|all| all[axis.index()]);
                TableCell::Figure(scales[axis.index() / 3].value(value))
            };
            axes.iter().map(value).collect::<Vec<_>>()
        };
        let line = |name: &str, kind: &str, values: Option<PerAxis<f64>>, basis: &str| {
            let mut row = vec![TableCell::from(name), TableCell::from(kind)];
            row.extend(figures(values));
            row.push(TableCell::Long(basis.to_owned()));
            row
        };
        let contribution = |of: &Contribution| {
            let kind = match of.evaluation {
                EvaluationType::TypeA => "A",
                EvaluationType::TypeB => "B",
            };
            let part = if of.is_part { "of which " } else { "" };
            line(&format!("{part}{}", of.source), kind, of.standard, &of.basis)
        };
        let mut rows: Vec<Vec<TableCell>> = self.budget.iter().map(contribution).collect();
        let sum = "combined standard uncertainty";
        rows.push(line(sum, "", Some(combined), "root of the sum of the squares"));
        rows.push(line("expanded uncertainty, k = 2", "", Some(expanded), "95 % of normal errors"));
        let mut header = vec!["standard uncertainty", "type"];
        header.extend(names.iter().map(String::as_str));
        header.push("from");
        let mut html = table("Uncertainty budget of a single frame", &header, rows);
        let unknown: Vec<&str> =
            self.budget.iter().filter(|of| of.standard.is_none()).map(|of| of.source).collect();
        if !unknown.is_empty() {
            let unknown = unknown.join(", ");
            let unknown = escape(&unknown);
            let _ = writeln!(
                html,
                "<p class=\"warning\"><strong>Not in the sum:</strong> {unknown}, of which nothing was stated.</p>"
            );
        }
        let _ = writeln!(html, "<p>{}</p>", escape(self.intervals));
        html
    }

    fn checked(&self) -> String {
        if self.weights.is_empty() {
            return String::new();
        }
        let row = |of: &CheckedLoad, axis: Axis| {
            let [stated, measured, allowed] =
                [of.stated, of.measured, of.allowed].map(|values| values[axis.index()]);
            let scale = ColumnUnit::new(axis.unit(), [stated, measured, allowed]);
            let figures = [stated, measured, measured - stated, allowed];
            let name = format!("{}: {}", of.group, of.load);
            let mut row = vec![TableCell::Text(name), TableCell::from(axis.name())];
            row.extend(figures.map(|x| TableCell::Figure(scale.value(Some(x)))));
            row.push(TableCell::Text(scale.unit));
            row.push(TableCell::from(if of.off.contains(axis) { "off" } else { "passes" }));
            row
        };
        let header =
            ["load", "axis", "stated", "measured", "difference", "allowed", "unit", "result"];
        let axes = self.calibration.axes;
        let rows = self.weights.iter().flat_map(|of| axes.iter().map(move |axis| row(of, axis)));
        table("Known weights on the calibrated sensor", &header, rows)
    }

    fn origin(&self) -> String {
        let command = escape(self.heading.command);
        let sources = sources_table(&self.calibration);
        format!(
            "{sources}<pre><code>{command}</code></pre>\n<p>Calibrated by: ____________________ \
             Checked by: ____________________ Date: ______________</p>\n"
        )
    }
}
