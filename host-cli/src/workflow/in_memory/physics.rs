//! The physics model, fitted to rows in memory.

use super::rows::{BLOCK_ROWS, InMemory, RowSource};
use crate::workflow::WorkflowError;
use crate::workflow::eval::{BlockEvaluator, Evaluation, Look};
use crate::workflow::model_choice::HeldOut;
use crate::workflow::physics::{FittedRows, GroupedRows, GroupsAre, Labels, fit_rows};
use calibration::physics::TrainingRows;
use calibration::validation::excitation::WrenchSums;
use calibration_file::{CalibrationFile, Diagnostics, Origin, Source};
use shell_data::block::Block;

/// A calibration by the physics model, and how well it does.
#[derive(Debug)]
pub struct PhysicsRowFit {
    fitted: FittedRows,
    /// Errors on the rows.
    train: Evaluation,
    /// The wrench that was measured.
    loads: WrenchSums,
    /// What a group is: labels, or stretches of rows.
    pub groups_are: GroupsAre,
}

impl PhysicsRowFit {
    /// The channels that were left out because they never change, from 0.
    pub fn dead_channels(&self) -> Vec<usize> {
        self.fitted.physics().model().dead_channels()
    }

    /// Groups of rows.
    pub fn groups(&self) -> usize {
        self.fitted.groups
    }

    /// The calibration file: made by `made_by` on `date`, from `sources`.
    ///
    /// # Errors
    /// [`WorkflowError::NoRows`] if there were none.
    pub fn file(
        self,
        (made_by, date): (String, String),
        sensor_serial: Option<String>,
        sources: Vec<Source>,
    ) -> Result<CalibrationFile, WorkflowError> {
        let diagnostics = Diagnostics {
            rows: self.train.rows,
            skipped_rows: 0,
            repeated_rows: 0,
            rank: self.fitted.physics().model().parameter_count(),
            condition: None,
            train: self.train.quality().ok_or(WorkflowError::NoRows)?,
            test: None,
            cross_validation: self.fitted.cross_validation(),
            selection: None,
            excitation: self.loads.excitation(),
        };
        Ok(CalibrationFile {
            calibration: self.fitted.calibration,
            origin: Origin {
                made_by,
                date,
                sensor_serial,
                solver: None,
                diagnostics: Some(diagnostics),
                sources,
                columns: None,
            },
        })
    }
}

/// Fits the physics model to rows, copied into columns, and finds its errors on them; on groups that were
/// held out, too, on each or on so many folds of them, if that is asked for.
///
/// # Errors
/// [`WorkflowError`] if the rows do not determine the model, have weights, or the caller stopped it.
pub fn fit_physics(
    source: &dyn RowSource,
    cross_validation: Option<Option<usize>>,
    threads: usize,
) -> Result<PhysicsRowFit, WorkflowError> {
    if source.has_weights() {
        return Err(WorkflowError::Weights { what: "the physics model" });
    }
    let GroupedRows { rows, groups_are, .. } = grouped(source)?;
    let is_stopped = || source.is_stopped();
    let fitted = fit_rows(&rows, cross_validation.map(HeldOut::from), &is_stopped)?;
    let (mut train, loads) = (Evaluation::default(), WrenchSums::of(&rows.wrench));
    let errors = |evaluator: &mut BlockEvaluator, block: &mut Block| {
        evaluator.evaluate(&fitted.calibration, block, &Look::default())
    };
    InMemory { source, threads }.each_block(BlockEvaluator::default, errors, |errors| {
        train.add(&errors, None);
        Ok(())
    })?;
    Ok(PhysicsRowFit { fitted, train, loads, groups_are })
}

/// The rows as columns, and their groups: in the order of their first rows, or stretches of rows.
fn grouped(source: &dyn RowSource) -> Result<GroupedRows, WorkflowError> {
    let (mut rows, mut labels) = (TrainingRows::default(), Labels::default());
    rows.readings.resize_with(source.channels(), Vec::new);
    let mut block = Block::default();
    for start in (0..source.rows()).step_by(BLOCK_ROWS) {
        if source.is_stopped() {
            return Err(WorkflowError::Interrupted);
        }
        source.fill(start..source.rows().min(start + BLOCK_ROWS), &mut block);
        labels.add(&mut rows, &block);
    }
    Ok(match source.has_groups() {
        true => GroupedRows { rows, labels: labels.names, groups_are: GroupsAre::Labels },
        false => GroupedRows::in_stretches(rows),
    })
}
