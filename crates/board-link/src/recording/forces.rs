//! Forces in addition to the readings, by the [force pipeline](forces).

use std::sync::{Arc, OnceLock};

use super::reception::BoardFrame;
use calibration::Calibration;
use calibration::memory::{MemoryState, TimeBase};
use calibration::quality::AxisQuality;
use calibration::validation::excitation::Excitation;
use forces::stationary::StationaryFinder;
use forces::{FirstRows, ForceError, ForceOptions, ForcePipeline, ForceStream, PipelineSetup};
use shared_proto::CHANNELS;
use shell_data::wrench::{Axes, Axis, AxisValues, PerAxis};

#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum UnsuitableCalibration {
    #[error("the calibration is for {0} channels, a board has {CHANNELS}")]
    Channels(usize),
    #[error("the board streams wrenches, so there are no readings to apply a calibration to")]
    Wrenches,
}

#[derive(Clone, Debug)]
pub struct LiveForces {
    pub calibration: Calibration,
    /// The low-pass is always applied forward only.
    pub options: ForceOptions,
    /// Errors and loads of the training data, if known.
    pub trained: Option<(PerAxis<AxisQuality>, Excitation)>,
    /// The reason to doubt that the shell was unloaded during the tare, once the tare is known; shared by all clones.
    pub tare_doubt: Arc<OnceLock<String>>,
}

#[derive(Clone, Debug)]
pub struct RunningForces {
    live: LiveForces,
    stage: ForceStage,
    memory: Option<MemoryState>,
    /// Finds stationary intervals, if the tare follows them.
    finder: Option<StationaryFinder>,
    newest: Option<PerAxis<f64>>,
}

#[derive(Clone, Debug)]
enum ForceStage {
    /// Tare and clock are being determined from the first frames, which are kept for the filter.
    Setup {
        setup: Box<PipelineSetup>,
        times_s: Vec<f64>,
        readings: Vec<Vec<f64>>,
    },
    Running {
        pipeline: Box<ForcePipeline>,
        stream: Box<ForceStream>,
    },
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Force {
    pub wrench: PerAxis<f64>,
    /// Bit i is set if channel i was outside the calibrated range.
    pub out_of_range: u64,
    pub untared: bool,
    pub unfiltered: bool,
}

impl RunningForces {
    /// Fails with [`UnsuitableCalibration`] if the calibration has another number of channels.
    pub fn new(live: LiveForces) -> Result<Self, UnsuitableCalibration> {
        let channels = live.calibration.channels();
        if channels != CHANNELS {
            return Err(UnsuitableCalibration::Channels(channels));
        }
        let live = LiveForces { options: live.options.with_delay(true), ..live };
        let options = live.options;
        let finder = options.tare.follows_rests().then(StationaryFinder::default);
        let setup = Box::new(PipelineSetup::while_recording(options));
        let (times_s, readings) = (Vec::new(), vec![Vec::new(); live.calibration.columns()]);
        let stage = ForceStage::Setup { setup, times_s, readings };
        let memory = live.calibration.start_memory();
        Ok(Self { live, stage, memory, finder, newest: None })
    }

    /// Computes the forces of frames that hold readings. Fails with [`ForceError`] if the low-pass is impossible at the
    /// frames' rate.
    pub fn of(&mut self, frames: &[BoardFrame]) -> Result<Vec<Force>, ForceError> {
        let times_s: Vec<f64> = frames.iter().map(|frame| frame.time_us as f64 / 1e6).collect();
        let mut readings = columns(frames);
        if let Some(memory) = &mut self.memory {
            readings.extend(memory.terms(&times_s, &readings).expect("a time for every frame"));
        }
        let out_of_range = self.live.calibration.out_of_range(&readings);
        let first = self.set_up(&times_s, &readings)?;
        let mut wrench = PerAxis::default();
        self.live.calibration.wrench(&cut(&readings, 0..first), &mut wrench);
        if let (ForceStage::Running { pipeline, stream }, true) =
            (&mut self.stage, first < frames.len())
        {
            let (times_s, readings) = (&times_s[first..], cut(&readings, first..frames.len()));
            follow(&mut self.finder, pipeline, &self.live.calibration, times_s, &readings);
            let tared = pipeline.wrench(&self.live.calibration, times_s, &readings);
            let filtered = stream.push(times_s, tared)?;
            wrench.iter_mut().zip(filtered).for_each(|(wrench, rest)| wrench.extend(rest));
        }
        let needs_tare = self.live.options.tare != forces::TareRule::Untared;
        let forces = out_of_range.into_iter().enumerate().map(|(row, out_of_range)| Force {
            wrench: wrench.each_ref().map(|axis| axis[row]),
            out_of_range,
            untared: row < first && needs_tare,
            unfiltered: row < first && self.live.options.low_pass.is_some(),
        });
        let forces: Vec<Force> = forces.collect();
        self.newest = forces.last().map(|force| force.wrench).or(self.newest);
        Ok(forces)
    }

