//! Serial ports: which there are, and opening one; or a connection over TCP in place of one.

use std::fmt;
use std::io::{Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::time::Duration;

use serde::Serialize;
pub use serialport::FlowControl;
use serialport::{ErrorKind, SerialPortType};

use super::LinkError;

/// How long a read waits: the longest time until Ctrl-C is heard.
const READ_TIMEOUT: Duration = Duration::from_millis(50);

/// What the name of a port over TCP begins with: `tcp://HOST:PORT`.
pub const TCP: &str = "tcp://";

/// How long a host over TCP may take to answer.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);

/// An open way to a board.
pub trait Connection: Read + Write + Send + fmt::Debug {}

impl<C: Read + Write + Send + fmt::Debug + ?Sized> Connection for C {}

/// A port and how to open it: 8 data bits, no parity, 1 stop bit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortOptions {
    /// Its name or path.
    pub port: String,
    /// Bits per second.
    pub baud: u32,
    /// Who may hold up whom.
    pub flow_control: FlowControl,
}

/// A port of this computer.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct PortInfo {
    /// What to call it.
    pub port: String,
    /// `usb`, `bluetooth`, `pci` or `unknown`.
    pub kind: &'static str,
    /// Product and manufacturer, where the system tells.
    pub description: String,
    /// Serial number of a USB adapter, where the system tells.
    pub serial: Option<String>,
}

/// The serial ports of this computer, by name.
///
/// # Errors
/// What the system says.
pub fn ports() -> Result<Vec<PortInfo>, serialport::Error> {
    let mut ports: Vec<_> = serialport::available_ports()?
        .into_iter()
        .map(|info| {
            let (kind, description, serial) = match info.port_type {
                SerialPortType::UsbPort(usb) => {
                    let ids = format!("{:04x}:{:04x}", usb.vid, usb.pid);
                    let parts = [usb.manufacturer, usb.product, Some(ids)];
                    let description = parts.into_iter().flatten().collect::<Vec<_>>().join(" ");
                    ("usb", description, usb.serial_number)
                }
                SerialPortType::BluetoothPort => ("bluetooth", String::new(), None),
                SerialPortType::PciPort => ("pci", String::new(), None),
                SerialPortType::Unknown => ("unknown", String::new(), None),
            };
            PortInfo { port: info.port_name, kind, description, serial }
        })
        .collect();
    ports.sort_unstable_by(|a, b| a.port.cmp(&b.port));
    Ok(ports)
}

impl PortOptions {
    /// Whether the port is one over TCP, which has no speed of its own.
    pub fn is_tcp(&self) -> bool {
        self.port.starts_with(TCP)
    }

    /// Opens the port for exclusive use.
    ///
    /// # Errors
    /// [`LinkError`] that tells a port that is missing, in use, or not permitted.
    pub fn open(&self) -> Result<Box<dyn Connection>, LinkError> {
        if let Some(address) = self.port.strip_prefix(TCP) {
            let connection = connect(address)
                .map_err(|reason| LinkError::Open { port: self.port.clone(), reason })?;
            return Ok(Box::new(connection));
        }
        let port = serialport::new(&self.port, self.baud)
            .flow_control(self.flow_control)
            .timeout(READ_TIMEOUT)
            .open()
            .map_err(|error| self.explain(&error))?;
        // What the system has kept from before is old.
        port.clear(serialport::ClearBuffer::Input).map_err(|error| self.explain(&error))?;
        Ok(Box::new(port))
    }

    fn explain(&self, error: &serialport::Error) -> LinkError {
        use std::io::ErrorKind as Io;
        let port = self.port.clone();
        match error.kind() {
            ErrorKind::Io(Io::NotFound) => LinkError::Missing { port },
            ErrorKind::Io(Io::PermissionDenied) => LinkError::Denied { port },
            // What the library reports of a port that is locked, and Windows of one that is not
            // there.
            ErrorKind::NoDevice if cfg!(unix) => LinkError::Busy { port },
            ErrorKind::NoDevice => LinkError::Missing { port },
            _ => LinkError::Open { port, reason: error.to_string() },
        }
    }
}

/// Connects to the first address of a host that answers; why not, where none does.
fn connect(address: &str) -> Result<TcpStream, String> {
    let named = |error: std::io::Error| format!("{error}; a board over TCP is `tcp://HOST:PORT`");
    let mut reason = "the host has no address".to_owned();
    for address in address.to_socket_addrs().map_err(named)? {
        let opened = TcpStream::connect_timeout(&address, CONNECT_TIMEOUT).and_then(|stream| {
            stream.set_nodelay(true)?;
            stream.set_read_timeout(Some(READ_TIMEOUT))?;
            stream.set_write_timeout(Some(CONNECT_TIMEOUT))?;
            Ok(stream)
        });
        match opened {
            Ok(stream) => return Ok(stream),
            Err(error) => reason = error.to_string(),
        }
    }
    Err(reason)
}
