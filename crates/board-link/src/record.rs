//! Recording: bytes from a source into a log and a raw file.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::Source;
use super::record_error::RecordError;
use super::record_options::RecordOptions;
use super::recorder::{Due, Recorded, Recorder, Sinks};
use super::watcher::RecordingProgress;

/// Records until the source ends, the time is over or `stop` is set; `observe` is told about twice
/// a second how it goes.
///
/// Every frame that arrived is in the log when this returns, with an error as without.
///
/// # Errors
/// [`RecordError`].
pub fn record(
    source: &mut Source,
    sinks: Sinks,
    options: &RecordOptions,
    stop: &AtomicBool,
    observe: &mut dyn FnMut(&RecordingProgress),
) -> Result<Recorded, RecordError> {
    let mut recorder = Recorder::new(source.name(), sinks, options.clone());
    let ran = run(&mut recorder, source, options.duration, stop, observe);
    source.send(&recorder.last_commands());
    // Whatever has happened: what has arrived is kept.
    let finished = match ran {
        Ok(()) => recorder.finish(),
        Err(error) => Err(recorder.finish().err().filter(is_about_files).unwrap_or(error)),
    };
    let mut recorded = recorder.recorded(source.elapsed());
    recorded.reconnections = source.reconnections;
    let closed = recorder.close();
    finished?;
    closed?;
    Ok(recorded)
}

fn is_about_files(error: &RecordError) -> bool {
    matches!(error, RecordError::Output(_))
}

fn run(
    recorder: &mut Recorder,
    source: &mut Source,
    duration: Option<Duration>,
    stop: &AtomicBool,
    observe: &mut dyn FnMut(&RecordingProgress),
) -> Result<(), RecordError> {
    let mut buffer = vec![0; 1 << 14];
    let commands = recorder.commands(source.arrival());
    source.send(&commands);
    loop {
        let elapsed = source.elapsed();
        if stop.load(Ordering::Relaxed) || duration.is_some_and(|end| elapsed >= end) {
            return Ok(());
        }
        let Some(count) = source.read(&mut buffer)? else { return Ok(()) };
        let (now, arrival) = (source.elapsed(), source.arrival());
        recorder.take(&buffer[..count], now, arrival)?;
        if let Some(Due { mut progress, commands }) = recorder.tend(now, arrival)? {
            source.send(&commands);
            progress.connected = source.is_connected();
            observe(&progress);
        }
    }
}
