//! Which load to hang next: designs of calibrations.
//!
//! A further pose tells the more, the less is known of what it would show. That does not depend on its readings, so it
//! is known before it is recorded:
//!
//! | criterion | of all loads that the rig can do, take the one |
//! |---|---|
//! | [`Criterion::Gain`] | with the greatest gain of information, `Σᵢ ln(1 + jᵢᵀCᵢjᵢ/vᵢ)` over the sensors; with no model of them, `ln(1 + φᵀCφ)` on the terms φ of [`Surface`]: the D-optimal design, one load at a time |
//! | [`Criterion::AverageVariance`] | after which the variance of a wrench is least on average over the range of loads (ALC) |
//!
//! `j` is the gradient of a sensor's answer by its parameters, `C` the covariance of these, `v` the variance of its
//! answer. After each load `C` is what it will be when that is recorded, by a rank-one change.
//!
//! Sources: Fedorov, Theory of Optimal Experiments, 1972, ch. 3 (exchange and sequential D-optimal designs);
//! DuMouchel & Jones, Technometrics 36, 37, 1994 (D-optimal with a prior on terms of higher order); MacKay, Neural
//! Computation 4, 590, 1992, and Cohn, Neural Networks 9, 1071, 1996 (information gain, and average variance: ALC).
//! Wind-tunnel balances are calibrated so: Parker et al., AIAA 2001-0170.

mod coupling;
mod covariance;
mod dataset_loads;
mod planner;
mod replay;
mod sensors;
mod surface;
#[cfg(test)]
mod tests;

pub use self::coupling::{Coupling, couplings};
pub use self::dataset_loads::loads_of_dataset;
pub use self::planner::{Criterion, PlannedLoad, Planner, PredictedError};
pub use self::replay::{Order, Replay, ReplayError, ReplayOptions};
pub use self::sensors::SensorKnowledge;
pub use self::surface::Surface;
