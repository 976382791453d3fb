//! Loads in the order in which they tell most.

use super::knowledge::{SensorAnswer, SensorKnowledge, Surface};
use shell_data::wrench::PerAxis;

/// Loads of the range over which variances are averaged, at most: more change no order.
const MOST_OF_RANGE: usize = 120;

/// What the next load is chosen by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Criterion {
    /// The gain of information.
    Gain,
    /// The variance of a wrench, averaged over the range of loads.
    AverageVariance,
}

/// What is known of the sensors.
#[derive(Clone, Debug)]
enum Knowledge {
    Surface(Surface),
    Sensors(Box<SensorKnowledge>),
}

/// Chooses loads one after the other.
pub struct Planner<'a> {
    candidates: &'a [PerAxis<f64>],
    left: Vec<usize>,
    range: Vec<PerAxis<f64>>,
    knowledge: Knowledge,
    criterion: Criterion,
}

/// A load that was chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedLoad {
    /// Its position among the candidates.
    pub candidate: usize,
    /// The gain of information, in nats.
    pub gain: f64,
    /// The error after it.
    pub error: PredictedError,
}

/// The error to expect, over the range of loads.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PredictedError {
    /// Of a wrench, root mean square, N and N·m.
    Wrench(PerAxis<f64>),
    /// Of the surface through the answers, in standard deviations of one pose: nothing was read yet.
    Relative(f64),
}

impl PredictedError {
    /// Whether every force is within `force_n`, and every moment within `moment_nm`, where these are given; no
    /// statement in N where nothing was read.
    pub fn is_within(&self, force_n: Option<f64>, moment_nm: Option<f64>) -> bool {
        let Self::Wrench(errors) = self else { return false };
        let within = |errors: &[f64], limit: Option<f64>| {
            limit.is_none_or(|limit| errors.iter().all(|&error| error <= limit))
        };
        within(&errors[..3], force_n) && within(&errors[3..], moment_nm)
    }
}

impl<'a> Planner<'a> {
    /// After `loads`; with a model of the sensors, which knows the loads that it was fitted to, or without.
    pub fn new(
        sensors: Option<SensorKnowledge>,
        criterion: Criterion,
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
        Self { candidates, left: (0..candidates.len()).collect(), range, knowledge, criterion }
    }

    /// The error to expect now.
    pub fn error(&self) -> PredictedError {
        match &self.knowledge {
            Knowledge::Surface(surface) => PredictedError::Relative(surface.error(&self.range)),
            Knowledge::Sensors(sensors) => {
                PredictedError::Wrench(sensors.errors(&self.answers(sensors)))
            }
        }
    }

    fn answers(&self, sensors: &SensorKnowledge) -> Vec<Vec<SensorAnswer>> {
        self.range.iter().map(|load| sensors.answers(load)).collect()
    }

    /// The gain of information by a load, in nats.
    fn gain(&self, load: &PerAxis<f64>) -> f64 {
        match &self.knowledge {
            Knowledge::Surface(surface) => surface.gain(load),
            Knowledge::Sensors(sensors) => sensors.gain(load),
        }
    }

    /// How much each load that is left is worth, the more the better.
    fn worths(&self) -> Vec<f64> {
        let loads = self.left.iter().map(|&position| &self.candidates[position]);
        match (self.criterion, &self.knowledge) {
            (Criterion::Gain, _) => loads.map(|load| self.gain(load)).collect(),
            (Criterion::AverageVariance, Knowledge::Surface(surface)) => {
                loads.map(|load| surface.variance_gain(load, &self.range)).collect()
            }
            (Criterion::AverageVariance, Knowledge::Sensors(sensors)) => {
                let range = self.answers(sensors);
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

    /// The load that is worth most of those that are left; the first of equals.
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
