//! What a trial is evaluated on.

use super::options::TrialOptions;
use super::profile::Profile;
use super::rows::{LogTimes, TrialRows};
use super::subject::Trial;
use calibration::Calibration;
use forces::{ForcePipeline, TareFrames};

/// What trials are evaluated with.
#[derive(Clone, Copy, Debug)]
pub struct Instrument<'a> {
    /// The robot.
    pub profile: &'a Profile,
    /// The calibration of its shell; without one there are no forces.
    pub calibration: Option<&'a Calibration>,
}

/// A trial, and all that its results are computed from.
#[derive(Clone, Copy, Debug)]
pub struct TrialInput<'a> {
    /// What is evaluated.
    pub trial: &'a Trial,
    /// What it is evaluated with.
    pub instrument: Instrument<'a>,
    /// The times of its log.
    pub times: &'a LogTimes,
    /// The rows around its window.
    pub rows: &'a TrialRows,
    /// From its readings to forces; `None` where there are no forces.
    pub pipeline: Option<&'a ForcePipeline>,
    /// The frames of the tare, if there is one.
    pub tare_frames: Option<&'a TareFrames>,
    /// How it is evaluated.
    pub options: &'a TrialOptions,
}
