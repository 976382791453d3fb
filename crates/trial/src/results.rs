//! What trials give: rows of tables, traces to draw, and what a reader of these should know about them.

use std::collections::BTreeMap;

use serde::Serialize;

use super::phase::PhaseProfile;
use super::statistics::{Interval, MeanDifference, Statistics};
use super::trace::Trace;
use super::uncertainty::ForceUncertainty;
use super::window::Proposal;
use shell_data::wrench::Axis;

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

impl TrialResult {
    /// The first diagnostic of each kind with the name of its trial, and how many more there are; notes first.
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

/// How much a diagnostic matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Severity {
    /// How the log was recorded.
    Note,
    /// The results may be worse than they look.
    Warning,
}

/// Something that a reader of a trial's results should know.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Diagnostic {
    /// How much it matters.
    pub severity: Severity,
    /// A short name for scripts, the same for all of a kind.
    pub code: &'static str,
    /// What it is, in words.
    pub text: String,
}

impl Diagnostic {
    /// How the log was recorded.
    pub(super) fn note(code: &'static str, text: impl Into<String>) -> Self {
        Self { severity: Severity::Note, code, text: text.into() }
    }

    /// What may make results worse than they look.
    pub fn warning(code: &'static str, text: impl Into<String>) -> Self {
        Self { severity: Severity::Warning, code, text: text.into() }
    }

    /// The window was found in the forces.
    pub fn found_window(found: &Proposal) -> Self {
        let text = format!(
            "the window was found in the drag: confidence {:.0} %, entry ± {:.3} s, exit ± {:.3} s",
            100.0 * found.confidence,
            found.t_enter_se_s,
            found.t_exit_se_s
        );
        let severity = if found.is_good() { Severity::Note } else { Severity::Warning };
        Self { severity, code: "found_window", text }
    }
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
    /// What it was like; its length is that of the channel.
    #[serde(flatten)]
    pub measures: RunMeasures,
    /// The 95 % interval of the drag energy, J.
    pub drag_energy_95_j: Option<Interval>,
    /// The 95 % interval of the mean drag, N.
    pub drag_mean_95_n: Option<Interval>,
    /// The 95 % interval of the mean lift, N.
    pub lift_mean_95_n: Option<Interval>,
    /// Whole strides in the window; `None` without a leg position.
    pub strides: Option<u64>,
    /// Strides in a second: whole strides over the time from the first one's start to the last one's
    /// end, Hz.
    pub stride_frequency_hz: Option<f64>,
    /// The length that the drag energy is over, m.
    #[serde(skip)]
    pub channel_length_m: f64,
    /// Whether most frames are outside the calibrated range.
    #[serde(skip)]
    pub is_beyond_range: bool,
    /// How sure its mean forces are.
    #[serde(skip)]
    pub uncertainty: Option<ForceUncertainty>,
}

impl TrialRow {
    /// What the calibration's error makes of a quantity, along directions that are alike in all trials, with its degrees
    /// of freedom. `None` if nothing is known of it; of what is no force it is nothing.
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
        Some((parts.collect(), of.degrees_of_freedom))
    }
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
    /// What it was like; its length is v̄·T.
    #[serde(flatten)]
    pub measures: RunMeasures,
}

/// The measures of a trial or a stride.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct RunMeasures {
    /// Mean drag, −Fx, N.
    pub drag_mean_n: Option<f64>,
    /// Mean lift, Fz, N.
    pub lift_mean_n: Option<f64>,
    /// mean(Fx) times the length, J: negative where energy is lost to drag.
    pub drag_energy_j: Option<f64>,
    /// ∫ (P_left + P_right) dt, J.
    pub electrical_energy_j: Option<f64>,
    /// Mean electrical power P̄ of both motors, W.
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

    /// That of a trial or a stride.
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
