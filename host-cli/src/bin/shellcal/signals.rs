//! Handling of signals that end the program: Ctrl-C, TERM, HUP. A command that runs until it is stopped requests a
//! flag. All others end as they would without this module, except that their temporary files are removed first.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Once, OnceLock};

use anyhow::Context;

static STOP: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// Starts listening. If this fails, the only harm is that temporary files may be left.
pub(crate) fn listen() {
    static BEGUN: Once = Once::new();
    BEGUN.call_once(|| {
        let _ = platform::listen(false);
    });
}

pub(crate) fn stop_flag() -> anyhow::Result<Arc<AtomicBool>> {
    let flag = Arc::clone(STOP.get_or_init(Arc::default));
    listen();
    // A command that waits to be stopped must hear signals even if a shell started it in the background.
    platform::listen(true).context("cannot listen for Ctrl-C")?;
    Ok(flag)
}

/// Handles a signal; returns true if the program goes on.
fn is_heard() -> bool {
    match STOP.get() {
        Some(flag) => {
            flag.store(true, Ordering::Relaxed);
            true
        }
        None => {
            output_file::remove_unfinished();
            false
        }
    }
}

#[cfg(unix)]
mod platform {
    use std::ffi::c_int;
    use std::{io, thread};

    use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
    use signal_hook::iterator::Signals;
    use signal_hook::low_level::emulate_default_handler;

    /// Listens for the signals that end the program by default; with `are_ignored`, for those that the parent set to
    /// be ignored, since Ctrl-C and TERM must still stop a command that waits for them.
    pub(super) fn listen(are_ignored: bool) -> io::Result<()> {
        let wanted: &[c_int] = match are_ignored {
            true => &[SIGINT, SIGTERM],
            false => &[SIGINT, SIGTERM, SIGHUP],
        };
        let ignored = ignored();
        let is_wanted = |signal: &&c_int| (ignored >> (**signal - 1) & 1 == 1) == are_ignored;
        let signals: Vec<&c_int> = wanted.iter().filter(is_wanted).collect();
        if signals.is_empty() {
            return Ok(());
        }
        let mut signals = Signals::new(signals)?;
        let wait = move || {
            for signal in signals.forever() {
                if !super::is_heard() {
                    let _ = emulate_default_handler(signal);
                }
            }
        };
        thread::Builder::new().name("signals".to_owned()).spawn(wait).map(drop)
    }

    /// The signals that the parent process set to be ignored, as `nohup` or a background job does; empty if
    /// the system does not tell.
    fn ignored() -> u64 {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
        mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0)
    }
}

#[cfg(not(unix))]
mod platform {
    use std::io;

    const ENDED: i32 = 130;

    /// Signals are never ignored here.
    pub(super) fn listen(are_ignored: bool) -> io::Result<()> {
        if are_ignored {
            return Ok(());
        }
        let handler = || {
            if !super::is_heard() {
                std::process::exit(ENDED);
            }
        };
        ctrlc::set_handler(handler).map_err(io::Error::other)
    }
}
