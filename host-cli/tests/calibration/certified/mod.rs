//! Least-squares problems with known exact answers (`README.md`), solved by every method.

mod exact;
mod families;
mod problem;
mod random;
mod report;
mod strd;
