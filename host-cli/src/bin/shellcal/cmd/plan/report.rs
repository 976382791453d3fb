//! Output of a plan: table, JSON, CSV, figure.

use calibration::load_plan::{Coupling, PlannedLoad, PredictedError};
use calibration::quality::significant;
use figures::{Chart, ChartMark, Figure, PlotAxis, Series, Size, Spacing};
use serde::Serialize;
use shell_data::wrench::Axis;

use super::LoadPlan;
use crate::printer::Printer;
use crate::tables::counted;

/// The output of `--json` for an error: in N and N·m, or relative to one pose.
fn error(of: PredictedError) -> impl Serialize {
    let (wrench, relative) = match of {
        PredictedError::Wrench(errors) => (Some(errors), None),
        PredictedError::Relative(error) => (None, Some(error)),
    };
    document! { wrench?: wrench, relative_to_pose?: relative }
}

impl LoadPlan {
    pub(super) fn document(&self) -> impl Serialize {
        let loads = self.table.loads();
        let load = |(step, planned): (usize, &PlannedLoad)| {
            document! {
                step,
                group: &loads[planned.candidate].group,
                load: loads[planned.candidate].to_string(),
                wrench: loads[planned.candidate].wrench(),
                gain_nats: planned.gain,
                predicted_error: error(planned.error),
            }
        };
        let coupling = |of: &Coupling| {
            document! {
                axes: [of.first.name(), of.second.name()],
                correlation: of.correlation,
                broken_by: of.broken_by.map(|(at, _)| &loads[at].group),
                correlation_after: of.broken_by.map(|(_, after)| after),
            }
        };
        document! {
            criterion: self.criterion,
            recorded_poses: self.recorded,
            error_before: error(self.before),
            loads: (1..).zip(&self.order).map(load).collect::<Vec<_>>(),
            // True if `--until` is reached; `null` without it.
            reached: self.limits.map(|_| self.is_reached()),
            couplings: self.couplings.iter().map(coupling).collect::<Vec<_>>(),
        }
    }

    /// True if the error after all loads is within the limits.
    fn is_reached(&self) -> bool {
        let [force_n, moment_nm] = self.limits.unwrap_or_default();
        self.error_after().is_within(force_n, moment_nm)
    }

    fn error_after(&self) -> PredictedError {
        self.order.last().map_or(self.before, |last| last.error)
    }

    pub(super) fn csv(&self) -> String {
        let lines: Vec<usize> = self.order.iter().map(|planned| planned.candidate).collect();
        let column = |name: &str, of: &dyn Fn(&PlannedLoad) -> String| {
            (format!("plan_{name}"), self.order.iter().map(of).collect::<Vec<_>>())
        };
        let steps = (1..=lines.len()).map(|step| step.to_string()).collect();
        let mut more = vec![("plan_step".to_owned(), steps)];
        more.push(column("gain_nats", &|planned| significant(planned.gain, 4)));
        for axis in
            Axis::ALL.into_iter().filter(|_| matches!(self.before, PredictedError::Wrench(_)))
        {
            more.push(column(
                &format!("error_{}", axis.column()),
                &|planned| match planned.error {
                    PredictedError::Wrench(errors) => significant(errors[axis.index()], 4),
                    PredictedError::Relative(_) => String::new(),
                },
            ));
        }
        self.table.to_csv(&lines, &more)
    }

    pub(super) fn print(&self, printer: &Printer) {
        let recorded = match self.recorded {
            0 => String::new(),
            poses => format!(" after {poses} poses"),
        };
        printer.line(format!(
            "{} of {} loads{recorded}, by {}",
            self.order.len(),
            self.table.loads().len(),
            self.criterion
        ));
        let header: &[&str] = match self.before {
            PredictedError::Wrench(_) => &["step", "group", "load", "gain", "± N", "± N·m"],
            PredictedError::Relative(_) => &["step", "group", "load", "gain", "relative error"],
        };
        let rows = (1..).zip(&self.order).map(|(step, planned): (usize, _)| {
            let load = &self.table.loads()[planned.candidate];
            let mut row = vec![step.to_string(), load.group.clone(), load.to_string()];
            row.push(significant(planned.gain, 3));
            row.extend(errors_of(planned.error));
            row
        });
        printer.table(header, rows);
        for line in self.conclusions() {
            printer.line(line);
        }
    }

