//! Data types that all crates of this workspace share.
//!
//! SI units throughout (s, N, N·m). Frame: x forward, y left, z up.
//!
//! ```
//! use shell_data::{Axis, Block};
//!
//! let block = Block {
//!     rows: 3,
//!     readings: vec![vec![1986.0, 1986.0, 1990.0]],
//!     ..Block::default()
//! };
//! // The second row repeats the first: telemetry runs faster than its sensor.
//! assert_eq!(block.fresh_rows(), [true, false, true]);
//! assert_eq!(Axis::Mz.column(), "mz_nm");
//! ```

#![forbid(unsafe_code)]

pub mod block;
pub mod by_axis;
pub mod columns;
pub mod converter;
pub mod dataset;
pub mod escape;
pub mod fingerprint;
pub mod hint;
pub mod instructions;
pub mod lock;
pub mod random;
pub mod statistics;
pub mod telemetry;
pub mod unit;
pub mod wrench;

pub use block::{Block, RowLines};
pub use columns::{ColumnNames, TimeUnit};
pub use converter::Converter;
pub use dataset::{Dataset, ReadSummary};
pub use telemetry::Telemetry;
pub use unit::{Quantity, Scale, Unit};
pub use wrench::{Axes, Axis, AxisValues, MomentUnit, PerAxis};
