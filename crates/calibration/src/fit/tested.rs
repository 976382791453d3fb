//! The verdict on a calibration by rows that were not used for the fit, on the same screen as a fit.

use super::evaluation::Evaluation;
use super::examination::{Examination, Promise};
use super::parts::spread;
use super::screen::{Screen, axis_row, test_words};
use super::verdict::{FrameInterval, USABLE, next_words, not_known, useless_axes, useless_words};
use crate::conversion::Calibration;
use crate::dynamics::Dynamics;
use crate::validation::excitation::{Excitation, Gap};
use least_squares::quality::AxisQuality;
use shell_data::block::Block;
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, Axis, PerAxis};

#[derive(Clone, Debug)]
pub struct TestedCalibration<'a> {
    /// Calibration of the axes that were compared.
    pub calibration: &'a Calibration,
    pub promise: Option<Promise>,
    pub excitation: Option<&'a Excitation>,
    pub evaluation: &'a Evaluation,
    pub quality: &'a PerAxis<AxisQuality>,
    pub interval: Option<FrameInterval>,
    pub examination: Examination,
    /// Name of a test log that was used for the fit, if there is one.
    pub fitted_to: Option<String>,
}

impl TestedCalibration<'_> {
    pub fn is_ok(&self) -> bool {
        self.unknown().is_none() && self.reasons().is_empty()
    }

    /// Reason why the test leaves the error on new loads unknown.
    fn unknown(&self) -> Option<String> {
        match (&self.fitted_to, &self.promise) {
            (Some(log), _) => Some(format!("`{log}` was used for the fit")),
            (None, None) => Some("the calibration file promises none to compare with".to_owned()),
            (None, Some(_)) => self.examination.test.as_ref()?.doubt(),
        }
    }

    /// Reasons not to use the calibration, most important first.
    pub fn reasons(&self) -> Vec<String> {
        let faults = self.examination.faults.iter();
        let faults = faults.map(|fault| format!(" on the test: {}", fault.text));
        let useless = useless_words(self.useless()).map(|words| format!(": {words}"));
        faults.chain(useless).collect()
    }

    fn useless(&self) -> Axes {
        let errors = self.quality.map(|of| of.rms);
        useless_axes(self.calibration.axes, &errors, self.excitation)
    }

    fn headline(&self) -> String {
        if let Some(reason) = self.reasons().first() {
            return format!("NOT OK{reason}");
        }
        match self.unknown() {
            Some(reason) => not_known(&reason),
            None => USABLE.to_owned(),
        }
    }

    pub fn screen(&self) -> Screen {
        let is_held_out = self.promise.as_ref().is_none_or(|promise| promise.is_held_out);
        let promised = match is_held_out {
            true => "error promised",
            false => "error on training rows",
        };
        let header = ["axis", promised, "95 % of frames", "error on your test", "calibrated range"];
        let row = |axis: Axis| {
            let at = axis.index();
            let promised = self.promise.as_ref().map(|of| (of.rms[at], of.spread[at]));
            let range = self.excitation.map(|of| [of.axes[at].min, of.axes[at].max]);
            axis_row(axis, promised, self.interval.as_ref(), Some(self.quality[at].rms), range)
        };
        let fault = self.examination.faults.first().map(|fault| fault.text.as_str());
        let counts = [self.evaluation.rows, self.evaluation.out_of_range_rows];
        let mut test = test_words(fault, None, counts, self.examination.test.as_ref());
        if self.evaluation.skipped_rows > 0 {
            test += &format!("; {} bad rows left out", self.evaluation.skipped_rows);
        }
        let mut notes = vec![("model", self.calibration.name()), ("test", test)];
        notes.extend(self.clock_words().map(|words| ("clock", words)));
        let gap = self.excitation.and_then(|of| of.gaps(self.calibration.axes).into_iter().next());
        notes.push(("next", self.next_words(gap.as_ref())));
        Screen {
            headline: self.headline(),
            header: header.map(str::to_owned).to_vec(),
            rows: self.calibration.axes.iter().map(row).collect(),
            notes,
        }
    }

    fn next_words(&self, gap: Option<&Gap>) -> String {
        let share = |axis: Axis| {
            let range = self.promise.as_ref()?.range[axis.index()];
            (range > 0.0).then(|| (axis, self.quality[axis.index()].rms / range))
        };
        let shares = self.calibration.axes.iter().filter_map(share);
        next_words(gap, shares)
            .unwrap_or_else(|| "fit again, for errors to compare with".to_owned())
    }

    fn clock_words(&self) -> Option<String> {
        let Calibration { lag, memory, .. } = self.calibration;
        let time_base = lag.map(|lag| lag.time_base).or(memory.as_ref().map(|of| of.time_base))?;
        let (lag, memory) = (*lag, memory.clone());
        let of = Dynamics { time_base, lag, lag_standard_error: None, memory, gain: None };
        Some(of.words())
    }
}

/// Mean half-width of the 95 % intervals, and share of rows within their interval, from a sample of the rows. `None`
/// without standard errors. `factors`: half-widths in standard errors.
pub fn frame_interval(
    calibration: &Calibration,
    factors: &PerAxis<f64>,
    data: &Dataset,
) -> Option<FrameInterval> {
    let blocks: Vec<&Block> = data.blocks().map(|(_, block)| &*block.rows).collect();
    let rows = spread(&blocks, 0.0..1.0);
    let errors = calibration.standard_errors(&rows.readings, None)?;
    let mut predicted = PerAxis::default();
    calibration.wrench(&rows.readings, &mut predicted);
    let count = rows.rows.max(1) as f64;
    let mean = |axis: usize| errors[axis].iter().sum::<f64>() / count * factors[axis];
    let held = |axis: usize| {
        let pairs = predicted[axis].iter().zip(&rows.wrench[axis]).zip(&errors[axis]);
        let within =
            pairs.filter(|((said, load), error)| (*said - *load).abs() <= factors[axis] * **error);
        within.count() as f64 / count
    };
    Some(FrameInterval {
        half_width: std::array::from_fn(mean),
        held: Some(std::array::from_fn(held)),
    })
}
