//! Reading all rows of logs in parallel, or a sample.

pub(crate) mod all;
pub(crate) mod companion;
pub(crate) mod sample;
