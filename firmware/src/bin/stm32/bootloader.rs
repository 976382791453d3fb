//! The bootloader in the chip's ROM, started from the state after a reset.
//!
//! It wants every peripheral as a reset leaves it (AN2606, "Bootloader activation"), and the watchdog
//! cannot be stopped but by a reset. So the word for it is left in RAM, the chip is reset, and before
//! anything is set up the word is found: then the core goes on in ROM.
#![expect(unsafe_code, reason = "the code before RAM is set up is assembly")]

use core::arch::global_asm;
use core::mem::MaybeUninit;
use core::ptr::addr_of_mut;

/// Not what RAM holds after power-on, but for one time in four thousand million.
const WANTED: u32 = 0xB007_10AD;

#[unsafe(link_section = ".uninit.bootloader")]
static mut WORD: MaybeUninit<u32> = MaybeUninit::uninit();

/// Leaves the word and resets the chip.
pub(crate) fn enter() -> ! {
    cortex_m::interrupt::disable();
    // SAFETY: interrupts are off and nothing returns from here, so nobody else looks.
    unsafe { addr_of_mut!(WORD).cast::<u32>().write_volatile(WANTED) };
    cortex_m::peripheral::SCB::sys_reset()
}

// Called first after a reset, while there is no RAM to speak of (cortex-m-rt, `__pre_init`): registers
// r0 to r3 only, no stack.
//
// The word is taken back first, so that whatever the bootloader starts is the firmware again. Where the
// firmware is to go on, the core is told where its vectors are: after the bootloader's Go they are not at 0.
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
    // System memory at 0, as BOOT0 makes it (RM0394, SYSCFG_MEMRMP), with the clock of SYSCFG on meanwhile.
    "ldr r0, =0x40021060", // RCC_APB2ENR, 0 after a reset
    "movs r1, #1",
    "str r1, [r0]",
    "ldr r2, [r0]", // the clock is there after a cycle or two
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
