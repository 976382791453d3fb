//! Which core each thread works on.
//!
//! Schedulers may leave two busy threads on one core for milliseconds while another idles: they
//! take a virtual machine's idle core for one that is not there (Linux, `available_idle_cpu`), and
//! set it right on the next tick only. A short command is over by then. So where there is one
//! thread for every core, each is told its own.

#[cfg(target_os = "linux")]
pub(crate) use linux::Cores;
#[cfg(not(target_os = "linux"))]
pub(crate) use others::Cores;

#[cfg(target_os = "linux")]
mod linux {
    use rustix::thread::{CpuSet, sched_getaffinity, sched_getcpu, sched_setaffinity};

    /// The cores that this process may use, that of the caller first.
    pub(crate) struct Cores {
        allowed: CpuSet,
        order: Vec<usize>,
    }

    /// Until it is dropped, the thread that has it stays on one core.
    pub(crate) struct Stay(CpuSet);

    impl Cores {
        /// Finds one core for each of `threads` threads; `None` unless there are just as many.
        pub(crate) fn for_each_of(threads: usize) -> Option<Self> {
            let allowed = sched_getaffinity(None).ok()?;
            if allowed.count() as usize != threads {
                return None;
            }
            let mut order: Vec<usize> =
                (0..CpuSet::MAX_CPU).filter(|&core| allowed.is_set(core)).collect();
            let here = sched_getcpu();
            order.sort_by_key(|&core| core != here);
            Some(Self { allowed, order })
        }

        /// Moves the calling thread, the caller being number 0, to its core and keeps it there.
        pub(crate) fn stay(&self, thread: usize) -> Option<Stay> {
            let mut only = CpuSet::new();
            only.set(*self.order.get(thread)?);
            // Where that is not allowed, things stay as they are.
            sched_setaffinity(None, &only).ok()?;
            Some(Stay(self.allowed))
        }
    }

    impl Drop for Stay {
        fn drop(&mut self) {
            // It was allowed before; a core that is gone since takes nothing from the others.
            let _ = sched_setaffinity(None, &self.0);
        }
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn every_thread_stays_on_a_core_of_its_own_and_is_then_let_go() {
            let before = sched_getaffinity(None).unwrap();
            let count = before.count() as usize;
            assert!(Cores::for_each_of(count + 1).is_none());
            let cores = Cores::for_each_of(count).unwrap();
            let here = |thread: usize| {
                let _stay = cores.stay(thread).unwrap();
                assert_eq!(sched_getaffinity(None).unwrap().count(), 1);
                sched_getcpu()
            };
            let mut used: Vec<usize> = std::thread::scope(|scope| {
                let threads: Vec<_> = (0..count).map(|k| scope.spawn(move || here(k))).collect();
                threads.into_iter().map(|thread| thread.join().unwrap()).collect()
            });
            used.sort_unstable();
            used.dedup();
            assert_eq!(used.len(), count);
            drop(cores.stay(0));
            assert!(sched_getaffinity(None).unwrap() == before);
        }
    }
}

#[cfg(not(target_os = "linux"))]
mod others {
    /// Elsewhere, threads are left where they are put.
    pub(crate) struct Cores;

    pub(crate) struct Stay;

    impl Cores {
        pub(crate) fn for_each_of(_threads: usize) -> Option<Self> {
            None
        }

        pub(crate) fn stay(&self, _thread: usize) -> Option<Stay> {
            None
        }
    }
}
