//! Tests of boards: recording, live views, streams and `doctor`. Without `SHELLCAL_REAL_DATA` at
//! build time, tests on real recordings are ignored (`build.rs`).

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    unreachable_pub,
    reason = "a test may panic and say why, and report its figures"
)]

#[cfg(unix)]
mod board;
#[cfg(unix)]
mod board_line;
#[cfg(unix)]
mod board_port;
mod board_wrench;
mod doctor;
#[cfg(unix)]
mod doctor_port;
#[cfg(all(unix, feature = "live"))]
mod live;
#[cfg(all(unix, feature = "live"))]
mod live_serve;
#[cfg(unix)]
mod record_port;
mod record_replay;
#[cfg(unix)]
mod record_restart;
#[path = "../support/recording.rs"]
#[allow(dead_code, reason = "each test program uses a part of it")]
mod recording;
mod reference;
#[path = "../support/sealed.rs"]
#[allow(dead_code, reason = "each test program uses a part of it")]
mod sealed;
mod tcp_board;
