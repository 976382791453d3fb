//! The byte protocol of the original SkinProc board, for reading an existing robot.
//!
//! An answer is the letter of its mode, a payload length (255: more follows) and the payload. A
//! scan is `E`, 20, eight little-endian 16-bit readings of a 12-bit converter and the time in µs,
//! 32 bits, little-endian. Without delimiter, sequence number and checksum, a decoder can only
//! check letter, length, the readings' twelve bits, and that another answer follows.

use crate::CHANNELS;
use crate::field::{Bytes, Reader};

/// Length of a scan in bytes, including letter and length.
pub const SCAN_LEN: usize = 22;

const SCAN: u8 = b'E';
const SCAN_PAYLOAD: u8 = 20;

/// One frame of readings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scan {
    /// Readings of the 12-bit converter.
    pub readings: [u16; CHANNELS],
    /// The board's clock in µs; it wraps.
    pub clock_us: u32,
}

impl Scan {
    /// Returns the bytes of the scan.
    pub fn encode(&self) -> [u8; SCAN_LEN] {
        let mut bytes = [0; SCAN_LEN];
        let fields = [SCAN, SCAN_PAYLOAD]
            .into_iter()
            .chain(self.readings.iter().flat_map(|reading| reading.to_le_bytes()))
            .chain(self.clock_us.to_le_bytes());
        bytes.iter_mut().zip(fields).for_each(|(to, from)| *to = from);
        bytes
    }
}

/// Returns the scan in a payload, `None` if it is not a scan.
pub fn decode_scan(payload: &[u8]) -> Option<Scan> {
    let mut rest = Reader(payload);
    if rest.array()? != [SCAN, SCAN_PAYLOAD] {
        return None;
    }
    let readings: [u16; CHANNELS] = rest.get()?;
    let clock_us = rest.get()?;
    let is_scan = readings.iter().all(|&reading| reading < 1 << 12);
    rest.end(Scan { readings, clock_us }).filter(|_| is_scan)
}

/// Decodes a byte stream to scans, and skips other answers. A scan is emitted when its clock
/// follows the previous one, or when the next byte begins another answer: without a checksum, a
/// lost byte only shows in the bytes after it.
#[derive(Clone, Debug, Default)]
pub struct Decoder {
    /// A scan and the byte after it.
    pending: Bytes<{ SCAN_LEN + 1 }>,
    last_clock_us: Option<u32>,
    /// Scans emitted.
    pub scans: u64,
    /// Bytes outside scans.
    pub skipped: u64,
}

impl Decoder {
    /// Longest step of the clock that confirms a scan, µs.
    const PLAUSIBLE_STEP_US: u32 = 1_000_000;

    /// Creates a decoder.
    pub fn new() -> Self {
        Self::default()
    }

    /// Decodes bytes, in slices of any size, and calls `sink` for every scan.
    pub fn feed(&mut self, bytes: &[u8], mut sink: impl FnMut(Scan)) {
        for &byte in bytes {
            self.pending.push(byte);
            if self.pending.len() <= SCAN_LEN {
                continue;
            }
            match decode_scan(&self.pending[..SCAN_LEN]) {
                Some(scan) if is_letter(byte) || self.follows(scan) => {
                    self.pending.remove_front(SCAN_LEN);
                    self.give(scan, &mut sink);
                }
                _ => self.skip_to_next_start(),
            }
        }
    }

    /// Ends the stream: no further byte can confirm the last scan.
    pub fn finish(&mut self, mut sink: impl FnMut(Scan)) {
        match decode_scan(&self.pending) {
            Some(scan) => self.give(scan, &mut sink),
            None => self.skipped += self.pending.len() as u64,
        }
        self.pending = Bytes::new();
    }

    fn follows(&self, scan: Scan) -> bool {
        self.last_clock_us.is_some_and(|last| {
            (1..=Self::PLAUSIBLE_STEP_US).contains(&scan.clock_us.wrapping_sub(last))
        })
    }

