//! A certificate: one printable page, in the terms of the GUM (JCGM 100:2008).

use std::fmt::Write;

use super::super::Heading;
use super::super::markup::{Column, escape, facts_table, page, reproduction, table};
use super::super::sections::calibration::{facts, sources_table};
use super::super::units::{AxisUnits, ColumnUnit};
use super::loads;
use calibration::quality::significant;
use calibration::uncertainty::student_quantile;
use calibration_file::CalibrationFile;
use serde::Serialize;
use shell_data::wrench::{Axes, PerAxis};

/// The coverage probability of an expanded uncertainty.
const LEVEL: f64 = 0.95;

/// The coverage factor if no degrees of freedom are known: 95 % of normal errors.
const COVERAGE: f64 = 2.0;

/// The content of a certificate, N and N·m.
#[derive(Clone, Debug)]
pub struct Certificate<'a> {
    pub heading: Heading<'a>,
    pub file: &'a CalibrationFile,
    pub name: &'a str,
    pub checksum: &'a str,
    pub budget: &'a [Contribution],
    /// A statement on the 95 % intervals of single frames.
    pub intervals: &'a str,
    pub weights: &'a [CheckedLoad],
    /// Weights, and axes of weights, whose comparison was requested but impossible.
    pub not_compared: &'a [String],
}

#[derive(Clone, Debug, PartialEq)]
pub struct Contribution {
    pub source: &'static str,
    /// The type of evaluation (GUM, 3.3.4): "A" from observations, "B" from prior knowledge.
    pub evaluation: &'static str,
    /// The origin of the number, or the reason for its absence.
    pub basis: String,
    pub standard: Option<PerAxis<f64>>,
    /// Degrees of freedom (GUM, G.3.3), from the number of observations; `None` if taken as exact.
    pub degrees_of_freedom: Option<f64>,
    /// True if another line already includes it.
    pub is_part: bool,
}

/// Formats degrees of freedom with the significant digits only.
fn digits(degrees: f64) -> String {
    match degrees.is_finite() {
        true => significant(degrees, usize::max(2, degrees.log10() as usize + 1)),
        false => "∞".to_owned(),
    }
}

#[derive(Clone, Debug, Serialize)]
pub struct CheckedLoad {
    pub group: String,
    pub load: String,
    pub stated: PerAxis<f64>,
    pub measured: PerAxis<f64>,
    pub allowed: PerAxis<f64>,
    pub off: Axes,
    /// True if the weight is so light that an unloaded sensor would pass as well.
    pub cannot_tell: bool,
    /// The angle between the measured and the stated force, degrees, if their magnitudes agree and
    /// the angle exceeds the limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub turned_deg: Option<f64>,
}

