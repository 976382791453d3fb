//! The calibration from sensor readings to a wrench.
//!
//! `W ≈ X(s)·C`: `X` holds one [feature](model) per column, products of up to three readings, `W`
//! the six axes of the wrench. Or the other way round: a model of what each sensor answers to a wrench
//! ([physics]), inverted.
//!
//! A [solver] reduces [blocks](shell_data::Block) of rows to a [`solver::Solution`]: by [exact] sums of
//! integer readings, or by a [least-squares method](least_squares) on the features. A
//! [`Calibration`] applies it to readings; [uncertainty] and [validation] say how far it can be
//! trusted. Everything here is pure: no files, no clocks, no printing.
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
#![warn(missing_docs)]

mod conversion;
pub mod double_double;
pub mod dynamics;
mod error;
pub mod exact;
pub mod factored;
pub mod features;
pub mod fit;
mod grouped_rows;
mod groups;
mod holds;
pub mod least_squares;
pub mod load_plan;
pub mod magnitudes;
pub mod memory;
pub mod model;
pub mod passes;
pub mod physics;
pub mod plausibility;
pub mod polynomial;
pub mod quality;
pub mod r_factor;
pub mod rank_loss;
pub mod reading_ranges;
pub mod recalibration;
pub mod sandwich;
pub mod scaling;
mod solution;
pub mod solver;
mod symmetric;
pub mod uncertainty;
pub mod validation;
mod vectors;

pub use self::conversion::{Calibration, Kind};
pub use self::error::FitError;
pub use self::fit::{Fit, FitOptions, fit};
pub use self::model::{Basis, Model};
pub use self::polynomial::Polynomial;
