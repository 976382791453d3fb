//! A trial on its log: between given times, or between times found in the drag.

mod reading;

use super::WorkflowError;
use log_file::{Log, ReadOptions};
use reading::RecordedTrial;
use trial::{
    Diagnostic, Instrument, LogTimes, NoWindow, Proposal, Trace, TraceExtent, Trial, TrialOptions,
    TrialResult, check_window, propose_window,
};

#[derive(Clone, Copy)]
pub struct TrialJob<'a> {
    pub log: &'a Log,
    pub instrument: Instrument<'a>,
    pub options: TrialOptions,
    pub read: ReadOptions<'a>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Evaluated {
    pub result: TrialResult,
    pub checksum: Option<String>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct WindowSearch {
    pub time_s: Vec<f64>,
    pub drag_n: Vec<f64>,
    pub proposal: Result<Proposal, NoWindow>,
}

/// Evaluates a trial on its log. Fails if the log cannot be read or the trial cannot be evaluated on it.
pub fn evaluate_log(job: &TrialJob<'_>, trial: &Trial) -> Result<Evaluated, WorkflowError> {
    let recorded = RecordedTrial::read(job, (trial.t_enter_s, trial.t_exit_s))?;
    // A fault of the window says more than a lack of rows in it.
    check_window(trial, &recorded.times)?;
    let mut result = recorded.evaluate(job, trial)?;
    let RecordedTrial { summary, zero, .. } = recorded;
    let moved = zero.and_then(|zero| zero.in_words());
    result.diagnostics.extend(moved.map(|text| Diagnostic::warning("moved_zero", text)));
    let rows = summary.skipped_rows;
    if rows > 0 {
        let text = format!("{rows} bad rows are left out");
        result.diagnostics.push(Diagnostic::warning("skipped_rows", text));
    }
    Ok(Evaluated { result, checksum: summary.checksum })
}

/// Evaluates a trial on its log between the entry and exit of `window_s`, on the log's clock; times that are not
/// given are found in the drag, and the diagnostics say so. Fails if there is no window.
pub fn evaluate_in_window(
    job: &TrialJob<'_>,
    trial: Trial,
    window_s: (Option<f64>, Option<f64>),
) -> Result<Evaluated, WorkflowError> {
    let mut found = None;
    let (t_enter_s, t_exit_s) = match window_s {
        (Some(enter_s), Some(exit_s)) => (enter_s, exit_s),
        (enter_s, exit_s) => {
            let read = ReadOptions { checksum: false, progress: None, ..job.read };
            let proposal = search_window(&TrialJob { read, ..*job })?.proposal?;
            found = Some(Diagnostic::found_window(&proposal));
            (enter_s.unwrap_or(proposal.t_enter_s), exit_s.unwrap_or(proposal.t_exit_s))
        }
    };
    let mut evaluated = evaluate_log(job, &Trial { t_enter_s, t_exit_s, ..trial })?;
    evaluated.result.diagnostics.extend(found);
    Ok(evaluated)
}

/// Finds entry and exit in the drag of a whole log, filtered without delay regardless of the options: a filter with a
/// delay would make the window late. Fails with [`WorkflowError`] if the log cannot be evaluated, or gives no forces.
pub fn search_window(job: &TrialJob<'_>) -> Result<WindowSearch, WorkflowError> {
    if job.instrument.calibration.is_none() {
        return Err(WorkflowError::NoCalibration);
    }
    let forces = job.options.forces.with_delay(false);
    let options = TrialOptions { forces, trace: TraceExtent::Log, ..job.options };
    let job = TrialJob { options, ..*job };
    // Evaluate the whole log as if it were one trial.
    let recorded = RecordedTrial::read(&job, (f64::NEG_INFINITY, f64::INFINITY))?;
    let LogTimes { first_s, last_s, .. } = recorded.times;
    let trial = Trial::from_window(job.log.path().display().to_string(), (first_s, last_s));
    let TrialResult { row, trace, .. } = recorded.evaluate(&job, &trial)?;
    let Trace { t_s, wrench: [fx, ..], .. } = trace.unwrap_or_default();
    let drag_n: Vec<f64> = fx.iter().map(|fx| -fx).collect();
    if drag_n.is_empty() {
        return Err(WorkflowError::NoForces);
    }
    let proposal = propose_window(&t_s, &drag_n, row.stride_frequency_hz.map(f64::recip));
    // A zero-phase low-pass makes a step rise about this much earlier.
    let resolution_s = forces.low_pass.map_or(0.0, |low_pass| 0.5 / low_pass.cutoff_hz);
    let proposal = proposal.map(|found| found.with_resolution(resolution_s));
    Ok(WindowSearch { time_s: t_s, drag_n, proposal })
}
