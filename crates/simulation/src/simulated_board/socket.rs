//! The serial line of a simulated board over TCP, where there are no ptys or the host is elsewhere.

use shell_data::lock::lock;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

/// The host at the other end, if there is one: one at a time, as on a serial port.
///
/// What the board sends while nobody is there is gone, as it is on a wire.
#[derive(Clone, Debug, Default)]
pub(super) struct Socket(Arc<Mutex<CurrentPeer>>);

#[derive(Debug, Default)]
struct CurrentPeer {
    host: Option<TcpStream>,
    /// Hosts so far: tells one that has gone from one that has come meanwhile.
    number: u64,
}

impl Socket {
    /// Listens; returns the address, with the port that was chosen where 0 was asked for. A read or write waits
    /// for `tick` at most.
    pub(super) fn listen(at: SocketAddr, tick: Duration) -> io::Result<(Self, SocketAddr)> {
        let listener = TcpListener::bind(at)?;
        let at = listener.local_addr()?;
        let socket = Self::default();
        let hosts = socket.clone();
        thread::spawn(move || {
            for host in listener.incoming() {
                match host {
                    Ok(host) => hosts.admit(host, tick),
                    // Out of descriptors, as a rule, which passes.
                    Err(_) => thread::sleep(tick),
                }
            }
        });
        Ok((socket, at))
    }

    /// Takes a host, unless there is one: that one is sent away.
    fn admit(&self, host: TcpStream, tick: Duration) {
        let mut current = lock(&self.0);
        if current.host.as_ref().is_none_or(is_gone)
            && host.set_nodelay(true).is_ok()
            && host.set_read_timeout(Some(tick)).is_ok()
            && host.set_write_timeout(Some(tick)).is_ok()
        {
            *current = CurrentPeer { host: Some(host), number: current.number + 1 };
        }
    }

    /// The host, and its number.
    fn host(&self) -> Option<(TcpStream, u64)> {
        let current = lock(&self.0);
        Some((current.host.as_ref()?.try_clone().ok()?, current.number))
    }

    /// Forgets a host that has gone, unless another has come.
    fn forget(&self, number: u64) {
        let mut current = lock(&self.0);
        if current.number == number {
            current.host = None;
        }
    }
}

/// Whether a host has closed its end.
fn is_gone(host: &TcpStream) -> bool {
    match host.peek(&mut [0]) {
        Ok(count) => count == 0,
        Err(error) => !is_wait(&error),
    }
}

/// Whether there is just nothing for now.
fn is_wait(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted)
}

impl Read for Socket {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let (mut host, number) = self.host().ok_or(ErrorKind::NotConnected)?;
        match host.read(buffer) {
            Ok(count) if count > 0 => Ok(count),
            Err(error) if is_wait(&error) => Err(ErrorKind::TimedOut.into()),
            Ok(_) | Err(_) => {
                self.forget(number);
                Err(ErrorKind::NotConnected.into())
            }
        }
    }
}

impl Write for Socket {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let Some((mut host, _)) = self.host() else { return Ok(bytes.len()) };
        match host.write(bytes) {
            Err(error) if is_wait(&error) => Err(ErrorKind::TimedOut.into()),
            // That it is gone is for the reader to find.
            Err(_) => Ok(bytes.len()),
            written => written,
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
