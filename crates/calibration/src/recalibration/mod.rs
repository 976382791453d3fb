//! A calibrated sensor that was mounted again or has aged: what has changed, found from a few new loads.
//!
//! The calibration is a prior: nothing of it is fitted again but what a mounting and age change, a zero and a gain
//! for each channel, a lever offset and a turn ([`Change`]). Each has a normal prior about nothing. How wide that is
//! for each of the four, down to no change at all, is what makes the new observations most probable, all changes
//! integrated out (Laplace's approximation; MacKay, Neural Computation 4, 415, 1992): a sensor that says what it said before
//! is left as it is.
//!
//! What is compared is what the calibration predicts: a polynomial the wrench, whose errors are those on held-out
//! loads; a physics model the readings, of which there are more than axes, with the variances that it has found.

mod change;
mod search;

pub use self::change::{Change, ChannelChange};
use self::search::{ChangeSearch, FoundChange};
use crate::conversion::{Calibration, Kind};
use least_squares::validation::cross_validation::HeldOutQuality;
use sensor_physics::Observation;
use shell_data::wrench::PerAxis;

/// What may have changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ChangedQuantity {
    /// What each channel reads without a load.
    Zero,
    /// How much each channel answers.
    Gain,
    /// Where the sensor is mounted.
    Lever,
    /// How it is turned.
    Turn,
}

impl ChangedQuantity {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Zero, Self::Gain, Self::Lever, Self::Turn];

    /// What people call it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Zero => "zeros",
            Self::Gain => "gains",
            Self::Lever => "lever",
            Self::Turn => "turn",
        }
    }
}

/// Differences larger than so many stated errors, after all changes, are no change of these kinds.
const CONTRADICTION: f64 = 2.0;

/// The widest priors, as standard deviations: of a zero as a share of the calibrated range of the channel, of a gain
/// relative, m, and rad.
const ZERO: f64 = 0.08;
const GAIN: f64 = 0.16;
const LEVER_M: f64 = 8e-3;
const TURN_RAD: f64 = 0.12;

/// A change of so many of these is none of a mounting or of age, but of a wrong load: 0.48 rad, 32 mm, a gain of 64 %,
/// a third of a channel's range. One in 16,000 sensors would change so much.
const IMPOSSIBLE: f64 = 4.0;

/// The shares of these that are tried. Of a handful of numbers their scatter is known to some 30 %, so halves do.
const SHARES: [f64; 6] = [0.0, 0.0625, 0.125, 0.25, 0.5, 1.0];

/// Where the search for shares begins, and how often it goes through all four.
const FIRST_SHARE: f64 = 0.25;
const SWEEPS: usize = 4;

/// A change is believed if the observations are this much more probable than without any: e⁶ is 400 to 1, because
/// errors of a calibration at a few loads are no white noise.
const LEAST_LN_EVIDENCE: f64 = 6.0;

/// A few loads on a calibrated sensor.
#[derive(Clone, Copy, Debug)]
pub struct NewLoads<'a> {
    /// Mean wrench and readings.
    pub observations: &'a [Observation],
    /// Standard errors of the wrench of each observation, N and N·m.
    pub reference_errors: &'a [PerAxis<f64>],
    /// Errors of the calibration on loads that it has not seen, N and N·m: what a polynomial's are.
    pub calibration_errors: PerAxis<f64>,
}

/// A calibration that has been brought up to date.
#[derive(Clone, Debug)]
pub struct Recalibration {
    /// That of the sensor as it is now; the old one, if nothing has changed.
    pub calibration: Calibration,
    /// What has changed, in the order of [`ChangedQuantity::ALL`].
    pub quantities: Vec<ChangedQuantity>,
    /// How much.
    pub change: Change,
    /// The standard errors of that; zero for what has not changed.
    pub standard_errors: Change,
    /// How much more probable the observations are than if nothing had changed, as a logarithm.
    pub ln_evidence: f64,
    /// Root mean square of the differences before and after the change, in stated errors.
    pub disagreement: [f64; 2],
    /// Root mean square errors of the old calibration on the new loads, N and N·m.
    pub before: PerAxis<f64>,
    /// Those of the new one.
    pub after: PerAxis<f64>,
    /// Errors on groups of observations that were held out while the change was found; `None` of a single group.
    pub held_out: Option<PerAxis<HeldOutQuality>>,
}

impl Recalibration {
    /// Whether the new loads contradict the calibration, whatever may have changed of zeros, gains and mounting.
    pub fn is_contradicted(&self) -> bool {
        self.disagreement[1] > CONTRADICTION
    }
}

/// Why a calibration cannot be brought up to date.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RecalibrationError {
    /// No loads.
    #[error("no loads")]
    NoLoads,
    /// Logs of another number of channels.
    #[error("the calibration is for `{expected}` channels, the loads have `{found}`")]
    Channels {
        /// Of the calibration.
        expected: usize,
        /// Of the logs.
        found: usize,
    },
    /// Neither a held-out error nor any other is known.
    #[error("nothing is known of the errors of the calibration")]
    NoErrors,
    /// A value that is not a number.
    #[error("a reading or wrench is not a finite number")]
    NotFinite,
    /// What the loads ask for is no change of a sensor, as where one of them is wrong.
    #[error("the loads ask for {} that no mounting and no age make", .change.map_or("errors as large as the loads", ChangedQuantity::name))]
    Impossible {
        /// What would have changed too much; `None` where errors are as large as the loads.
        change: Option<ChangedQuantity>,
        /// The group of the load that is furthest from the calibration.
        group: u64,
    },
}

impl Calibration {
    /// The calibration of the sensor as it is now.
    ///
    /// # Errors
    /// [`RecalibrationError`] if the loads are none of this sensor.
    ///
    /// # Panics
    /// If there are not as many reference errors as observations.
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
        // How many times those of a physics model the variances of held-out errors are.
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
        // Whether anything has changed is judged by errors as large as those on held-out loads; what, by the variances
        // of the readings themselves, of which a wrench hides some.
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
        // Loads that no change explains are told to contradict the calibration.
        let is_explained = disagreement[1] <= CONTRADICTION;
        if let Some(quantity) = outcome.impossible.filter(|_| is_explained) {
            return Err(impossible(Some(quantity)));
        }
        let is_changed = |of: &ChangedQuantity| shares[*of as usize] > 0.0;
        let quantities: Vec<_> = ChangedQuantity::ALL.into_iter().filter(is_changed).collect();
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
            // Not a number is as large as any.
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

/// Predicted less measured wrench of some observations.
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
