//! A robot with the shell runs through a channel: its telemetry, and the truth of every result.
//!
//! ```text
//! Gait ── leg angles ──► encoder counts          Truth: integrals of the same functions,
//!  │  ╲── speeds ──► Drive: duty, back EMF,             never of what was sampled
//!  │                 battery ──► counts
//!  ╰─► Contact: drag, lift, shaking ── wrench ──► SensorModel (100 Hz) ──► readings
//! ```
//!
//! [`VirtualTrial`] is a function of its settings and seeds to the last bit. Rows
//! ([`TelemetryRow`]) have the columns of the lab's telemetry, as integers, at 1 kHz of the robot's
//! clock; readings are fresh at 100 Hz and repeated in between.
//!
//! The window of the trial is from first to last contact with the beams, in which the robot covers
//! the length of the channel: v̄ = l/(t_exit − t_enter). The speed follows from the condition's
//! specific resistance and the motors' usual power, v̄ = P/(m g η), with a scatter of 3 %.
//!
//! Not modelled: the body's dynamics. Its columns hold oscillations at stride frequency with noise.

mod channel;
mod drive;
mod gait;
pub(crate) mod telemetry;
mod truth;

pub use channel::ChannelForces;
pub use gait::{Gait, LegSide};
pub use telemetry::TelemetryRow;
pub use truth::{StrideTruth, Truth};

use std::f64::consts::TAU;

use crate::SimulationError;
use crate::sensor_model::{SensorModel, SensorParameters, SimulatedFrame};
use channel::BeamContact;
use drive::Drive;
use shell_data::random::{Purpose, RandomStream};
use shell_data::wrench::PerAxis;

/// Time between rows of the telemetry, s: 1 kHz, as in the real log.
const ROW_S: f64 = 1001e-6;
const FIRST_S: f64 = 302e-6;
const FRAME_S: f64 = 0.01;
/// Times from the start of the legs to the channel, and from the channel to the end of the log.
const APPROACH_S: [f64; 2] = [1.0, 1.3];
const AFTERWARDS_S: f64 = 0.8;
const STALL_S: f64 = 0.4;

// Constants of the VelociRoACH and the lab's telemetry, repeated to reveal errors in its profile.

/// Standard gravity, m/s² (3rd CGPM, 1901).
const GRAVITY: f64 = 9.806_65;
const TURN: i64 = 1 << 16;
const RAD_PER_COUNT: f64 = TAU / TURN as f64;

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Constants {
    pub mass_kg: f64,
    pub robot_m: f64,
    pub channel_m: f64,
    pub motor_resistance_ohm: f64,
}

/// Table I of the paper; 3.3 Ω as used by the lab.
const CONSTANTS: Constants =
    Constants { mass_kg: 0.087, robot_m: 0.18, channel_m: 0.28, motor_resistance_ohm: 3.3 };

const WEIGHT_N: f64 = CONSTANTS.mass_kg * GRAVITY;

#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct TrialSettings {
    /// Determines noise, light, temperature, phases and scatter.
    pub seed: u64,
    pub unit_seed: u64,
    pub condition: ChannelForces,
    pub stride_hz: f64,
    pub lead_in_s: f64,
    pub noise_scale: f64,
    /// Noise of the encoders, counts (standard deviation).
    pub encoder_noise: f64,
    pub counter: Counter,
    pub missing: f64,
    pub stall: bool,
    pub reversed: bool,
    pub elastic: bool,
}

impl TrialSettings {
    /// Noise scale that gives the paper's noise at zero load, 0.037 N: the RMS of its 0.040, 0.015 and 0.048 N. With a
    /// scale of 1, the sensor model has 0.0214 N.
    pub const PAPER_NOISE: f64 = 1.7;

