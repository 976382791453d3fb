//! Reading: what is asked for, all rows in parallel, or a sample.

pub(crate) mod all;
pub(crate) mod sample;
