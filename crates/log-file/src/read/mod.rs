//! Reading: what is asked for, all rows in parallel, a selection of them, or a sample.

pub(crate) mod all;
pub(crate) mod sample;
pub(crate) mod selection;
