//! The firmware's last message before a fatal error, kept in RAM across the reset: a panic, a fault
//! of the core, or a stack overflow.
//!
//! A stack overflow is a fault, as there is no memory below the stack (memory/stm32.x). The core's
//! exception frame is lost, so the handler starts with a fresh stack.
#![expect(unsafe_code, reason = "RAM that start-up does not clear, and a handler in assembly")]

use core::arch::global_asm;
use core::fmt::{self, Write};
use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::ptr::addr_of_mut;

use cortex_m_rt::ExceptionFrame;
use firmware::LastWords;
use shared_proto::ResetCause;

/// Marks valid words, plus the code of the reset's cause. After power-on, RAM is random.
const MARK: u32 = 0x4C57_5200;

#[repr(C)]
struct Words {
    mark: u32,
    len: usize,
    text: [u8; LastWords::LEN],
}

#[unsafe(link_section = ".uninit.last_words")]
static mut WORDS: MaybeUninit<Words> = MaybeUninit::uninit();

/// Takes words and reset cause of the previous run. Call once, before interrupts are enabled.
pub(crate) fn take() -> Option<(ResetCause, LastWords)> {
    let words = addr_of_mut!(WORDS).cast::<Words>();
    // SAFETY: no other code runs yet, the memory exists, and any content is valid for its types.
    let Words { mark, len, text } = unsafe {
        let read = words.read_volatile();
        addr_of_mut!((*words).mark).write_volatile(0);
        read
    };
    let ends = [ResetCause::Panic, ResetCause::Fault];
    let cause = ends.into_iter().find(|cause| mark == MARK | u32::from(cause.code()))?;
    Some((cause, LastWords::from_bytes(text.get(..len)?)))
}

pub(crate) fn leave(cause: ResetCause, said: fmt::Arguments<'_>) -> ! {
    cortex_m::interrupt::disable();
    let words = addr_of_mut!(WORDS).cast::<Words>();
    let mut pen = LastWords::new();
    _ = pen.write_fmt(said);
    let mut text = [0; LastWords::LEN];
    let said = pen.as_bytes();
    text.iter_mut().zip(said).for_each(|(to, from)| *to = *from);
    let mark = MARK | u32::from(cause.code());
    // SAFETY: interrupts are off and this function does not return: no other code accesses it.
    unsafe { words.write_volatile(Words { mark, len: said.len(), text }) };
    cortex_m::peripheral::SCB::sys_reset()
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    leave(ResetCause::Panic, format_args!("{info}"))
}

/// Configurable fault status register (Arm DDI0403, B3.2.15).
const CFSR: *const u32 = 0xE000_ED28 as *const u32;

// SAFETY: defined by memory/stm32.x. Only the symbol's address is used, below.
unsafe extern "C" {
    safe static _stack_end: u8;
}

// Replaces the handler of cortex-m-rt, which would push onto the overflowed stack.
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

/// Records the fault; `frame` is the stack pointer at that time.
extern "C" fn on_fault(frame: *const ExceptionFrame) -> ! {
    // SAFETY: a register of every Cortex-M4, aligned, and reading it has no side effect.
    let status = unsafe { CFSR.read_volatile() };
    if frame.addr() < (&raw const _stack_end).addr() {
        let words = format_args!("stack overflow, down to {frame:p}, CFSR {status:#010x}");
        leave(ResetCause::Fault, words)
    }
    // SAFETY: the stack pointer is within the stack, so the core has pushed a frame there.
    let frame = unsafe { &*frame };
    let (pc, lr) = (frame.pc(), frame.lr());
    let words = format_args!("fault at {pc:#010x}, called from {lr:#010x}, CFSR {status:#010x}");
    leave(ResetCause::Fault, words)
}
