//! Choice of loads by their information, from smooth responses or a physics model.

use sensor_physics::cholesky::{Cholesky, diagonal};
use sensor_physics::response::{Parameters, Response};
use sensor_physics::{PhysicsCalibration, PhysicsModel, Sensor};
use shell_data::wrench::PerAxis;

/// Number of terms: 1, w (6) and w·w (21).
const TERMS: usize = 28;
/// Prior variances of first- and second-order terms, in variances of one pose, for loads divided by the largest of each
/// axis. Ten times larger values hardly change the order.
const FIRST_ORDER: f64 = 1e4;
const SECOND_ORDER: f64 = 25.0;
/// Level of an interval of one standard error, for normal errors.
const ONE_SIGMA: f64 = 0.683;

/// `C·x`.
fn times<const N: usize>(c: &[[f64; N]; N], x: &[f64; N]) -> [f64; N] {
    std::array::from_fn(|i| dot(&c[i], x))
}

/// `xᵀCx`, at least 0.
fn variance<const N: usize>(c: &[[f64; N]; N], x: &[f64; N]) -> f64 {
    dot(&times(c, x), x).max(0.0)
}

/// Replaces the covariance `C` of `p` by the covariance after an observation of `xᵀp` with this
/// variance: `C − Cx(Cx)ᵀ/(noise + xᵀCx)` (Golub & Van Loan, 4th ed., §2.1.4).
pub(super) fn observe<const N: usize>(c: &mut [[f64; N]; N], x: &[f64; N], noise: f64) {
    let cx = times(c, x);
    let divisor = noise + dot(&cx, x).max(0.0);
    for (row, &left) in c.iter_mut().zip(&cx) {
        let share = left / divisor;
        row.iter_mut().zip(&cx).for_each(|(value, right)| *value -= share * right);
    }
}

fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    a.iter().zip(b).fold(0.0, |sum, (a, b)| a.mul_add(*b, sum))
}

/// Second-order surfaces in the wrench as prior knowledge of the responses: 28 terms, 1, w and w·w. Loads that
/// determine these well determine other smooth responses, too. The prior makes first-order terms come first until
/// there are more loads than terms.
#[derive(Clone, Debug, PartialEq)]
pub struct Surface {
    pub(super) covariance: Box<[[f64; TERMS]; TERMS]>,
    largest: PerAxis<f64>,
}

impl Surface {
    /// Creates a surface after `loads`; `candidates` may be hung later. N and N·m.
    pub fn new(loads: &[PerAxis<f64>], candidates: &[PerAxis<f64>]) -> Self {
        let of = |axis: usize| {
            let sizes = loads.iter().chain(candidates).map(|load| load[axis].abs());
            Some(sizes.fold(0.0, f64::max)).filter(|&most| most > 0.0).unwrap_or(1.0)
        };
        let mut prior = [SECOND_ORDER; TERMS];
        prior[..7].fill(FIRST_ORDER);
        let largest = std::array::from_fn(of);
        let mut surface = Self { covariance: Box::new(diagonal(prior)), largest };
        loads.iter().for_each(|load| surface.observe(load));
        surface
    }

    fn terms(&self, load: &PerAxis<f64>) -> [f64; TERMS] {
        let w: PerAxis<f64> = std::array::from_fn(|axis| load[axis] / self.largest[axis]);
        let mut terms = [1.0; TERMS];
        terms[1..7].copy_from_slice(&w);
        let products = (0..6).flat_map(|i| (i..6).map(move |j| w[i] * w[j]));
        terms[7..].iter_mut().zip(products).for_each(|(term, product)| *term = product);
        terms
    }

    fn observe(&mut self, load: &PerAxis<f64>) {
        let terms = self.terms(load);
        observe(&mut self.covariance, &terms, 1.0);
    }

    fn gain(&self, load: &PerAxis<f64>) -> f64 {
        variance(&self.covariance, &self.terms(load)).ln_1p()
    }

    /// Root of the mean variance of a response over some loads, in standard deviations of one pose.
    fn error(&self, range: &[PerAxis<f64>]) -> f64 {
        let variances = range.iter().map(|load| variance(&self.covariance, &self.terms(load)));
        (variances.sum::<f64>() / range.len().max(1) as f64).sqrt()
    }

    /// Reduction of the mean variance of a response over `range` by a load.
    fn variance_gain(&self, load: &PerAxis<f64>, range: &[PerAxis<f64>]) -> f64 {
        let of_load = self.terms(load);
        let known = times(&self.covariance, &of_load);
        let divisor = 1.0 + dot(&known, &of_load).max(0.0);
        let squares = range.iter().map(|at| dot(&known, &self.terms(at)).powi(2));
        squares.sum::<f64>() / (divisor * range.len().max(1) as f64)
    }
}

