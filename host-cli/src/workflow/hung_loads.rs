//! Hung weights as the reference: rows of logs without a wrench, and the loads hung at the time.
//!
//! ```text
//! logs ─▶ rows labelled by load ─▶ wrench as stated ─▶ loads corrected by the readings ─▶ rows to fit to
//! ```

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use super::WorkflowError;
use super::fit::FitData;
use super::gates::{Gate, GateSubject};
use super::sitting::{Estimate, WrongLoad};
use calibration::FitError;
use calibration::fit::{Workers, label_loads};
use calibration::physics::uncertain_loads::{
    CorrectedLoad, CorrectedLoads, StatedLoad, correct_loads,
};
use calibration::physics::{Observation, TrainingRows};
use calibration::uncertainty::HALF_WIDTH;
use load_table::{HungLoad, HungLoads, Pull};
use log_file::{Log, ReadOptions, Wanted, read_dataset};
use shell_data::dataset::Dataset;
use shell_data::wrench::{Axes, Axis, PerAxis};

/// Standard deviation of the lever offset of a mounting, m.
const MOUNTING_M: f64 = 3e-3;

#[derive(Clone, Debug)]
pub struct HungReference {
    /// The loads with readings, in the order of the table.
    pub loads: Vec<HungLoad>,
    /// Number of different loads; those that are the same are one group of rows.
    pub distinct: usize,
    /// Mean readings at the loads.
    readings: Vec<Vec<f64>>,
    pub corrected: CorrectedLoads,
    /// Labels of the mountings whose offsets were estimated.
    pub mountings: Vec<String>,
    /// The loads that held-out errors refer to, by label: as stated, or as found if the line of the table is wrong.
    pub judged_by: BTreeMap<String, PerAxis<f64>>,
    pub unread: Vec<String>,
    /// Number of rows without a load, which were left out.
    pub unloaded_rows: u64,
    /// Passes if every load of the table was used.
    pub gate: Gate,
}

impl HungReference {
    /// Reads logs and assigns to their rows the wrench of the hung load, corrected by their readings. Fails if a
    /// log cannot be read, rows cannot be matched with loads, or these do not determine a model of the sensors.
    pub fn read(
        logs: &[Log],
        table: &HungLoads,
        read: &ReadOptions<'_>,
    ) -> Result<(FitData, Self), WorkflowError> {
        let (mut data, unloaded_rows) = hung_rows(logs, table, read)?;
        let mut gate = gate_of_loads(table, &data, |_| Axes::ALL, Axes::ALL);
        gate.subjects().iter_mut().for_each(GateSubject::hold);
        let (rows, labels) = TrainingRows::from_dataset(&data);
        let observations = rows.observations().map_err(FitError::from)?;
        let by_label: HashMap<&str, &Observation> =
            observations.iter().map(|o| (labels[o.group as usize].as_str(), o)).collect();
        let is_read = |load: &HungLoad| by_label.contains_key(load.group.as_str());
        let (loads, unread): (Vec<HungLoad>, Vec<HungLoad>) =
            table.loads().iter().cloned().partition(is_read);
        let observed: Vec<Observation> =
            loads.iter().map(|load| by_label[load.group.as_str()].clone()).collect();
        let LoadCorrection { corrected, mountings } = LoadCorrection::new(&loads, &observed)?;
        let (mut judged_by, mut found) = (BTreeMap::new(), HashMap::new());
        for (load, corrected) in loads.iter().zip(&corrected.loads) {
            judged_by.insert(load.group.clone(), judged(load, corrected));
            found.insert(load.group.as_str(), corrected.wrench);
        }
        hang(&mut data, &found);
        let alike = first_alike(&loads, &corrected);
        let readings = observed.into_iter().map(|of| of.readings).collect();
        let distinct = alike.iter().collect::<BTreeSet<_>>().len();
        let first = |&at: &usize| loads[at].group.clone();
        let labels = loads.iter().map(|load| load.group.as_str()).zip(alike.iter().map(first));
        relabel(&mut data, &labels.collect());
        let unread = unread.into_iter().map(|load| load.group).collect();
        let data = FitData { train: data, ..FitData::default() };
        let hung = Self {
            loads,
            distinct,
            readings,
            corrected,
            mountings,
            judged_by,
            unread,
            unloaded_rows,
            gate,
        };
        Ok((data, hung))
    }

    /// Finds a load without which the errors on the others are far smaller; one may spoil a fit to few.
    pub fn wrong_load(&self, workers: Workers<'_>) -> Option<WrongLoad> {
        let readings: Vec<&[f64]> = self.readings.iter().map(Vec::as_slice).collect();
        let estimate = Estimate::new(&self.loads, &readings, workers).ok()?;
        estimate.wrong_load(&self.loads, &readings, workers)
    }

