//! What trials give: rows of tables, and traces to draw.

use serde::Serialize;

use super::phase::PhaseProfile;
use super::remark::Remark;
use super::statistics::{Difference, Interval, Statistics};
use shell_data::wrench::PerAxis;

/// The results of one trial. What the log or the calibration does not allow is `None`, and
/// [`TrialResult::remarks`] say why.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrialResult {
    /// The row of the per-trial table.
    #[serde(flatten)]
    pub row: TrialRow,
    /// One row for each whole stride in the window, in order.
    pub stride_rows: Vec<StrideRow>,
    /// What to know about these results.
    pub remarks: Vec<Remark>,
    /// What happened over the window, or over the whole log, if asked for.
    #[serde(skip)]
    pub trace: Option<Trace>,
    /// Drag and lift over the phase of the leg, if that was made from the trace.
    #[serde(skip)]
    pub phase: Option<PhaseProfile>,
}

/// One trial.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrialRow {
    /// The log, as the manifest names it.
    pub file: String,
    /// The condition.
    pub condition: String,
    /// When the robot enters the channel, s on the log's clock.
    pub t_enter_s: f64,
    /// When it leaves, s.
    pub t_exit_s: f64,
    /// The time between, s.
    pub duration_s: f64,
    /// Mean velocity v̄, m/s.
    pub velocity_m_s: f64,
    /// Rows of the log in the window.
    pub rows: u64,
    /// Rows among them whose readings differ from those before; `None` without sensors.
    pub fresh_frames: Option<u64>,
    /// Mean drag, −Fx, N.
    pub drag_mean_n: Option<f64>,
    /// Mean lift, Fz, N.
    pub lift_mean_n: Option<f64>,
    /// mean(Fx)·l, J: negative where energy is lost to drag.
    pub drag_energy_j: Option<f64>,
    /// The 95 % interval of the drag energy, J.
    pub drag_energy_95_j: Option<Interval>,
    /// The 95 % interval of the mean drag, N.
    pub drag_mean_95_n: Option<Interval>,
    /// The 95 % interval of the mean lift, N.
    pub lift_mean_95_n: Option<Interval>,
    /// ∫ (P_left + P_right) dt, J.
    pub electrical_energy_j: Option<f64>,
    /// Mean electrical power P̄ of both motors, W.
    pub mean_power_w: Option<f64>,
    /// P̄/(m·g·v̄).
    pub specific_resistance: Option<f64>,
    /// Whole strides in the window; `None` without a leg position.
    pub strides: Option<u64>,
    /// Strides in a second: whole strides over the time from the first one's start to the last one's
    /// end, Hz.
    pub stride_frequency_hz: Option<f64>,
}

/// One stride: a turn of the right leg from phase 0 to phase 2π.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StrideRow {
    /// Its number in the trial, from 1.
    pub stride: u64,
    /// Start, s on the log's clock.
    pub t_start_s: f64,
    /// End, s.
    pub t_end_s: f64,
    /// The time T between, s.
    pub period_s: f64,
    /// Rows of the log in it.
    pub rows: u64,
    /// Mean drag, −Fx, N.
    pub drag_mean_n: Option<f64>,
    /// Mean lift, Fz, N.
    pub lift_mean_n: Option<f64>,
    /// mean(Fx)·v̄·T, J.
    pub drag_energy_j: Option<f64>,
    /// ∫ (P_left + P_right) dt, J.
    pub electrical_energy_j: Option<f64>,
    /// Mean electrical power of both motors, W.
    pub mean_power_w: Option<f64>,
    /// P̄/(m·g·v̄), with the trial's v̄.
    pub specific_resistance: Option<f64>,
}

