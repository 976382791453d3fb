//! The console log of the lab's base station: messages, and payloads of the original SkinProc board, as
//! `SRC: 0x2052 |  [69, 20, 169, 7, …]`.
//!
//! Scans are decoded by [`shared_proto::skinproc`]. Other payloads and all other lines are skipped.

use memchr::{memchr, memchr_iter};
use shared_proto::skinproc::decode_scan;

use super::number::parse_field;
use super::parsed_rows::{ParsedRows, RowError};
use crate::error::RowProblem;

/// The letter `E`, with which scans begin.
const SCAN: &[u8] = b"69";

const BYTE: std::ops::RangeInclusive<f64> = 0.0..=255.0;

/// Readings of the channels 0 to 7, followed by the time in µs.
pub(crate) type ConsoleFrame = [f64; 9];

/// Parses the requested values of all frames in `lines`, given by `positions` in [`ConsoleFrame`].
pub(crate) fn parse_lines(
    lines: &[u8],
    positions: &[usize],
    skip_bad_rows: bool,
) -> Result<ParsedRows, RowError> {
    let mut parsed = ParsedRows::default();
    parsed.clear(positions.len(), 0);
    let ends = memchr_iter(b'\n', lines).chain([lines.len()]);
    let mut start = 0;
    for end in ends {
        let line = &lines[start..end];
        match payload(line).map(scan) {
            Some(Ok(Some(frame))) => {
                for (column, &position) in positions.iter().enumerate() {
                    parsed.put(column, frame[position]);
                }
                parsed.rows += 1;
            }
            Some(Err(problem)) if !skip_bad_rows => {
                return Err(RowError { offset: start, problem });
            }
            other => {
                parsed.skipped += u64::from(matches!(other, Some(Err(_))));
                parsed.pass_lines(1);
            }
        }
        start = end + 1;
    }
    Ok(parsed)
}

pub(crate) fn payload(line: &[u8]) -> Option<&[u8]> {
    let received = line.trim_ascii().strip_prefix(b"SRC:")?;
    let bar = memchr(b'|', received)?;
    let list = received[bar + 1..].trim_ascii_start().strip_prefix(b"[")?;
    Some(list.strip_suffix(b"]").unwrap_or(list))
}

/// Decodes the frame in a payload; `None` if it is not a scan.
fn scan(list: &[u8]) -> Result<Option<ConsoleFrame>, RowProblem> {
    let items = || list.split(|&byte| byte == b',').map(<[u8]>::trim_ascii);
    if items().next() != Some(SCAN) {
        return Ok(None);
    }
    let byte =
        |item| parse_field(item).ok().filter(|value| BYTE.contains(value) && value.fract() == 0.0);
    let bytes: Option<Vec<u8>> = items().map(|item| byte(item).map(|value| value as u8)).collect();
    let text = || String::from_utf8_lossy(list).into_owned();
    let scan = bytes.and_then(|bytes| decode_scan(&bytes));
    let scan = scan.ok_or_else(|| RowProblem::Payload(text()))?;
    let mut frame = [0.0; 9];
    for (value, reading) in frame.iter_mut().zip(scan.readings) {
        *value = f64::from(reading);
    }
    frame[8] = f64::from(scan.clock_us);
    Ok(Some(frame))
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINE: &[u8] = b"SRC: 0x2052 |  [69, 20, 169, 7, 75, 8, 50, 9, 238, 9, 13, 9, 34, 8, 37, 8, 168, 8, 37, 20, 0, 0]\r";

    #[test]
    fn a_scan_is_eight_readings_and_a_time() {
        let frame = scan(payload(LINE).unwrap()).unwrap().unwrap();
        // The base station printed the decoded values below this line: the same readings, and 0.005157 s.
        let expected = [1961.0, 2123.0, 2354.0, 2542.0, 2317.0, 2082.0, 2085.0, 2216.0, 5157.0];
        assert_eq!(frame, expected);
    }

    #[test]
    fn other_lines_are_passed_over() {
        assert_eq!(payload(b"DST: 0x2052 |  [69, 20]"), None);
        assert_eq!(payload(b"SRC: 0x2052 |  query : 1"), None);
        assert_eq!(payload(b"[69, 20]"), None);
        assert_eq!(scan(payload(b"SRC: 0x2052 | [71, 2, 8, 2]").unwrap()), Ok(None));
    }

    #[test]
    fn a_scan_of_another_length_is_a_bad_row() {
        for list in [
            "69",
            "69, 20, 1, 2",
            "69, 20, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 256",
            "69, 19, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20",
            "69, 20, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21",
        ] {
            assert!(scan(list.as_bytes()).is_err(), "{list}");
        }
    }
}
