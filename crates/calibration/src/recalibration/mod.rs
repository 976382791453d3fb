//! Recalibration of a sensor that was mounted again or has aged, from a few new loads.
//!
//! Only the effects of mounting and age are fitted: a zero and a gain for each channel, a lever offset and a turn
//! ([`Change`]). Each has a normal prior with mean zero. The prior widths, down to zero, maximise the probability of
//! the observations with all changes integrated out (Laplace's approximation; MacKay, Neural Computation 4, 415,
//! 1992): a sensor that reads as before is left unchanged.
//!
//! A polynomial predicts the wrench, with the errors on held-out loads. A physics model predicts
//! the readings, which outnumber the axes, with the variances of the model.

mod change;
mod search;

pub use self::change::{Change, ChannelChange};
use self::search::{ChangeSearch, FoundChange};
use crate::conversion::{Calibration, Kind};
use least_squares::validation::cross_validation::HeldOutQuality;
use sensor_physics::Observation;
use shell_data::wrench::{Axis, PerAxis};

/// Quantity that may have changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChangedQuantity {
    /// Reading of each channel without a load.
    Zero,
    /// Sensitivity of each channel.
    Gain,
    /// Position of the sensor.
    Lever,
    /// Orientation of the sensor.
    Turn,
}

impl ChangedQuantity {
    pub const ALL: [Self; 4] = [Self::Zero, Self::Gain, Self::Lever, Self::Turn];

    pub const fn name(self) -> &'static str {
        match self {
            Self::Zero => "zeros",
            Self::Gain => "gains",
            Self::Lever => "lever",
            Self::Turn => "turn",
        }
    }
}

/// RMS difference after all changes, in stated errors, above which changes of these kinds do not explain the loads.
const CONTRADICTION: f64 = 2.0;

/// Standard deviations of the widest priors: a zero as a share of the calibrated range of the
/// channel, a relative gain, a lever in m, a turn in rad.
const ZERO: f64 = 0.08;
const GAIN: f64 = 0.16;
const LEVER_M: f64 = 8e-3;
const TURN_RAD: f64 = 0.12;

/// A change of this many standard deviations comes from a wrong load: 0.48 rad, 32 mm, a gain of 64 %, a third of a
/// channel's range. One in 16,000 sensors would change so much.
const IMPOSSIBLE: f64 = 4.0;

/// Fewest loads that tell what has changed: three determine the gains of six axes at best, and a fourth is needed to
/// hold some out.
const FEWEST_LOADS: usize = 4;

/// Candidate prior widths, as shares of the widest: factors of two suffice, as scatter is known to some 30 % at best.
const SHARES: [f64; 6] = [0.0, 0.0625, 0.125, 0.25, 0.5, 1.0];

/// Share from which the search starts, and maximum number of passes through all four quantities.
const FIRST_SHARE: f64 = 0.25;
const SWEEPS: usize = 4;

/// Least log evidence for a change: odds of e⁶, or 400 to 1, because errors at a few loads are not white noise.
const LEAST_LN_EVIDENCE: f64 = 6.0;

/// A few loads on a calibrated sensor.
#[derive(Clone, Copy, Debug)]
pub struct NewLoads<'a> {
    /// Mean wrench and readings.
    pub observations: &'a [Observation],
    /// Standard errors of the wrench of each observation, N and N·m.
    pub reference_errors: &'a [PerAxis<f64>],
    /// Errors of a polynomial calibration on held-out loads, N and N·m.
    pub calibration_errors: PerAxis<f64>,
}

#[derive(Clone, Debug)]
pub struct Recalibration {
    /// Calibration of the sensor in its present state; the old one if nothing has changed.
    pub calibration: Calibration,
    /// Quantities that have changed, in the order of [`ChangedQuantity::ALL`].
    pub quantities: Vec<ChangedQuantity>,
    pub change: Change,
    /// Standard errors of the change; zero for unchanged quantities.
    pub standard_errors: Change,
    /// Log evidence: how much more probable the observations are than without a change.
    pub ln_evidence: f64,
    /// Root mean square of the differences before and after the change, in stated errors.
    pub disagreement: [f64; 2],
    /// Root mean square errors of the old calibration on the new loads, N and N·m.
    pub before: PerAxis<f64>,
    pub after: PerAxis<f64>,
    /// Errors on groups held out from the fit of the change; `None` for a single group.
    pub held_out: Option<PerAxis<HeldOutQuality>>,
}

