//! What the firmware says when it cannot go on, kept in RAM across the reset that follows.
#![expect(unsafe_code, reason = "RAM that start-up does not clear is reached by a pointer")]

use core::fmt::{self, Write};
use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::ptr::addr_of_mut;

use firmware::LastWords;
use shared_proto::ResetCause;

/// How a run has ended. The codes mark words that were written; anything else is what RAM holds
/// after power-on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum End {
    /// The firmware found something that cannot be.
    Panic = 0x4C57_5250,
    /// The core met something that it cannot execute.
    Fault = 0x4C57_5246,
}

impl End {
    fn from_code(code: u32) -> Option<Self> {
        [Self::Panic, Self::Fault].into_iter().find(|&end| end as u32 == code)
    }

    /// The cause of the reset that followed.
    pub(crate) fn cause(self) -> ResetCause {
        match self {
            Self::Panic => ResetCause::Panic,
            Self::Fault => ResetCause::Fault,
        }
    }
}

#[repr(C)]
struct Words {
    end: u32,
    len: usize,
    text: [u8; LastWords::LEN],
}

#[unsafe(link_section = ".uninit.last_words")]
static mut WORDS: MaybeUninit<Words> = MaybeUninit::uninit();

/// Takes the words of the run before, if that is how it ended.
///
/// To be called once, before interrupts are on.
pub(crate) fn take() -> Option<(End, LastWords)> {
    let words = addr_of_mut!(WORDS).cast::<Words>();
    // SAFETY: nothing else runs yet, the memory is there, and whatever it holds is a valid value of
    // the types read.
    let Words { end, len, text } = unsafe {
        let read = words.read_volatile();
        addr_of_mut!((*words).end).write_volatile(0);
        read
    };
    let end = End::from_code(end)?;
    Some((end, LastWords::from_bytes(text.get(..len)?)))
}

/// Keeps the words and resets the board.
pub(crate) fn leave(end: End, said: fmt::Arguments<'_>) -> ! {
    cortex_m::interrupt::disable();
    let words = addr_of_mut!(WORDS).cast::<Words>();
    let mut pen = LastWords::new();
    _ = pen.write_fmt(said);
    let mut text = [0; LastWords::LEN];
    let said = pen.as_bytes();
    text.iter_mut().zip(said).for_each(|(to, from)| *to = *from);
    // SAFETY: interrupts are off and nothing returns from here, so nobody else looks.
    unsafe { words.write_volatile(Words { end: end as u32, len: said.len(), text }) };
    cortex_m::peripheral::SCB::sys_reset()
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    leave(End::Panic, format_args!("{info}"))
}
