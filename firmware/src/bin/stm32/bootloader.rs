//! The bootloader in the chip's ROM, started from the state after a reset.
//!
//! It expects every peripheral in its reset state (AN2606, "Bootloader activation"), and only a
//! reset stops the watchdog. So `enter` writes a magic word to RAM and resets the chip, and the
//! start-up code jumps to ROM before it sets anything up.
#![expect(unsafe_code, reason = "the code before RAM is set up is assembly")]

use core::arch::global_asm;
use core::mem::MaybeUninit;
use core::ptr::addr_of_mut;

/// RAM holds it by chance after one power-on in four thousand million.
const WANTED: u32 = 0xB007_10AD;

#[unsafe(link_section = ".uninit.bootloader")]
static mut WORD: MaybeUninit<u32> = MaybeUninit::uninit();

pub(crate) fn enter() -> ! {
    cortex_m::interrupt::disable();
    // SAFETY: interrupts are off and this function does not return: no other code accesses it.
    unsafe { addr_of_mut!(WORD).cast::<u32>().write_volatile(WANTED) };
    cortex_m::peripheral::SCB::sys_reset()
}

// Runs before RAM is initialised (cortex-m-rt, `__pre_init`): registers r0 to r3 only, no stack.
// Clears the word, so that the next reset starts the firmware. VTOR is set because after the
// bootloader's Go command the vectors are not at 0.
global_asm!(
    ".section .text.__pre_init, \"ax\", %progbits",
    ".global __pre_init",
    ".type __pre_init, %function",
    ".thumb_func",
    "__pre_init:",
    "ldr r0, ={word}",
    "ldr r1, [r0]",
    "movs r2, #0",
    "str r2, [r0]",
    "ldr r2, ={wanted}",
    "ldr r3, =0xE000ED08", // VTOR (Arm DDI0403, B3.2.5)
    "cmp r1, r2",
    "beq 1f",
    "ldr r0, =__vector_table",
    "str r0, [r3]",
    "bx lr",
    "1:",
    // Maps system memory to 0, as BOOT0 does (RM0394, SYSCFG_MEMRMP), with SYSCFG's clock on.
    "ldr r0, =0x40021060", // RCC_APB2ENR, 0 after a reset
    "movs r1, #1",
    "str r1, [r0]",
    "ldr r2, [r0]", // the clock needs a cycle or two to start
    "ldr r2, =0x40010000",
    "str r1, [r2]",
    "movs r1, #0",
    "str r1, [r0]",
    "ldr r0, =0x1FFF0000", // stack pointer and first instruction of the bootloader
    "str r0, [r3]",
    "ldr r1, [r0]",
    "msr MSP, r1",
    "ldr r0, [r0, #4]",
    "bx r0",
    ".ltorg",
    ".size __pre_init, . - __pre_init",
    word = sym WORD,
    wanted = const WANTED,
);