impl Recalibration {
    /// Returns true if the loads do not support the change: no change of these kinds explains them, or the changed
    /// calibration predicts held-out loads worse than the old one does, by the mean over the axes.
    pub fn is_contradicted(&self) -> bool {
        self.disagreement[1] > CONTRADICTION || self.is_worse_held_out()
    }

    pub fn is_worse_held_out(&self) -> bool {
        let Some(held_out) = self.held_out.filter(|_| !self.quantities.is_empty()) else {
            return false;
        };
        let ratios = self.calibration.axes.iter().map(Axis::index).map(|axis| {
            let ratio = held_out[axis].rms / self.before[axis];
            if ratio.is_finite() { ratio * ratio } else { 1.0 }
        });
        ratios.clone().sum::<f64>() > ratios.count() as f64
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RecalibrationError {
    #[error("no loads")]
    NoLoads,
    #[error("the calibration is for `{expected}` channels, the loads have `{found}`")]
    Channels {
        /// Channels of the calibration.
        expected: usize,
        found: usize,
    },
    #[error("nothing is known of the errors of the calibration")]
    NoErrors,
    #[error("a reading or wrench is not a finite number")]
    NotFinite,
    #[error(
        "`{0}` different loads are too few to tell what has changed: hang at least {FEWEST_LOADS}"
    )]
    FewLoads(usize),
    #[error("the loads ask for {} that no mounting and no age make", .change.map_or("errors as large as the loads", ChangedQuantity::name))]
    Impossible {
        /// Quantity that would have changed too much; `None` if errors are as large as the loads.
        change: Option<ChangedQuantity>,
        /// Group of the load that is furthest from the calibration.
        group: u64,
    },
}

