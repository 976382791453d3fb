//! Raw bytes of a recording, with the times of their arrival.
//!
//! ```text
//! file:   "shellcal raw 1\n", then pieces
//! piece:  arrival since the start, µs (u64) | number of bytes (u32) | bytes
//! ```
//!
//! Numbers are little-endian. The times show how long a board was off or a port was gone. A file without this first
//! line, as from another program, holds only the bytes.

use std::io::{self, BufRead, Read};
use std::time::Duration;

const FIRST_LINE: &[u8] = b"shellcal raw 1\n";

/// Encodes bytes that arrived together; the first piece includes the first line. Without a time, returns the bytes as
/// they are.
pub(crate) fn piece(bytes: &[u8], arrival: Option<Duration>, is_first: bool) -> Vec<u8> {
    let Some(arrival) = arrival else { return bytes.to_vec() };
    let mut piece = Vec::new();
    for bytes in bytes.chunks(u32::MAX as usize) {
        let micros = u64::try_from(arrival.as_micros()).unwrap_or(u64::MAX);
        if is_first && piece.is_empty() {
            piece.extend(FIRST_LINE);
        }
        piece.extend(micros.to_le_bytes());
        piece.extend((bytes.len() as u32).to_le_bytes());
        piece.extend(bytes);
    }
    piece
}

/// Reads recorded bytes, one arrival at a time. After a kill, reads the incomplete last piece as far as it goes.
#[derive(Debug)]
pub struct CaptureReader<R> {
    input: R,
    /// Unread bytes of the piece; `None` if the file has no times.
    left: Option<u32>,
    arrival: Option<Duration>,
}

impl<R: BufRead> CaptureReader<R> {
    pub fn new(mut input: R) -> io::Result<Self> {
        let has_times = input.fill_buf()?.starts_with(FIRST_LINE);
        if has_times {
            input.consume(FIRST_LINE.len());
        }
        Ok(Self { input, left: has_times.then_some(0), arrival: None })
    }

    /// Returns the arrival time of the bytes read last, if known.
    pub fn arrival(&self) -> Option<Duration> {
        self.arrival
    }
}

impl<R: BufRead> Read for CaptureReader<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let Some(left) = &mut self.left else { return self.input.read(buffer) };
        while *left == 0 {
            let (mut micros, mut length) = ([0; 8], [0; 4]);
            let head = self.input.read_exact(&mut micros);
            match head.and_then(|()| self.input.read_exact(&mut length)) {
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(0),
                head => head?,
            }
            self.arrival = Some(Duration::from_micros(u64::from_le_bytes(micros)));
            *left = u32::from_le_bytes(length);
        }
        let most = buffer.len().min(*left as usize);
        let count = self.input.read(&mut buffer[..most])?;
        *left -= count as u32;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pieces(file: &[u8], size: usize) -> Vec<(Option<Duration>, Vec<u8>)> {
        let (mut reader, mut buffer) = (CaptureReader::new(file).unwrap(), vec![0; size]);
        let mut pieces = Vec::new();
        loop {
            match reader.read(&mut buffer).unwrap() {
                0 => return pieces,
                count => pieces.push((reader.arrival(), buffer[..count].to_vec())),
            }
        }
    }

    #[test]
    fn bytes_return_with_their_times_and_a_cut_end_as_far_as_it_goes() {
        let [early, late] = [3, 7_000_000].map(|micros| Some(Duration::from_micros(micros)));
        let file = [piece(b"abc", early, true), piece(b"", late, false), piece(b"de", late, false)];
        let file = file.concat();
        let expected = [(early, b"abc".to_vec()), (late, b"de".to_vec())];
        assert_eq!(pieces(&file, 100), expected);
        let halves = [(early, b"ab".to_vec()), (early, b"c".to_vec()), (late, b"de".to_vec())];
        assert_eq!(pieces(&file, 2), halves);
        for end in FIRST_LINE.len()..file.len() {
            let read: Vec<u8> = pieces(&file[..end], 100).into_iter().flat_map(|it| it.1).collect();
            assert!(b"abcd".starts_with(&read[..]), "{end}: {read:?}");
        }
    }

    #[test]
    fn bytes_without_times_stay_as_they_are() {
        let file = [piece(b"abc", None, true), piece(b"shellcal raw 1\n", None, false)].concat();
        assert_eq!(file, b"abcshellcal raw 1\n");
        assert_eq!(pieces(&file, 100), [(None, file.clone())]);
    }
}
