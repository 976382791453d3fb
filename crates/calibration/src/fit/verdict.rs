//! The verdict on a fit: its error on unseen data, the interval of a frame, and what to record next.

use std::fmt;

use super::examination::{Examination, Fault, FaultPlace};
use super::{Fit, FitMethod};
use crate::groups::GroupBy;
use crate::validation::excitation::{Excitation, Gap};
use sensor_physics::COVERAGE_LEVEL;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// An axis is useless if its RMS error exceeds the first share of its RMS load, or the second share of the range of its
/// loads. Evenly spread loads have a standard deviation of 0.29 ranges.
const USELESS: f64 = 0.5;
const USELESS_OF_RANGE: f64 = 0.25;

/// Number of rows whose standard errors are averaged for the width of the interval.
const ROWS_OF_INTERVAL: u64 = 1024;

/// Minimum of 1 − leverage: a fit without a row of higher leverage says next to nothing about that row.
const LEAST_LEFT: f64 = 0.1;

#[derive(Clone, Debug)]
pub struct Verdict<'a> {
    pub(super) fit: &'a Fit,
    pub axes: Axes,
    pub unseen: Option<UnseenErrors>,
    /// Interval that holds 95 % of single frames, or the reason why it is not known.
    pub interval: Result<FrameInterval, String>,
    /// Axes whose error is about as large as the loads.
    pub useless: Axes,
    gaps: Vec<Gap>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct UnseenErrors {
    /// Root mean square, N and N·m.
    pub rms: PerAxis<f64>,
    /// `rms` divided by the range of the training loads; `None` for an axis without a range.
    pub share_of_range: PerAxis<Option<f64>>,
    pub on: UnseenRows,
    /// Factor by which errors may be larger in a new file, from the scatter between files, if some were held out.
    pub spread: Option<PerAxis<f64>>,
}

/// Rows that were not used for a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum UnseenRows {
    /// Training rows, held out in folds of groups.
    HeldOut {
        by: GroupBy,
        groups: usize,
        folds: usize,
        /// True if the rows were not in order of time, so that rows similar to those of a fold remain in its fit.
        are_shuffled: bool,
    },
    /// Test rows, with their number.
    Test(u64),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameInterval {
    /// Half of the interval's width, N and N·m.
    pub half_width: PerAxis<f64>,
    /// The share of held-out rows within the interval, if they were counted.
    pub held: Option<PerAxis<f64>>,
}

impl Fit {
    pub fn unseen_errors(&self) -> Option<UnseenErrors> {
        unseen_errors(self)
    }

    pub fn verdict(&self) -> Verdict<'_> {
        let (axes, unseen) = (self.calibration.axes, self.unseen_errors());
        let errors = unseen.as_ref().map_or(self.train.map(|of| of.rms), |of| of.rms);
        let useless = useless_axes(axes, &errors, self.excitation.as_ref());
        let gaps = self.excitation.as_ref().map(|of| of.gaps(axes)).unwrap_or_default();
        Verdict { fit: self, axes, unseen, interval: interval(self), useless, gaps }
    }
}

