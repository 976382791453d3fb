//! From readings to forces.

pub mod filter;
