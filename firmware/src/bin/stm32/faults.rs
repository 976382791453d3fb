//! What the core says of an instruction that it cannot execute, or of a stack that is too deep.
//!
//! There is no memory below the stack (memory/stm32.x). One that grows out of it is a fault, and what
//! the core would keep of it on the stack is lost with it: the handler begins with a stack of its own.
#![expect(unsafe_code, reason = "an exception handler begins in assembly")]

use core::arch::global_asm;

use super::last_words;
use cortex_m_rt::ExceptionFrame;
use shared_proto::ResetCause;

/// Configurable fault status register: what was wrong (Arm DDI0403, B3.2.15).
const CFSR: *const u32 = 0xE000_ED28 as *const u32;

// SAFETY: defined by memory/stm32.x. It has an address only, which is taken below.
unsafe extern "C" {
    safe static _stack_end: u8;
}

// Takes the place of the handler of cortex-m-rt, which would push onto the stack that there is.
global_asm!(
    ".section .HardFault.guarded, \"ax\", %progbits",
    ".global HardFault",
    ".type HardFault, %function",
    ".thumb_func",
    "HardFault:",
    "mrs r0, MSP",
    "ldr r1, =_stack_end",
    "cmp r0, r1",
    "bhs 1f",
    "ldr r1, =_stack_start",
    "msr MSP, r1",
    "1:",
    "b {on_fault}",
    ".ltorg",
    ".size HardFault, . - HardFault",
    on_fault = sym on_fault,
);

/// Keeps what is known: `frame` is where the stack pointer was.
extern "C" fn on_fault(frame: *const ExceptionFrame) -> ! {
    // SAFETY: a register of every Cortex-M4, aligned, and reading it has no effect.
    let status = unsafe { CFSR.read_volatile() };
    if frame.addr() < (&raw const _stack_end).addr() {
        let words = format_args!("stack overflow, down to {frame:p}, CFSR {status:#010x}");
        last_words::leave(ResetCause::Fault, words)
    }
    // SAFETY: the stack pointer is in the stack, so the core has pushed a frame there.
    let frame = unsafe { &*frame };
    let (pc, lr) = (frame.pc(), frame.lr());
    let words = format_args!("fault at {pc:#010x}, called from {lr:#010x}, CFSR {status:#010x}");
    last_words::leave(ResetCause::Fault, words)
}
