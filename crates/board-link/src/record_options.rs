//! How a recording is made.

use std::time::Duration;

use shared_proto::Protocol;

use super::Uplink;
use crate::recording::LiveForces;

/// How a recording is made.
#[derive(Clone, Debug, Default)]
pub struct RecordOptions {
    /// The protocol, if it is not to be recognised.
    pub protocol: Option<Protocol>,
    /// For forces beside the readings.
    pub forces: Option<LiveForces>,
    /// When to end.
    pub duration: Option<Duration>,
    /// Tells the board to start streaming, again as before if it restarts, and to stop at the end.
    pub start: Option<Uplink>,
    /// Channels are not brought to one time.
    pub as_sampled: bool,
    /// Stretches are labelled while they are recorded ([`RecordCommand::Label`](super::RecordCommand::Label)): there is a
    /// column for the labels, and rows of the first board wait until they are
    /// [settled](super::RecordCommand::Settled), so that a stretch may have begun when it is found.
    pub labels: bool,
}
