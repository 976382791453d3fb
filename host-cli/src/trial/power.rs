//! Electrical power of the leg motors.

use super::profile::Profile;
use super::rows::TrialRows;
use shell_data::telemetry::Telemetry;

/// The power of each motor at every row, W.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Power {
    pub(super) right_w: Vec<f64>,
    pub(super) left_w: Vec<f64>,
}

impl Power {
    /// From telemetry; the columns that are not there, if any are missing.
    pub(super) fn new(rows: &TrialRows, profile: &Profile) -> Result<Self, Vec<&'static str>> {
        let columns = Telemetry::POWER.map(|kind| rows.telemetry(kind));
        let [Some(duty_r), Some(duty_l), Some(emf_r), Some(emf_l), Some(battery)] = columns else {
            let missing =
                Telemetry::POWER.iter().zip(columns).filter(|(_, column)| column.is_none());
            return Err(missing.map(|(kind, _)| kind.name()).collect());
        };
        let scales = profile.telemetry;
        let side = |duty: &[f64], emf: &[f64]| {
            let samples = duty.iter().zip(emf).zip(battery);
            samples
                .map(|((&duty, &emf), &battery)| {
                    profile.motor.power_w(
                        duty / scales.duty_counts,
                        battery * scales.battery_v_per_count,
                        emf * scales.back_emf_v_per_count,
                    )
                })
                .collect()
        };
        Ok(Self { right_w: side(duty_r, emf_r), left_w: side(duty_l, emf_l) })
    }

    /// Of both motors, W.
    pub(super) fn total_w(&self) -> Vec<f64> {
        self.right_w.iter().zip(&self.left_w).map(|(right, left)| right + left).collect()
    }
}
