//! What trials give: rows of tables, and traces to draw.

use serde::Serialize;

use super::diagnostic::Diagnostic;
use super::phase::PhaseProfile;
use super::statistics::{Interval, MeanDifference, Statistics};
use super::trace::Trace;

/// The results of one trial. What the log or the calibration does not allow is `None`, and
/// [`TrialResult::diagnostics`] say why.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrialResult {
    /// The row of the per-trial table.
    #[serde(flatten)]
    pub row: TrialRow,
    /// One row for each whole stride in the window, in order.
    pub stride_rows: Vec<StrideRow>,
    /// What to know about these results.
    #[serde(rename = "remarks")]
    pub diagnostics: Vec<Diagnostic>,
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
    pub difference: Option<MeanDifference>,
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

    /// What conditions are compared by, the first first.
    pub const COMPARED: [Self; 3] =
        [Self::DragEnergy, Self::ElectricalEnergy, Self::SpecificResistance];

    /// What people call it, the name of its column, and its unit.
    const fn texts(self) -> [&'static str; 3] {
        match self {
            Self::Drag => ["drag", "drag_mean_n", "N"],
            Self::Lift => ["lift", "lift_mean_n", "N"],
            Self::DragEnergy => ["drag energy", "drag_energy_j", "J"],
            Self::ElectricalEnergy => ["electrical energy", "electrical_energy_j", "J"],
            Self::SpecificResistance => ["specific resistance", "specific_resistance", ""],
        }
    }

    /// What people call it.
    pub const fn name(self) -> &'static str {
        self.texts()[0]
    }

    /// The name of its column, with the SI unit.
    pub const fn column(self) -> &'static str {
        self.texts()[1]
    }

    /// The SI unit as people read it; empty without one.
    pub const fn unit(self) -> &'static str {
        self.texts()[2]
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
