//! Files of trials of the virtual robot: a log, its true values, and a set with a manifest.

use std::io::Write;
use std::path::Path;

use super::WorkflowError;
use output_file::{OutputError, Outputs};
use simulation::synthetic_log::{
    FRAME_HEADER, TrialLayout, write_frame, write_telemetry_header, write_telemetry_row,
};
use simulation::virtual_robot::{ChannelForces, TrialSettings, Truth, VirtualTrial};

/// Writes the log of a trial; returns the number of rows. Fails if the sensor cannot be modelled or `out` fails.
pub fn write_log(
    out: &mut impl Write,
    trial: &VirtualTrial,
    layout: TrialLayout,
) -> Result<u64, WorkflowError> {
    let mut rows = 0;
    // Writing row by row would cost too many system calls if the output is a pipe.
    let mut text = Vec::new();
    match layout {
        TrialLayout::WithoutTelemetry => {
            writeln!(text, "{FRAME_HEADER}")?;
            for (time_s, frame) in trial.frames() {
                write_frame(&mut text, time_s, &frame)?;
                rows += 1;
            }
        }
        TrialLayout::Full | TrialLayout::WithoutSensors => {
            let sensors = layout == TrialLayout::Full;
            write_telemetry_header(&mut text, &trial.settings, sensors)?;
            for row in trial.rows() {
                write_telemetry_row(&mut text, &row, sensors)?;
                rows += 1;
            }
        }
    }
    out.write_all(&text)?;
    Ok(rows)
}

pub fn truth_json(truth: &Truth) -> Vec<u8> {
    let mut text = serde_json::to_vec_pretty(truth).expect("numbers and names");
    text.push(b'\n');
    text
}

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct SetTrial {
    /// The log, relative to the manifest.
    pub file: String,
    /// The true values, relative to the manifest.
    pub truth_file: String,
    pub rows: u64,
}

pub const MANIFEST: &str = "manifest.csv";

/// Writes the example set into `directory`, which is created if necessary: `per_condition` trials of each of the
/// paper's conditions, their true values, and the manifest for `shellcal batch`. `base` sets everything but seed
/// and condition; seeds count up from its seed.
pub fn write_set(
    outputs: &Outputs,
    directory: &Path,
    base: TrialSettings,
    per_condition: u64,
    mut progress: impl FnMut(u64),
) -> Result<Vec<SetTrial>, WorkflowError> {
    std::fs::create_dir_all(directory)
        .map_err(|source| OutputError::failed(directory.to_owned(), source))?;
    let mut trials = Vec::new();
    let mut manifest = String::from("file,condition,t_enter_s,t_exit_s\n");
    for (index, condition) in ChannelForces::PAPER.into_iter().enumerate() {
        for run in 1..=per_condition {
            let seed = base.seed.wrapping_add(index as u64 * per_condition + run - 1);
            let trial = VirtualTrial::new(TrialSettings { condition, seed, ..base })?;
            let stem = format!("{}-{run}", condition.name.replace(' ', ""));
            let (file, truth_file) = (format!("{stem}.txt"), format!("{stem}.truth.json"));
            let mut out = outputs.create(directory.join(&file))?;
            let rows = write_log(&mut out, &trial, TrialLayout::Full)?;
            out.commit()?;
            outputs.write(directory.join(&truth_file), &truth_json(&trial.truth()))?;
            let [enter_s, exit_s] = trial.window_s;
            manifest += &format!("{file},{},{enter_s},{exit_s}\n", condition.name);
            trials.push(SetTrial { file, truth_file, rows });
            progress(trials.len() as u64);
        }
    }
    outputs.write(directory.join(MANIFEST), manifest.as_bytes())?;
    Ok(trials)
}