impl Verdict<'_> {
    /// Returns true if errors on unseen rows are known and every check has passed.
    pub fn is_ok(&self) -> bool {
        self.unseen.is_some() && self.doubt().is_none() && self.reasons().is_empty()
    }

    /// Reason why the test leaves the error on new loads unknown.
    fn doubt(&self) -> Option<String> {
        self.fit.examination.as_ref()?.test.as_ref()?.doubt()
    }

    pub fn examination(&self) -> Option<&Examination> {
        self.fit.examination.as_ref()
    }

    /// Reasons not to use the fit, most important first, each with its subject.
    pub fn reasons(&self) -> Vec<String> {
        let of_model = self.reasons_of_model().into_iter().map(|reason| format!(": {reason}"));
        let faults = self.fit.examination.iter().flat_map(|of| &of.faults);
        let words = |fault: &Fault| match fault.place {
            FaultPlace::Test => format!(" on the test: {}", fault.text),
            FaultPlace::Data => format!(", the data: {}", fault.text),
        };
        let leak = self.fit.leaks.in_test().filter(|_| !self.is_tested_only()).map(|share| {
            format!(
                " on the test: {:.0} % of it was recorded at poses of the training data",
                100.0 * share
            )
        });
        faults.map(words).chain(of_model).chain(leak).collect()
    }

    /// The reasons that concern the model or its errors on unseen rows.
    pub(super) fn reasons_of_model(&self) -> Vec<String> {
        let leaks = self.fit.leaks;
        let (leak, rows) = match self.is_tested_only() {
            true => (leaks.in_test(), "test rows"),
            false => (leaks.in_groups(), "rows"),
        };
        let leak = leak.map(|share| {
            format!(
                "{:.0} % of the {rows} were recorded at poses that the fit has seen, so the error on new poses is \
                 not known",
                100.0 * share
            )
        });
        let wide = self.interval.as_ref().ok().and_then(|of| of.words_if_wide(self));
        leak.into_iter().chain(useless_words(self.useless)).chain(wide).collect()
    }

    fn is_tested_only(&self) -> bool {
        matches!(&self.unseen, Some(of) if matches!(of.on, UnseenRows::Test(_)))
    }

    pub(super) fn fault(&self, place: FaultPlace) -> Option<&str> {
        let faults = self.fit.examination.iter().flat_map(|of| &of.faults);
        faults.filter(|fault| fault.place == place).map(|fault| fault.text.as_str()).next()
    }

    /// First reason not to use the fit, as a headline.
    pub fn refusal(&self) -> Option<String> {
        self.reasons().first().map(|reason| format!("NOT OK{reason}"))
    }

    /// Says how to use the fit, or the first reason not to use it.
    pub fn headline(&self) -> String {
        if let Some(refusal) = self.refusal() {
            return refusal;
        }
        if self.unseen.is_none() {
            let reason = match &self.fit.not_judged {
                None => "nothing was held out (`--model auto` or `--cv` does)".to_owned(),
                Some(reason) => reason.to_string(),
            };
            return not_known(&reason);
        }
        if let Some(doubt) = self.doubt() {
            return not_known(&doubt);
        }
        let mut said = USABLE.to_owned();
        let unloaded = |gap: &Gap| if let Gap::Unloaded(axis) = gap { Some(*axis) } else { None };
        let unloaded: Axes = self.gaps.iter().filter_map(unloaded).collect();
        if !unloaded.is_empty() {
            said += &format!("; not for {unloaded}, which was never loaded");
        }
        said
    }

    pub(super) fn next_words(&self) -> String {
        let shares = self.unseen.as_ref().map(|of| of.share_of_range).unwrap_or_default();
        let known = self.axes.iter().filter_map(|axis| Some((axis, shares[axis.index()]?)));
        let judge = || match self.fit.not_judged {
            None => "hold out part of the loads (`--cv`), for the error on new ones".to_owned(),
            Some(_) => {
                "record loads in several poses, with a column `group` that numbers them, or in \
                     several files"
                    .to_owned()
            }
        };
        next_words(self.gaps.first(), known).unwrap_or_else(judge)
    }
}

impl FrameInterval {
    /// Describes intervals that are as wide as the range of the loads.
    fn words_if_wide(&self, verdict: &Verdict<'_>) -> Option<String> {
        let loads = verdict.fit.excitation.as_ref()?.axes;
        let is_wide = |axis: &Axis| {
            let (half, of) = (self.half_width[axis.index()], loads[axis.index()]);
            of.max > of.min && 2.0 * half >= of.max - of.min
        };
        let wide: Axes = verdict.axes.without(verdict.useless).iter().filter(is_wide).collect();
        (!wide.is_empty())
            .then(|| format!("the 95 % interval of {wide} is as wide as the range of its loads"))
    }
}

impl UnseenRows {
    /// Describes how errors were found; the text follows the name of the model.
    pub(super) fn words(&self) -> String {
        match *self {
            Self::Test(rows) => format!("judged by {rows} test rows"),
            Self::HeldOut { are_shuffled: true, .. } => {
                "judged by rows that were held out at random, which is optimistic (the rows are shuffled: nothing in \
                 them can be held out by time)"
                    .to_owned()
            }
            Self::HeldOut { by, groups, folds, .. } => {
                let how = match folds == groups {
                    true => "each held out once".to_owned(),
                    false => format!("held out in {folds} folds"),
                };
                format!("judged by {groups} {}, {how}", by.plural())
            }
        }
    }
}

pub(super) const USABLE: &str = "OK: use it within the calibrated range";

pub(super) fn not_known(reason: &dyn fmt::Display) -> String {
    format!("NOT KNOWN how large the error on new loads is: {reason}")
}

/// Reason not to use a calibration with these axes.
pub(super) fn useless_words(useless: Axes) -> Option<String> {
    (!useless.is_empty()).then(|| {
        format!("the error of {useless} is about as large as the loads: check its column, or load it more")
    })
}

