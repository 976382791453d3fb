//! Several readers of one stream, one of which stops.

#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    clippy::unwrap_used,
    reason = "tests open sockets and read files"
)]

use std::io::{BufRead, BufReader, Read};
use std::net::{Ipv4Addr, TcpStream, UdpSocket};
use std::time::Duration;

use frame_stream::{Destination, Readers, StreamRow};
use shell_data::wrench::Axes;

fn row(index: i64) -> StreamRow {
    StreamRow {
        time_us: index * 1000,
        index,
        host_us: 1_700_000_000_000_000 + index * 1000,
        readings: Some([2000.0; 8]),
        wrench: Some([0.123_456_789; 6]),
        standard_errors: Some([0.01; 6]),
        flags: String::new(),
        lost: false,
    }
}

fn number(line: &str, name: &str) -> u64 {
    let start = line.find(&format!("\"{name}\":")).unwrap() + name.len() + 3;
    let digits: String = line[start..].chars().take_while(char::is_ascii_digit).collect();
    digits.parse().unwrap()
}

fn udp() -> (UdpSocket, Destination) {
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let address = socket.local_addr().unwrap();
    (socket, Destination::Udp(address))
}

#[test]
fn a_stopped_reader_loses_rows_and_no_other_reader_does() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("rows.jsonl");
    let ((first, to_first), (second, to_second)) = (udp(), udp());
    let any = Destination::Tcp((Ipv4Addr::LOCALHOST, 0).into());
    let destinations = [to_first, to_second, any, Destination::File(file.clone())];
    let mut readers = Readers::open(&destinations, None, false).unwrap();
    let address = readers.addresses()[0];
    let (reading, mut stopped) =
        (TcpStream::connect(address).unwrap(), TcpStream::connect(address).unwrap());
    reading.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let mut reading = BufReader::new(reading);

    // Two minutes at 1 kHz, more than buffers hold. Each row is read before the next is sent, so
    // other readers are fast enough on any machine.
    const ROWS: u64 = 120_000;
    let (mut datagram, mut line) = ([0; 2048], String::new());
    for index in 0..ROWS {
        readers.send(&row(index as i64), Axes::ALL);
        for socket in [&first, &second] {
            let count = socket.recv(&mut datagram).unwrap();
            let text = std::str::from_utf8(&datagram[..count]).unwrap();
            assert_eq!((number(text, "row"), number(text, "lost")), (index, 0));
        }
        line.clear();
        reading.read_line(&mut line).unwrap();
        assert_eq!((number(&line, "row"), number(&line, "lost")), (index, 0));
    }
    // The stopped reader continues with the pending rows, and the next row shows how many it has lost.
    stopped.set_nonblocking(true).unwrap();
    let (mut got, mut index) = (Vec::new(), ROWS);
    let whole = loop {
        let _ = stopped.read_to_end(&mut got);
        readers.send(&row(index as i64), Axes::ALL);
        index += 1;
        let text = String::from_utf8(got.clone()).unwrap();
        let lines: Vec<String> = text.split_inclusive('\n').map(str::to_owned).collect();
        let whole: Vec<String> = lines.into_iter().filter(|line| line.ends_with('\n')).collect();
        if whole.last().is_some_and(|line| number(line, "row") > ROWS) {
            break whole;
        }
        assert!(index < ROWS + 100_000);
        std::thread::sleep(Duration::from_millis(1));
    };
    for (position, line) in whole.iter().enumerate() {
        assert_eq!(number(line, "row") - number(line, "lost"), position as u64);
    }
    let lost = number(whole.last().unwrap(), "lost");
    assert!(lost > 10_000, "{lost}");
    drop((reading, stopped));

    let summaries = readers.finish();
    let of = |name: &str| {
        let found: Vec<_> = summaries.iter().filter(|it| it.name.starts_with(name)).collect();
        found.iter().map(|it| it.rows + it.lost).collect::<Vec<_>>()
    };
    assert_eq!(of("udp"), [index, index]);
    assert_eq!(of("`"), [index]);
    let text = std::fs::read_to_string(file).unwrap();
    // The stream does not wait for the file's thread: rows that it could not take count, too.
    let lost = text.lines().last().map(|line| number(line, "lost")).unwrap();
    let last = text.lines().last().map(|line| number(line, "row")).unwrap();
    assert_eq!(text.lines().count() as u64 + lost, last + 1);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_output_is_closed_and_others_continue() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("rows.csv");
    let full = Destination::File("/dev/full".into());
    let destinations = [full, Destination::File(file.clone())];
    let mut readers = Readers::open(&destinations, None, false).unwrap();
    for index in 0..100 {
        readers.send(&row(index), Axes::ALL);
    }
    let mut summaries = readers.finish();
    summaries.sort_by_key(|of| !of.is_broken);
    let [broken, whole] = &summaries[..] else { panic!("{summaries:?}") };
    assert_eq!((broken.rows, broken.lost, broken.is_broken), (0, 100, true));
    assert!(broken.problem.as_ref().unwrap().contains("No space left"), "{broken:?}");
    assert_eq!((whole.rows, whole.lost, whole.is_broken), (100, 0, false));
    let text = std::fs::read_to_string(file).unwrap();
    assert!(text.starts_with("t_s,index,") && text.lines().count() == 101, "{text}");
}
