//! A forward model of the sensors' physics, fitted sensor by sensor and inverted for the wrench.
//!
//! A reflective photointerrupter responds monotonically to one displacement, which is linear in the wrench. Its ten
//! parameters, `y = lo + h·σ(b + aᵀx)^ν` ([`response`]), are fitted from the wrench to the reading, because the noise
//! is in the readings. Conversion inverts all sensors at once ([`Inversion`]).
//!
//! ```text
//! rows → one mean per pose → sensors (priors, noise) → shared factors → model
//!                            └── λ, prior width and number of factors by held-out poses ──┘
//! ```
//!
//! Polynomials in the readings need a coefficient per power and axis and are inaccurate between poses. This model has
//! 80 numbers for eight sensors, each with a physical meaning, and flattens where the sensors saturate.
//!
//! Not modelled: play and creep as states (they are part of the noise and the factors), and temperature.

#![forbid(unsafe_code)]

mod calibration;
mod choice;
pub mod cholesky;
mod damping;
mod expectation;
mod factors;
mod fit;
mod inversion;
mod lanes;
mod model;
mod noise;
pub mod response;
mod rows;
mod sensor;
pub mod uncertain_loads;

pub use self::calibration::{GroupErrors, PhysicsCalibration, PhysicsValidation};
pub use self::choice::{Choice, FactorTrial};
pub use self::fit::wrench_scale;
pub use self::fit::{MOST_CHANNELS, Observation};
pub use self::inversion::{Estimate, Estimates, Flags, Inversion};
pub use self::model::{PhysicsModel, Sensor};
pub use self::noise::Noise;
pub use self::response::{FACTORS, Loadings};
pub use self::rows::ObservationSample;
pub use self::rows::TrainingRows;
pub use least_squares::error::PhysicsError;
pub use least_squares::held_out_errors::COVERAGE_LEVEL;
pub use least_squares::uncertainty::{GroupIntervals, TooFewGroups};
