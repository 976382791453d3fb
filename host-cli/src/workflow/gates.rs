//! Limits on the errors of a calibration: whatever is asked for is compared, or it fails.

use std::path::PathBuf;

use super::WorkflowError;
use calibration::quality::significant;
use log_file::Log;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// What is asked of the errors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gates {
    /// The largest RMS error of Fx, Fy and Fz, N.
    pub force_n: Option<f64>,
    /// The largest RMS error of Mx, My and Mz, N·m.
    pub moment_nm: Option<f64>,
    /// The axes that are compared, and no others.
    pub axes: Option<Axes>,
}

/// The axes that calibration and all logs have.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ComparedAxes {
    /// They are compared.
    pub axes: Axes,
    /// Axes of the calibration that a log does not have.
    pub missing: Vec<(PathBuf, Axes)>,
    /// Axes that all logs have, and the calibration does not.
    pub uncalibrated: Axes,
}

/// Why a calibration does not pass.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GateFailure {
    /// Axes that were asked for are not in the log at `path`.
    #[error("not compared: {axes}, which `{}` does not have", path.display())]
    NotCompared { path: PathBuf, axes: Axes },
    /// The RMS error of an axis is above its limit, N or N·m.
    #[error(
        "the RMS error of `{}` is {rms} {unit}, above the limit of {limit} {unit}",
        axis.name(), rms = significant(*rms, 4), limit = significant(*limit, 4), unit = axis.unit()
    )]
    Above { axis: Axis, rms: f64, limit: f64 },
}

impl Gates {
    /// The limit of an axis.
    fn limit(&self, axis: Axis) -> Option<f64> {
        if axis.is_moment() { self.moment_nm } else { self.force_n }
    }

    /// The axes that have to be compared: those that were named, otherwise those with a limit.
    pub fn asked(&self) -> Axes {
        let limited = || Axis::ALL.into_iter().filter(|axis| self.limit(*axis).is_some()).collect();
        self.axes.unwrap_or_else(limited)
    }

    /// The axes of `logs` that are compared with those of a calibration; the logs keep these alone.
    ///
    /// # Errors
    /// [`WorkflowError`] if what is asked for can never be compared, or nothing is left.
    pub fn compare(
        &self,
        calibrated: Axes,
        logs: &mut [Log],
    ) -> Result<ComparedAxes, WorkflowError> {
        let measured: Vec<Axes> = logs.iter().map(Log::axes).collect();
        let axes = self.comparable(calibrated, &measured)?;
        let wanted = self.axes.unwrap_or(calibrated);
        if axes.is_empty() {
            // Says all that are missing.
            logs.iter().try_for_each(|log| log.require_axes(wanted))?;
        }
        let missing = logs.iter().map(|log| (log.path().to_path_buf(), wanted.without(log.axes())));
        let missing = missing.filter(|(_, axes)| !axes.is_empty()).collect();
        logs.iter_mut().try_for_each(|log| log.keep_axes(axes))?;
        let uncalibrated = measured.into_iter().fold(Axes::ALL, Axes::and).without(calibrated);
        Ok(ComparedAxes { axes, missing, uncalibrated })
    }

    /// The axes that are compared where logs have `measured` ones.
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

    /// Why RMS errors, in N and N·m, do not pass; nothing if they do.
    pub fn failures(&self, compared: &ComparedAxes, rms: &PerAxis<f64>) -> Vec<GateFailure> {
        let asked = self.asked();
        let not_compared = compared.missing.iter().filter_map(|(path, axes)| {
            let axes = axes.and(asked);
            (!axes.is_empty()).then(|| GateFailure::NotCompared { path: path.clone(), axes })
        });
        let above = compared.axes.iter().filter_map(|axis| {
            let (rms, limit) = (rms[axis.index()], self.limit(axis)?);
            // NaN is within no limit.
            let passes = rms <= limit;
            (!passes).then_some(GateFailure::Above { axis, rms, limit })
        });
        not_compared.chain(above).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn subsets() -> impl Iterator<Item = Axes> {
        let of = |bits: u8| Axis::ALL.into_iter().filter(move |axis| bits >> axis.index() & 1 == 1);
        (0..64).map(move |bits| of(bits).collect())
    }

    /// Errors pass only where each axis that was asked for is in calibration and logs, and below its limit.
    #[test]
    fn over_all_subsets_of_axes_nothing_passes_that_was_not_compared() {
        let (good, bad, nan) = (0.5, 2.0, f64::NAN);
        let limits = [(Some(1.0), None), (None, Some(1.0)), (Some(1.0), Some(1.0)), (None, None)];
        let mut passed = 0;
        for (force_n, moment_nm) in limits {
            let named = [None, Some([Axis::Fx, Axis::Mz].into_iter().collect()), Some(Axes::ALL)];
            for axes in named {
                let gates = Gates { force_n, moment_nm, axes };
                for (calibrated, measured) in subsets().flat_map(|c| subsets().map(move |m| (c, m)))
                {
                    for errors in [[good; 6], [good, good, good, good, bad, good], [nan; 6]] {
                        let Ok(axes) = gates.comparable(calibrated, &[Axes::ALL, measured]) else {
                            assert!(!calibrated.contain(gates.asked()), "{gates:?} {calibrated}");
                            continue;
                        };
                        let absent = gates.axes.unwrap_or(calibrated).without(measured);
                        let missing = vec![(PathBuf::from("log"), absent)];
                        let compared = ComparedAxes { axes, missing, uncalibrated: Axes::NONE };
                        let is_pass = gates.failures(&compared, &errors).is_empty();
                        let is_right = |axis: Axis| {
                            let limit = if axis.is_moment() { moment_nm } else { force_n };
                            let is_asked =
                                gates.axes.map_or(limit.is_some(), |it| it.contains(axis));
                            let rms = errors[axis.index()];
                            !is_asked
                                || calibrated.contains(axis)
                                    && measured.contains(axis)
                                    && limit.is_none_or(|limit| rms <= limit)
                        };
                        assert_eq!(
                            is_pass,
                            Axis::ALL.into_iter().all(is_right),
                            "{gates:?} {compared:?}"
                        );
                        passed += usize::from(is_pass);
                    }
                }
            }
        }
        assert!(passed > 10_000, "{passed}");
    }
}