    /// Sets up a trial as the lab records it: 13 strides a second, no mishaps.
    pub fn new(condition: ChannelForces, seed: u64) -> Self {
        Self {
            seed,
            unit_seed: 1,
            condition,
            stride_hz: 13.0,
            lead_in_s: 1.0,
            noise_scale: Self::PAPER_NOISE,
            encoder_noise: 4.0,
            counter: Counter::Long,
            missing: 0.0,
            stall: false,
            reversed: false,
            elastic: false,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Counter {
    /// The lab's format: 32 bits with a sign, from somewhere in the middle.
    Long,
    /// Like `Long`, but it wraps around after two seconds of running.
    LongWrapping,
    /// From 0 to 65,535 in each turn.
    Turn,
}

/// One trial: functions of time on the robot's clock, and the rows of its telemetry.
#[derive(Clone, Debug)]
pub struct VirtualTrial {
    pub settings: TrialSettings,
    pub gait: Gait,
    contact: BeamContact,
    drive: Drive,
    sensor: SensorModel,
    /// Contact with the beams, on the robot's clock.
    pub window_s: [f64; 2],
    /// Times of all rows, including missing ones.
    pub times_s: Vec<f64>,
    first_count: i64,
    frame_delay_s: f64,
}

impl VirtualTrial {
    /// # Errors
    /// [`SimulationError`] if the settings are invalid.
    pub fn new(settings: TrialSettings) -> Result<Self, SimulationError> {
        check(&settings)?;
        let mut unit = SensorParameters::noisy_unit(settings.unit_seed, settings.noise_scale)?;
        unit.elastic = settings.elastic;
        let sensor = SensorModel::new(&unit, settings.seed)?;
        let TrialSettings { seed, condition, stride_hz, lead_in_s, .. } = settings;
        let mut random = RandomStream::new(seed, Purpose::Trial, 0);
        let usual_w = drive::usual_power_w(stride_hz);
        let usual_m_s = usual_w / (WEIGHT_N * condition.specific_resistance);
        let velocity_m_s = usual_m_s * (1.0 + 0.03 * random.normal().clamp(-3.0, 3.0));
        // The robot's clock counts whole µs.
        let to_us = |time_s: f64| (time_s * 1e6).round() / 1e6;
        let enter_s = to_us(lead_in_s + random.between(APPROACH_S[0], APPROACH_S[1]));
        let exit_s = to_us(enter_s + CONSTANTS.channel_m / velocity_m_s);
        let window_s = [enter_s, exit_s];
        let stall_at = enter_s + random.between(0.3, 0.6) * (exit_s - enter_s);
        let stall_s = settings.stall.then_some([stall_at, stall_at + STALL_S]);
        let gait = Gait::new(stride_hz, lead_in_s, stall_s, &mut random);
        let Constants { robot_m, channel_m, .. } = CONSTANTS;
        let entering = robot_m / (robot_m + channel_m);
        let contact = BeamContact::new(condition, window_s, entering, velocity_m_s, &mut random);
        let rows = ((exit_s + AFTERWARDS_S - FIRST_S) / ROW_S).ceil() as u64;
        let times_s: Vec<f64> = (0..rows).map(|row| to_us(FIRST_S + row as f64 * ROW_S)).collect();
        let mut controller = RandomStream::new(seed, Purpose::Controller, 0);
        let drive = Drive::new(&gait, lead_in_s, &times_s, &mut controller);
        // About two seconds, in full turns: the encoder's zero is a position of the leg.
        let span = TURN * (2.0 * stride_hz) as i64;
        let first_count = match settings.counter {
            Counter::Long => 762 * TURN,
            Counter::LongWrapping if settings.reversed => i64::from(i32::MIN) + span,
            Counter::LongWrapping => -i64::from(i32::MIN) - span,
            Counter::Turn => 0,
        };
        Ok(Self {
            settings,
            gait,
            contact,
            drive,
            sensor,
            window_s,
            times_s,
            first_count,
            frame_delay_s: random.between(0.0, FRAME_S),
        })
    }

    pub fn wrench_at(&self, time_s: f64) -> PerAxis<f64> {
        let leg_rad = self.gait.angle_rad(LegSide::Right, time_s);
        self.contact.wrench_at(time_s, leg_rad, self.gait.share(time_s))
    }

    pub fn frames(&self) -> impl Iterator<Item = (f64, SimulatedFrame)> {
        let mut sensor = self.sensor.clone();
        let end_s = self.times_s[self.times_s.len() - 1];
        let frames = ((end_s - self.frame_delay_s) / FRAME_S) as u64 + 1;
        (0..frames).map(move |frame| {
            let time_s = self.frame_delay_s + frame as f64 * FRAME_S;
            (time_s, sensor.sample(time_s, &self.wrench_at(time_s)))
        })
    }
}

fn check(settings: &TrialSettings) -> Result<(), SimulationError> {
    let &TrialSettings { stride_hz, lead_in_s, encoder_noise, missing, .. } = settings;
    let ChannelForces { drag_n, lift_n, specific_resistance, .. } = settings.condition;
    let is_rate = (0.2..=50.0).contains(&stride_hz);
    ensure!(is_rate, "{stride_hz} strides per second, where 0.2 to 50 can be made");
    let is_time = (0.0..=3600.0).contains(&lead_in_s);
    ensure!(is_time, "a lead-in of {lead_in_s} s, where 0 to 3600 s can be made");
    let is_noise = (0.0..=1000.0).contains(&encoder_noise);
    ensure!(is_noise, "encoder noise of {encoder_noise} counts, where 0 to 1000 can be made");
    let is_share = (0.0..1.0).contains(&missing);
    ensure!(is_share, "a share of {missing} of the frames lost, where 0 to 1 (excluded) is wanted");
    let are_usual = drag_n.abs() <= 10.0
        && lift_n.abs() <= 10.0
        && (1.0..=1000.0).contains(&specific_resistance);
    ensure!(
        are_usual,
        "drag {drag_n} N, lift {lift_n} N and specific resistance {specific_resistance}, where \
         forces up to 10 N and a resistance from 1 to 1000 can be made"
    );
    Ok(())
}
