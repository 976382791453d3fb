//! Calibration from sensor readings to a wrench.
//!
//! `W ≈ X(s)·C`: `X` holds one [feature](model) per column, a product of up to three readings, and
//! `W` the six axes of the wrench. Alternatively, a model of each sensor's response to a wrench
//! ([physics]) is inverted.
//!
//! [`fit()`] takes rows, finds groups and a model, and reports how far the resulting [`Calibration`] can be trusted.
//! [`least_squares`] sums, solves and holds out rows; [`sensor_physics`] models a sensor's response. The crate reads no
//! files or clocks, and prints nothing.
//!
//! ```
//! use calibration::solver::{self, FitProblem, SolverKind};
//! use calibration::{Basis, Calibration, Model};
//! use shell_data::Block;
//!
//! // One channel that reads 100 counts per newton of Fx, and 2 of noise.
//! let readings = vec![vec![0.0, 102.0, 198.0, 300.0]];
//! let mut wrench = vec![vec![0.0; 4]; 6];
//! wrench[0] = vec![0.0, 1.0, 2.0, 3.0];
//! let block = Block { rows: 4, readings, wrench, ..Block::default() };
//!
//! let model = Model { basis: Basis::Linear, intercept: true, channels: 1, memory: 0 };
//! let problem = FitProblem { model, scaling: calibration::scaling::Scaling::identity(1), ridge: 0.0 };
//! let (solution, ranges) = solver::fit(SolverKind::Exact, problem, &(&block).into())?;
//! let calibration = Calibration::from_solution(&solution, &ranges);
//!
//! let mut converted = Default::default();
//! calibration.wrench(&[vec![150.0]], &mut converted);
//! assert!((converted[0][0] - 1.5).abs() < 0.01);
//! # Ok::<_, calibration::FitError>(())
//! ```

#![forbid(unsafe_code)]

mod conversion;
pub mod dynamics;
pub mod fit;
mod groups;
mod load_labels;
pub mod load_plan;
pub mod memory;
pub mod plausibility;
mod prediction;
pub mod recalibration;
mod stuck;
pub mod validation;

pub use self::conversion::{Calibration, Kind};
pub use self::fit::{Fit, FitOptions, fit};
pub use self::stuck::ReadingSpans;
pub use least_squares::error::FitError;
pub use least_squares::model::{Basis, Model};
pub use least_squares::polynomial::Polynomial;
pub use least_squares::{
    double_double, exact, factored, features, magnitudes, methods, model, quality, rank_loss,
    reading_ranges, scaling, solver, sums,
};
pub use sensor_physics as physics;

pub mod uncertainty {
    pub use crate::prediction::{HALF_WIDTH, Tare, Trust};
    pub use least_squares::uncertainty::*;
}
