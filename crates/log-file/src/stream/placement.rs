//! Where a new thread begins.
//!
//! Schedulers may begin it on the core of the thread that made it, and leave both there for milliseconds while
//! another core idles: they take a virtual machine's idle core for one that is not there (Linux,
//! `available_idle_cpu`). A short command is over by then. So a new thread leaves that core once; where it works
//! after that is the scheduler's business.

/// The core of the thread that makes others.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Origin(#[cfg(target_os = "linux")] usize);

#[cfg(target_os = "linux")]
impl Origin {
    /// That of the calling thread.
    pub(crate) fn here() -> Self {
        Self(rustix::thread::sched_getcpu())
    }

    /// Moves the calling thread, which is new, to any other core that it may use.
    pub(crate) fn leave(self) {
        use rustix::thread::{sched_getaffinity, sched_setaffinity};
        // Where it is not allowed, things stay as they are.
        let Ok(allowed) = sched_getaffinity(None) else { return };
        let mut others = allowed;
        others.unset(self.0);
        if others.count() > 0 && sched_setaffinity(None, &others).is_ok() {
            let _ = sched_setaffinity(None, &allowed);
        }
    }

    /// Lets the threads that have just been made leave.
    pub(crate) fn let_leave(self) {
        std::thread::yield_now();
    }
}

#[cfg(not(target_os = "linux"))]
impl Origin {
    pub(crate) fn here() -> Self {
        Self()
    }

    pub(crate) fn leave(self) {}

    pub(crate) fn let_leave(self) {}
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use rustix::thread::sched_getaffinity;

    #[test]
    fn a_thread_may_use_all_cores_after_it_has_moved() {
        let of_process = sched_getaffinity(None).unwrap();
        let origin = Origin::here();
        let thread = std::thread::spawn(move || {
            origin.leave();
            sched_getaffinity(None).unwrap()
        });
        assert_eq!(thread.join().unwrap(), of_process);
    }
}
