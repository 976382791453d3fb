//! An executor that sleeps by WFI. Embassy's own sleeps by WFE, which QEMU treats as a yield: it
//! would spin.
#![expect(unsafe_code, reason = "the raw executor asks for it")]

use core::sync::atomic::{AtomicBool, Ordering};
use embassy_executor::{Spawner, raw};
use static_cell::StaticCell;

static WORK: AtomicBool = AtomicBool::new(false);

// SAFETY: the one definition of the name that embassy-executor calls, with its signature.
#[unsafe(export_name = "__pender")]
fn pender(_context: *mut ()) {
    WORK.store(true, Ordering::SeqCst);
}

/// Runs the tasks that `init` spawns.
pub(crate) fn run(init: impl FnOnce(Spawner)) -> ! {
    static EXECUTOR: StaticCell<raw::Executor> = StaticCell::new();
    let executor: &'static raw::Executor = EXECUTOR.init(raw::Executor::new(core::ptr::null_mut()));
    init(executor.spawner());
    loop {
        // SAFETY: the executor was initialised, and nothing else polls it.
        unsafe { executor.poll() };
        // Interrupts are off between the look and the sleep; one that comes ends the sleep all the
        // same and is served after.
        cortex_m::interrupt::free(|_| {
            if !WORK.swap(false, Ordering::SeqCst) {
                cortex_m::asm::wfi();
            }
        });
    }
}
