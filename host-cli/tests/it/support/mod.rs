//! What several groups of tests share.

pub(crate) mod alignment;
pub(crate) mod foreign;
pub(crate) mod rational;
pub(crate) mod recording;
