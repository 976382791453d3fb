//! The least-squares calibration from eight readings to a wrench.
//!
//! `W ≈ X(s)·C`: `X` holds one [feature](model) per column, products of up to three readings, `W`
//! the six axes of the wrench.

mod conversion;
mod error;
pub mod exact;
pub mod extent;
pub mod features;
pub mod least_squares;
pub mod magnitudes;
pub mod model;
pub mod physics;
pub mod quality;
pub mod rank_loss;
pub mod raw_units;
pub mod scaling;
pub mod solver;
pub mod triangle;
pub mod uncertainty;
pub mod validation;
mod vectors;
mod wide_features;

pub use self::conversion::Calibration;
pub use self::error::FitError;
pub use self::model::{Basis, Model};
