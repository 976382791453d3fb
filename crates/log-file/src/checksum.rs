//! Checksums that identify the files a result was computed from.
//!
//! XXH3 of 128 bits, `xxh128:` and what `xxh128sum` prints: it costs a tenth of what a
//! cryptographic hash does, which would be a twentieth of a whole fit. Files are not mistaken for
//! one another by chance; a forger could make one that is.

use std::io::{self, Read};

use twox_hash::XxHash3_128;

/// A checksum under way.
#[derive(Clone, Default)]
pub(crate) struct Checksum(XxHash3_128);

impl Checksum {
    /// Takes up the next bytes.
    pub(crate) fn update(&mut self, bytes: &[u8]) {
        self.0.write(bytes);
    }

    /// The checksum of all bytes so far.
    pub(crate) fn finish(&self) -> String {
        format!("xxh128:{:032x}", self.0.finish_128())
    }
}

/// The checksum of `bytes`.
pub fn of(bytes: &[u8]) -> String {
    let mut checksum = Checksum::default();
    checksum.update(bytes);
    checksum.finish()
}

/// The checksum of all that a stream gives.
///
/// # Errors
/// Those of the stream.
pub fn of_stream(mut stream: impl Read) -> io::Result<String> {
    let (mut checksum, mut buffer) = (Checksum::default(), vec![0; 1 << 16]);
    loop {
        match stream.read(&mut buffer)? {
            0 => return Ok(checksum.finish()),
            read => checksum.update(&buffer[..read]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn checksums_are_those_that_xxh128sum_prints() {
        assert_eq!(of(b""), "xxh128:99aa06d3014798d86001c324468d497f");
        assert_eq!(of(b"time,s1\n1,2\n"), "xxh128:3bc00d86db8130a43a2e22b8bcb4290f");
    }

    #[test]
    fn pieces_add_up_to_the_whole() {
        let bytes: Vec<u8> = (0..10_000_u32).map(|i| ((i * i) >> 3) as u8).collect();
        for size in [1, 255, 256, 257, 4096] {
            let mut checksum = Checksum::default();
            bytes.chunks(size).for_each(|piece| checksum.update(piece));
            assert_eq!(checksum.finish(), of(&bytes));
            assert_eq!(of_stream(&bytes[..]).unwrap(), of(&bytes));
        }
    }
}
