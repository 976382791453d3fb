//! Limits on the use of a calibration, as far as its own fit shows them.

use super::super::units::ColumnUnit;
use super::CalibrationReport;
use calibration::fit::FewGroups;
use calibration::validation::cross_validation::CrossValidation;
use shell_data::wrench::Axis;

/// The condition number of the loads' correlation above which axes are poorly separated.
const POOR_CONDITION: f64 = 10.0;

/// Largest share of test rows outside the range of the training data that is not reported.
const MUCH_OUTSIDE: f64 = 0.05;

/// The limits as sentences, the most important first.
pub(super) fn limits(report: &CalibrationReport<'_>) -> Vec<String> {
    let mut limits = Vec::new();
    let (fit, axes) = (report.fit, report.file.calibration.axes);
    let test = fit.test();
    let (features, rank) = (fit.parameter_count(), fit.rank());
    if test.quality().is_none() && fit.cross_validation.is_none() {
        limits.push(
            "It must not be trusted with loads that it has not seen: no error was measured on any. Test it \
             (--test) or hold out groups (--cv)."
                .to_owned(),
        );
    }
    if rank < features {
        limits.push(format!(
            "{} of {features} directions of the readings were not determined by the data: a load that moves \
             the readings along one of them is read wrongly.",
            features - rank
        ));
    }
    if let Some(FewGroups { features, groups }) = fit.few_groups {
        limits.push(format!(
            "It has {features} features and was fitted to {groups} groups of rows, less than two for each: its \
             errors on new loads are larger than on these. Record more poses, or choose a smaller model."
        ));
    }
    if let Some(excitation) = &fit.excitation {
        let range = |axis: Axis| {
            let of = &excitation.axes[axis.index()];
            let scale = ColumnUnit::new(axis.unit(), [of.min, of.max]);
            format!("{} {} {}", axis.name(), scale.range(of.min, of.max), scale.unit)
        };
        limits.push(format!(
            "Loads beyond these were never shown to it: {}. convert flags readings outside their range, \
             and a fit on more loads widens it.",
            axes.iter().map(range).collect::<Vec<_>>().join(", ")
        ));
        limits.extend(excitation.gaps(axes).iter().map(|gap| format!("{gap}.")));
        let condition = excitation.condition.unwrap_or(f64::INFINITY);
        if condition > POOR_CONDITION {
            limits.push(format!(
                "Its loads came together (load coupling {condition:.0}): a load on \
                 one axis alone may show on another."
            ));
        }
    }
    if let Some((axis, ratio)) = fit.cross_validation.as_ref().and_then(CrossValidation::suspicious)
    {
        limits.push(format!(
            "Its error on groups that were held out is {ratio:.1} times that on random rows ({}): only the former \
             is that of new loads.",
            axis.name()
        ));
    }
    let (rows, outside) = (test.rows, test.out_of_range_rows);
    if rows > 0 && outside as f64 > MUCH_OUTSIDE * rows as f64 {
        limits.push(format!(
            "{:.0} % of the test rows have a reading outside the range of the training data: the test asks more \
             of it than the training showed.",
            100.0 * outside as f64 / rows as f64
        ));
    }
    if !report.file.calibration.has_standard_errors() {
        limits.push(
            "It has no standard errors: what a single number is worth cannot be told from it."
                .to_owned(),
        );
    }
    let (frame, place) = match axes.iter().any(Axis::is_moment) {
        true => ("Moments are about the origin", "Another point, another mounting"),
        false => ("Forces are along the axes", "Another mounting"),
    };
    limits.push(format!(
        "{frame} of the reference sensor that it was fitted with, x forward, y left, z up; the shell was mounted \
         as it was. {place} or another sensor needs another calibration."
    ));
    limits
}
