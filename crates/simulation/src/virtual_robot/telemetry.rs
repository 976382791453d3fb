//! The robot's telemetry, in the columns of the lab's format.

use super::drive::Drive;
use super::{Counter, LegSide, VirtualTrial};
use super::{GRAVITY, RAD_PER_COUNT, TURN};
use shell_data::random::{Purpose, RandomStream};

/// Columns by the lab's names: the robot's, then the sensor's.
pub(crate) const COLUMNS: [&str; 2] = [
    "time | Right Leg Pos | Left Leg Pos | Commanded Right Leg Pos | Commanded Left Leg Pos | DCR | DCL | \
     GyroX | GyroY | GyroZ | AX | AY | AZ | RBEMF | LBEMF | VBatt",
    " | S1 | S2 | S3 | S4 | S5 | S6 | S7 | S8",
];

pub(crate) const TELEMETRY_COLUMNS: usize = 16;

pub type TelemetryRow = [i64; 24];

/// The encoders have 14 bits, scaled to sixteen.
const ENCODER_STEP: f64 = 4.0;
/// Noise of back EMF and battery, counts (standard deviations), as in the real log.
const BACK_EMF_NOISE: f64 = 12.0;
const BATTERY_NOISE: f64 = 3.0;
/// Gyro, °/s, and acceleration, m/s²: amplitude at stride frequency and noise, as in the real log.
const GYRO_DEG_S: [f64; 2] = [100.0, 60.0];
const ACCELERATION_M_S2: [f64; 2] = [4.0, 5.0];

impl VirtualTrial {
    /// Returns the rows without the missing ones.
    pub fn rows(&self) -> impl Iterator<Item = TelemetryRow> {
        let seed = self.settings.seed;
        let mut noise = RandomStream::new(seed, Purpose::Telemetry, 0);
        let mut losses = RandomStream::new(seed, Purpose::Losses, 0);
        let mut frames = self.frames().peekable();
        // Before its first frame the sensor repeats an earlier reading, which differs from the first only by noise.
        let mut readings = frames.peek().map(|(_, frame)| frame.readings).unwrap_or_default();
        self.times_s.iter().enumerate().filter_map(move |(row, &time_s)| {
            while let Some((_, frame)) = frames.next_if(|&(at_s, _)| at_s <= time_s) {
                readings = frame.readings;
            }
            let mut values = self.telemetry(row, time_s, &mut noise);
            for (value, reading) in values[TELEMETRY_COLUMNS..].iter_mut().zip(readings) {
                *value = i64::from(reading);
            }
            (losses.uniform() >= self.settings.missing).then_some(values)
        })
    }

    /// Fills the robot's columns; the sensor's stay zero.
    fn telemetry(&self, row: usize, time_s: f64, noise: &mut RandomStream) -> TelemetryRow {
        let mut values = TelemetryRow::default();
        let scale = self.settings.noise_scale;
        let (gait, drive) = (&self.gait, &self.drive);
        let counts = |value: f64| value.round() as i64;
        values[0] = counts(1e6 * time_s);
        for (i, side) in LegSide::BOTH.into_iter().enumerate() {
            let angle = gait.angle_rad(side, time_s) / RAD_PER_COUNT;
            let read = angle + self.settings.encoder_noise * noise.normal();
            values[1 + i] = self.count(side, ENCODER_STEP * (read / ENCODER_STEP).round());
            values[3 + i] = self.count(side, gait.commanded_rad(side, time_s) / RAD_PER_COUNT);
            values[5 + i] = counts(drive.duty(side, row));
            let emf = Drive::back_emf_v(gait, side, time_s) * 1024.0 / 3.3 * 15.0 / 47.0;
            values[13 + i] = counts(emf + scale * BACK_EMF_NOISE / 1.7 * noise.normal());
        }
        let leg = gait.angle_rad(LegSide::Right, time_s);
        let running = gait.share(time_s);
        for axis in 0..3 {
            let phase = libm::sin(leg + axis as f64);
            let [size, scatter] = GYRO_DEG_S;
            let rate = running * (size * phase + scale * scatter * noise.normal());
            values[7 + axis] = counts(16.384 * rate);
            let [size, scatter] = ACCELERATION_M_S2;
            let shaken = running * (size * phase + scale * scatter * noise.normal());
            let upward = if axis == 2 { GRAVITY } else { 0.0 };
            values[10 + axis] = counts(4096.0 / 9.81 * (upward + shaken));
        }
        let battery = drive.battery_v(gait, row, time_s) * 1023.0 / 3.3 * 2.7 / 3.7;
        values[15] = counts(battery + scale * BATTERY_NOISE / 1.7 * noise.normal());
        values
    }

    fn count(&self, side: LegSide, angle: f64) -> i64 {
        let backwards = self.settings.reversed && side == LegSide::Right;
        let turned = if backwards { -angle } else { angle }.round() as i64;
        let count = self.first_count + turned;
        match self.settings.counter {
            Counter::Long | Counter::LongWrapping => i64::from(count as i32),
            Counter::Turn => count.rem_euclid(TURN),
        }
    }

    /// Returns the times at which the right encoder's noiseless count passes whole turns, in order.
    pub fn turns_s(&self) -> Vec<f64> {
        let end_s = self.times_s[self.times_s.len() - 1];
        let first = self.first_count;
        // Distance to the next whole turn in the direction of counting, in counts of the angle.
        let offset = if self.settings.reversed { first } else { -first }.rem_euclid(TURN);
        let angle = |turn: i64| (offset + turn * TURN) as f64 * RAD_PER_COUNT;
        let turn_of = |time_s: f64| {
            let counts = self.gait.angle_rad(LegSide::Right, time_s) / RAD_PER_COUNT;
            (counts - offset as f64) / TURN as f64
        };
        let turns = turn_of(0.0).floor() as i64..=turn_of(end_s).ceil() as i64;
        turns.filter_map(|turn| self.gait.time_of(LegSide::Right, angle(turn), end_s)).collect()
    }
}
