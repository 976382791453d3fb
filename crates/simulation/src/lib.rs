//! Synthetic data from physics: the sensor, the robot, the board and the radio link.
//!
//! [`channel_study`] varies the channel of beams. [`sensor_model`] simulates readings of a shell
//! under load, and [`virtual_robot`] trials of a robot; [`synthetic_log`] writes them as logs or
//! returns them in memory. [`simulated_board`] runs the firmware's library over the sensor model on
//! a pseudo-terminal or over TCP, behind a [`radio`] that loses and damages packets.

/// Invalid settings, or no line for a board. States the requested value and the supported range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct SimulationError(String);

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
