//! The flags of every command that evaluates trials.

use std::path::{Path, PathBuf};

use anyhow::Context;
use log_file::{Mapping, ReadOptions};
use shellcal::calibration_file::CalibrationFile;
use shellcal::trial::{LowPass, Profile, Rule, TareRule, TraceExtent, TrialOptions};
use shellcal::workflow::selection::TimeWindow;
use shellcal::workflow::trial::Instrument;

use crate::cmd::frames::parse_window;
use crate::cmd::mapping::MappingArgs;

/// The lab's tare, in frames.
const TARE_FRAMES: usize = 50;

/// How trials are evaluated.
#[derive(Debug, clap::Args)]
pub(crate) struct EvaluationArgs {
    /// Calibration file; without one there are energies but no forces
    #[arg(long, short, value_name = "CAL")]
    calibration: Option<PathBuf>,

    /// Robot profile, in TOML [default: the built-in `velociroach`; see `shellcal profile`]
    #[arg(long, value_name = "FILE")]
    profile: Option<PathBuf>,

    /// Evaluate rows as the lab's notebooks did: each is a sample, the filter steps once a row and
    /// lags behind, the tare is taken over rows, and energy is summed up row by row
    #[arg(long)]
    by_row: bool,

    /// Subtract the mean wrench of the first N frames [default: 50]
    #[arg(long, value_name = "N", group = "tares", help_heading = "Taring", value_parser = parse_frames)]
    tare: Option<usize>,

    /// Subtract the mean wrench between two times, in s on the log's clock
    #[arg(long, value_name = "START:END", group = "tares", help_heading = "Taring", value_parser = parse_window)]
    tare_time: Option<TimeWindow>,

    /// Subtract nothing
    #[arg(long, group = "tares", help_heading = "Taring")]
    no_tare: bool,

    /// Cutoff of the Butterworth low-pass, in Hz
    #[arg(long, value_name = "HZ", default_value_t = 10.0, help_heading = "Filtering")]
    lowpass: f64,

    /// Do not filter
    #[arg(long, conflicts_with = "lowpass", help_heading = "Filtering")]
    no_lowpass: bool,

    /// Number of poles of the low-pass
    #[arg(long, value_name = "N", default_value_t = 4, help_heading = "Filtering")]
    order: usize,

    /// Filter forward only: forces lag behind, some 40 ms at 10 Hz
    #[arg(long, help_heading = "Filtering")]
    causal: bool,

    /// Rows per second, for the low-pass [default: one over the median time from row to row]
    #[arg(long, value_name = "HZ", help_heading = "Filtering")]
    rate: Option<f64>,

    /// The highest reading the converter can give, to tell saturation
    #[arg(long, value_name = "COUNTS", default_value_t = 4095.0)]
    full_scale: f64,

    #[command(flatten)]
    mapping: MappingArgs,
}

/// What trials are evaluated with, read from its files.
#[derive(Debug)]
pub(crate) struct Equipment {
    pub(crate) profile: Profile,
    pub(crate) calibration: Option<CalibrationFile>,
    pub(crate) mapping: Mapping,
}

impl Equipment {
    pub(crate) fn instrument(&self) -> Instrument<'_> {
        let calibration = self.calibration.as_ref().map(|file| &file.calibration);
        Instrument { profile: &self.profile, calibration }
    }
}

impl EvaluationArgs {
    pub(crate) fn equipment(&self) -> anyhow::Result<Equipment> {
        let calibration = self.calibration.as_deref().map(CalibrationFile::read).transpose()?;
        let profile = match &self.profile {
            None => Profile::velociroach(),
            Some(path) => read_profile(path)?,
        };
        Ok(Equipment { profile, calibration, mapping: self.mapping.mapping()? })
    }

    pub(crate) fn options(&self, equipment: &Equipment, trace: TraceExtent) -> TrialOptions {
        let zero_phase = !self.causal && !self.by_row;
        TrialOptions {
            tare: match (self.tare_time, self.tare) {
                _ if self.no_tare => TareRule::Untared,
                (Some(window), _) => TareRule::Between(window.start_s, window.end_s),
                (None, frames) => TareRule::First(frames.unwrap_or(TARE_FRAMES)),
            },
            low_pass: (!self.no_lowpass).then_some(LowPass {
                cutoff_hz: self.lowpass,
                order: self.order,
                zero_phase,
            }),
            rate_hz: self.rate,
            rule: if self.by_row { Rule::Rows } else { Rule::Time },
            trace,
            full_scale: self.full_scale,
            unexplained: equipment.calibration.as_ref().and_then(CalibrationFile::unexplained),
        }
    }

    pub(crate) fn read_options(&self) -> ReadOptions<'static> {
        ReadOptions { checksum: true, ..self.mapping.read_options() }
    }

    pub(crate) fn calibration(&self) -> Option<&Path> {
        self.calibration.as_deref()
    }

    /// The files that results depend on beside manifest and logs, and what they are.
    pub(crate) fn files_by_role(&self) -> impl Iterator<Item = (&'static str, &Path)> {
        let calibration = self.calibration.iter().map(|path| ("calibration", &**path));
        calibration.chain(self.profile.iter().map(|path| ("profile", &**path)))
    }

    /// The files that results depend on beside manifest and logs.
    pub(crate) fn files(&self) -> impl Iterator<Item = &Path> {
        self.calibration.iter().chain(&self.profile).map(PathBuf::as_path)
    }
}

fn read_profile(path: &Path) -> anyhow::Result<Profile> {
    let text = std::fs::read_to_string(path)
        .with_context(|| format!("cannot read `{}`", path.display()))?;
    Profile::parse(&text).map_err(|error| anyhow::anyhow!("`{}`, {error}", path.display()))
}

fn parse_frames(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(0) | Err(_) => Err("expected a number of frames, 1 or more".to_owned()),
        Ok(frames) => Ok(frames),
    }
}
