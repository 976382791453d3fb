//! The results of trials: table rows, traces, and diagnostics.

use std::collections::BTreeMap;

use serde::Serialize;

use super::diagnostic::{Diagnostic, Severity};
use super::phase::PhaseProfile;
use super::statistics::{Interval, MeanDifference, Statistics};
use super::trace::Trace;
use super::uncertainty::ForceUncertainty;
use shell_data::wrench::Axis;

/// Values that the log or the calibration does not allow are `None`, with the reason in
/// [`TrialResult::diagnostics`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrialResult {
    #[serde(flatten)]
    pub row: TrialRow,
    pub stride_rows: Vec<StrideRow>,
    #[serde(rename = "remarks")]
    pub diagnostics: Vec<Diagnostic>,
    /// Signals over the window or over the whole log, if requested.
    #[serde(skip)]
    pub trace: Option<Trace>,
    /// Computed from the trace.
    #[serde(skip)]
    pub phase: Option<PhaseProfile>,
}

impl TrialResult {
    /// First diagnostic of each kind with its trial, and the number of further ones; notes first.
    pub fn diagnostics_of_each_kind<'a>(
        trials: impl IntoIterator<Item = (&'a str, &'a Self)>,
    ) -> impl Iterator<Item = (Severity, String)> {
        let mut kinds: BTreeMap<(Severity, &str), (String, usize)> = BTreeMap::new();
        for (name, result) in trials {
            for Diagnostic { severity, code, text } in &result.diagnostics {
                let first = || (format!("{name}: {text}"), 0);
                kinds.entry((*severity, code)).or_insert_with(first).1 += 1;
            }
        }
        kinds.into_iter().map(|((severity, _), (first, count))| match count {
            1 => (severity, first),
            2 => (severity, first + " (also in another trial)"),
            _ => (severity, format!("{first} (also in {} other trials)", count - 1)),
        })
    }
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrialRow {
    pub file: String,
    pub condition: String,
    pub t_enter_s: f64,
    pub t_exit_s: f64,
    pub duration_s: f64,
    /// Mean velocity v̄, m/s.
    pub velocity_m_s: f64,
    pub rows: u64,
    /// `None` without sensors.
    pub fresh_frames: Option<u64>,
    #[serde(flatten)]
    pub measures: RunMeasures,
    pub drag_energy_95_j: Option<Interval>,
    pub drag_mean_95_n: Option<Interval>,
    pub lift_mean_95_n: Option<Interval>,
    pub strides: Option<u64>,
    /// Number of whole strides, divided by the time from the first start to the last end.
    pub stride_frequency_hz: Option<f64>,
    #[serde(skip)]
    pub channel_length_m: f64,
    #[serde(skip)]
    pub has_unknown_error: bool,
    #[serde(skip)]
    pub uncertainty: Option<ForceUncertainty>,
}

impl TrialRow {
    /// Error due to the calibration, as components along directions common to all trials, with its
    /// degrees of freedom. `None` if unknown; zero for quantities that do not depend on forces.
    pub fn shared_error(&self, quantity: Quantity) -> Option<(Vec<f64>, f64)> {
        let (axis, factor) = match quantity {
            Quantity::Drag => (Axis::Fx, -1.0),
            Quantity::Lift => (Axis::Fz, 1.0),
            Quantity::DragEnergy => (Axis::Fx, self.channel_length_m),
            Quantity::ElectricalEnergy | Quantity::SpecificResistance => {
                return Some((Vec::new(), f64::INFINITY));
            }
        };
        let of = self.uncertainty.as_ref()?;
        let parts = of.shared[axis.index()].iter().map(|part| factor * part);
        Some((parts.collect(), of.degrees_of_freedom[axis.index()]))
    }
}

/// One stride: a turn of the right leg from phase 0 to phase 2π.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StrideRow {
    pub stride: u64,
    pub t_start_s: f64,
    pub t_end_s: f64,
    pub period_s: f64,
    pub rows: u64,
    #[serde(flatten)]
    pub measures: RunMeasures,
}

#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RunMeasures {
    /// Mean drag, −Fx, N.
    pub drag_mean_n: Option<f64>,
    /// Mean lift, Fz, N.
    pub lift_mean_n: Option<f64>,
    /// mean(Fx) times the length, J: negative if energy is lost to drag.
    pub drag_energy_j: Option<f64>,
    /// ∫ (P_left + P_right) dt, J.
    pub electrical_energy_j: Option<f64>,
    /// Mean electrical power P̄ of both motors, W.
    pub mean_power_w: Option<f64>,
    /// P̄/(m·g·v̄), with the trial's v̄.
    pub specific_resistance: Option<f64>,
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ConditionRow {
    pub condition: String,
    pub per: Per,
    pub quantity: Quantity,
    #[serde(flatten)]
    pub statistics: Statistics,
    /// Difference of the mean from that of the named reference condition, if this is another condition.
    pub difference: Option<MeanDifference>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Per {
    Trial,
    Stride,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    Drag,
    Lift,
    DragEnergy,
    ElectricalEnergy,
    SpecificResistance,
}

impl Per {
    pub const ALL: [Self; 2] = [Self::Trial, Self::Stride];

    pub const fn name(self) -> &'static str {
        match self {
            Self::Trial => "trial",
            Self::Stride => "stride",
        }
    }
}

impl Quantity {
    pub const ALL: [Self; 5] = [
        Self::Drag,
        Self::Lift,
        Self::DragEnergy,
        Self::ElectricalEnergy,
        Self::SpecificResistance,
    ];

    /// The quantities by which conditions are compared, the most important first.
    pub const COMPARED: [Self; 3] =
        [Self::DragEnergy, Self::ElectricalEnergy, Self::SpecificResistance];

    const fn texts(self) -> [&'static str; 3] {
        match self {
            Self::Drag => ["drag", "drag_mean_n", "N"],
            Self::Lift => ["lift", "lift_mean_n", "N"],
            Self::DragEnergy => ["drag energy", "drag_energy_j", "J"],
            Self::ElectricalEnergy => ["electrical energy", "electrical_energy_j", "J"],
            Self::SpecificResistance => ["specific resistance", "specific_resistance", ""],
        }
    }

    pub const fn name(self) -> &'static str {
        self.texts()[0]
    }

    /// The name of its column, with the SI unit.
    pub const fn column(self) -> &'static str {
        self.texts()[1]
    }

    pub const fn unit(self) -> &'static str {
        self.texts()[2]
    }

    pub fn of(self, measures: &RunMeasures) -> Option<f64> {
        match self {
            Self::Drag => measures.drag_mean_n,
            Self::Lift => measures.lift_mean_n,
            Self::DragEnergy => measures.drag_energy_j,
            Self::ElectricalEnergy => measures.electrical_energy_j,
            Self::SpecificResistance => measures.specific_resistance,
        }
    }
}
