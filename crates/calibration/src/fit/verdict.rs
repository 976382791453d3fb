//! What a fit is worth, in at most four lines: the error on data that it has not seen, the interval of a frame, what to
//! use the calibration for, and what to record next.

use super::{Fit, FitMethod};
use crate::groups::GroupBy;
use crate::validation::excitation::Gap;
use least_squares::quality::significant;
use sensor_physics::COVERAGE_LEVEL;
use shell_data::statistics::extremes;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// An axis whose error is a larger share of its loads (both root mean square) is not measured.
const USELESS: f64 = 0.5;

/// Rows whose standard errors tell how wide an interval is in the mean.
const ROWS_OF_INTERVAL: u64 = 1024;

/// Of a row with more leverage than this leaves, a fit without it says next to nothing.
const LEAST_LEFT: f64 = 0.1;

/// What a fit is worth on data that it has not seen.
#[derive(Clone, Debug)]
pub struct Verdict<'a> {
    fit: &'a Fit,
    /// The axes of the calibration.
    pub axes: Axes,
    /// Errors on rows that were not used, as far as they are known.
    pub unseen: Option<UnseenErrors>,
    /// What 95 % of single frames are within, or why that is not known.
    pub interval: Result<FrameInterval, String>,
    /// Axes whose error is about as large as the loads.
    pub useless: Axes,
    /// What the training loads do not cover.
    gaps: Vec<Gap>,
}

/// Errors on rows that were not used for the fit.
#[derive(Clone, Debug, PartialEq)]
pub struct UnseenErrors {
    /// Root mean square, N and N·m.
    pub rms: PerAxis<f64>,
    /// The same over the range of the training loads; `None` of an axis without one.
    pub share_of_range: PerAxis<Option<f64>>,
    /// Which rows they are.
    pub on: UnseenRows,
}

/// Rows that were not used for a fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum UnseenRows {
    /// Groups of the training rows, held out in folds.
    HeldOut {
        /// What the groups are.
        by: GroupBy,
        /// Groups.
        groups: usize,
        /// Folds.
        folds: usize,
        /// Whether the rows were in no order of time, and so are on both sides of every fold.
        are_shuffled: bool,
    },
    /// So many test rows.
    Test(u64),
}

/// The interval that holds 95 % of single frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrameInterval {
    /// Half its width, N and N·m.
    pub half_width: PerAxis<f64>,
    /// The share of held-out rows within it, where rows were counted.
    pub held: Option<PerAxis<f64>>,
}

impl Fit {
    /// What it is worth on data that it has not seen.
    pub fn verdict(&self) -> Verdict<'_> {
        let (axes, unseen) = (self.calibration.axes, unseen_errors(self));
        let errors = unseen.as_ref().map_or(self.train.map(|of| of.rms), |of| of.rms);
        let is_useless = |axis: &Axis| {
            let load = self.excitation.as_ref().map_or(0.0, |of| of.axes[axis.index()].rms);
            load > 0.0 && errors[axis.index()] > USELESS * load
        };
        let useless = axes.iter().filter(is_useless).collect();
        let gaps = self.excitation.as_ref().map(|of| of.gaps(axes)).unwrap_or_default();
        Verdict { fit: self, axes, unseen, interval: interval(self), useless, gaps }
    }
}

