//! Least-squares problems with known exact answers, solved by every method. See `README.md` for
//! their origin and the answers.

mod exact;
mod families;
mod problem;
mod random;
mod report;
mod strd;