    /// Returns the standard errors of the frames' wrenches by the calibration, N and N·m, before the low-pass.
    pub fn standard_errors(&self, frames: &[BoardFrame]) -> Option<PerAxis<Vec<f64>>> {
        let tare = match &self.stage {
            ForceStage::Setup { .. } => None,
            ForceStage::Running { pipeline, .. } => pipeline.tare.as_ref(),
        };
        self.live.calibration.standard_errors(&columns(frames), tare)
    }

    /// Converts a frame's time, µs, to the time of its force on the reference's clock.
    pub fn moved_us(&self, time_us: i64) -> i64 {
        let lag = self.live.calibration.lag.filter(|lag| lag.time_base == TimeBase::Seconds);
        time_us + lag.map_or(0, |lag| (lag.by * 1e6).round() as i64)
    }

    pub fn axes(&self) -> Axes {
        self.live.calibration.axes
    }

    pub fn newest(&self) -> Option<AxisValues<f64>> {
        self.newest.map(|wrench| self.axes().values(&wrench))
    }

    /// Determines tare and clock if they are not known; returns the number of frames used. The
    /// filter's state is then as if they had been known from the start.
    fn set_up(&mut self, times_s: &[f64], readings: &[Vec<f64>]) -> Result<usize, ForceError> {
        let ForceStage::Setup { setup, times_s: kept_s, readings: kept } = &mut self.stage else {
            return Ok(0);
        };
        let mut row = 0;
        while row < times_s.len() && !setup.is_done() {
            let (times_s, readings) = (&times_s[row..=row], cut(readings, row..row + 1));
            let rows = FirstRows { times_s, readings: &readings, fresh: &[true], leg: None };
            setup.look_at(&self.live.calibration, rows);
            kept_s.extend_from_slice(times_s);
            kept.iter_mut().zip(readings).for_each(|(kept, reading)| kept.extend(reading));
            row += 1;
        }
        if setup.is_done() {
            let mut pipeline = setup.as_ref().clone().finish(&self.live.calibration)?;
            follow(&mut self.finder, &mut pipeline, &self.live.calibration, kept_s, kept);
            let known = self.live.trained.as_ref().zip(pipeline.tare_result.as_ref());
            if let Some(doubt) = known.and_then(|((errors, loads), tare)| tare.doubt(errors, loads))
            {
                self.live.tare_doubt.get_or_init(|| doubt);
            }
            let mut stream = pipeline.stream(&Axis::ALL);
            stream.push(kept_s, pipeline.wrench(&self.live.calibration, kept_s, kept))?;
            let (pipeline, stream) = (Box::new(pipeline), Box::new(stream));
            self.stage = ForceStage::Running { pipeline, stream };
        }
        Ok(row)
    }
}

/// Passes stationary intervals that end in these frames to the pipeline, if its tare follows them.
fn follow(
    finder: &mut Option<StationaryFinder>,
    pipeline: &mut ForcePipeline,
    calibration: &Calibration,
    times_s: &[f64],
    readings: &[Vec<f64>],
) {
    if let Some(finder) = finder {
        // Memory columns do not matter while the sensor is still.
        let channels = &readings[..calibration.channels()];
        finder
            .look_at(times_s, channels, &mut |stationary| pipeline.follow(calibration, stationary));
    }
}

fn columns(frames: &[BoardFrame]) -> Vec<Vec<f64>> {
    let column = |channel: usize| {
        let reading =
            |frame: &BoardFrame| frame.measured.readings().map_or(f64::NAN, |it| it[channel]);
        frames.iter().map(reading).collect()
    };
    (0..CHANNELS).map(column).collect()
}

fn cut(columns: &[Vec<f64>], rows: std::ops::Range<usize>) -> Vec<Vec<f64>> {
    columns.iter().map(|column| column[rows.clone()].to_vec()).collect()
}
