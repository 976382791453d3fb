//! Synthetic data from physics: the sensor, the robot, the board and the radio link.
//!
//! [`channel_study`] sweeps and varies the channel of beams. [`sensor_model`] makes readings of a shell under load, [`virtual_robot`] trials of a robot in a
//! channel of beams; [`synthetic_log`] writes them as logs or hands them over in memory.
//! [`simulated_board`] runs the firmware's library over the sensor model on a pseudo-terminal
//! or over TCP, behind a [`radio`] that loses and damages packets.

/// Settings that are not those of an instrument, a recording, a trial, a load or a radio: what was asked for, and what
/// can be simulated. Or a line that the system does not give to a board.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct SimulationError(String);

/// Returns what cannot be simulated as a [`SimulationError`], unless a condition holds.
macro_rules! ensure {
    ($holds:expr, $($text:tt)+) => {
        let holds: bool = $holds;
        if !holds {
            return Err(SimulationError(format!($($text)+)));
        }
    };
}

pub mod channel_study;
pub mod radio;
pub mod sensor_model;
#[allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    reason = "a board on a pty or a port, in real time"
)]
pub mod simulated_board;
pub mod synthetic_log;
pub mod virtual_robot;
