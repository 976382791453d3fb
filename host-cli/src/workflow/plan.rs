//! Data of recorded sessions for a plan of further loads.

use super::WorkflowError;
use super::fit::FitData;
use super::hung_loads::hung_rows;
use calibration::fit::{FitOptions, HeldOut, Workers, label_groups, label_poses_or_files};
use calibration::load_plan::{SensorKnowledge, loads_of_dataset};
use calibration::physics::{Observation, PhysicsCalibration, TrainingRows};
use load_table::HungLoads;
use log_file::{Log, ReadOptions};
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, PerAxis};

#[derive(Debug)]
pub struct RecordedSession {
    /// Load of each pose, N and N·m.
    pub loads: Vec<PerAxis<f64>>,
    /// The knowledge of a physics model after the session, or the reason why there is none.
    pub sensors: Result<SensorKnowledge, String>,
}

impl RecordedSession {
    /// Reads logs, and fits a physics model to them if they determine one. For logs without a wrench, such as those of
    /// `calibrate`, `table` has the hung loads. Fails with [`WorkflowError`] if a log cannot be read, the
    /// logs differ in their channels or axes, or rows cannot be matched with loads.
    pub fn read(
        logs: &[Log],
        table: &HungLoads,
        read: &ReadOptions<'_>,
    ) -> Result<Self, WorkflowError> {
        let data = match logs.iter().any(Log::has_wrench) {
            true => labelled(logs, read)?,
            false => hung_rows(logs, table, read)?.0,
        };
        let workers = Workers::new(read.threads);
        let axes = data.logs.first().map_or(Axes::ALL, |log| log.axes);
        let sensors = match axes.are_all() {
            false => Err(format!("a model of the sensors takes all six axes, not {axes}")),
            true => PhysicsCalibration::fit(&training_rows(&data), workers)
                .map(|(calibration, _)| SensorKnowledge::from_calibration(&calibration))
                .map_err(|error| error.to_string()),
        };
        Ok(Self { loads: loads_of_dataset(&data), sensors })
    }
}

/// The rows of logs, labelled by pose. A single label for all rows carries no information and is dropped.
fn labelled(logs: &[Log], read: &ReadOptions<'_>) -> Result<Dataset, WorkflowError> {
    let data = FitData::read(logs, &[], (&FitOptions::default(), false), read)?.train;
    let labelled = label_poses_or_files(&data);
    let is_one = {
        let mut labels = labelled.blocks().flat_map(|(_, block)| block.labels.iter());
        let first = labels.next().map(|(label, _)| label);
        labels.all(|(label, _)| Some(label) == first)
    };
    Ok(if is_one { data } else { labelled })
}

/// The rows with their labels; if some rows have none, all are labelled by groups that can be held out.
fn training_rows(data: &Dataset) -> TrainingRows {
    let (rows, _) = TrainingRows::from_dataset(data);
    if rows.row_count() as u64 == data.rows() {
        return rows;
    }
    let labelled = label_groups(data, HeldOut::Auto);
    let labelled = labelled.map_or_else(|| label_poses_or_files(data), |(_, labelled)| labelled);
    TrainingRows::from_dataset(&labelled).0
}

/// The mean of each pose of a session, for a replay of the session. Fails with [`WorkflowError`] as
/// [`RecordedSession::read`], or if readings or wrench are not finite.
pub fn observations(
    logs: &[Log],
    read: &ReadOptions<'_>,
) -> Result<Vec<Observation>, WorkflowError> {
    let rows = training_rows(&labelled(logs, read)?);
    rows.observations().map_err(|error| WorkflowError::Fit(error.into()))
}
