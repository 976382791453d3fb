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

use super::PacedClock;
use crate::radio::Radio;
use shell_data::lock::lock;

/// Packets queued for the host before the board is held up, as by CTS: some seconds at 100 Hz.
const QUEUE: usize = 512;

/// Maximum time between checks of the radio.
const TICK: Duration = Duration::from_millis(10);

pub(super) type InputPipe = Pipe<CriticalSectionRawMutex, 1024>;

pub(super) struct SerialLine {
    pub(super) port: String,
    pub(super) packets: SyncSender<Vec<u8>>,
    pub(super) receiver: &'static InputPipe,
}

impl SerialLine {
    #[cfg(unix)]
    pub(super) fn open(radios: &[Arc<Mutex<Radio>>; 2]) -> Result<Self, serialport::Error> {
        let (mut pty, host) = TTYPort::pair()?;
        pty.set_timeout(TICK)?;
        let port = host.name().unwrap_or_default();
        let from_host = pty.try_clone_native()?;
        Ok(Self::between(port, from_host, pty, radios))
    }

    pub(super) fn listen(at: SocketAddr, radios: &[Arc<Mutex<Radio>>; 2]) -> io::Result<Self> {
        let (socket, at) = Socket::listen(at)?;
        Ok(Self::between(format!("tcp://{at}"), socket.clone(), socket, radios))
    }

    fn between(
        port: String,
        from_host: impl io::Read + Send + 'static,
        to_host: impl io::Write + Send + 'static,
        radios: &[Arc<Mutex<Radio>>; 2],
    ) -> Self {
        let [up, down] = radios.each_ref().map(Arc::clone);
        let (queue, packets) = sync_channel(QUEUE);
        // Leaked, as the threads need it for the life of the process.
        let receiver: &InputPipe = Box::leak(Box::new(InputPipe::new()));
        thread::spawn(move || give_to_host(&packets, &up, to_host));
        thread::spawn(move || give_to_board(from_host, &down, receiver));
        Self { port, packets: queue, receiver }
    }
}

/// Output of the board: each write becomes one packet.
pub(super) struct LineSender {
    pub(super) packets: SyncSender<Vec<u8>>,
    pub(super) clock: PacedClock,
}

impl ErrorType for LineSender {
    type Error = Infallible;
}

impl Write for LineSender {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        let mut packet = bytes.to_vec();
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

fn give_to_host(packets: &Queue<Vec<u8>>, radio: &Mutex<Radio>, mut host: impl io::Write) {
    let start = Instant::now();
    let now_us = || start.elapsed().as_micros() as u64;
    loop {
        let wait_us = lock(radio).next_arrival_us().map(|at| at.saturating_sub(now_us()));
        let wait = wait_us.map_or(TICK, |us| Duration::from_micros(us).min(TICK));
        match packets.recv_timeout(wait) {
            Ok(packet) => lock(radio).send(now_us(), &packet),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return,
        }
        loop {
            let Some(delivery) = lock(radio).receive(now_us()) else { break };
            write_all(&mut host, &delivery.bytes);
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

fn give_to_board(mut host: impl io::Read, radio: &Mutex<Radio>, input: &InputPipe) {
    let start = Instant::now();
    let now_us = || start.elapsed().as_micros() as u64;
    let mut buffer = [0; 256];
    loop {
        match host.read(&mut buffer) {
            Ok(count) => lock(radio).send(now_us(), &buffer[..count]),
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

/// The serial line over TCP, for systems without ptys or a remote host. Like a serial port, it
/// holds one host at a time and loses output without a host.
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
