//! Work without the interpreter's lock, which Ctrl-C ends and whose progress is told.

use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

use pyo3::prelude::*;

use crate::error::PythonFailure;

/// How often signals are looked for.
const EVERY: Duration = Duration::from_millis(50);

/// What work and its caller tell each other.
#[derive(Default)]
pub(crate) struct Watch {
    stop: AtomicBool,
    done: AtomicU64,
}

impl Watch {
    /// Whether the caller wants no more of it.
    pub(crate) fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Notes that so much more is done.
    pub(crate) fn note(&self, more: u64) {
        self.done.fetch_add(more, Ordering::Relaxed);
    }
}

/// Runs `work` on a thread of its own while this one looks for signals and tells `progress`, if there is
/// one, how much is done. A signal's exception, or that of `progress`, tells `work` to stop and is returned.
pub(crate) fn without_lock<T: Send>(
    py: Python<'_>,
    progress: Option<&Py<PyAny>>,
    work: impl FnOnce(&Watch) -> Result<T, PythonFailure> + Send,
) -> Result<T, PythonFailure> {
    let watch = Watch::default();
    let mut raised = None;
    let tell = |py: Python<'_>| {
        if let Some(progress) = progress {
            progress.call1(py, (watch.done.load(Ordering::Relaxed),))?;
        }
        py.check_signals()
    };
    let result = py.detach(|| {
        std::thread::scope(|scope| {
            let (done, is_done) = sync_channel::<()>(1);
            let watch = &watch;
            let worker = scope.spawn(move || {
                let result = work(watch);
                // Nobody waits where a signal came first.
                let _ = done.try_send(());
                result
            });
            while let Err(RecvTimeoutError::Timeout) = is_done.recv_timeout(EVERY) {
                if raised.is_none()
                    && let Err(error) = Python::attach(tell)
                {
                    raised = Some(error);
                    watch.stop.store(true, Ordering::Relaxed);
                }
            }
            // PyO3 makes an exception of a panic, on the thread of the caller.
            worker.join().unwrap_or_else(|panic| resume_unwind(panic))
        })
    });
    raised.map_or(result, |error| Err(PythonFailure(error)))
}
