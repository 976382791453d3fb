//! What is known of the sensors by a physics model: the parameters of each and their covariance.

use super::covariance::{CovarianceMatrix, dot};
use crate::physics::cholesky::Cholesky;
use crate::physics::response::{Answer, PARAMETERS, Parameters};
use crate::physics::{Noise, PhysicsCalibration, PhysicsModel, Sensor};
use shell_data::wrench::PerAxis;

/// The level of an interval of one standard error, of normal errors.
const ONE_SIGMA: f64 = 0.683;

/// A physics model whose covariances are those after some more loads, readings unknown.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorKnowledge {
    parameters: Vec<Parameters>,
    covariances: Vec<CovarianceMatrix<PARAMETERS>>,
    noise: Noise,
    scale: PerAxis<f64>,
    /// `λ·Σ_w⁻¹`.
    prior: PerAxis<PerAxis<f64>>,
    /// What standard errors are multiplied by.
    inflation: PerAxis<f64>,
}

/// What each sensor answers to a load.
pub(super) struct Answers(Vec<AnswerOf>);

struct AnswerOf {
    /// By the parameters.
    gradient: Parameters,
    /// By the wrench, in the model's scales.
    slopes: PerAxis<f64>,
    /// The variance of the answer when the parameters are known.
    noise: f64,
}

impl SensorKnowledge {
    /// What a calibration knows, with its standard errors multiplied by what made them those of errors on groups that
    /// were held out.
    pub fn from_calibration(calibration: &PhysicsCalibration) -> Self {
        let factors = calibration.intervals.as_ref().and_then(|of| of.factors(ONE_SIGMA).ok());
        let inflation = factors.unwrap_or([1.0; 6]);
        Self { inflation, ..Self::from_model(calibration.model()) }
    }

    /// What a model says.
    pub fn from_model(model: &PhysicsModel) -> Self {
        let covariance = |of: &Sensor| CovarianceMatrix(Box::new(of.covariance));
        Self {
            parameters: model.sensors.iter().map(|of| of.parameters).collect(),
            covariances: model.sensors.iter().map(covariance).collect(),
            noise: model.noise,
            scale: model.wrench_scale,
            prior: model.load_precision.map(|row| row.map(|x| model.lambda * x)),
            inflation: [1.0; 6],
        }
    }

    pub(super) fn answers(&self, load: &PerAxis<f64>) -> Answers {
        let x: PerAxis<f64> = std::array::from_fn(|axis| load[axis] / self.scale[axis]);
        let of = |parameters: &Parameters| {
            let answer = Answer::at(parameters, &x);
            AnswerOf {
                gradient: answer.gradient(&x),
                slopes: std::array::from_fn(|axis| answer.slope * parameters[1 + axis]),
                noise: self.noise.variance(answer.slope),
            }
        };
        Answers(self.parameters.iter().map(of).collect())
    }

    pub(super) fn observe(&mut self, load: &PerAxis<f64>) {
        let Answers(answers) = self.answers(load);
        for (covariance, answer) in self.covariances.iter_mut().zip(&answers) {
            covariance.observe(&answer.gradient, answer.noise);
        }
    }

    /// `Σᵢ ln(1 + jᵢᵀCᵢjᵢ/vᵢ)`.
    pub(super) fn gain(&self, Answers(answers): &Answers) -> f64 {
        let pairs = self.covariances.iter().zip(answers);
        pairs.map(|(of, answer)| (of.variance(&answer.gradient) / answer.noise).ln_1p()).sum()
    }

    /// The mean variances of a wrench over some loads, in the model's scales; with `next`, after that load, too.
    pub(super) fn mean_variances(&self, range: &[Answers], next: Option<&Answers>) -> PerAxis<f64> {
        let known: Option<Vec<(Parameters, f64)>> = next.map(|Answers(next)| {
            let of = |(of, answer): (&CovarianceMatrix<PARAMETERS>, &AnswerOf)| {
                let known = of.times(&answer.gradient);
                (known, answer.noise + dot(&known, &answer.gradient).max(0.0))
            };
            self.covariances.iter().zip(next).map(of).collect()
        });
        let mut sums = [0.0; 6];
        for Answers(answers) in range {
            let mut information = self.prior;
            let pairs = answers.iter().zip(&self.covariances);
            for (position, (answer, covariance)) in pairs.enumerate() {
                let mut unsure = covariance.variance(&answer.gradient);
                if let Some(known) = &known {
                    let (known, divisor) = &known[position];
                    unsure -= dot(known, &answer.gradient).powi(2) / divisor;
                }
                let weight = (answer.noise + unsure.max(0.0)).recip();
                for (row, slope) in information.iter_mut().zip(answer.slopes) {
                    let share = weight * slope;
                    let pairs = row.iter_mut().zip(answer.slopes);
                    pairs.for_each(|(sum, other)| *sum += share * other);
                }
            }
            // The prior makes it positive definite; a load where rounding does not is left out of the mean.
            if let Some(factor) = Cholesky::new(&information) {
                let variances = factor.inverse();
                sums.iter_mut().enumerate().for_each(|(axis, sum)| *sum += variances[axis][axis]);
            }
        }
        sums.map(|sum| sum / range.len().max(1) as f64)
    }

    /// Those variances as errors, N and N·m.
    pub(super) fn errors(&self, range: &[Answers]) -> PerAxis<f64> {
        let variances = self.mean_variances(range, None);
        std::array::from_fn(|axis| variances[axis].sqrt() * self.scale[axis] * self.inflation[axis])
    }
}
