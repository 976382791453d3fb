//! A forward model of the sensors' physics, fitted sensor by sensor and inverted for the wrench.
//!
//! A reflective photointerrupter answers one displacement, monotonically; the displacement is linear
//! in the wrench. So each sensor is ten parameters, `y = lo + h·σ(b + aᵀx)^ν` ([`response`]), fitted
//! from the wrench to the reading: the noise is in the readings, the reference is good. Conversion
//! inverts all sensors at once ([`Inversion`]).
//!
//! ```text
//! rows → one mean per pose → sensors (priors, noise) → shared factors → model
//!                            └── λ, prior width and number of factors by held-out poses ──┘
//! ```
//!
//! Polynomials in the readings need a coefficient per power and axis and go astray between poses;
//! this has 80 numbers for eight sensors, all with a meaning, and flattens where sensors saturate.
//!
//! Left out: play and creep as states (they are in the noise and in the factors), and temperature.

mod calibration;
mod choice;
pub(crate) mod cholesky;
mod expectation;
mod factors;
mod fit;
pub mod intervals;
mod inversion;
mod lanes;
mod model;
mod noise;
pub mod response;
mod rows;
mod sensor;
pub mod uncertain_loads;

pub use self::calibration::{COVERAGE_LEVEL, GroupErrors, PhysicsCalibration, PhysicsValidation};
pub use self::choice::{Choice, FactorTrial};
pub(crate) use self::fit::wrench_scale;
pub use self::fit::{MOST_CHANNELS, Observation};
pub use self::intervals::{GroupIntervals, TooFewGroups};
pub use self::inversion::{Estimate, Estimates, Flags, Inversion};
pub use self::model::{PhysicsModel, Sensor};
pub use self::noise::Noise;
pub use self::response::{FACTORS, Loadings};
pub(crate) use self::rows::ObservationSample;
pub use self::rows::TrainingRows;

/// Why a physics model cannot be fitted.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PhysicsError {
    /// Fewer observations than parameters of a sensor.
    #[error("`{found}` poses are too few for the `{needed}` parameters of a sensor")]
    TooFewObservations {
        /// Observations.
        found: usize,
        /// Parameters.
        needed: usize,
    },
    /// Fewer channels that vary than axes.
    #[error("`{0}` channels vary, at least `6` are needed for six axes")]
    TooFewChannels(usize),
    /// Too many channels, or none.
    #[error("expected `1` to `16` channels, found `{0}`")]
    Channels(usize),
    /// Nothing to hold out.
    #[error("at least `2` groups are needed to choose the priors, found `{0}`")]
    TooFewGroups(usize),
    /// An infinite value or one that is not a number.
    #[error("a reading or wrench is not a finite number")]
    NotFinite,
}