    fn give(&mut self, scan: Scan, sink: &mut impl FnMut(Scan)) {
        self.last_clock_us = Some(scan.clock_us);
        self.scans += 1;
        sink(scan);
    }

    fn skip_to_next_start(&mut self) {
        let start = self.pending.iter().skip(1).position(|&byte| byte == SCAN);
        let skipped = start.map_or(self.pending.len(), |start| start + 1);
        self.pending.remove_front(skipped);
        self.skipped += skipped as u64;
    }
}

fn is_letter(byte: u8) -> bool {
    matches!(byte, b'A'..=b'G' | b'S' | b'T' | b'Z')
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn scan(i: u32) -> Scan {
        let channel = |c: u32| ((i * 37 + c * 501) % 4096) as u16;
        Scan { readings: core::array::from_fn(|c| channel(c as u32)), clock_us: i * 5_493 }
    }

    fn decoded(stream: &[u8], piece: usize) -> (Vec<Scan>, u64) {
        let (mut decoder, mut scans) = (Decoder::new(), Vec::new());
        stream.chunks(piece).for_each(|bytes| decoder.feed(bytes, |scan| scans.push(scan)));
        decoder.finish(|scan| scans.push(scan));
        (scans, decoder.skipped)
    }

    fn stream(count: u32) -> Vec<u8> {
        (0..count).flat_map(|i| scan(i).encode()).collect()
    }

    /// A payload from a log of the base station.
    const LOGGED: [u8; SCAN_LEN] =
        [69, 20, 169, 7, 75, 8, 50, 9, 238, 9, 13, 9, 34, 8, 37, 8, 168, 8, 37, 20, 0, 0];

    #[test]
    fn a_logged_payload_gives_the_readings_that_the_base_station_printed() {
        let readings = [1961, 2123, 2354, 2542, 2317, 2082, 2085, 2216];
        assert_eq!(decode_scan(&LOGGED), Some(Scan { readings, clock_us: 5157 }));
        assert_eq!(decode_scan(&LOGGED).unwrap().encode(), LOGGED);
    }

    #[test]
    fn payloads_that_are_no_scan_are_refused() {
        assert_eq!(decode_scan(&[]), None);
        assert_eq!(decode_scan(&LOGGED[..21]), None);
        assert_eq!(decode_scan(&[&LOGGED[..], &[0]].concat()), None);
        for (at, value) in [(0, b'G'), (1, 21), (3, 0x10)] {
            let mut payload = LOGGED;
            payload[at] = value;
            assert_eq!(decode_scan(&payload), None);
        }
    }

    #[test]
    fn other_answers_between_scans_are_skipped() {
        let stream = [&[71, 2, 8, 2, 83, 1, 1][..], &stream(2), &[71, 2, 8, 2], &stream(3)[44..]];
        assert_eq!(decoded(&stream.concat(), 5), ((0..3).map(scan).collect(), 11));
    }

    #[test]
    fn a_lost_byte_costs_no_more_than_its_scan() {
        let whole = stream(5);
        for lost in 44..66 {
            let mut cut = whole.clone();
            cut.remove(lost);
            let (scans, _) = decoded(&cut, 7);
            let expected: Vec<_> = [0, 1, 3, 4].map(scan).into();
            // A byte lost next to an equal one leaves no trace; the neighbours are intact.
            assert!(expected.iter().all(|scan| scans.contains(scan)), "{lost}");
        }
    }

    proptest! {
        #[test]
        fn splitting_changes_nothing(count in 1..20_u32, piece in 1..60_usize) {
            prop_assert_eq!(decoded(&stream(count), piece), ((0..count).map(scan).collect(), 0));
        }

        #[test]
        fn every_byte_of_garbage_is_accounted_for(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let (scans, skipped) = decoded(&bytes, 13);
            prop_assert_eq!(scans.len() * SCAN_LEN + skipped as usize, bytes.len());
        }
    }
}
