//! Frames of the Robotiq FT 300: the header 20 4E, six little-endian 16-bit values, Modbus CRC-16.
//!
//! Forces are in hundredths of N, moments in thousandths of N·m. The header also occurs inside
//! frames: 200.00 N is 20000, which is 20 4E. So the CRC over these 14 bytes decides where a frame
//! is; if it does not match, the search continues one byte later.

use shell_data::PerAxis;

pub const FRAME_SIZE: usize = 16;

const HEADER: [u8; 2] = [0x20, 0x4e];

/// The Modbus request that starts the stream: writes 0x0200 to register 410 of slave 9.
pub const START: [u8; 11] = [0x09, 0x10, 0x01, 0x9a, 0x00, 0x01, 0x02, 0x02, 0x00, 0xcd, 0xca];

pub fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xffff, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte), |crc, _| {
            (crc >> 1) ^ if crc & 1 == 1 { 0xa001 } else { 0 }
        })
    })
}

pub fn encode(values: [i16; 6]) -> [u8; FRAME_SIZE] {
    let mut bytes = [0; FRAME_SIZE];
    bytes[..2].copy_from_slice(&HEADER);
    for (place, value) in bytes[2..14].chunks_exact_mut(2).zip(values) {
        place.copy_from_slice(&value.to_le_bytes());
    }
    let crc = crc(&bytes[..14]);
    bytes[14..].copy_from_slice(&crc.to_le_bytes());
    bytes
}

#[derive(Clone, Debug, Default)]
pub struct FrameReader {
    waiting: Vec<u8>,
    skipped: usize,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ft300Frame {
    /// Forces in N, moments in N·m.
    pub wrench: PerAxis<f64>,
    pub skipped: usize,
}

impl FrameReader {
    pub fn feed(&mut self, bytes: &[u8]) -> Vec<Ft300Frame> {
        self.waiting.extend_from_slice(bytes);
        let (mut frames, mut at) = (Vec::new(), 0);
        while let Some(candidate) = self.waiting.get(at..at + FRAME_SIZE) {
            let is_frame = candidate[..2] == HEADER && crc(candidate) == 0;
            if is_frame {
                let skipped = std::mem::take(&mut self.skipped);
                frames.push(Ft300Frame { wrench: decode(candidate), skipped });
                at += FRAME_SIZE;
            } else {
                self.skipped += 1;
                at += 1;
            }
        }
        self.waiting.drain(..at);
        frames
    }
}

fn decode(frame: &[u8]) -> PerAxis<f64> {
    std::array::from_fn(|axis| {
        let at = 2 + 2 * axis;
        let value = i16::from_le_bytes([frame[at], frame[at + 1]]);
        f64::from(value) / if axis < 3 { 100.0 } else { 1000.0 }
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn the_crc_is_that_of_modbus() {
        // The check value of CRC-16/MODBUS in the catalogue of parametrised CRC algorithms.
        assert_eq!(crc(b"123456789"), 0x4b37);
        assert_eq!(crc(&START), 0);
    }

    #[test]
    fn two_hundred_newtons_hold_the_header_and_are_one_frame() {
        let frame = encode([20_000, 0x4e20, -20_000, 1, 20_000, -1]);
        let stream = [&frame[3..], &frame, &frame].concat();
        for cut in 0..stream.len() {
            let mut reader = FrameReader::default();
            let mut frames = reader.feed(&stream[..cut]);
            frames.extend(reader.feed(&stream[cut..]));
            let wrench = [200.0, 200.0, -200.0, 0.001, 20.0, -0.001];
            assert_eq!(frames.len(), 2, "cut at {cut}");
            assert!(frames.iter().all(|frame| frame.wrench == wrench));
            assert_eq!([frames[0].skipped, frames[1].skipped], [13, 0]);
        }
    }

    proptest! {
        #[test]
        fn frames_are_found_whatever_is_between_and_none_is_made_up(
            values in prop::collection::vec(any::<[i16; 6]>(), 1..20),
            damaged in any::<prop::sample::Index>(),
            bit in 0..128_usize,
        ) {
            let mut bytes: Vec<Vec<u8>> = values.iter().map(|of| encode(*of).to_vec()).collect();
            let at = damaged.index(values.len());
            bytes[at][bit / 8] ^= 1 << (bit % 8);
            let found = FrameReader::default().feed(&bytes.concat());
            let wanted = values.iter().enumerate().filter(|(index, _)| *index != at);
            let wanted: Vec<_> = wanted.map(|(_, of)| decode(&encode(*of))).collect();
            let found: Vec<_> = found.iter().map(|frame| frame.wrench).collect();
            prop_assert_eq!(found, wanted);
        }
    }
}
