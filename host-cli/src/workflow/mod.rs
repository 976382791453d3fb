//! Whole jobs, from a log to a result: reading, calculating and writing put together, in memory that
//! does not grow with the log. Nothing here prints or names a file format.

pub mod convert;
pub mod noise;
pub mod sampling;
pub mod selection;