/// Physics model with covariances that include further loads, whose readings are not yet known.
#[derive(Clone, Debug, PartialEq)]
pub struct SensorKnowledge {
    model: PhysicsModel,
    inflation: PerAxis<f64>,
}

struct SensorResponse {
    gradient: Parameters,
    /// Derivatives with respect to the wrench, in the model's scales.
    slopes: PerAxis<f64>,
    noise: f64,
}

impl SensorKnowledge {
    /// Takes a model with standard errors scaled to the errors on held-out groups.
    pub fn from_calibration(calibration: &PhysicsCalibration) -> Self {
        let factors = calibration.intervals.as_ref().and_then(|of| of.factors(ONE_SIGMA).ok());
        Self { model: calibration.model().clone(), inflation: factors.unwrap_or([1.0; 6]) }
    }

    /// Takes a model with its own standard errors.
    pub fn from_model(model: &PhysicsModel) -> Self {
        Self { model: model.clone(), inflation: [1.0; 6] }
    }

    fn responses(&self, load: &PerAxis<f64>) -> Vec<SensorResponse> {
        let PhysicsModel { sensors, noise, wrench_scale, .. } = &self.model;
        let x: PerAxis<f64> = std::array::from_fn(|axis| load[axis] / wrench_scale[axis]);
        let of = |Sensor { parameters, .. }: &Sensor| {
            let response = Response::at(parameters, &x);
            SensorResponse {
                gradient: response.gradient(&x),
                slopes: std::array::from_fn(|axis| response.slope * parameters[1 + axis]),
                noise: noise.variance(response.slope),
            }
        };
        sensors.iter().map(of).collect()
    }

    fn observe(&mut self, load: &PerAxis<f64>) {
        for (response, sensor) in self.responses(load).iter().zip(&mut self.model.sensors) {
            observe(&mut sensor.covariance, &response.gradient, response.noise);
        }
    }

    /// `Σᵢ ln(1 + jᵢᵀCᵢjᵢ/vᵢ)`.
    fn gain(&self, load: &PerAxis<f64>) -> f64 {
        let pairs = self.model.sensors.iter().zip(self.responses(load));
        let gain = |(sensor, SensorResponse { gradient, noise, .. }): (&Sensor, SensorResponse)| {
            (variance(&sensor.covariance, &gradient) / noise).ln_1p()
        };
        pairs.map(gain).sum()
    }

    /// Mean variances of a wrench over some loads with these responses, in the model's scales.
    fn mean_variances(&self, range: &[Vec<SensorResponse>]) -> PerAxis<f64> {
        let PhysicsModel { sensors, load_precision, lambda, .. } = &self.model;
        let mut sums = [0.0; 6];
        for responses in range {
            let mut information = load_precision.map(|row| row.map(|x| lambda * x));
            for (response, sensor) in responses.iter().zip(sensors) {
                let own = variance(&sensor.covariance, &response.gradient);
                let weight = (response.noise + own).recip();
                for (row, slope) in information.iter_mut().zip(response.slopes) {
                    let share = weight * slope;
                    let pairs = row.iter_mut().zip(response.slopes);
                    pairs.for_each(|(sum, other)| *sum += share * other);
                }
            }
            // The prior makes the matrix positive definite. If rounding spoils this, the load adds nothing to the sum.
            if let Some(factor) = Cholesky::new(&information) {
                let variances = factor.inverse();
                sums.iter_mut().enumerate().for_each(|(axis, sum)| *sum += variances[axis][axis]);
            }
        }
        sums.map(|sum| sum / range.len().max(1) as f64)
    }

    fn errors(&self, range: &[Vec<SensorResponse>]) -> PerAxis<f64> {
        let (variances, scale) = (self.mean_variances(range), &self.model.wrench_scale);
        std::array::from_fn(|axis| variances[axis].sqrt() * scale[axis] * self.inflation[axis])
    }
}

/// Most loads over which variances are averaged: more would not change any order.
const MOST_OF_RANGE: usize = 120;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// The given order, which should be random.
    Random,
    /// D-optimal on 1, w and w·w, by the gain of information without readings.
    DOptimal,
    /// By the gain of information with the current model, if there is one.
    Gain,
    /// By the variance of a wrench, averaged over the range of loads.
    AverageVariance,
}

impl Order {
    pub const ALL: [Self; 4] = [Self::Random, Self::DOptimal, Self::Gain, Self::AverageVariance];

