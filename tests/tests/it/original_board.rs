//! Payloads logged by a base station from an original board, with the readings that it printed.

use shared_proto::skinproc::{Decoder, Scan, decode_scan};
use system_tests::real_recording;

fn numbers<T: std::str::FromStr>(line: &str) -> Option<Vec<T>> {
    let (_, list) = line.strip_suffix(']')?.split_once('[')?;
    let words = list.split([',', ' ']).filter(|word| !word.is_empty());
    words.map(|word| word.parse().ok()).collect()
}

#[test]
#[ignore = "needs the recordings"]
fn logged_payloads_give_the_readings_that_the_base_station_printed() {
    let path = real_recording("skinproc/stream_log_excerpt.txt");
    let log = std::fs::read_to_string(path).unwrap();
    let (mut scans, mut stream) = (Vec::new(), Vec::new());
    for line in log.lines().map(str::trim_end) {
        if line.starts_with("SRC:") {
            let Some(payload) = numbers::<u8>(line) else { continue };
            scans.extend(decode_scan(&payload));
            stream.extend(payload);
        } else if line.starts_with('[') {
            let printed: Vec<u16> = numbers(line).unwrap();
            assert_eq!(scans.last().unwrap().readings[..], printed);
        }
    }
    assert_eq!(scans.len(), 150);
    // The same payloads in one stream, with other answers.
    let (mut decoder, mut streamed) = (Decoder::new(), Vec::<Scan>::new());
    stream.chunks(7).for_each(|bytes| decoder.feed(bytes, |scan| streamed.push(scan)));
    decoder.finish(|scan| streamed.push(scan));
    assert_eq!(streamed, scans);
}
