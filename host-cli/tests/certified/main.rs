//! Least-squares problems whose exact answers are known, put to every method.
//!
//! See `README.md` for where the problems come from and how the answers are had.

#![expect(clippy::print_stdout, reason = "figures to look at when a test fails")]
#![expect(clippy::unwrap_used, reason = "a test may panic and say why")]

mod exact;
mod families;
mod problem;
mod random;
mod report;
mod strd;