    pub fn suspicious(&self) -> impl Iterator<Item = (&HungLoad, &CorrectedLoad)> {
        self.loads.iter().zip(&self.corrected.loads).filter(|(_, of)| of.suspicious.is_some())
    }
}

pub(super) fn judged(load: &HungLoad, corrected: &CorrectedLoad) -> PerAxis<f64> {
    if corrected.suspicious.is_some() { corrected.wrench } else { load.wrench() }
}

/// The first load with the same wrench, for each: one that was hung again is no new load, and must not be predicted
/// from its repetitions.
pub(super) fn first_alike(loads: &[HungLoad], corrected: &CorrectedLoads) -> Vec<usize> {
    /// Rounding errors of a direction in degrees, N and N·m.
    const ROUNDING: f64 = 1e-6;
    let wrenches: Vec<PerAxis<f64>> =
        loads.iter().zip(&corrected.loads).map(|(load, found)| judged(load, found)).collect();
    let is_like = |a: &PerAxis<f64>, b: &PerAxis<f64>| {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() <= ROUNDING)
    };
    let first = |of: &PerAxis<f64>| wrenches.iter().position(|known| is_like(known, of));
    wrenches.iter().map(|of| first(of).expect("a wrench is like itself")).collect()
}

fn relabel(data: &mut Dataset, labels: &HashMap<&str, String>) {
    for block in data.logs.iter_mut().flat_map(|log| &mut log.blocks) {
        for (label, _) in Arc::make_mut(&mut block.labels) {
            if let Some(new) = labels.get(label.as_str()) {
                label.clone_from(new);
            }
        }
    }
}

pub(super) struct LoadCorrection {
    pub(super) corrected: CorrectedLoads,
    pub(super) mountings: Vec<String>,
}

impl LoadCorrection {
    /// Corrects loads by the observations at them, which are in the same order.
    pub(super) fn new(loads: &[HungLoad], observed: &[Observation]) -> Result<Self, FitError> {
        let mut mountings: Vec<String> =
            loads.iter().filter_map(|of| of.mounting.clone()).collect();
        mountings.sort_unstable();
        mountings.dedup();
        // An offset shared by all loads cannot be distinguished from the sensors.
        if mountings.len() < 2 {
            mountings.clear();
        }
        let stated: Vec<StatedLoad> = loads.iter().map(|load| stated(load, &mountings)).collect();
        let corrected = correct_loads(observed, &stated, (mountings.len(), MOUNTING_M))?;
        Ok(Self { corrected, mountings })
    }
}

pub(super) fn wanted(logs: &[Log]) -> Wanted {
    Wanted {
        readings: true,
        groups: logs.iter().all(Log::has_groups),
        time: logs.iter().all(Log::has_time),
        ..Wanted::default()
    }
}

/// The wanted columns of logs, labelled by load: the group column, or poses in the order of the table.
pub(super) fn labelled_rows(
    logs: &[Log],
    table: &HungLoads,
    wanted: &Wanted,
    read: &ReadOptions<'_>,
) -> Result<Dataset, WorkflowError> {
    super::check_logs(logs, &[], wanted)?;
    let asked: Vec<(&Log, Wanted)> = logs.iter().map(|log| (log, wanted.clone())).collect();
    let data = read_dataset(&asked, read)?;
    if wanted.groups {
        check_numbers(table, &data)?;
        return Ok(data);
    }
    let labels: Vec<String> = table.loads().iter().map(|load| load.group.clone()).collect();
    let hint = "give the log a group column with the labels of the table, as `calibrate` writes it";
    label_loads(&data, &labels).map_err(|error| WorkflowError::refused(error, hint))
}

/// Refuses a log with other labels than the numbers of the loads of a table that does not label them: they may be
/// shifted.
fn check_numbers(table: &HungLoads, data: &Dataset) -> Result<(), WorkflowError> {
    let is_of_table = |label: &str| table.loads().iter().any(|load| load.group == label);
    let is_other = |label: &&String| !label.is_empty() && !is_of_table(label);
    let mut labels =
        data.blocks().flat_map(|(_, block)| block.labels.iter()).map(|(label, _)| label);
    match labels.find(is_other).filter(|_| !table.has_labels()) {
        None => Ok(()),
        Some(label) => Err(WorkflowError::refused(
            format!(
                "the log has a load `{label}`, and the table, which has no column `group`, loads 1 to {}",
                table.loads().len()
            ),
            "write the log's labels in a column `group` of the table",
        )),
    }
}

