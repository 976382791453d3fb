//! The signals of a trial over time.

use super::integral::rows_within;
use shell_data::wrench::PerAxis;

/// Signals over time. Columns that the log does not allow are empty, others as long as `t_s`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    pub t_s: Vec<f64>,
    /// Wrench, tared and filtered, N and N·m.
    pub wrench: PerAxis<Vec<f64>>,
    /// True for each row with a new frame.
    pub fresh: Vec<bool>,
    pub right_leg_rad: Vec<f64>,
    pub left_leg_rad: Vec<f64>,
    pub right_power_w: Vec<f64>,
    pub left_power_w: Vec<f64>,
    /// Electrical power of both motors, if the log has only their sum, W.
    pub power_w: Vec<f64>,
    /// Start of each whole stride, and the end of the last, s.
    pub stride_times_s: Vec<f64>,
}

impl Trace {
    pub fn within(&self, from_s: f64, to_s: f64) -> Self {
        let rows: Vec<usize> = rows_within(&self.t_s, from_s, to_s).collect();
        self.with_rows(&rows)
    }

    /// The rows with a new frame, where each motor's power is the mean since the previous frame;
    /// without sensors, rows `period_s` apart.
    pub fn thinned(&self, period_s: f64) -> Self {
        let mut last_s = f64::NEG_INFINITY;
        let is_shown = |&row: &usize| {
            let shown = match self.fresh.get(row) {
                Some(&fresh) => fresh,
                None => self.t_s[row] - last_s >= period_s,
            };
            if shown {
                last_s = self.t_s[row];
            }
            shown
        };
        let rows: Vec<usize> = (0..self.t_s.len()).filter(is_shown).collect();
        let mut thinned = self.with_rows(&rows);
        for (mean, power) in [
            (&mut thinned.right_power_w, &self.right_power_w),
            (&mut thinned.left_power_w, &self.left_power_w),
            (&mut thinned.power_w, &self.power_w),
        ] {
            for (mean, pair) in mean.iter_mut().skip(1).zip(rows.windows(2)) {
                let since = &power[pair[0] + 1..=pair[1]];
                *mean = since.iter().sum::<f64>() / since.len() as f64;
            }
        }
        thinned
    }

    fn with_rows(&self, rows: &[usize]) -> Self {
        let pick = |column: &Vec<f64>| match column.is_empty() {
            true => Vec::new(),
            false => rows.iter().map(|&row| column[row]).collect(),
        };
        Self {
            t_s: pick(&self.t_s),
            wrench: self.wrench.each_ref().map(pick),
            fresh: rows.iter().filter_map(|&row| self.fresh.get(row).copied()).collect(),
            right_leg_rad: pick(&self.right_leg_rad),
            left_leg_rad: pick(&self.left_leg_rad),
            right_power_w: pick(&self.right_power_w),
            left_power_w: pick(&self.left_power_w),
            power_w: pick(&self.power_w),
            stride_times_s: self.stride_times_s.clone(),
        }
    }
}