    pub fn name(self) -> &'static str {
        match self {
            Self::Random => "random order",
            Self::DOptimal => "D-optimal",
            Self::Gain => "information gain",
            Self::AverageVariance => "average variance (ALC)",
        }
    }
}

#[derive(Clone, Debug)]
enum Knowledge {
    Surface(Surface),
    Sensors(Box<SensorKnowledge>),
}

pub struct Planner<'a> {
    candidates: &'a [PerAxis<f64>],
    left: Vec<usize>,
    range: Vec<PerAxis<f64>>,
    knowledge: Knowledge,
    order: Order,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedLoad {
    pub candidate: usize,
    /// Gain of information, in nats.
    pub gain: f64,
    /// Predicted error after this load.
    pub error: PredictedError,
}

/// Predicted error over the range of loads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PredictedError {
    Wrench(PerAxis<f64>),
    /// Relative to the standard deviation of one pose, because nothing was read yet.
    Relative(f64),
}

impl PredictedError {
    /// Returns true if forces and moments are within the given limits. False without readings, because errors in N are
    /// then unknown.
    pub fn is_within(&self, force_n: Option<f64>, moment_nm: Option<f64>) -> bool {
        let Self::Wrench(errors) = self else { return false };
        let within = |errors: &[f64], limit: Option<f64>| {
            limit.is_none_or(|limit| errors.iter().all(|&error| error <= limit))
        };
        within(&errors[..3], force_n) && within(&errors[3..], moment_nm)
    }
}

impl<'a> Planner<'a> {
    /// Creates a planner after `loads`, which a model of the sensors already includes.
    pub fn new(
        sensors: Option<SensorKnowledge>,
        order: Order,
        loads: &[PerAxis<f64>],
        candidates: &'a [PerAxis<f64>],
    ) -> Self {
        let knowledge = match sensors {
            Some(sensors) => Knowledge::Sensors(Box::new(sensors)),
            None => Knowledge::Surface(Surface::new(loads, candidates)),
        };
        let all: Vec<PerAxis<f64>> = loads.iter().chain(candidates).copied().collect();
        let every = all.len().div_ceil(MOST_OF_RANGE).max(1);
        let range = all.into_iter().step_by(every).collect();
        Self { candidates, left: (0..candidates.len()).collect(), range, knowledge, order }
    }

    pub fn error(&self) -> PredictedError {
        match &self.knowledge {
            Knowledge::Surface(surface) => PredictedError::Relative(surface.error(&self.range)),
            Knowledge::Sensors(sensors) => {
                PredictedError::Wrench(sensors.errors(&self.responses(sensors)))
            }
        }
    }

    fn responses(&self, sensors: &SensorKnowledge) -> Vec<Vec<SensorResponse>> {
        self.range.iter().map(|load| sensors.responses(load)).collect()
    }

    fn gain(&self, load: &PerAxis<f64>) -> f64 {
        match &self.knowledge {
            Knowledge::Surface(surface) => surface.gain(load),
            Knowledge::Sensors(sensors) => sensors.gain(load),
        }
    }

    fn worths(&self) -> Vec<f64> {
        let loads = self.left.iter().map(|&position| &self.candidates[position]);
        match (self.order, &self.knowledge) {
            (Order::Random, _) => vec![0.0; self.left.len()],
            (Order::Gain | Order::DOptimal, _) => loads.map(|load| self.gain(load)).collect(),
            (Order::AverageVariance, Knowledge::Surface(surface)) => {
                loads.map(|load| surface.variance_gain(load, &self.range)).collect()
            }
            (Order::AverageVariance, Knowledge::Sensors(sensors)) => {
                let range = self.responses(sensors);
                let after = |load| {
                    let mut after = sensors.clone();
                    after.observe(load);
                    -after.mean_variances(&range).iter().sum::<f64>()
                };
                loads.map(after).collect()
            }
        }
    }
}

impl Iterator for Planner<'_> {
    type Item = PlannedLoad;

    /// Takes the most valuable of the remaining loads; the first if several are equal.
    fn next(&mut self) -> Option<PlannedLoad> {
        let worths = self.worths();
        let best =
            (1..worths.len()).fold(0, |best, at| if worths[at] > worths[best] { at } else { best });
        if self.left.is_empty() {
            return None;
        }
        let candidate = self.left.remove(best);
        let load = &self.candidates[candidate];
        let gain = self.gain(load);
        match &mut self.knowledge {
            Knowledge::Surface(surface) => surface.observe(load),
            Knowledge::Sensors(sensors) => sensors.observe(load),
        }
        Some(PlannedLoad { candidate, gain, error: self.error() })
    }
}
