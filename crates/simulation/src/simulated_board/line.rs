//! The serial line of a simulated board: a pty or a TCP connection, with the radio in between.

use std::convert::Infallible;
use std::io::{self, ErrorKind};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::mpsc::{
    Receiver as Queue, RecvTimeoutError, SyncSender, TrySendError, sync_channel,
};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::pipe::Pipe;
use embedded_io_async::{ErrorType, Write};
use firmware::Clock;
#[cfg(unix)]
use serialport::{SerialPort, TTYPort};

use super::base_station::Relayed;
use super::{BaseStation, PacedClock};
use crate::radio::Radio;
use shell_data::lock::lock;

/// Packets queued for the host before the board is held up, as by CTS: some seconds at 100 Hz.
const QUEUE: usize = 512;

/// Maximum time between checks of the radio.
const TICK: Duration = Duration::from_millis(10);

pub(super) type InputPipe = Pipe<CriticalSectionRawMutex, 1024>;

/// Radios and base station between board and host.
pub(super) struct Ways {
    /// To the host and to the board.
    pub(super) radios: [Arc<Mutex<Radio>>; 2],
    pub(super) station: Option<Arc<Mutex<BaseStation>>>,
}

/// Bytes for the host.
pub(super) enum Upward {
    /// A packet of the board, for the radio.
    Packet(Vec<u8>),
    /// Frames of the base station.
    Answer(Vec<u8>),
}

/// The board's end of the line.
pub(super) struct SerialLine {
    pub(super) port: String,
    pub(super) packets: SyncSender<Upward>,
    pub(super) receiver: &'static InputPipe,
}

impl SerialLine {
    /// Creates a pty.
    #[cfg(unix)]
    pub(super) fn open(ways: &Ways) -> Result<Self, serialport::Error> {
        let (mut pty, host) = TTYPort::pair()?;
        pty.set_timeout(TICK)?;
        let port = host.name().unwrap_or_default();
        let from_host = pty.try_clone_native()?;
        Ok(Self::between(port, from_host, pty, ways))
    }

    pub(super) fn listen(at: SocketAddr, ways: &Ways) -> io::Result<Self> {
        let (socket, at) = Socket::listen(at)?;
        Ok(Self::between(format!("tcp://{at}"), socket.clone(), socket, ways))
    }

    fn between(
        port: String,
        from_host: impl io::Read + Send + 'static,
        to_host: impl io::Write + Send + 'static,
        ways: &Ways,
    ) -> Self {
        let [up, down] = ways.radios.each_ref().map(Arc::clone);
        let (queue, packets) = sync_channel(QUEUE);
        // Leaked, as the threads need it for the life of the process.
        let receiver: &InputPipe = Box::leak(Box::new(InputPipe::new()));
        let station = ways.station.clone();
        let base = station.clone().map(|station| (station, queue.clone()));
        thread::spawn(move || give_to_host(&packets, &up, station.as_deref(), to_host));
        thread::spawn(move || give_to_board(from_host, &down, base, receiver));
        Self { port, packets: queue, receiver }
    }
}

/// Output of the board: each write becomes one packet.
pub(super) struct LineSender {
    pub(super) packets: SyncSender<Upward>,
    pub(super) clock: PacedClock,
}

impl ErrorType for LineSender {
    type Error = Infallible;
}

