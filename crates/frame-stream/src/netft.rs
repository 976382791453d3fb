//! A stream in the format of an ATI Net F/T box: UDP records to the client with the latest request.
//!
//! ```text
//! request ─ a thread ─▶ client, mode ──────┐
//! row ─▶ counts − bias, status word ───────┴─▶ a record, or several in one datagram
//! ```
//!
//! Counts are 1 µN and 1 µN·m. `ft_sequence` is the number of the frame, with gaps for lost frames;
//! `rdt_sequence` counts the records of the stream. Like a box, the stream serves one client at a
//! time, and a bias request takes the newest load as zero.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use reference_sensor::page::{self, BoxSettings};
use reference_sensor::rdt::{self, BUFFERED, RECORD_SIZE, RdtCommand, RdtRecord, status};
use shell_data::lock::lock;

use crate::encoding::StreamRow;
use crate::summary::ReaderSummary;

/// Timeout of a read: the thread notices within it that it should end.
const WAIT: Duration = Duration::from_millis(100);

const HAND_OVER: Duration = Duration::from_millis(1);

const RATE_US: i64 = 1_000_000;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NetFtAddress {
    /// Address to listen at. By default, requests are accepted from this machine only.
    pub ip: IpAddr,
    /// UDP port; `None` for that of a box.
    pub port: Option<u16>,
}

impl Default for NetFtAddress {
    fn default() -> Self {
        Self { ip: Ipv4Addr::LOCALHOST.into(), port: None }
    }
}

#[derive(Clone, Debug)]
pub struct NetFtPage {
    /// Addresses for the page, which is served at the first free one.
    pub addresses: Vec<SocketAddr>,
    state: Arc<Mutex<BoxState>>,
}

impl NetFtPage {
    pub fn text(&self) -> String {
        page::write(&BoxSettings::micro(), lock(&self.state).rate_hz, "shellcal")
    }
}

#[derive(Debug)]
pub(crate) struct NetFtBox {
    socket: Arc<UdpSocket>,
    address: SocketAddr,
    page_ports: Vec<u16>,
    state: Arc<Mutex<BoxState>>,
    ended: Arc<AtomicBool>,
}

#[derive(Clone, Copy, Debug)]
struct ServedClient {
    address: SocketAddr,
    is_buffered: bool,
    /// Datagrams still to be sent; `None` without end.
    left: Option<u32>,
}

#[derive(Debug, Default)]
struct BoxState {
    client: Option<ServedClient>,
    rdt_sequence: u32,
    waiting: Vec<u8>,
    newest: Option<[i32; 6]>,
    bias: [i32; 6],
    is_bias_due: bool,
    rate_hz: u32,
    /// Start of the rate estimate, µs, and the rows since.
    counted: Option<(i64, u32)>,
    sent: u64,
    failed: u64,
    without_forces: u64,
}

impl NetFtBox {
    pub(crate) fn open(at: NetFtAddress) -> io::Result<Self> {
        let socket = UdpSocket::bind((at.ip, at.port.unwrap_or(rdt::PORT)))?;
        socket.set_read_timeout(Some(WAIT))?;
        socket.set_write_timeout(Some(HAND_OVER))?;
        let (socket, address) = (Arc::new(socket.try_clone()?), socket.local_addr()?);
        // A box serves its page at port 80, which not every user may open; otherwise the TCP port
        // has the number of the UDP port.
        let page_ports = match at.port {
            None => vec![80, address.port()],
            Some(_) => vec![address.port()],
        };
        let (state, ended): (Arc<Mutex<BoxState>>, Arc<AtomicBool>) = Default::default();
        let (of_thread, is_over) = (Arc::clone(&state), Arc::clone(&ended));
        let own = Arc::clone(&socket);
        let listen = move || {
            let mut request = [0; 64];
            while !is_over.load(Ordering::Relaxed) {
                match own.recv_from(&mut request) {
                    Ok((length, from)) => {
                        if let Some(command) = RdtCommand::decode(&request[..length]) {
                            lock(&of_thread).obey(command, from);
                        }
                    }
                    Err(error) if is_pause(&error) => {}
                    // Some systems report here that a client has gone.
                    Err(_) => thread::sleep(HAND_OVER),
                }
            }
        };
        thread::Builder::new().name("netft".to_owned()).spawn(listen)?;
        Ok(Self { socket, address, page_ports, state, ended })
    }

