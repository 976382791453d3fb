//! A live view in Foxglove: every row, as it comes.

use std::thread;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use foxglove_view::FoxgloveServer;
use live_view::LiveRow;
use shell_data::wrench::Axes;

use super::session::{LiveSession, PERIOD, Until};

/// Where Foxglove looks unless it is told otherwise.
pub(super) const LOOPBACK: &str = "127.0.0.1:8765";

/// Sends what comes until a signal or the end of the source ends it.
pub(super) fn run(
    session: &mut LiveSession,
    mut server: FoxgloveServer,
    axes: Axes,
    until: &Until<'_>,
) -> anyhow::Result<()> {
    let mut clock = None;
    let mut due = Instant::now();
    while session.advance(until)? {
        for row in &session.news {
            let start_s = *clock.get_or_insert_with(|| now_s() - row.time_s);
            let time_ns = ((start_s + row.time_s) * 1e9) as u64;
            let wrench = row.wrench.filter(|_| axes.are_all());
            server.publish(time_ns, wrench, &details(row, axes));
        }
        due = (due + PERIOD).max(Instant::now());
        thread::sleep(due.saturating_duration_since(Instant::now()));
    }
    server.stop();
    Ok(())
}

/// Readings, and the forces that make no whole wrench.
fn details(row: &LiveRow, axes: Axes) -> Vec<(&'static str, f64)> {
    const READINGS: [&str; 8] = ["s1", "s2", "s3", "s4", "s5", "s6", "s7", "s8"];
    let readings = row.readings.iter().flatten().copied();
    let readings = READINGS.into_iter().zip(readings);
    let some = row.wrench.filter(|_| !axes.are_all()).into_iter();
    let forces = some.flat_map(|wrench| axes.iter().map(move |axis| (axis, wrench[axis.index()])));
    readings.chain(forces.map(|(axis, value)| (axis.column(), value))).collect()
}

/// s since 1970, to a microsecond.
fn now_s() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default().as_secs_f64()
}
