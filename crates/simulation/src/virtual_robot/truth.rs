//! The truth of a trial: integrals of the functions that generated it.
//!
//! Duty is constant between rows and all else is smooth: Simpson's rule integrates each interval.
//! Corners at starts and stalls of the legs leave errors of some 1e-8.

use super::{CONSTANTS, Constants, TrialSettings, VirtualTrial, WEIGHT_N};
use shell_data::wrench::PerAxis;

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Truth {
    pub t_enter_s: f64,
    pub t_exit_s: f64,
    pub velocity_m_s: f64,
    pub mean_wrench: PerAxis<f64>,
    /// Mean Fx times the length of the channel, J.
    pub drag_energy_j: f64,
    pub electrical_energy_j: f64,
    pub mean_power_w: f64,
    /// Mean power over weight and speed.
    pub specific_resistance: f64,
    /// Full turns of the right encoder within the window.
    pub strides: Vec<StrideTruth>,
    /// Full turns of the right encoder in the log.
    pub turns_s: Vec<f64>,
    pub constants: Constants,
    pub settings: TrialSettings,
}

#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct StrideTruth {
    pub t_start_s: f64,
    pub t_end_s: f64,
    pub mean_fx_n: f64,
    /// Mean Fx times mean speed times duration.
    pub drag_energy_j: f64,
    pub electrical_energy_j: f64,
    pub specific_resistance: f64,
}

impl VirtualTrial {
    pub fn truth(&self) -> Truth {
        let Constants { channel_m, .. } = CONSTANTS;
        let [enter_s, exit_s] = self.window_s;
        let length_s = exit_s - enter_s;
        let velocity_m_s = channel_m / length_s;
        let weight_w = WEIGHT_N * velocity_m_s;
        let sums = self.integrate(enter_s, exit_s);
        let mean_wrench: PerAxis<f64> = std::array::from_fn(|axis| sums[axis] / length_s);
        let turns_s = self.turns_s();
        let inside = |pair: &&[f64]| pair[0] >= enter_s && pair[1] <= exit_s;
        let strides = turns_s.windows(2).filter(inside).map(|pair| {
            let sums = self.integrate(pair[0], pair[1]);
            let length_s = pair[1] - pair[0];
            StrideTruth {
                t_start_s: pair[0],
                t_end_s: pair[1],
                mean_fx_n: sums[0] / length_s,
                drag_energy_j: sums[0] * velocity_m_s,
                electrical_energy_j: sums[6],
                specific_resistance: sums[6] / length_s / weight_w,
            }
        });
        Truth {
            t_enter_s: enter_s,
            t_exit_s: exit_s,
            velocity_m_s,
            mean_wrench,
            drag_energy_j: mean_wrench[0] * channel_m,
            electrical_energy_j: sums[6],
            mean_power_w: sums[6] / length_s,
            specific_resistance: sums[6] / length_s / weight_w,
            strides: strides.collect(),
            turns_s,
            constants: CONSTANTS,
            settings: self.settings,
        }
    }

    fn integrate(&self, from_s: f64, to_s: f64) -> [f64; 7] {
        let at = |row: usize, time_s: f64| -> [f64; 7] {
            let wrench = self.wrench_at(time_s);
            let power_w = self.drive.power_w(&self.gait, row, time_s);
            std::array::from_fn(|i| if i < 6 { wrench[i] } else { power_w })
        };
        let mut sums = [0.0; 7];
        let first = self.times_s.partition_point(|&time_s| time_s <= from_s).saturating_sub(1);
        for row in first..self.times_s.len() {
            let start_s = self.times_s[row].max(from_s);
            let end_s = self.times_s.get(row + 1).map_or(to_s, |&next_s| next_s.min(to_s));
            if start_s >= to_s {
                break;
            }
            let sixth = (end_s - start_s) / 6.0;
            let (a, b) = (at(row, start_s), at(row, end_s));
            let middle = at(row, 0.5 * (start_s + end_s));
            for (i, sum) in sums.iter_mut().enumerate() {
                *sum += sixth * (a[i] + 4.0 * middle[i] + b[i]);
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::super::{ChannelForces, Counter};
    use super::*;

    fn trial(change: impl FnOnce(&mut TrialSettings)) -> VirtualTrial {
        let mut settings = TrialSettings::new(ChannelForces::named("3 cm").unwrap(), 7);
        change(&mut settings);
        VirtualTrial::new(settings).unwrap()
    }

    #[test]
    fn truth_is_near_the_papers_values_for_the_condition() {
        let truth = trial(|_| ()).truth();
        // Scatter of the speed 3 %, of the sway 15 %, of the usual power some percent.
        assert!((truth.mean_wrench[0] / -0.13 - 1.0).abs() < 0.2);
        assert!(
            (truth.specific_resistance / 49.5 - 1.0).abs() < 0.15,
            "{}",
            truth.specific_resistance
        );
        let ratio =
            truth.electrical_energy_j / (truth.mean_power_w * (truth.t_exit_s - truth.t_enter_s));
        assert!((ratio - 1.0).abs() < 1e-12);
    }

    #[test]
    fn energies_of_adjoining_strides_add_up() {
        let trial = trial(|settings| settings.stall = true);
        let strides = trial.truth().strides;
        let (first, last) = (&strides[0], &strides[strides.len() - 1]);
        let whole = trial.integrate(first.t_start_s, last.t_end_s);
        let electrical_j: f64 = strides.iter().map(|stride| stride.electrical_energy_j).sum();
        // The integrals are cut at different times, with different errors of Simpson's rule.
        assert!((electrical_j / whole[6] - 1.0).abs() < 1e-7);
        let impulse: f64 = strides.iter().map(|s| s.mean_fx_n * (s.t_end_s - s.t_start_s)).sum();
        // Each corner of the stall, a jump of 250 N/s² in the second derivative, adds 1 ms³ times this jump.
        assert!((impulse / whole[0] - 1.0).abs() < 1e-7);
    }

    #[test]
    fn turns_are_where_the_count_without_noise_wraps() {
        for (counter, reversed) in
            [(Counter::Turn, false), (Counter::Turn, true), (Counter::LongWrapping, true)]
        {
            let trial = trial(|settings| {
                (settings.counter, settings.reversed) = (counter, reversed);
                (settings.encoder_noise, settings.noise_scale) = (0.0, 0.0);
            });
            let rows: Vec<_> = trial.rows().collect();
            let turn_of = |row: &super::super::TelemetryRow| row[1].div_euclid(1 << 16);
            let within = |row: &super::super::TelemetryRow| row[1].rem_euclid(1 << 16);
            // A fast leg moves 900 counts between rows; only a wrap moves it by half a turn.
            let wraps: Vec<_> = rows
                .windows(2)
                .filter(|pair| (within(&pair[1]) - within(&pair[0])).abs() > 1 << 15)
                .map(|pair| (pair[0][0], pair[1][0]))
                .collect();
            let turns_s = trial.turns_s();
            assert_eq!(wraps.len(), turns_s.len(), "{counter:?} {reversed}");
            for ((before_us, after_us), turn_s) in wraps.into_iter().zip(turns_s) {
                // A step of the encoder is 5 µs at 13 turns per second.
                let turn_us = 1e6 * turn_s;
                assert!(before_us as f64 - 6.0 < turn_us && turn_us < after_us as f64 + 6.0);
            }
            assert_eq!(
                turn_of(&rows[0]) == turn_of(&rows[rows.len() - 1]),
                counter == Counter::Turn
            );
        }
    }
}