    pub(crate) fn address(&self) -> SocketAddr {
        self.address
    }

    pub(crate) fn page(&self) -> NetFtPage {
        let at = |port: &u16| SocketAddr::new(self.address.ip(), *port);
        NetFtPage {
            addresses: self.page_ports.iter().map(at).collect(),
            state: Arc::clone(&self.state),
        }
    }

    pub(crate) fn send(&self, row: &StreamRow) {
        let datagram = lock(&self.state).take(row);
        let Some((datagram, to)) = datagram else { return };
        let records = (datagram.len() / RECORD_SIZE) as u64;
        let is_sent = self.socket.send_to(&datagram, to).is_ok();
        let state = &mut *lock(&self.state);
        *(if is_sent { &mut state.sent } else { &mut state.failed }) += records;
    }

    pub(crate) fn summary(&self) -> ReaderSummary {
        let state = lock(&self.state);
        let problem = match state.without_forces {
            0 => None,
            rows => Some(format!("{rows} rows have no forces: give `--calibration`")),
        };
        ReaderSummary {
            name: format!("netft:{}", self.address),
            rows: state.sent,
            lost: state.failed,
            problem,
            is_broken: false,
        }
    }
}

impl Drop for NetFtBox {
    fn drop(&mut self) {
        self.ended.store(true, Ordering::Relaxed);
    }
}

fn is_pause(error: &io::Error) -> bool {
    use io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), Interrupted | TimedOut | WouldBlock)
}

impl BoxState {
    fn obey(&mut self, command: RdtCommand, from: SocketAddr) {
        let (is_buffered, count) = match command {
            RdtCommand::Bias => {
                match self.newest {
                    Some(newest) => self.bias = newest,
                    None => self.is_bias_due = true,
                }
                return;
            }
            RdtCommand::Stop => {
                self.client = None;
                self.waiting.clear();
                return;
            }
            RdtCommand::Start(count) => (false, count),
            RdtCommand::StartBuffered(count) => (true, count),
        };
        let left = (count > 0).then_some(count);
        let goes_on = self.client.is_some_and(|client| {
            client.address == from && client.is_buffered == is_buffered && client.left.is_none()
        });
        // A served client may repeat its request after a bias: `rdt_sequence` continues.
        if goes_on && left.is_none() {
            return;
        }
        self.client = Some(ServedClient { address: from, is_buffered, left });
        self.rdt_sequence = 0;
        self.waiting.clear();
    }

    fn take(&mut self, row: &StreamRow) -> Option<(Vec<u8>, SocketAddr)> {
        self.count(row.time_us);
        let Some(wrench) = &row.wrench else {
            self.without_forces += 1;
            return None;
        };
        let (counts, mut is_beyond) = BoxSettings::micro().counts(wrench);
        self.newest = Some(counts);
        if std::mem::take(&mut self.is_bias_due) {
            self.bias = counts;
        }
        let counts = std::array::from_fn(|axis| {
            let free = i64::from(counts[axis]) - i64::from(self.bias[axis]);
            let held = free.clamp(i32::MIN.into(), i32::MAX.into());
            is_beyond |= held != free;
            held as i32
        });
        let client = self.client.as_mut()?;
        self.rdt_sequence = self.rdt_sequence.wrapping_add(1);
        let record = RdtRecord {
            rdt_sequence: self.rdt_sequence,
            ft_sequence: row.index as u32,
            status: status_of(row, is_beyond),
            counts,
        };
        self.waiting.extend_from_slice(&record.encode());
        if client.is_buffered && self.waiting.len() < BUFFERED * RECORD_SIZE {
            return None;
        }
        let to = client.address;
        if let Some(left) = &mut client.left {
            *left -= 1;
            if *left == 0 {
                self.client = None;
            }
        }
        Some((std::mem::take(&mut self.waiting), to))
    }

