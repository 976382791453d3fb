//! From partial fits, merged, to a calibration.

use super::WorkflowError;
use super::fit::calibration_file;
use calibration::fit::merged::fit_sums;
use calibration::fit::{Fit, FitOptions, HeldOut, ModelRule, RANDOM_FOLDS};
use calibration_file::{CalibrationFile, Origin, PartialFit};

/// Fits a calibration to the sums of `merged`, which is [in order](PartialFit::put_in_order): its model, where
/// none is given.
///
/// # Errors
/// [`WorkflowError`] if the rows do not determine the coefficients, or something is asked of groups
/// where there are none.
pub fn fit(
    merged: &PartialFit,
    model: Option<ModelRule>,
    options: &FitOptions<'_>,
) -> Result<Fit, WorkflowError> {
    let model = model.unwrap_or(merged.model.basis.into());
    let options = FitOptions { model, intercept: merged.model.intercept, ..*options };
    let folds = options.cross_validation.map(|held_out| match held_out {
        HeldOut::Folds(folds) => folds,
        _ => RANDOM_FOLDS,
    });
    let fit = fit_sums(merged.row_sums(folds)?, merged.axes, &options)?;
    let (skipped_rows, repeated_rows) = (merged.skipped_rows, merged.repeated_rows);
    Ok(Fit { skipped_rows, repeated_rows, ..fit })
}

/// The calibration file of a fit to `merged`.
pub fn file(fit: &Fit, merged: &PartialFit) -> CalibrationFile {
    let origin = Origin {
        made_by: merged.made_by.clone(),
        date: merged.date.clone(),
        sensor_serial: merged.sensor_serial.clone(),
        sources: merged.sources.clone(),
        columns: merged.columns.clone(),
        ..Origin::default()
    };
    calibration_file(fit, origin)
}