/// The rows of logs at the loads of a table, with the loads as their wrench, and the number of rows left out.
pub(super) fn hung_rows(
    logs: &[Log],
    table: &HungLoads,
    read: &ReadOptions<'_>,
) -> Result<(Dataset, u64), WorkflowError> {
    let mut data = labelled_rows(logs, table, &wanted(logs), read)?;
    let loads = table.loads();
    let first = {
        let mut labels = data.blocks().flat_map(|(_, block)| block.labels.iter());
        labels.find(|(label, _)| !label.is_empty()).map(|(label, _)| label.clone())
    };
    let rows = data.rows();
    let stated = loads.iter().map(|load| (load.group.as_str(), load.wrench())).collect();
    hang(&mut data, &stated);
    if data.rows() == 0 {
        let found = first.unwrap_or_default();
        let load = loads.first().map_or("", |load| &load.group);
        return Err(WorkflowError::refused(
            format!(
                "no row has the label of a load: the first label is `{found}`, the first load `{load}`"
            ),
            match table.has_labels() {
                true => "name the log's column of labels with `--group`",
                false => "write the log's labels in a column `group` of the table",
            },
        ));
    }
    let left_out = rows - data.rows();
    Ok((data, left_out))
}

/// Requires every load of a table, axis by axis: its rows, and its axes in the calibration.
pub(super) fn gate_of_loads(
    table: &HungLoads,
    data: &Dataset,
    asked: impl Fn(&HungLoad) -> Axes,
    calibrated: Axes,
) -> Gate {
    let mut rows: HashMap<&str, u64> = HashMap::new();
    for (label, count) in data.blocks().flat_map(|(_, block)| block.labels.iter()) {
        *rows.entry(label.as_str()).or_default() += *count as u64;
    }
    // A skipped row may have been at any load.
    let skipped: u64 = data.logs.iter().map(|log| log.summary.skipped_rows).sum();
    let mut gate = Gate::default();
    for load in table.loads() {
        let asked = asked(load);
        let name = load_name(load);
        let subject = gate.ask(&name, asked);
        match rows.get(load.group.as_str()).copied().unwrap_or_default() {
            0 => subject.lacks(Axes::ALL, |_| format!("{name}, which no row is at")),
            rows => subject.has_rows(rows, rows + skipped),
        }
        subject.lacks(asked.without(calibrated), |axes| {
            format!("{axes} of {name}, which the calibration does not give")
        });
    }
    gate
}

pub(super) fn load_name(load: &HungLoad) -> String {
    format!("load `{}` (line {}: {load})", load.group, load.line)
}

/// Axes to compare for a load: all calibrated axes, whether it loads them or not, and any others that it loads.
pub(super) fn axes_to_compare(load: &HungLoad, calibrated: Axes) -> Axes {
    calibrated.iter().chain(loaded_axes(load).iter()).collect()
}

/// Axes on which a load exceeds its errors.
fn loaded_axes(load: &HungLoad) -> Axes {
    let (wrench, errors) = (load.wrench(), stated(load, &[]).standard_errors());
    // A direction in degrees leaves rounding errors on axes that it does not load.
    let is_loaded = |axis: &Axis| {
        let (value, error) = (wrench[axis.index()].abs(), errors[axis.index()]);
        value > 1e-9_f64.max(HALF_WIDTH * error)
    };
    Axis::ALL.into_iter().filter(is_loaded).collect()
}

pub(super) fn stated(load: &HungLoad, mountings: &[String]) -> StatedLoad {
    match load.pull {
        Pull::Wrench(wrench) => StatedLoad::Wrench(wrench),
        Pull::Force { force_n, point_m, direction, .. } => StatedLoad::Force {
            force_n,
            direction,
            point_m,
            errors: load.errors,
            mounting: mountings.iter().position(|label| Some(label) == load.mounting.as_ref()),
        },
    }
}

/// Assigns to every row the wrench of its label, and drops rows with other labels.
fn hang(data: &mut Dataset, loads: &HashMap<&str, PerAxis<f64>>) {
    for log in &mut data.logs {
        log.axes = Axes::ALL;
        for block in &mut log.blocks {
            let hangs = |label: &str| loads.contains_key(label);
            let keep = block.labels.iter().map(|(label, rows)| (hangs(label), *rows));
            let keep = keep.flat_map(|(keep, rows)| std::iter::repeat_n(keep, rows));
            *block = block.kept(&keep.collect::<Vec<_>>());
            let column = |axis: usize| {
                let loads = block.labels.iter().map(|(label, rows)| (loads[label.as_str()], *rows));
                loads.flat_map(|(load, rows)| std::iter::repeat_n(load[axis], rows)).collect()
            };
            let wrench = (0..6).map(column).collect();
            Arc::make_mut(&mut block.rows).wrench = wrench;
        }
    }
}
