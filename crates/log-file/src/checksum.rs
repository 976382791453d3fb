//! Checksums that identify the files a result was computed from.
//!
//! 128-bit XXH3, written as `xxh128:` and the output of `xxh128sum`. It takes a tenth of the time of a cryptographic
//! hash, which would add a twentieth to a whole fit. Equal checksums do not occur by chance, but can be forged.

use std::io::{self, Read};

use twox_hash::XxHash3_128;

pub(crate) fn text(hash: &XxHash3_128) -> String {
    format!("xxh128:{:032x}", hash.finish_128())
}

pub fn of(bytes: &[u8]) -> String {
    let mut hash = XxHash3_128::default();
    hash.write(bytes);
    text(&hash)
}

/// Returns the checksum of a whole stream.
///
/// # Errors
/// Errors of the stream.
pub fn of_stream(mut stream: impl Read) -> io::Result<String> {
    let (mut hash, mut buffer) = (XxHash3_128::default(), vec![0; 1 << 16]);
    loop {
        match stream.read(&mut buffer)? {
            0 => return Ok(text(&hash)),
            read => hash.write(&buffer[..read]),
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
            let mut hash = XxHash3_128::default();
            bytes.chunks(size).for_each(|piece| hash.write(piece));
            assert_eq!(text(&hash), of(&bytes));
            assert_eq!(of_stream(&bytes[..]).unwrap(), of(&bytes));
        }
    }
}
