//! Orders to the board before it starts, so that a run needs nobody at its serial port and is the
//! same every time.
//!
//! In memory, where QEMU's `-device loader` puts it: the number of frames after which the board
//! resets itself (0 for never), the number of bytes that follow, and the bytes, which the board
//! takes as received. Words are little-endian. Without orders all of it is zero.

use crate::registers::Block;

const FRAMES: usize = 0;
const LENGTH: usize = 4;
const BYTES: usize = 8;

/// Most bytes: what fits below the storage.
const MAX_LENGTH: u32 = 1 << 16;

/// The number of the frame that the board resets itself after.
pub(crate) fn last_frame() -> Option<u32> {
    Some(Block::ORDERS.read(FRAMES)).filter(|&frames| frames > 0)
}

/// Copies bytes from `from` on into `buffer`; how many there were.
pub(crate) fn read(from: usize, buffer: &mut [u8]) -> usize {
    let length = Block::ORDERS.read(LENGTH).min(MAX_LENGTH) as usize;
    let count = length.saturating_sub(from).min(buffer.len());
    for (at, byte) in (from..).zip(&mut buffer[..count]) {
        *byte = (Block::ORDERS.read(BYTES + (at & !3)) >> (8 * (at % 4))) as u8;
    }
    count
}
