//! Robot profiles: what the counts of a robot's telemetry mean, and what the robot is.
//!
//! A profile is a TOML document. [`Profile::velociroach`] is built in; its file says where each
//! constant comes from.

use serde::{Deserialize, Serialize};

use super::toml_place::{TomlError, parse};

/// The built-in profile as a document, to start another from.
pub const VELOCIROACH: &str = include_str!("../../assets/profiles/velociroach.toml");

/// A robot and its channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Profile {
    /// What the robot is called.
    pub name: String,
    /// What its telemetry counts mean.
    pub telemetry: TelemetryScales,
    /// Its leg motors.
    pub motor: Motor,
    /// Its body.
    pub robot: Robot,
    /// What it runs through.
    pub channel: Channel,
}

/// The value of one count in each telemetry column.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TelemetryScales {
    /// Leg position, rad.
    pub leg_rad_per_count: f64,
    /// Angular rate, °/s.
    pub gyro_deg_s_per_count: f64,
    /// Acceleration, m/s².
    pub acceleration_m_s2_per_count: f64,
    /// Back EMF of a motor, V.
    pub back_emf_v_per_count: f64,
    /// Battery, V.
    pub battery_v_per_count: f64,
    /// The counts of a motor duty of 1.
    pub duty_counts: f64,
}

/// A leg motor; the two are alike.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Motor {
    /// Resistance R, Ω.
    pub resistance_ohm: f64,
    /// Torque constant Kt, N·m/A.
    pub torque_constant_nm_per_a: f64,
}

/// The robot's body.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Robot {
    /// Mass m, shell included, kg.
    pub mass_kg: f64,
    /// Acceleration of free fall g, m/s².
    pub gravity_m_s2: f64,
    /// Length, m, if known: figures shade when the robot enters and leaves.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub length_m: Option<f64>,
}

/// The channel of a trial.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Channel {
    /// Its length, m.
    pub length_m: f64,
}

impl Profile {
    /// The robot of the paper.
    pub fn velociroach() -> Self {
        Self::parse(VELOCIROACH).expect("the built-in profile is tested")
    }

    /// Reads a profile.
    ///
    /// # Errors
    /// [`TomlError`] with line and column: no TOML, a key that is missing or unknown, or a constant
    /// that is not a positive number.
    pub fn parse(text: &str) -> Result<Self, TomlError> {
        let profile: Self = parse(text)?;
        let length = profile.robot.length_m.map(|length| ("robot", "length_m", length));
        for (table, key, value) in profile.constants().into_iter().chain(length) {
            if !(value > 0.0 && value.is_finite()) {
                let message = format!("`{table}.{key}` is `{value}`, expected a positive number");
                return Err(TomlError::at_key(text, table, key, message));
            }
        }
        Ok(profile)
    }

    /// All constants with their tables and keys.
    fn constants(&self) -> [(&'static str, &'static str, f64); 11] {
        let Self { telemetry, motor, robot, channel, .. } = self;
        [
            ("telemetry", "leg_rad_per_count", telemetry.leg_rad_per_count),
            ("telemetry", "gyro_deg_s_per_count", telemetry.gyro_deg_s_per_count),
            ("telemetry", "acceleration_m_s2_per_count", telemetry.acceleration_m_s2_per_count),
            ("telemetry", "back_emf_v_per_count", telemetry.back_emf_v_per_count),
            ("telemetry", "battery_v_per_count", telemetry.battery_v_per_count),
            ("telemetry", "duty_counts", telemetry.duty_counts),
            ("motor", "resistance_ohm", motor.resistance_ohm),
            ("motor", "torque_constant_nm_per_a", motor.torque_constant_nm_per_a),
            ("robot", "mass_kg", robot.mass_kg),
            ("robot", "gravity_m_s2", robot.gravity_m_s2),
            ("channel", "length_m", channel.length_m),
        ]
    }
}

impl Motor {
    /// The electrical power drawn by one motor, W: `|d·V·(V − E)/R|` of duty d, battery V and back
    /// EMF E.
    pub fn power_w(&self, duty: f64, battery_v: f64, back_emf_v: f64) -> f64 {
        (duty * battery_v * (battery_v - back_emf_v) / self.resistance_ohm).abs()
    }

    /// The torque of one motor, N·m: `d·Kt·(V − E)/R`.
    pub fn torque_nm(&self, duty: f64, battery_v: f64, back_emf_v: f64) -> f64 {
        duty * self.torque_constant_nm_per_a * (battery_v - back_emf_v) / self.resistance_ohm
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_constants_are_the_arithmetic_of_their_sources() {
        let Profile { telemetry, motor, robot, channel, .. } = Profile::velociroach();
        let expected = [
            (telemetry.leg_rad_per_count, 95.8738e-6),
            (telemetry.gyro_deg_s_per_count, 1.0 / 16.384),
            (telemetry.acceleration_m_s2_per_count, 1.0 / 4096.0 * 9.81),
            (telemetry.back_emf_v_per_count, 3.3 / 1024.0 * 47.0 / 15.0),
            (telemetry.battery_v_per_count, 3.3 / 1023.0 * 3.7 / 2.7),
            (telemetry.duty_counts, 4096.0),
            (motor.resistance_ohm, 3.3),
            (motor.torque_constant_nm_per_a, 1.41e-3),
            (robot.mass_kg, 0.087),
            (robot.gravity_m_s2, 9.81),
            (channel.length_m, 0.28),
        ];
        for (found, expected) in expected {
            // The arithmetic rounds up to four times.
            assert!((found / expected - 1.0).abs() < 4.0 * f64::EPSILON, "{found} {expected}");
        }
        let turn = std::f64::consts::TAU / telemetry.leg_rad_per_count;
        // Five digits are given.
        assert!((turn / 65536.0 - 1.0).abs() < 1e-6);
    }

    #[test]
    fn a_motor_against_a_worked_example() {
        let motor = Profile::velociroach().motor;
        // Half duty at 4 V with 0.7 V of back EMF: 0.5·3.3/3.3 = 0.5 A in the mean.
        assert!((motor.power_w(-0.5, 4.0, 0.7) - 2.0).abs() < 1e-15);
        assert!((motor.torque_nm(-0.5, 4.0, 0.7) + 0.705e-3).abs() < 1e-18);
    }

    #[test]
    fn what_is_wrong_with_a_profile_is_told_with_its_place() {
        let cases = [
            ("mass_kg = 0.087", "mass_g = 87", "unknown field `mass_g`"),
            ("mass_kg = 0.087 ", "mass_kg = 0.0 ", "`robot.mass_kg` is `0`"),
            ("mass_kg = 0.087 ", "mass_kg = nan ", "`robot.mass_kg` is `NaN`"),
            ("mass_kg = 0.087 ", "mass_kg = \"87 g\" ", "invalid type: string"),
        ];
        for (old, new, message) in cases {
            let error = Profile::parse(&VELOCIROACH.replace(old, new)).unwrap_err();
            assert!(error.message.contains(message), "{error}");
            let line =
                1 + VELOCIROACH.lines().position(|line| line.starts_with("mass_kg")).unwrap();
            assert_eq!(error.line, line, "{error}");
        }
        let error = Profile::parse(&VELOCIROACH.replace("mass_kg", "# ")).unwrap_err();
        assert!(error.message.contains("missing field `mass_kg`"), "{error}");
        let error = Profile::parse("name = ").unwrap_err();
        assert_eq!(error.line, 1);
    }
}
