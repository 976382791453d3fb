//! Least-squares problems whose exact answers are known, put to every method.
//!
//! See `README.md` for where the problems come from and how the answers are had.

mod exact;
mod families;
mod problem;
mod random;
mod report;
mod strd;
