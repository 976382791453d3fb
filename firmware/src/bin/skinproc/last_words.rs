//! What the firmware says when it panics, kept in RAM across the reset that follows.
#![expect(unsafe_code, reason = "RAM that start-up does not clear is reached by a pointer")]

use core::fmt::{self, Write};
use core::mem::MaybeUninit;
use core::panic::PanicInfo;
use core::ptr::{addr_of, addr_of_mut};

/// Marks words that were written; anything else is what RAM holds after power-on.
const WRITTEN: u32 = 0x4C57_5244;

const LONGEST: usize = 200;

#[repr(C)]
struct Words {
    written: u32,
    len: usize,
    text: [u8; LONGEST],
}

#[unsafe(link_section = ".uninit.last_words")]
static mut WORDS: MaybeUninit<Words> = MaybeUninit::uninit();

/// Takes the words of the last panic, if that is what ended the run before.
///
/// To be called once, before interrupts are on.
pub(crate) fn take(text: &mut [u8; LONGEST]) -> Option<&str> {
    let words = addr_of_mut!(WORDS).cast::<Words>();
    // SAFETY: nothing else runs yet, the memory is there, and whatever it holds is a valid value of
    // the types read.
    let (written, len) = unsafe {
        let written = addr_of!((*words).written).read_volatile();
        addr_of_mut!((*words).written).write_volatile(0);
        *text = addr_of!((*words).text).read_volatile();
        (written, addr_of!((*words).len).read_volatile())
    };
    let text = text.get(..len.min(LONGEST))?;
    (written == WRITTEN).then(|| core::str::from_utf8(text).unwrap_or("not text"))
}

/// Room for the words; what does not fit is cut.
pub(crate) const fn room() -> [u8; LONGEST] {
    [0; LONGEST]
}

struct Pen {
    text: [u8; LONGEST],
    len: usize,
}

impl Write for Pen {
    fn write_str(&mut self, part: &str) -> fmt::Result {
        let room = self.text.get_mut(self.len..).ok_or(fmt::Error)?;
        for (to, from) in room.iter_mut().zip(part.bytes()) {
            *to = from;
            self.len += 1;
        }
        Ok(())
    }
}

#[panic_handler]
fn panic(info: &PanicInfo<'_>) -> ! {
    cortex_m::interrupt::disable();
    let mut pen = Pen { text: [0; LONGEST], len: 0 };
    _ = write!(pen, "{info}");
    let words = addr_of_mut!(WORDS).cast::<Words>();
    // SAFETY: interrupts are off and nothing returns from here, so nobody else looks.
    unsafe {
        addr_of_mut!((*words).text).write_volatile(pen.text);
        addr_of_mut!((*words).len).write_volatile(pen.len);
        addr_of_mut!((*words).written).write_volatile(WRITTEN);
    }
    cortex_m::peripheral::SCB::sys_reset()
}
