//! Least-squares problems whose exact answers are known, put to every method.
//!
//! See `README.md` for where the problems come from and how the answers are had.

#![expect(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a failed expectation is a failed test, and a test may report its figures"
)]

mod exact;
mod families;
mod problem;
mod random;
mod report;
mod strd;
