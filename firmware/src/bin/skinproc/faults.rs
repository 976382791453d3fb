//! What the core says of an instruction that it cannot execute.
#![expect(unsafe_code, reason = "an exception handler asks for it")]

use crate::last_words::{self, End};
use cortex_m_rt::ExceptionFrame;

/// Configurable fault status register: what was wrong (Arm DDI0403, B3.2.15).
const CFSR: *const u32 = 0xE000_ED28 as *const u32;

// SAFETY: does not return to what was interrupted.
#[cortex_m_rt::exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    // SAFETY: a register of every Cortex-M4, aligned, and reading it has no effect.
    let status = unsafe { CFSR.read_volatile() };
    let (pc, lr) = (frame.pc(), frame.lr());
    let words = format_args!("fault at {pc:#010x}, called from {lr:#010x}, CFSR {status:#010x}");
    last_words::leave(End::Fault, words)
}