/// What happened over time. Columns that the log does not allow are empty, the others as long as
/// `t_s`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Trace {
    /// Time of each row, s on the log's clock.
    pub t_s: Vec<f64>,
    /// Wrench, tared and filtered, N and N·m.
    pub wrench: PerAxis<Vec<f64>>,
    /// Whether the row brings a new frame.
    pub fresh: Vec<bool>,
    /// Angle of the right legs, unwrapped, rad.
    pub right_leg_rad: Vec<f64>,
    /// Angle of the left legs, unwrapped, rad.
    pub left_leg_rad: Vec<f64>,
    /// Electrical power of the right motor, W.
    pub right_power_w: Vec<f64>,
    /// Electrical power of the left motor, W.
    pub left_power_w: Vec<f64>,
    /// Start of each whole stride, and the end of the last, s.
    pub stride_times_s: Vec<f64>,
}

impl Trace {
    /// The rows from one time to another, s, both included.
    pub fn within(&self, from_s: f64, to_s: f64) -> Self {
        let rows =
            self.t_s.partition_point(|&t| t < from_s)..self.t_s.partition_point(|&t| t <= to_s);
        let rows: Vec<usize> = rows.collect();
        self.with_rows(&rows)
    }

    /// The rows that bring a new frame, with the power of each motor as its mean since the one before:
    /// what there is to see of it. Without sensors rows `period_s` apart.
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
            stride_times_s: self.stride_times_s.clone(),
        }
    }
}

/// Statistics of one quantity in one condition.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ConditionRow {
    /// The condition.
    pub condition: String,
    /// Of trials or of strides.
    pub per: Per,
    /// What of them.
    pub quantity: Quantity,
    /// The numbers, in the quantity's SI unit.
    #[serde(flatten)]
    pub statistics: Statistics,
    /// Its mean less that of the reference condition, if one was named and this is another.
    pub difference: Option<Difference>,
}

/// Of what statistics are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Per {
    /// One value a trial.
    Trial,
    /// One value a stride.
    Stride,
}

/// What trials and strides are compared by.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Mean drag, N.
    Drag,
    /// Mean lift, N.
    Lift,
    /// Drag energy, J.
    DragEnergy,
    /// Electrical energy, J.
    ElectricalEnergy,
    /// Specific resistance.
    SpecificResistance,
}

impl Per {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Trial, Self::Stride];

    /// `trial` or `stride`.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Trial => "trial",
            Self::Stride => "stride",
        }
    }
}

impl Quantity {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Drag,
        Self::Lift,
        Self::DragEnergy,
        Self::ElectricalEnergy,
        Self::SpecificResistance,
    ];

    /// What people call it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Drag => "drag",
            Self::Lift => "lift",
            Self::DragEnergy => "drag energy",
            Self::ElectricalEnergy => "electrical energy",
            Self::SpecificResistance => "specific resistance",
        }
    }

    /// The name of its column, with the SI unit.
    pub const fn column(self) -> &'static str {
        match self {
            Self::Drag => "drag_mean_n",
            Self::Lift => "lift_mean_n",
            Self::DragEnergy => "drag_energy_j",
            Self::ElectricalEnergy => "electrical_energy_j",
            Self::SpecificResistance => "specific_resistance",
        }
    }

    /// The SI unit as people read it; empty without one.
    pub const fn unit(self) -> &'static str {
        match self {
            Self::Drag | Self::Lift => "N",
            Self::DragEnergy | Self::ElectricalEnergy => "J",
            Self::SpecificResistance => "",
        }
    }

    /// That of a trial.
    pub fn of_trial(self, row: &TrialRow) -> Option<f64> {
        match self {
            Self::Drag => row.drag_mean_n,
            Self::Lift => row.lift_mean_n,
            Self::DragEnergy => row.drag_energy_j,
            Self::ElectricalEnergy => row.electrical_energy_j,
            Self::SpecificResistance => row.specific_resistance,
        }
    }

    /// That of a stride.
    pub fn of_stride(self, row: &StrideRow) -> Option<f64> {
        match self {
            Self::Drag => row.drag_mean_n,
            Self::Lift => row.lift_mean_n,
            Self::DragEnergy => row.drag_energy_j,
            Self::ElectricalEnergy => row.electrical_energy_j,
            Self::SpecificResistance => row.specific_resistance,
        }
    }
}
