//! Trials: one, all of a manifest, and the statistics of a table.

pub(crate) mod batch;
mod evaluation;
mod outputs;
pub(crate) mod profile;
mod show;
pub(crate) mod stats;
pub(crate) mod trial;
mod watch;