    fn count(&mut self, time_us: i64) {
        let (since, rows) = self.counted.unwrap_or((time_us, 0));
        let elapsed = time_us - since;
        if elapsed > 0 && (elapsed >= RATE_US || self.rate_hz == 0 || rows < 100) {
            let rate_hz = f64::from(rows) * 1e6 / elapsed as f64;
            self.rate_hz = rate_hz.round().max(1.0) as u32;
        }
        self.counted = match elapsed {
            0..RATE_US => Some((since, rows + 1)),
            _ => Some((time_us, 1)),
        };
    }
}

fn status_of(row: &StreamRow, is_beyond: bool) -> u32 {
    let has = |ending: &str| row.flags.split(' ').any(|flag| flag.ends_with(ending));
    let errors = [
        (has(":saturated") || has(":insensitive"), status::GAGE_OUT_OF_RANGE),
        (has(":range") || is_beyond, status::LOAD_OUT_OF_RANGE),
    ];
    let errors = errors.into_iter().filter(|(applies, _)| *applies);
    let errors = errors.fold(0, |word, (_, bit)| word | bit | status::ERROR);
    errors | if row.lost { status::BUSY } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(index: i64, fx_n: f64, flags: &str) -> StreamRow {
        StreamRow {
            time_us: index * 1000,
            index,
            host_us: 0,
            readings: None,
            wrench: Some([fx_n, 0.0, 0.0, 0.0, 0.0, -0.25]),
            standard_errors: None,
            flags: flags.to_owned(),
            lost: false,
        }
    }

    fn record(sent: Option<(Vec<u8>, SocketAddr)>) -> RdtRecord {
        RdtRecord::decode_all(&sent.unwrap().0).unwrap()[0]
    }

    #[test]
    fn counts_bias_and_status_equal_those_of_the_row() {
        let (mut state, client) = (BoxState::default(), SocketAddr::from(([127, 0, 0, 1], 9)));
        assert!(state.take(&row(1, 1.0, "")).is_none(), "nobody has asked");
        state.obey(RdtCommand::Start(0), client);
        let first = record(state.take(&row(2, 1.5, "late")));
        assert_eq!((first.rdt_sequence, first.ft_sequence, first.status), (1, 2, 0));
        assert_eq!(first.counts, [1_500_000, 0, 0, 0, 0, -250_000]);
        state.obey(RdtCommand::Bias, client);
        let saturated = record(state.take(&row(3, 1.25, "late s3:saturated")));
        assert_eq!(saturated.counts, [-250_000, 0, 0, 0, 0, 0]);
        assert_eq!(saturated.status, 0x8800_0000);
        assert_eq!(record(state.take(&row(4, 1.25, "s3:range"))).status, 0xc000_0000);
        let beyond = record(state.take(&row(5, -3e3, "")));
        assert_eq!((beyond.counts[0], beyond.status), (i32::MIN, 0xc000_0000));
        assert_eq!(state.rate_hz, 1000);
        let lost = StreamRow { lost: true, ..row(9, 1.25, "") };
        assert_eq!(record(state.take(&lost)).status, 8);
    }

    #[test]
    fn the_requested_number_of_records_is_sent() {
        let (mut state, client) = (BoxState::default(), SocketAddr::from(([127, 0, 0, 1], 9)));
        state.obey(RdtCommand::Start(2), client);
        let sent = (1..9).filter(|index| state.take(&row(*index, 0.0, "")).is_some()).count();
        assert_eq!(sent, 2);
        state.obey(RdtCommand::StartBuffered(1), client);
        let sent: Vec<_> = (1..99).filter_map(|at| state.take(&row(at, 0.0, ""))).collect();
        let [(datagram, to)] = &sent[..] else { panic!("{} datagrams", sent.len()) };
        let numbers: Vec<_> = RdtRecord::decode_all(datagram).unwrap();
        assert_eq!((numbers.len(), numbers[39].rdt_sequence, *to), (40, 40, client));
        state.obey(RdtCommand::Start(0), client);
        assert_eq!(record(state.take(&row(1, 0.0, ""))).rdt_sequence, 1);
        state.obey(RdtCommand::Stop, client);
        assert!(state.take(&row(2, 0.0, "")).is_none());
    }
}