    fn conclusions(&self) -> Vec<String> {
        let mut said = Vec::new();
        let size = |error: PredictedError| {
            let values = errors_of(error);
            let texts =
                values.iter().zip([" N", " N·m"]).map(|(value, unit)| format!("±{value}{unit}"));
            texts.collect::<Vec<_>>().join(" and ")
        };
        let (before, after) = (size(self.before), size(self.error_after()));
        let count = self.order.len();
        match self.limits {
            Some(_) if count == 0 => {
                said.push(format!("no more loads are needed: predicted error {before}"));
            }
            Some(_) if self.is_reached() => {
                let loads = counted(count, "more load");
                said.push(format!("{loads} for {after}; now {before}"));
            }
            Some(_) => said.push(format!(
                "not reached: after {count} more loads the predicted error is {after}, now it is {before}"
            )),
            // Without readings the error is known only relative to that of one pose.
            None if matches!(self.before, PredictedError::Relative(_)) => {}
            None => said.push(format!("predicted error: now {before}, after these loads {after}")),
        }
        for coupling in &self.couplings {
            let [first, second] = [coupling.first.name(), coupling.second.name()];
            let whose = if self.recorded > 0 { "so far" } else { "in all loads of the rig" };
            let correlation = coupling.correlation;
            said.push(match coupling.broken_by {
                Some((at, after)) => {
                    let load = &self.table.loads()[at];
                    format!(
                        "{first} and {second} moved together {whose} (correlation {correlation:.2}): best separated by `{}` \
                         ({load}; then {after:.2})",
                        load.group
                    )
                }
                None => format!(
                    "{first} and {second} move together {whose} (correlation {correlation:.2}), and no load of \
                     the rig separates them: pull at another point"
                ),
            });
        }
        said
    }

    pub(super) fn figure(&self, size: Size) -> Figure {
        let errors = std::iter::once(self.before).chain(self.order.iter().map(|of| of.error));
        let largest = |axis: Axis| {
            let loads = self.table.loads().iter().map(|load| load.wrench()[axis.index()].abs());
            loads.fold(0.0, f64::max)
        };
        let loaded = || Axis::ALL.into_iter().filter(|&axis| largest(axis) > 0.0);
        let (name, labels) = match self.before {
            PredictedError::Relative(_) => {
                ("standard error, in those of one pose", vec!["all axes"])
            }
            PredictedError::Wrench(_) => {
                ("predicted error, % of the largest load", loaded().map(Axis::name).collect())
            }
        };
        let drawn = |error: &PredictedError| match error {
            PredictedError::Relative(error) => vec![*error],
            PredictedError::Wrench(errors) => {
                loaded().map(|axis| 100.0 * errors[axis.index()] / largest(axis)).collect()
            }
        };
        let drawn: Vec<Vec<f64>> = errors.map(|error| drawn(&error)).collect();
        let series = labels.into_iter().enumerate().map(|(at, label)| Series {
            label: label.to_owned(),
            points: (self.recorded..).zip(&drawn).map(|(n, of)| (n as f64, of[at])).collect(),
            mark: ChartMark::Both,
        });
        chart("Predicted error of a plan", name, Spacing::Log, series.collect()).figure(size)
    }
}

pub(super) fn chart(title: &str, quantity: &str, spacing: Spacing, series: Vec<Series>) -> Chart {
    let range = |of: fn(&(f64, f64)) -> f64| {
        let values = series.iter().flat_map(|series| series.points.iter().map(of));
        let finite = values.filter(|value| value.is_finite());
        finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
    };
    let ((first, last), (low, high)) = (range(|point| point.0), range(|point| point.1));
    let low = if spacing == Spacing::Linear { 0.0 } else { low };
    Chart {
        title: title.to_owned(),
        x: PlotAxis::new("poses", "", Spacing::Linear, first, last).padded(0.02),
        y: PlotAxis::new(quantity, "", spacing, low, high).padded(0.05),
        series,
    }
}

fn errors_of(error: PredictedError) -> Vec<String> {
    match error {
        PredictedError::Wrench(errors) => {
            let largest = |errors: &[f64]| errors.iter().copied().fold(0.0, f64::max);
            vec![significant(largest(&errors[..3]), 3), significant(largest(&errors[3..]), 3)]
        }
        PredictedError::Relative(error) => vec![significant(error, 3)],
    }
}