impl Calibration {
    /// Calibrates the sensor in its present state.
    ///
    /// # Errors
    /// [`RecalibrationError`] if the loads do not belong to this sensor.
    ///
    /// # Panics
    /// If the numbers of reference errors and observations differ.
    pub fn recalibrated(&self, loads: &NewLoads<'_>) -> Result<Recalibration, RecalibrationError> {
        let observations = loads.observations;
        assert_eq!(observations.len(), loads.reference_errors.len(), "errors of every observation");
        let first = observations.first().ok_or(RecalibrationError::NoLoads)?;
        let (expected, found) = (self.channels(), first.readings.len());
        if expected != found {
            return Err(RecalibrationError::Channels { expected, found });
        }
        let is_finite = |o: &Observation| o.wrench.iter().chain(&o.readings).all(|x| x.is_finite());
        if !observations.iter().all(is_finite) {
            return Err(RecalibrationError::NotFinite);
        }
        // Ratio of the variances of held-out errors to those of the physics model.
        let held_out_variance = match &self.kind {
            Kind::Polynomial(_) => {
                if !self.axes.of(&loads.calibration_errors).into_iter().all(|error| error > 0.0) {
                    return Err(RecalibrationError::NoErrors);
                }
                1.0
            }
            Kind::Physics(of) => {
                of.error_scale.iter().map(|scale| scale * scale).sum::<f64>() / 6.0
            }
        };
        // Held-out errors decide if anything has changed. Variances of readings, which show more, then decide what.
        let cautious = ChangeSearch::new(self, loads, held_out_variance);
        let found = cautious.find(true);
        let outcome = match found.ln_evidence > LEAST_LN_EVIDENCE {
            true => ChangeSearch::new(self, loads, 1.0).find(true),
            false => cautious.find(false),
        };
        let furthest = cautious.furthest();
        let FoundChange { shares, change, standard_errors, ln_evidence, disagreement, .. } =
            outcome;
        let impossible = |change| RecalibrationError::Impossible { change, group: furthest };
        // Loads that no change explains are reported as a contradiction instead.
        let is_explained = disagreement[1] <= CONTRADICTION;
        if let Some(quantity) = outcome.impossible.filter(|_| is_explained) {
            return Err(impossible(Some(quantity)));
        }
        let is_changed = |of: &ChangedQuantity| shares[*of as usize] > 0.0;
        let quantities: Vec<_> = ChangedQuantity::ALL.into_iter().filter(is_changed).collect();
        let count = different_loads(observations);
        if !quantities.is_empty() && count < FEWEST_LOADS {
            return Err(RecalibrationError::FewLoads(count));
        }
        let calibration = if quantities.is_empty() { self.clone() } else { change.apply(self) };
        let held_out = (outcome.held_out.len() > 1).then(|| {
            let errors: Vec<_> = (outcome.held_out.iter())
                .flat_map(|(group, change)| {
                    let out = observations.iter().filter(|o| o.group == *group);
                    errors(&change.apply(self), &out.collect::<Vec<_>>())
                })
                .collect();
            let (rms, count) = (rms(&errors), errors.len() as f64);
            let bias = |axis: usize| errors.iter().map(|of| of[axis]).sum::<f64>() / count;
            std::array::from_fn(|axis| HeldOutQuality { rms: rms[axis], bias: bias(axis) })
        });
        let all: Vec<&Observation> = observations.iter().collect();
        if let Some(held_out) = held_out.filter(|_| is_explained && !quantities.is_empty()) {
            let loads = rms(&observations.iter().map(|o| o.wrench).collect::<Vec<_>>());
            let sizes = |of: PerAxis<f64>| {
                let size = |moment: bool| {
                    let axes = self.axes.iter().filter(|axis| axis.is_moment() == moment);
                    axes.map(|axis| of[axis.index()].powi(2)).sum::<f64>()
                };
                [size(false), size(true)]
            };
            let errors: PerAxis<f64> = held_out.map(|axis: HeldOutQuality| axis.rms);
            let mut pairs = sizes(errors).into_iter().zip(sizes(loads));
            // NaN counts as large.
            let is_small = |(error, load): (f64, f64)| load == 0.0 || error < load;
            if !pairs.all(is_small) {
                return Err(impossible(None));
            }
        }
        Ok(Recalibration {
            before: rms(&errors(self, &all)),
            after: rms(&errors(&calibration, &all)),
            held_out,
            disagreement,
            ln_evidence,
            change,
            standard_errors,
            calibration,
            quantities,
        })
    }
}

/// Number of different wrenches other than zero.
fn different_loads(observations: &[Observation]) -> usize {
    let mut loads: Vec<&PerAxis<f64>> = observations.iter().map(|o| &o.wrench).collect();
    loads.retain(|wrench| wrench.iter().any(|value| *value != 0.0));
    loads.sort_by(|a, b| a.partial_cmp(b).expect("finite numbers"));
    loads.dedup();
    loads.len()
}

fn errors(calibration: &Calibration, some: &[&Observation]) -> Vec<PerAxis<f64>> {
    let column = |channel| some.iter().map(|o| o.readings[channel]).collect();
    let readings: Vec<Vec<f64>> = (0..calibration.channels()).map(column).collect();
    let mut wrench = PerAxis::default();
    calibration.wrench(&readings, &mut wrench);
    let error = |(row, o): (usize, &&Observation)| {
        std::array::from_fn(|axis| wrench[axis][row] - o.wrench[axis])
    };
    some.iter().enumerate().map(error).collect()
}

fn rms(errors: &[PerAxis<f64>]) -> PerAxis<f64> {
    let square = |axis: usize| errors.iter().map(|of| of[axis].powi(2)).sum::<f64>();
    std::array::from_fn(|axis| (square(axis) / errors.len() as f64).sqrt())
}
