//! Gates: the comparisons that a check requires, and whether each was made and held.

use std::path::Path;

use super::WorkflowError;
use calibration::quality::significant;
use log_file::Log;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// A subject counts as compared with at least this many rows and a tenth of its rows, or with all if it has fewer.
const LEAST_ROWS: u64 = 10;

/// A list of required comparisons. It passes only if every item was compared, and held.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Gate {
    subjects: Vec<GateSubject>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct GateSubject {
    name: String,
    /// Axes that have not been compared yet.
    open: Axes,
    failures: Vec<GateFailure>,
}

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GateFailure {
    #[error("not compared: {what}")]
    NotCompared { axes: Axes, what: String },
    #[error(
        "the RMS error of `{}`{on} is {rms} {unit}, above the limit of {limit} {unit}",
        axis.name(), rms = significant(*rms, 4), limit = significant(*limit, 4), unit = axis.unit()
    )]
    Above { axis: Axis, on: &'static str, rms: f64, limit: f64 },
    #[error("{axes} of {name} differ by more than is to be expected")]
    Off { axes: Axes, name: String },
}

impl Gate {
    pub fn ask(&mut self, name: impl Into<String>, axes: Axes) -> &mut GateSubject {
        let subject = GateSubject { name: name.into(), open: axes, failures: Vec::new() };
        self.subjects.push(subject);
        self.subjects.last_mut().expect("one was just added")
    }

    /// All subjects, in the order in which they were added.
    pub fn subjects(&mut self) -> &mut [GateSubject] {
        &mut self.subjects
    }

    pub fn extend(&mut self, other: Self) {
        self.subjects.extend(other.subjects);
    }

    /// The reasons why the gate does not pass, in the order of the subjects; empty if it does.
    pub fn failures(&self) -> Vec<GateFailure> {
        let of = |subject: &GateSubject| {
            let mut subject = subject.clone();
            let name = subject.name.clone();
            subject.lacks(Axes::ALL, |axes| format!("{axes} of {name}"));
            subject.failures
        };
        self.subjects.iter().flat_map(of).collect()
    }

    pub fn passes(&self) -> bool {
        self.failures().is_empty()
    }

    /// Summarises the failures in one line; `None` if the gate passes.
    pub fn summary(&self) -> Option<String> {
        let failures = self.failures();
        let above = failures.iter().filter_map(|failure| match failure {
            GateFailure::Above { axis, .. } => Some(*axis),
            _ => None,
        });
        let above: Axes = above.collect();
        match above.is_empty() {
            _ if failures.is_empty() => None,
            true => Some("not everything that was asked for could be compared".to_owned()),
            false => Some(format!("above the limit: {above}")),
        }
    }

    pub fn not_compared(&self) -> Axes {
        let failures = self.failures();
        let axes = failures.iter().filter_map(|failure| match failure {
            GateFailure::NotCompared { axes, .. } => Some(axes.iter()),
            _ => None,
        });
        axes.flatten().collect()
    }
}

impl GateSubject {
    /// Records that axes cannot be compared, if they are required; `what` names them and the reason.
    pub fn lacks(&mut self, axes: Axes, what: impl FnOnce(Axes) -> String) {
        let axes = self.open.and(axes);
        if !axes.is_empty() {
            self.open = self.open.without(axes);
            self.failures.push(GateFailure::NotCompared { axes, what: what(axes) });
        }
    }

    /// Records the number of rows that can be compared, out of `of`. Too few count as none.
    pub fn has_rows(&mut self, rows: u64, of: u64) {
        let needed = LEAST_ROWS.max(of.div_ceil(10)).min(of).max(1);
        if rows < needed {
            let name = self.name.clone();
            self.lacks(Axes::ALL, |_| {
                format!("{name}, of which {rows} of {of} rows are left; at least {needed} tell")
            });
        }
    }

    /// Compares all remaining axes: `failures` returns the comparisons that do not hold.
    pub fn compare<F: IntoIterator<Item = GateFailure>>(
        &mut self,
        failures: impl FnOnce(Axes) -> F,
    ) {
        self.failures.extend(failures(self.open));
        self.open = Axes::NONE;
    }

    pub fn hold(&mut self) {
        self.compare(|_| None);
    }
}

/// Limits on the errors of a calibration, and the axes that they apply to.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ErrorLimits {
    /// The largest RMS error of Fx, Fy and Fz, N.
    pub force_n: Option<f64>,
    /// The largest RMS error of Mx, My and Mz, N·m.
    pub moment_nm: Option<f64>,
    /// The only axes to compare; `None` for those with a limit.
    pub axes: Option<Axes>,
}

impl ErrorLimits {
    fn limit(&self, axis: Axis) -> Option<f64> {
        if axis.is_moment() { self.moment_nm } else { self.force_n }
    }

    /// The axes to compare: those that were named, otherwise those with a limit.
    pub fn asked(&self) -> Axes {
        let limited = || Axis::ALL.into_iter().filter(|axis| self.limit(*axis).is_some()).collect();
        self.axes.unwrap_or_else(limited)
    }

    /// The axes of `logs` to compare with those of a calibration; the logs keep only these. Fails with
    /// [`WorkflowError`] if a requested comparison is impossible, or no axes are left.
    pub fn compared(&self, calibrated: Axes, logs: &mut [Log]) -> Result<Axes, WorkflowError> {
        let measured: Vec<Axes> = logs.iter().map(Log::axes).collect();
        let axes = self.comparable(calibrated, &measured)?;
        if axes.is_empty() {
            let wanted = self.axes.unwrap_or(calibrated);
            logs.iter().try_for_each(|log| log.require_axes(wanted))?;
        }
        logs.iter_mut().try_for_each(|log| log.keep_axes(axes))?;
        Ok(axes)
    }

