//! What the firmware says when it cannot go on, kept in RAM across the reset that follows.
#![expect(unsafe_code, reason = "RAM that start-up does not clear is reached by a pointer")]

use core::fmt::{self, Write};
use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::ptr::addr_of_mut;

use firmware::LastWords;
use shared_proto::ResetCause;

/// Marks words that were written, together with the code of the cause of the reset that followed; anything else is what
/// RAM holds after power-on.
const MARK: u32 = 0x4C57_5200;

#[repr(C)]
struct Words {
    mark: u32,
    len: usize,
    text: [u8; LastWords::LEN],
}

#[unsafe(link_section = ".uninit.last_words")]
static mut WORDS: MaybeUninit<Words> = MaybeUninit::uninit();

/// Takes the words of the run before and the cause of its end, if that is how it ended.
///
/// To be called once, before interrupts are on.
pub(crate) fn take() -> Option<(ResetCause, LastWords)> {
    let words = addr_of_mut!(WORDS).cast::<Words>();
    // SAFETY: nothing else runs yet, the memory is there, and whatever it holds is a valid value of
    // the types read.
    let Words { mark, len, text } = unsafe {
        let read = words.read_volatile();
        addr_of_mut!((*words).mark).write_volatile(0);
        read
    };
    let cause = ResetCause::from_code(mark as u8);
    let is_marked = mark == MARK | u32::from(cause.code());
    let is_end = is_marked && matches!(cause, ResetCause::Panic | ResetCause::Fault);
    let text = text.get(..len).filter(|_| is_end)?;
    Some((cause, LastWords::from_bytes(text)))
}

/// Keeps the words and resets the board, for this cause.
pub(crate) fn leave(cause: ResetCause, said: fmt::Arguments<'_>) -> ! {
    cortex_m::interrupt::disable();
    let words = addr_of_mut!(WORDS).cast::<Words>();
    let mut pen = LastWords::new();
    _ = pen.write_fmt(said);
    let mut text = [0; LastWords::LEN];
    let said = pen.as_bytes();
    text.iter_mut().zip(said).for_each(|(to, from)| *to = *from);
    let mark = MARK | u32::from(cause.code());
    // SAFETY: interrupts are off and nothing returns from here, so nobody else looks.
    unsafe { words.write_volatile(Words { mark, len: said.len(), text }) };
    cortex_m::peripheral::SCB::sys_reset()
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    leave(ResetCause::Panic, format_args!("{info}"))
}
