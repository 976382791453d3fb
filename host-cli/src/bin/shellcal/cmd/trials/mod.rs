//! Trials: one, all of a manifest, and the statistics of a table.

pub(crate) mod batch;
pub(crate) mod evaluation;
pub(crate) mod plot;
pub(crate) mod report;
mod show;
pub(crate) mod stats;
pub(crate) mod trial;
mod window;
