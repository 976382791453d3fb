//! Work without the interpreter's lock, with interruption by Ctrl-C and progress reports.

use std::panic::resume_unwind;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{RecvTimeoutError, sync_channel};
use std::time::Duration;

use pyo3::prelude::*;

use crate::error::PythonFailure;

const EVERY: Duration = Duration::from_millis(50);

#[derive(Default)]
pub(crate) struct Watch {
    stop: AtomicBool,
    done: AtomicU64,
}

impl Watch {
    pub(crate) fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    pub(crate) fn note(&self, more: u64) {
        self.done.fetch_add(more, Ordering::Relaxed);
    }
}

/// Runs `work` on another thread, while this one checks for signals and reports to `progress`. An
/// exception from a signal or from `progress` stops the work and is returned.
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
                // After a signal, the receiver is gone.
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
            // PyO3 converts a panic to an exception, on the thread of the caller.
            worker.join().unwrap_or_else(|panic| resume_unwind(panic))
        })
    });
    raised.map_or(result, |error| Err(PythonFailure(error)))
}
