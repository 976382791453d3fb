//! Photointerrupters that play a script.
//!
//! The script is in memory, where QEMU's `-device loader` or a shared memory backend puts it: the
//! number of frames, a word, then for each frame and channel the dark and the lit code, 16 bits
//! each, little-endian. The frames are played over and over, one for each frame that is taken.
//! Without a script there is a light that channel i sees at code 256·(i + 1).

use crate::orders;
use crate::registers::Block;
use cortex_m::peripheral::SCB;
use firmware::{FrontEnd, RECORD, Record, Storage, StorageError};
use shared_proto::CHANNELS;

/// Most frames of a script: what fits below the storage.
const MAX_FRAMES: u32 = 100_000;

#[derive(Default)]
pub(crate) struct Script {
    /// Frames begun.
    begun: u32,
    lit: Option<usize>,
}

impl FrontEnd for Script {
    /// Conversions take no time here.
    const CONVERSION_NS: u32 = 0;

    fn light(&mut self, channel: Option<usize>) {
        self.lit = channel;
    }

    async fn sum(&mut self, channel: usize, conversions: u8) -> u32 {
        if channel == 0 && self.lit.is_none() {
            if orders::last_frame() == Some(self.begun) {
                SCB::sys_reset();
            }
            self.begun = self.begun.wrapping_add(1);
        }
        let (dark, lit) = self.codes(channel);
        let code = if self.lit == Some(channel) { lit } else { dark };
        u32::from(code) * u32::from(conversions)
    }
}

impl Script {
    fn codes(&self, channel: usize) -> (u16, u16) {
        let frames = Block::SCRIPT.read(0).min(MAX_FRAMES);
        let Some(frame) = self.begun.wrapping_sub(1).checked_rem(frames) else {
            return (0, 256 * (channel as u16 + 1));
        };
        let word = Block::SCRIPT.read(4 + 4 * (frame as usize * CHANNELS + channel));
        (word as u16, (word >> 16) as u16)
    }
}

/// A record in memory that QEMU can keep in a file.
pub(crate) struct Memory;

impl Storage for Memory {
    fn load(&mut self, record: &mut Record) {
        for (i, word) in record.chunks_exact_mut(4).enumerate() {
            word.copy_from_slice(&Block::STORAGE.read(4 * i).to_le_bytes());
        }
    }

    fn store(&mut self, record: &Record) -> Result<(), StorageError> {
        const { assert!(RECORD % 4 == 0, "records are whole words") };
        for (i, word) in record.as_chunks::<4>().0.iter().enumerate() {
            Block::STORAGE.write(4 * i, u32::from_le_bytes(*word));
        }
        Ok(())
    }
}
