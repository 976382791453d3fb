//! The tests across crates, one module per subject. A test that needs more than the program is
//! ignored, and names its requirement; `cargo xtask test` sets that up and runs the test.

#![allow(
    clippy::unwrap_used,
    unreachable_pub,
    reason = "a test may panic and say why; modules of a test have no outside"
)]

#[cfg(unix)]
mod base_station;
mod beam_reference;
#[cfg(unix)]
mod bridge;
#[cfg(unix)]
mod flashed_image;
#[cfg(unix)]
mod live_page;
mod lossy_radio;
#[cfg(unix)]
mod netft;
mod original_board;
mod page_rules;
mod published_results;
mod report;
#[cfg(unix)]
mod simulated_board;
#[cfg(unix)]
mod sitting;
#[cfg(unix)]
mod stream;
#[cfg(unix)]
mod two_boards;
mod web_page;