impl Verdict<'_> {
    /// Whether the calibration can be used for some axis.
    pub fn is_usable(&self) -> bool {
        self.useless != self.axes
    }

    /// What is to be said, most important first.
    pub fn lines(&self) -> Vec<String> {
        vec![self.error_words(), self.interval_words(), self.use_words(), self.next_words()]
    }

    fn error_words(&self) -> String {
        let model = self.fit.calibration.name();
        let Some(of) = &self.unseen else {
            let unknown = format!("{model}: the error on new loads is not known");
            return match &self.fit.not_judged {
                None => unknown + ", nothing was held out (`--model auto` or `--cv` finds it)",
                Some(reason) => format!("{unknown}: {reason}"),
            };
        };
        let error = |axis: Axis| significant(of.rms[axis.index()], 3);
        let percent = |axis: &Axis| {
            let share = of.share_of_range[axis.index()];
            share.map_or("–".to_owned(), |share| significant(100.0 * share, 2))
        };
        let shares = |axes: &[Axis]| {
            format!(" ({} %)", axes.iter().map(percent).collect::<Vec<_>>().join(", "))
        };
        let errors = each_unit(self.axes, error, shares);
        format!("{model}: error {}: {errors} (% of the calibrated range)", of.on.words())
    }

    fn interval_words(&self) -> String {
        let interval = match &self.interval {
            Ok(interval) => interval,
            Err(reason) => return format!("no 95 % interval: {reason}"),
        };
        let half = |axis: Axis| format!("±{}", significant(interval.half_width[axis.index()], 2));
        let halves = each_unit(self.axes, half, |_| String::new());
        let held = interval.held.map_or_else(String::new, |held| {
            let (least, most) = extremes(self.axes.of(&held));
            format!(" (held {:.0} to {:.0} % of the held-out frames)", 100.0 * least, 100.0 * most)
        });
        format!("95 % of single frames are within {halves}{held}")
    }

    fn use_words(&self) -> String {
        let (percent, leaks) = (|share: f64| format!("{:.0} %", 100.0 * share), self.fit.leaks);
        let is_tested_only =
            matches!(&self.unseen, Some(of) if matches!(of.on, UnseenRows::Test(_)));
        let (leak, rows) = match is_tested_only {
            true => (leaks.in_test(), "test rows"),
            false => (leaks.in_groups(), "rows"),
        };
        if let Some(share) = leak {
            return format!(
                "do not rely on it: {} of the {rows} were recorded at poses that the fit has seen, so the error on \
                 new poses is not known",
                percent(share)
            );
        }
        if !self.is_usable() {
            return "do not use it: its errors are about as large as the loads".to_owned();
        }
        if self.unseen.is_none() {
            return "do not rely on it before it has been tested on loads that it has not seen"
                .to_owned();
        }
        let mut said = "use it within the calibrated loads".to_owned();
        let Self { useless, .. } = self;
        if !useless.is_empty() {
            said += &format!("; not for {useless}, where the error is about as large as the loads");
        }
        let unloaded = |gap: &Gap| if let Gap::Unloaded(axis) = gap { Some(*axis) } else { None };
        let unloaded: Axes = self.gaps.iter().filter_map(unloaded).collect();
        if !unloaded.is_empty() {
            said += &format!("; not for {unloaded}, which was never loaded");
        }
        if self.fit.test().is_out_of_range() {
            said +=
                "; ignore the test set, no row of it is within the calibrated range of readings";
        }
        if let Some(share) = leaks.in_test().map(percent) {
            said += &format!(
                "; ignore the test set, {share} of it was recorded at poses of the training data"
            );
        }
        said
    }

    fn next_words(&self) -> String {
        if let Some(gap) = self.gaps.first() {
            return format!("next: {gap}");
        }
        let shares = self.unseen.as_ref().map(|of| of.share_of_range).unwrap_or_default();
        let known = self.axes.iter().filter_map(|axis| Some((axis, shares[axis.index()]?)));
        match known.max_by(|a, b| a.1.total_cmp(&b.1)) {
            Some((axis, _)) => format!(
                "next: record more poses with large loads on {}, the axis with the largest relative error",
                axis.name()
            ),
            None => "next: record loads in several poses, with a column `group` that numbers them"
                .to_owned(),
        }
    }
}

impl UnseenRows {
    fn words(&self) -> String {
        match *self {
            Self::Test(rows) => format!("on {rows} test rows"),
            Self::HeldOut { are_shuffled: true, .. } => {
                "on rows that were held out at random, which is optimistic (the rows are shuffled: nothing in \
                 them can be held out by time)"
                    .to_owned()
            }
            Self::HeldOut { by, groups, folds, .. } => {
                let how = match folds == groups {
                    true => "each held out once".to_owned(),
                    false => format!("held out in {folds} folds"),
                };
                format!("on {} not used for the fit ({groups} in all, {how})", by.plural())
            }
        }
    }
}

/// The value of each axis with its name, the forces and then the moments with their unit and what is said after it.
fn each_unit(
    axes: Axes,
    value: impl Fn(Axis) -> String,
    after: impl Fn(&[Axis]) -> String,
) -> String {
    let axes: Vec<Axis> = axes.iter().collect();
    let words = |axes: &[Axis]| {
        let values = axes.iter().map(|axis| format!("{} {}", axis.name(), value(*axis)));
        format!("{} {}{}", values.collect::<Vec<_>>().join(", "), axes[0].unit(), after(axes))
    };
    axes.chunk_by(|a, b| a.unit() == b.unit()).map(words).collect::<Vec<_>>().join("; ")
}

fn unseen_errors(fit: &Fit) -> Option<UnseenErrors> {
    let test = fit.test();
    let (rms, on) = match (&fit.cross_validation, fit.group_by, test.quality()) {
        (Some(found), Some(by), _) => {
            let are_shuffled = by.is_stretches() && crate::groups::rows_are_shuffled(&fit.used);
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
    Some(UnseenErrors { rms, share_of_range, on })
}

/// The mean standard error of rows like those of training, N and N·m.
///
/// A row of leverage h has part in its own prediction, and a variance of s²·(1 + h); without it, that is s²/(1 − h)
/// (Cook and Weisberg, Residuals and Influence in Regression, 1982, §2.2.1).
fn mean_standard_errors(fit: &Fit, residual_sd: &PerAxis<f64>) -> PerAxis<f64> {
    let every = fit.used.rows().div_ceil(ROWS_OF_INTERVAL).max(1) as usize;
    let mut readings = vec![Vec::new(); fit.calibration.channels()];
    for (_, block) in fit.used.blocks() {
        for (all, column) in readings.iter_mut().zip(&block.rows.readings) {
            all.extend(column.iter().step_by(every));
        }
    }
    let errors = fit.calibration.standard_errors(&readings, None).unwrap_or_default();
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
            let errors = mean_standard_errors(fit, &covariance.residual_sd());
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