    fn comparable(&self, calibrated: Axes, measured: &[Axes]) -> Result<Axes, WorkflowError> {
        for (limit, is_moment, name) in
            [(self.force_n, false, "the forces"), (self.moment_nm, true, "the moments")]
        {
            let is_limited = self.asked().iter().any(|axis| axis.is_moment() == is_moment);
            if limit.is_some() && !is_limited {
                return Err(WorkflowError::refused(
                    format!("the limit of {name} is for none of the axes that are compared"),
                    "leave the limit out, or add an axis to `--axes`",
                ));
            }
        }
        let asked = self.asked().without(calibrated);
        if !asked.is_empty() {
            let names: Vec<_> = calibrated.iter().map(|axis| axis.name().to_lowercase()).collect();
            let axes = names.join(",");
            return Err(WorkflowError::refused(
                format!("{asked} cannot be compared: the calibration gives {calibrated} only"),
                &*format!("compare what there is with `--axes {axes}`, which leaves out {asked}"),
            ));
        }
        Ok(measured.iter().fold(self.axes.unwrap_or(calibrated), |all, axes| all.and(*axes)))
    }

    /// Requires a log with the axes `measured`, of which `rows` of `of` rows can be compared.
    pub fn ask_log(&self, gate: &mut Gate, path: &Path, measured: Axes, [rows, of]: [u64; 2]) {
        let name = format!("`{}`", path.display());
        let subject = gate.ask(&name, self.asked());
        let absent = self.asked().without(measured);
        subject.lacks(absent, |axes| format!("{axes}, which {name} does not have"));
        subject.has_rows(rows, of);
        subject.hold();
    }

    /// Requires the RMS errors of some axes, in N and N·m, to be within their limits. `on` names the rows if
    /// there are several sets.
    pub fn ask_errors(&self, gate: &mut Gate, axes: Axes, on: &'static str, rms: &PerAxis<f64>) {
        let judge = |axis: Axis| {
            let (rms, limit) = (rms[axis.index()], self.limit(axis)?);
            // NaN exceeds every limit.
            let passes = rms <= limit;
            (!passes).then_some(GateFailure::Above { axis, on, rms, limit })
        };
        let asked = self.asked().and(axes);
        gate.ask(on, asked).compare(|axes| axes.iter().filter_map(judge).collect::<Vec<_>>());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn subsets() -> impl Iterator<Item = Axes> {
        let of = |bits: u8| Axis::ALL.into_iter().filter(move |axis| bits >> axis.index() & 1 == 1);
        (0..64).map(move |bits| of(bits).collect())
    }

    #[test]
    fn axes_that_were_not_compared_never_pass() {
        let (good, bad, nan) = (0.5, 2.0, f64::NAN);
        let limits = [(Some(1.0), None), (None, Some(1.0)), (Some(1.0), Some(1.0)), (None, None)];
        let mut passed = 0;
        for (force_n, moment_nm) in limits {
            let named = [None, Some([Axis::Fx, Axis::Mz].into_iter().collect()), Some(Axes::ALL)];
            for axes in named {
                let limits = ErrorLimits { force_n, moment_nm, axes };
                for (calibrated, measured) in subsets().flat_map(|c| subsets().map(move |m| (c, m)))
                {
                    for errors in [[good; 6], [good, good, good, good, bad, good], [nan; 6]] {
                        let Ok(axes) = limits.comparable(calibrated, &[Axes::ALL, measured]) else {
                            assert!(!calibrated.contain(limits.asked()), "{limits:?} {calibrated}");
                            continue;
                        };
                        let mut gate = Gate::default();
                        limits.ask_log(&mut gate, Path::new("log"), measured, [100, 100]);
                        limits.ask_errors(&mut gate, axes, "", &errors);
                        let is_right = |axis: Axis| {
                            let limit = if axis.is_moment() { moment_nm } else { force_n };
                            let is_asked =
                                limits.axes.map_or(limit.is_some(), |it| it.contains(axis));
                            let rms = errors[axis.index()];
                            !is_asked
                                || calibrated.contains(axis)
                                    && measured.contains(axis)
                                    && limit.is_none_or(|limit| rms <= limit)
                        };
                        let is_right = Axis::ALL.into_iter().all(is_right);
                        assert_eq!(gate.passes(), is_right, "{limits:?} {calibrated} {measured}");
                        passed += usize::from(is_right);
                    }
                }
            }
        }
        assert!(passed > 10_000, "{passed}");
    }

    #[test]
    fn an_item_without_result_does_not_pass() {
        let mut gate = Gate::default();
        assert!(gate.passes());
        gate.ask("load `a`", Axes::ALL).hold();
        assert!(gate.passes());
        gate.ask("load `b`", [Axis::Fx].into_iter().collect());
        assert_eq!(gate.failures()[0].to_string(), "not compared: Fx of load `b`");
        assert!(!gate.passes());
    }

    /// At least ten rows and a tenth of all; a shorter log needs all its rows.
    #[test]
    fn rows_that_are_too_few_are_not_compared() {
        let passes = |rows, of| {
            let mut gate = Gate::default();
            let subject = gate.ask("a log", Axes::ALL);
            subject.has_rows(rows, of);
            subject.hold();
            gate.passes()
        };
        for (rows, of) in [(800, 800), (80, 800), (10, 100), (10, 11), (1, 1), (9, 9)] {
            assert!(passes(rows, of), "{rows} of {of}");
        }
        for (rows, of) in [(0, 0), (0, 800), (1, 800), (79, 800), (9, 10), (8, 9)] {
            assert!(!passes(rows, of), "{rows} of {of}");
        }
    }
}
