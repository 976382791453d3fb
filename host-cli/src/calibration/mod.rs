//! The least-squares calibration from eight readings to a wrench.
//!
//! `W ≈ X(s)·C`: `X` holds one [feature](model) per column, products of up to three readings, `W`
//! the six axes of the wrench.

pub mod exact;
pub mod model;
