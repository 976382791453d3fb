//! Output of the figures of a batch.

use std::io;
use std::path::Path;

use figures::trial::{Passage, box_figure, drag_lift_figure, phase_figure, stack_figure};
use figures::{Figure, Format, Size};
use output_file::{OutputError, Outputs};
use trial::{ConditionRow, PhaseProfile, Profile, Trace, TrialResult, TrialRow};

/// Number of strides in a telemetry figure if the window has many.
const STRIDES: usize = 10;

/// Sampling interval of thinned traces without sensors, s.
const THIN_S: f64 = 0.01;

#[derive(Debug)]
pub struct FigureFolder<'a> {
    pub outputs: &'a Outputs,
    pub directory: &'a Path,
    pub formats: &'a [Format],
    pub size: Size,
}

impl FigureFolder<'_> {
    /// Writes drag and lift over time, and the telemetry of some strides, of a trial with the trace of its whole log:
    /// `STEM.drag.svg`, `STEM.telemetry.svg`. Fails with [`OutputError`] if a file cannot be written.
    pub fn write_trial(
        &self,
        stem: &str,
        row: &TrialRow,
        trace: &Trace,
        profile: &Profile,
    ) -> Result<(), OutputError> {
        let title = title(row);
        let passage = passage(row, profile);
        if !trace.wrench[0].is_empty() {
            let figure = drag_lift_figure(self.size, &title, trace, &passage);
            self.write(&format!("{stem}.drag"), &figure)?;
        }
        let range_s = some_strides(row, trace);
        let figure = stack_figure(self.size, &title, trace, &passage, range_s);
        self.write(&format!("{stem}.telemetry"), &figure)
    }

    /// Writes the figures over all trials: `boxes.svg`, `phase.svg`. Fails if a file cannot be written.
    pub fn write_batch(
        &self,
        conditions: &[ConditionRow],
        phases: &[(String, PhaseProfile)],
    ) -> Result<(), OutputError> {
        let figure = box_figure(self.size, "Energies and specific resistance", conditions);
        self.write("boxes", &figure)?;
        if phases.is_empty() {
            return Ok(());
        }
        self.write("phase", &phase_figure(self.size, "Drag and lift over a stride", phases))
    }

    fn write(&self, name: &str, figure: &Figure) -> Result<(), OutputError> {
        for &format in self.formats {
            let extension = match format {
                Format::Svg => "svg",
                Format::Pdf => "pdf",
                Format::Png => "png",
            };
            let path = self.directory.join(format!("{name}.{extension}"));
            let rendered = figure.render(format);
            let bytes = rendered.map_err(|e| OutputError::failed(&path, io::Error::other(e)))?;
            self.outputs.write(path, &bytes)?;
        }
        Ok(())
    }
}

pub fn title(row: &TrialRow) -> String {
    match row.condition.is_empty() {
        true => row.file.clone(),
        false => format!("{}: {}", row.condition, row.file),
    }
}

pub fn passage(row: &TrialRow, profile: &Profile) -> Passage {
    let window_s = [row.t_enter_s, row.t_exit_s];
    Passage::new(window_s, profile.robot.length_m, profile.channel.length_m)
}

/// Reduces a trace of the whole log to the data needed for a figure of many trials: the phase profile over
/// the time that the robot is fully inside (or over the window, if there are no strides in that time) and, if
/// `thinned`, the trace frame by frame.
pub fn reduce_trace(result: &mut TrialResult, profile: &Profile, thinned: bool) {
    let Some(trace) = result.trace.take() else { return };
    let window_s = [result.row.t_enter_s, result.row.t_exit_s];
    let inside_s = passage(&result.row, profile).wholly_s;
    let of = |window_s| PhaseProfile::new(&trace, window_s);
    result.phase = inside_s.and_then(of).or_else(|| of(window_s));
    result.trace = thinned.then(|| trace.thinned(THIN_S));
}

/// The window or, if it has many strides, the ten in its middle, s.
pub fn some_strides(row: &TrialRow, trace: &Trace) -> [f64; 2] {
    let times = &trace.stride_times_s;
    if times.len() < STRIDES + STRIDES / 2 {
        return [row.t_enter_s, row.t_exit_s];
    }
    let first = (times.len() - STRIDES) / 2;
    [times[first], times[first + STRIDES]]
}
