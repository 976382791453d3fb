//! Finding API frames in a byte stream.

use super::{ApiFrame, ESCAPE, ESCAPED_BY, Mode, START};
use crate::field::Bytes;

/// Most bytes of a frame between length and checksum that are followed. The longest with a payload
/// has 14 bytes of header; room is left for other kinds.
const MAX_DATA: usize = 128;

/// Start, length, data, checksum.
const MAX_RAW: usize = MAX_DATA + 4;

/// Turns a byte stream into API frames.
///
/// Without escapes a start byte can stand anywhere. So after a damaged frame its bytes are looked
/// through again for the start of the next, lest a wrong length swallow it; and a frame with a
/// start byte in its data, which might be two frames of which the first has a wrong length, is
/// believed when another start follows it.
#[derive(Clone, Debug)]
pub struct Deframer {
    mode: Mode,
    /// Unescaped, from a start byte on; empty while none has been seen.
    pending: Bytes<{ MAX_RAW + 1 }>,
    /// Bytes at the front of `pending` that belong to a frame already counted as damaged.
    condemned: usize,
    /// Whether bytes outside a frame are left over from damage that has been counted, or from
    /// before this end listened.
    skipping: bool,
    escape: bool,
    /// Frames with a wrong start, length or checksum, or cut short.
    pub damaged: u64,
}

impl Deframer {
    /// Nothing has arrived.
    pub const fn new(mode: Mode) -> Self {
        let pending = Bytes::new();
        Self { mode, pending, condemned: 0, skipping: true, escape: false, damaged: 0 }
    }

    /// Takes bytes, in slices of any size, and calls `sink` with every frame.
    pub fn feed(&mut self, mut bytes: &[u8], mut sink: impl FnMut(ApiFrame<'_>)) {
        while let Some((&byte, rest)) = bytes.split_first() {
            let whole = if self.pending.is_empty() { whole_frame(bytes) } else { None };
            bytes = whole.map_or(rest, |(_, after)| after);
            if let Some((data, _)) = whole {
                self.skipping = false;
                give(data, &mut sink);
            } else if self.pending.is_empty() && byte != START {
                // Damage counts once, however many bytes it leaves behind.
                self.damaged += u64::from(!self.skipping);
                self.skipping = true;
            } else {
                self.take(byte, &mut sink);
            }
        }
    }

    fn take(&mut self, byte: u8, sink: &mut impl FnMut(ApiFrame<'_>)) {
        let is_plain = self.mode == Mode::Plain;
        if !is_plain && byte == START {
            self.damaged += u64::from(!self.pending.is_empty());
            self.pending = Bytes::new();
            self.escape = false;
        } else if !is_plain && byte == ESCAPE {
            self.escape = true;
            return;
        }
        self.pending.push(if self.escape { byte ^ ESCAPED_BY } else { byte });
        self.escape = false;
        while !self.pending.is_empty() {
            let (len, good) = match progress(&self.pending) {
                Deframed::Incomplete => return,
                Deframed::Damaged { len } => (len, false),
                Deframed::Whole(data) => {
                    let len = data.len() + 4;
                    let next = self.pending.get(len);
                    let suspect = is_plain && data.contains(&START);
                    if suspect && next.is_none() {
                        return;
                    }
                    let good = !suspect || next == Some(&START);
                    if good {
                        give(data, sink);
                    }
                    (len, good)
                }
            };
            if !good && self.condemned == 0 {
                self.damaged += 1;
                self.condemned = len;
            }
            self.skipping = !good;
            let len = if good { len } else { 1 };
            // With escapes a start byte in what is left was data.
            let is_start = |&byte: &u8| is_plain && byte == START;
            let next = self.pending.iter().skip(len).position(is_start);
            let gone = next.map_or(self.pending.len(), |next| len + next);
            self.pending.remove_front(gone);
            self.condemned = self.condemned.saturating_sub(gone);
        }
    }
}

enum Deframed<'a> {
    Incomplete,
    Whole(&'a [u8]),
    Damaged { len: usize },
}

/// How far a frame is that begins at the front of `bytes`.
fn progress(bytes: &[u8]) -> Deframed<'_> {
    let [_, high, low, rest @ ..] = bytes else { return Deframed::Incomplete };
    let len = usize::from(u16::from_be_bytes([*high, *low]));
    if len == 0 || len > MAX_DATA {
        return Deframed::Damaged { len: 3 };
    }
    let Some(sealed) = rest.get(..=len) else { return Deframed::Incomplete };
    match sealed.iter().copied().fold(0, u8::wrapping_add) {
        0xFF => Deframed::Whole(&sealed[..len]),
        _ => Deframed::Damaged { len: len + 4 },
    }
}

/// The data of a good frame at the front of `bytes`, if in either mode it can be read as it
/// stands, and what follows it: most frames are, and this takes a quarter of the time that byte by byte takes.
fn whole_frame(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let Deframed::Whole(data) = progress(bytes) else { return None };
    let (frame, after) = bytes.split_at_checked(data.len() + 4)?;
    let (&start, rest) = frame.split_first()?;
    let as_it_is = start == START && !rest.iter().any(|byte| matches!(*byte, START | ESCAPE));
    as_it_is.then_some((data, after))
}

fn give(data: &[u8], sink: &mut impl FnMut(ApiFrame<'_>)) {
    // A frame of another kind, or too short for its own, is no damage, but nothing to read either.
    ApiFrame::parse(data).into_iter().for_each(sink);
}
