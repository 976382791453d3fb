//! What several groups of tests share.

pub(crate) mod alignment;
#[cfg(unix)]
pub(crate) mod board;
pub(crate) mod foreign;
pub(crate) mod rational;
pub(crate) mod recording;
pub(crate) mod sealed;