/// The axes whose error is about as large as the training loads.
pub(super) fn useless_axes(
    axes: Axes,
    errors: &PerAxis<f64>,
    excitation: Option<&Excitation>,
) -> Axes {
    let is_useless = |axis: &Axis| {
        excitation.map(|of| of.axes[axis.index()]).is_some_and(|of| {
            let range = of.max - of.min;
            range > 0.0 && errors[axis.index()] > (USELESS * of.rms).min(USELESS_OF_RANGE * range)
        })
    };
    axes.iter().filter(is_useless).collect()
}

fn unseen_errors(fit: &Fit) -> Option<UnseenErrors> {
    let test = fit.test();
    let (rms, on) = match (&fit.cross_validation, fit.group_by, test.quality()) {
        (Some(found), Some(by), _) => {
            let are_shuffled = by.is_time_blocks() && crate::groups::rows_are_shuffled(&fit.used);
            let (groups, folds) = (found.groups, found.folds);
            let on = UnseenRows::HeldOut { by, groups, folds, are_shuffled };
            (found.grouped.map(|of| of.rms), on)
        }
        (.., Some(tested)) => (tested.map(|of| of.rms), UnseenRows::Test(test.rows)),
        _ => return None,
    };
    let share_of_range = std::array::from_fn(|axis| {
        let loads = fit.excitation.as_ref()?.axes[axis];
        let range = loads.max - loads.min;
        (range > 0.0).then(|| rms[axis] / range)
    });
    Some(UnseenErrors { rms, share_of_range, on, spread: fit.spread() })
}

/// Mean standard error of unseen rows like the training rows, N and N·m; `None` if only sums of the rows are left.
///
/// A training row of leverage h takes part in the fit that predicts it, with variance s²·(1 + h). In a fit without the
/// row, the variance is s²/(1 − h) (Cook and Weisberg, Residuals and Influence in Regression, 1982, §2.2.1).
fn mean_standard_errors(fit: &Fit, residual_sd: &PerAxis<f64>) -> Option<PerAxis<f64>> {
    let every = fit.used.rows().div_ceil(ROWS_OF_INTERVAL).max(1) as usize;
    let mut readings = vec![Vec::new(); fit.calibration.columns()];
    for (_, block) in fit.used.blocks() {
        for (all, column) in readings.iter_mut().zip(&block.rows.readings) {
            all.extend(column.iter().step_by(every));
        }
    }
    let errors = fit.calibration.standard_errors(&readings, None)?;
    let has_rows = errors.iter().all(|of| !of.is_empty());
    has_rows.then(|| {
        std::array::from_fn(|axis| {
            let (errors, sd) = (&errors[axis], residual_sd[axis]);
            let unseen = |error: &f64| {
                let leverage = (error / sd).powi(2) - 1.0;
                sd / (1.0 - leverage).max(LEAST_LEFT).sqrt()
            };
            match sd > 0.0 {
                true => errors.iter().map(unseen).sum::<f64>() / errors.len() as f64,
                false => 0.0,
            }
        })
    })
}

fn interval(fit: &Fit) -> Result<FrameInterval, String> {
    match &fit.method {
        FitMethod::Polynomial { .. } => {
            let covariance = fit.calibration.covariance.as_ref();
            let covariance = covariance.ok_or(match fit.few_groups {
                Some(_) => "the groups are too few for so many features",
                None => "nothing was held out",
            })?;
            let factors = covariance.interval_factors(COVERAGE_LEVEL).map_err(|e| e.to_string())?;
            let errors = mean_standard_errors(fit, &covariance.residual_sd())
                .ok_or("it needs the rows, not only their sums")?;
            let half_width = std::array::from_fn(|axis| factors[axis] * errors[axis]);
            Ok(FrameInterval { half_width, held: None })
        }
        FitMethod::Physics(physics) => {
            let validation = physics.validation.as_ref().ok_or("nothing was held out")?;
            let coverage = validation.coverage().ok_or("too few groups were held out")?;
            Ok(FrameInterval {
                half_width: coverage.map(|(_, half)| half),
                held: Some(coverage.map(|(share, _)| share)),
            })
        }
    }
}

/// Next step: fills the gap in the loads, or else lowers the largest of `shares`, the errors relative to load ranges.
pub(super) fn next_words(
    gap: Option<&Gap>,
    shares: impl Iterator<Item = (Axis, f64)>,
) -> Option<String> {
    let largest = || {
        let (axis, _) = shares.max_by(|a, b| a.1.total_cmp(&b.1))?;
        let axis = axis.name();
        Some(format!(
            "record more poses with large loads on {axis}, the axis with the largest relative error"
        ))
    };
    gap.map(Gap::to_string).or_else(largest)
}
