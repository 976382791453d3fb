//! What a sensor carries: fitted to poses at rest, and taken off a run.

mod columns;
mod motion;
mod poses;

pub use columns::MotionColumns;
pub use motion::{find_motion_lag, read_motion};
pub use poses::{FittedPayload, GravityFrom, fit_payload};
