//! Work without the interpreter's lock, which Ctrl-C ends.

use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

use pyo3::prelude::*;

use crate::error::Failure;

/// How often signals are looked for.
const EVERY: Duration = Duration::from_millis(50);

/// Runs `work` on a thread of its own while this one looks for signals; where there is one, `work` is told
/// to stop and the signal's exception is returned.
pub(crate) fn without_lock<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&AtomicBool) -> Result<T, Failure> + Send,
) -> Result<T, Failure> {
    let stop = AtomicBool::new(false);
    let mut signal = None;
    let result = py.detach(|| {
        std::thread::scope(|scope| {
            let (done, is_done) = sync_channel::<()>(1);
            let stop = &stop;
            let worker = scope.spawn(move || {
                let result = work(stop);
                // Nobody waits where a signal came first.
                let _ = done.try_send(());
                result
            });
            while let Err(RecvTimeoutError::Timeout) = is_done.recv_timeout(EVERY) {
                if signal.is_none()
                    && let Err(error) = Python::attach(|py| py.check_signals())
                {
                    signal = Some(error);
                    stop.store(true, Ordering::Relaxed);
                }
            }
            // PyO3 makes an exception of a panic, on the thread of the caller.
            worker.join().unwrap_or_else(|panic| resume_unwind(panic))
        })
    });
    match signal {
        Some(signal) => Err(Failure::Python(signal)),
        None => result,
    }
}
