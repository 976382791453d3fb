//! Conversion of UTF-16, which Excel calls Unicode text, to UTF-8.

use std::io::Read;

use super::text_stream::TextStream;

/// Converts a UTF-16 stream without its byte-order mark. Invalid code units become U+FFFD.
pub(crate) fn as_utf8(mut stream: impl Read, high_first: bool) -> impl Read {
    // Bytes that are read but not decoded: an odd byte, and half of a surrogate pair.
    let mut rest = Vec::new();
    let mut has_begun = false;
    TextStream::new(Vec::new(), move |text| {
        let mut bytes = std::mem::take(&mut rest);
        let before = bytes.len();
        bytes.resize(1 << 15, 0);
        let read = stream.read(&mut bytes[before..])?;
        let ended = read == 0;
        bytes.truncate(before + read);
        let (pairs, odd) = bytes.as_chunks::<2>();
        let mut units: Vec<u16> = pairs
            .iter()
            .map(|&pair| match high_first {
                true => u16::from_be_bytes(pair),
                false => u16::from_le_bytes(pair),
            })
            .collect();
        let mut left = odd.len();
        // The first half of a surrogate pair waits for the second.
        if !ended && units.last().is_some_and(|unit| (0xd800..0xdc00).contains(unit)) {
            units.pop();
            left += 2;
        }
        rest = bytes[bytes.len() - left..].to_vec();
        if ended && left > 0 {
            units.push(0xfffd);
        }
        let skip = usize::from(!has_begun && units.first() == Some(&0xfeff));
        has_begun |= !units.is_empty();
        for character in char::decode_utf16(units.into_iter().skip(skip)) {
            let character = character.unwrap_or(char::REPLACEMENT_CHARACTER);
            text.extend_from_slice(character.encode_utf8(&mut [0; 4]).as_bytes());
        }
        Ok(!ended)
    })
}

#[cfg(test)]
mod tests {
    use std::io;

    use super::*;

    /// A stream that returns a few bytes at a time.
    struct Dripping<'a>(&'a [u8], usize);

    impl Read for Dripping<'_> {
        fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
            let count = self.1.min(buffer.len()).min(self.0.len());
            let (now, later) = self.0.split_at(count);
            buffer[..count].copy_from_slice(now);
            self.0 = later;
            Ok(count)
        }
    }

    #[test]
    fn characters_of_any_length_survive_cuts_anywhere() {
        let text = "t;µs;😀\n1,5;2;3\n";
        for high_first in [false, true] {
            let bytes: Vec<u8> = "\u{feff}"
                .encode_utf16()
                .chain(text.encode_utf16())
                .flat_map(|unit| if high_first { unit.to_be_bytes() } else { unit.to_le_bytes() })
                .collect();
            for step in [1, 2, 3, 5, 1000] {
                let mut decoded = String::new();
                let mut stream = as_utf8(Dripping(&bytes, step), high_first);
                stream.read_to_string(&mut decoded).unwrap();
                assert_eq!(decoded, text, "{step}");
            }
        }
        let mut decoded = String::new();
        let mut stream = as_utf8(&b"\xff\xfea\0\x01"[..], false);
        stream.read_to_string(&mut decoded).unwrap();
        assert_eq!(decoded, "a\u{fffd}", "half a character at the end");
    }
}
