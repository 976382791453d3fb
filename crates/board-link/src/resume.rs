//! Restoration of a board's settings and stream after a reset, which loses both.

use std::time::Duration;

use shared_proto::{Command, Identity, Status};

use crate::Uplink;
use crate::recording::HeardBoard;

/// Duration of a silence after which a board is asked for its state.
const SILENCE: Duration = Duration::from_secs(1);

/// Returns the bytes to send now so that every board streams as at first; usually none.
pub(super) fn commands(uplink: &Uplink, heard: &mut [HeardBoard], now: Duration) -> Vec<u8> {
    let mut bytes = Vec::new();
    if heard.is_empty() {
        bytes.extend(to_all(uplink, &[Command::Start]));
    }
    for board in heard {
        let reception = &board.reception;
        let (identity, status) = (reception.identity, reception.status);
        match (&board.started, identity, status) {
            (None, Some(_), Some(status)) if status.streaming => board.started = Some(status),
            (None, ..) if reception.start.is_some() => {
                let commands = [Command::Identify, Command::Start, Command::Status];
                bytes.extend(to_all(uplink, &commands));
            }
            (None, ..) if !reception.has_begun() => {
                bytes.extend(to_all(uplink, &[Command::Start]));
            }
            (Some(wanted), Some(identity), status)
                if status.is_none_or(|status| !is_as(wanted, &status)) =>
            {
                bytes.extend(restart(uplink, &identity, wanted));
            }
            (Some(wanted), Some(identity), _) => {
                let patience = SILENCE + 3 * Duration::from_micros(wanted.period_us.into());
                let is_silent = board.heard_at.is_some_and(|at| now > at + patience);
                if is_silent {
                    bytes.extend(uplink.encode(0, Some(identity.id()), Command::Status));
                }
            }
            _ => {}
        }
    }
    bytes
}

fn to_all(uplink: &Uplink, commands: &[Command]) -> Vec<u8> {
    commands.iter().flat_map(|&command| uplink.encode(0, None, command)).collect()
}

fn is_as(wanted: &Status, status: &Status) -> bool {
    let settings = |it: &Status| (it.period_us, it.conversions, it.settling_us, it.stream);
    status.streaming && settings(status) == settings(wanted)
}

/// Returns the commands that restore settings and stream. A board accepts longer conversions only after a longer
/// period, and a shorter period only after shorter conversions. So the commands for conversions come before and after
/// the period.
fn restart(uplink: &Uplink, identity: &Identity, wanted: &Status) -> Vec<u8> {
    let Status { period_us, conversions, settling_us, stream, .. } = *wanted;
    let settling = Command::SetSettling { settling_us };
    let oversampling = Command::SetOversampling { conversions };
    let period = Command::SetPeriod { period_us };
    let settings = [settling, oversampling, period, settling, oversampling];
    let rest = [Command::SetStream(stream), Command::Start, Command::Status];
    let to = Some(identity.id());
    settings.into_iter().chain(rest).flat_map(|command| uplink.encode(0, to, command)).collect()
}