impl Certificate<'_> {
    /// Combined standard uncertainty: the root of the sum of the known squares (GUM, 5.1.2).
    pub fn combined(&self) -> PerAxis<f64> {
        let parts = self.budget.iter().filter(|of| !of.is_part).filter_map(|of| of.standard);
        let squares = |axis: usize| parts.clone().map(move |part| part[axis] * part[axis]);
        std::array::from_fn(|axis| squares(axis).fold(0.0, |sum, square| sum + square).sqrt())
    }

    /// Effective degrees of freedom by the Welch-Satterthwaite formula (GUM, G.4.1); infinite if
    /// all uncertainties are taken as exact.
    pub fn degrees_of_freedom(&self) -> PerAxis<f64> {
        let combined = self.combined();
        let parts = self.budget.iter().filter(|of| !of.is_part);
        let parts = parts.filter_map(|of| Some((of.standard?, of.degrees_of_freedom?)));
        std::array::from_fn(|axis| {
            let share = |(standard, degrees): (PerAxis<f64>, f64)| standard[axis].powi(4) / degrees;
            let sum: f64 = parts.clone().map(share).sum();
            if sum > 0.0 { combined[axis].powi(4) / sum } else { f64::INFINITY }
        })
    }

    /// Coverage factors: the 95 % quantiles of Student's t (GUM, G.6.4), or 2 for infinite degrees.
    pub fn coverage(&self) -> PerAxis<f64> {
        self.degrees_of_freedom().map(|degrees| match degrees.is_finite() {
            true => student_quantile(LEVEL, degrees),
            false => COVERAGE,
        })
    }

    /// Expanded uncertainty: combined uncertainty times the coverage factor (GUM, 6.2.1).
    pub fn expanded(&self) -> PerAxis<f64> {
        let (combined, coverage) = (self.combined(), self.coverage());
        std::array::from_fn(|axis| coverage[axis] * combined[axis])
    }

    pub fn html(&self) -> String {
        let mut facts = facts(self.name, self.file);
        facts.push(("checksum of the file", self.checksum.to_owned()));
        let facts = self.warnings() + &facts_table("The calibration", &facts);
        let sections = [
            ("sensor", "The sensor and its calibration", facts),
            ("loads", "Loads that were calibrated", self.loads()),
            ("uncertainty", "Uncertainty", self.uncertainty()),
            ("weights", "Check weights", self.checked()),
            ("origin", "Traceability", self.origin()),
        ];
        page(self.heading, &self.heading.made(), &sections, None)
    }

    /// Reasons not to use the calibration: the verdict of its fit, and check weights that are off.
    fn warnings(&self) -> String {
        let verdict = self.file.not_ok().map(str::to_owned);
        let off = self.weights.iter().filter(|of| !of.off.is_empty());
        let off: Vec<&str> = off.map(|of| of.group.as_str()).collect();
        let weights =
            (!off.is_empty()).then(|| format!("NOT OK: check weights are off: {}", off.join(", ")));
        let warning =
            |text: String| format!("<p class=\"warning\"><strong>{}</strong></p>\n", escape(&text));
        verdict.into_iter().chain(weights).map(warning).collect()
    }

    fn loads(&self) -> String {
        let diagnostics = self.file.origin.diagnostics.as_ref();
        let Some(excitation) = diagnostics.and_then(|of| of.excitation.as_ref()) else {
            return "<p>The calibration file does not say which loads it was made from.</p>\n"
                .into();
        };
        let columns = loads(excitation, self.file.calibration.axes);
        table("Loads of the calibration; outside them it is not valid", &columns)
    }

    fn uncertainty(&self) -> String {
        let (combined, expanded) = (self.combined(), self.expanded());
        let units = AxisUnits::new(|axis| vec![expanded[axis.index()]]);
        let mut lines = Vec::new();
        for of in self.budget {
            let part = if of.is_part { "of which " } else { "" };
            lines.push((format!("{part}{}", of.source), of.evaluation, of.standard, &*of.basis));
        }
        let sum = "combined standard uncertainty".to_owned();
        lines.push((sum, "", Some(combined), "root of the sum of the squares"));
        let (whole, basis) = self.coverage_words();
        lines.push((whole, "", Some(expanded), &basis));
        let mut columns = vec![
            Column::text("standard uncertainty", lines.iter().map(|line| &line.0)),
            Column::text("type", lines.iter().map(|line| line.1)),
        ];
        columns.extend(self.file.calibration.axes.iter().map(|axis| {
            let unit = units.of(axis);
            let values = lines.iter().map(|line| unit.value(line.2.map(|all| all[axis.index()])));
            Column::numbers(&unit.name(axis.name()), values)
        }));
        let degrees = self.budget.iter().map(|of| of.degrees_of_freedom.map_or("∞".into(), digits));
        let none = std::iter::repeat_n(String::new(), 2);
        columns.push(Column::text("ν", degrees.chain(none)));
        columns.push(Column::long("from", lines.iter().map(|line| line.3)));
        let mut html = table("Uncertainty budget of a single frame", &columns);
        let unknown: Vec<&str> =
            self.budget.iter().filter(|of| of.standard.is_none()).map(|of| of.source).collect();
        if !unknown.is_empty() {
            let unknown = unknown.join(", ");
            let _ = writeln!(
                html,
                "<p class=\"warning\"><strong>Not in the sum:</strong> {}, of which nothing was stated.</p>",
                escape(&unknown)
            );
        }
        let _ = writeln!(html, "<p>{}</p>", escape(self.intervals));
        html
    }

    fn coverage_words(&self) -> (String, String) {
        let (coverage, degrees) = (self.coverage(), self.degrees_of_freedom());
        let axes = || self.file.calibration.axes.iter().map(|axis| axis.index());
        if axes().all(|axis| !degrees[axis].is_finite()) {
            return ("expanded uncertainty, k = 2".into(), "95 % of normal errors".into());
        }
        let shown: Vec<String> = axes().map(|axis| format!("{:.2}", coverage[axis])).collect();
        let degrees: Vec<String> = axes().map(|axis| digits(degrees[axis])).collect();
        let all = |texts: &[String]| match texts.iter().all(|text| *text == texts[0]) {
            true => texts[0].clone(),
            false => texts.join(", "),
        };
        let basis = format!(
            "95 % of Student's t with {} effective degrees of freedom (GUM, G.4.1)",
            all(&degrees)
        );
        (format!("expanded uncertainty, k = {}", all(&shown)), basis)
    }

    fn checked(&self) -> String {
        if self.weights.is_empty() {
            return String::new();
        }
        let mut rows = Vec::new();
        for of in self.weights {
            for axis in self.file.calibration.axes.iter() {
                let values = [of.stated, of.measured, of.allowed];
                let [stated, measured, allowed] = values.map(|values| values[axis.index()]);
                let scale = ColumnUnit::new(axis.unit(), [stated, measured, allowed]);
                rows.push((of, axis, [stated, measured, measured - stated, allowed], scale));
            }
        }
        let names = rows.iter().map(|(of, ..)| format!("{}: {}", of.group, of.load));
        let mut columns = vec![
            Column::text("load", names),
            Column::text("axis", rows.iter().map(|(_, axis, ..)| axis.name())),
        ];
        for (at, name) in ["stated", "measured", "difference", "allowed"].into_iter().enumerate() {
            let values = rows.iter().map(|(.., values, scale)| scale.value(Some(values[at])));
            columns.push(Column::numbers(name, values));
        }
        let result = |of: &CheckedLoad, axis| match of.off.contains(axis) {
            true => "off",
            false if of.cannot_tell => "cannot tell",
            false => "passes",
        };
        columns.push(Column::text("unit", rows.iter().map(|(.., scale)| &scale.unit)));
        columns.push(Column::text("result", rows.iter().map(|&(of, axis, ..)| result(of, axis))));
        let missing = self.not_compared.iter().map(|what| format!("<p>{}</p>\n", escape(what)));
        table("Known weights on the calibrated sensor", &columns) + &missing.collect::<String>()
    }

    fn origin(&self) -> String {
        let signatures = "<p>Calibrated by: ____________________ Checked by: ____________________ \
                          Date: ______________</p>\n";
        sources_table(self.file) + &reproduction(self.heading.command) + signatures
    }
}