impl Write for LineSender {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        let mut packet = Upward::Packet(bytes.to_vec());
        while let Err(TrySendError::Full(back)) = self.packets.try_send(packet) {
            packet = back;
            self.clock.wait_until_us(self.clock.now_us() + 1000).await;
        }
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

fn give_to_host(
    packets: &Queue<Upward>,
    radio: &Mutex<Radio>,
    station: Option<&Mutex<BaseStation>>,
    mut host: impl io::Write,
) {
    let start = Instant::now();
    let now_us = || start.elapsed().as_micros() as u64;
    loop {
        let wait_us = lock(radio).next_arrival_us().map(|at| at.saturating_sub(now_us()));
        let wait = wait_us.map_or(TICK, |us| Duration::from_micros(us).min(TICK));
        match packets.recv_timeout(wait) {
            Ok(Upward::Packet(packet)) => lock(radio).send(now_us(), &packet),
            Ok(Upward::Answer(frames)) => write_all(&mut host, &frames),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
        loop {
            let Some(delivery) = lock(radio).receive(now_us()) else { break };
            match station {
                Some(station) => write_all(&mut host, &lock(station).receive(&delivery.bytes)),
                None => write_all(&mut host, &delivery.bytes),
            }
        }
    }
}

fn write_all(host: &mut impl io::Write, mut bytes: &[u8]) {
    while !bytes.is_empty() {
        match host.write(bytes) {
            Ok(count) => bytes = &bytes[count..],
            Err(error) if error.kind() == ErrorKind::TimedOut => {}
            // The other end is not open.
            Err(_) => thread::sleep(TICK),
        }
    }
}

fn give_to_board(
    mut host: impl io::Read,
    radio: &Mutex<Radio>,
    base: Option<(Arc<Mutex<BaseStation>>, SyncSender<Upward>)>,
    input: &InputPipe,
) {
    let start = Instant::now();
    let now_us = || start.elapsed().as_micros() as u64;
    let mut buffer = [0; 256];
    loop {
        match host.read(&mut buffer) {
            Ok(count) => match &base {
                None => lock(radio).send(now_us(), &buffer[..count]),
                Some((station, answers)) => {
                    let Relayed { to_board, to_host } = lock(station).take(&buffer[..count]);
                    to_board.iter().for_each(|data| lock(radio).send(now_us(), data));
                    if !to_host.is_empty() {
                        // The other thread ends only with the process.
                        _ = answers.send(Upward::Answer(to_host));
                    }
                }
            },
            Err(error) if error.kind() == ErrorKind::TimedOut => {}
            Err(_) => thread::sleep(TICK),
        }
        loop {
            let Some(delivery) = lock(radio).receive(now_us()) else { break };
            let mut bytes = &delivery.bytes[..];
            while !bytes.is_empty() {
                match input.try_write(bytes) {
                    Ok(count) => bytes = &bytes[count..],
                    Err(_) => thread::sleep(Duration::from_millis(1)),
                }
            }
        }
    }
}

/// The serial line over TCP, for systems without ptys or for a remote host. It serves one host at a time; without a
/// host, output is lost.
#[derive(Clone, Debug, Default)]
struct Socket(Arc<Mutex<Option<TcpStream>>>);

impl Socket {
    /// Listens; returns the address with the chosen port. Reads and writes wait at most [`TICK`].
    fn listen(at: SocketAddr) -> io::Result<(Self, SocketAddr)> {
        let listener = TcpListener::bind(at)?;
        let at = listener.local_addr()?;
        let socket = Self::default();
        let hosts = socket.clone();
        thread::spawn(move || {
            for host in listener.incoming() {
                match host {
                    Ok(host) => hosts.admit(host),
                    // Usually a temporary lack of file descriptors.
                    Err(_) => thread::sleep(TICK),
                }
            }
        });
        Ok((socket, at))
    }

    fn admit(&self, host: TcpStream) {
        let mut current = lock(&self.0);
        if current.as_ref().is_none_or(is_gone)
            && host.set_nodelay(true).is_ok()
            && host.set_read_timeout(Some(TICK)).is_ok()
            && host.set_write_timeout(Some(TICK)).is_ok()
        {
            *current = Some(host);
        }
    }

    fn host(&self) -> Option<TcpStream> {
        lock(&self.0).as_ref()?.try_clone().ok()
    }
}

fn is_gone(host: &TcpStream) -> bool {
    match host.peek(&mut [0]) {
        Ok(count) => count == 0,
        Err(error) => !is_wait(&error),
    }
}

fn is_wait(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

impl io::Read for Socket {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let mut host = self.host().ok_or(ErrorKind::NotConnected)?;
        match io::Read::read(&mut host, buffer) {
            Ok(0) => Err(ErrorKind::NotConnected.into()),
            Err(error) if is_wait(&error) => Err(ErrorKind::TimedOut.into()),
            read => read,
        }
    }
}

impl io::Write for Socket {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Some(mut host) = self.host() else { return Ok(bytes.len()) };
        match io::Write::write(&mut host, bytes) {
            Err(error) if is_wait(&error) => Err(ErrorKind::TimedOut.into()),
            // The reader will notice that the host is gone.
            Err(_) => Ok(bytes.len()),
            written => written,
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
