//! Serial ports and connections over TCP: listing, opening, and diagnosis. Linux exposes in files
//! who may open a port, which process has it open, and the latency of its adapter. On other systems
//! only the result of opening is known.

use std::io::{Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::path::{Path, PathBuf};
use std::time::Duration;
use std::{fmt, fs};

use serde::Serialize;
pub use serialport::FlowControl;
use serialport::{ErrorKind, SerialPortType};

use super::LinkError;

/// Timeout of a read; bounds the response time to Ctrl-C.
const READ_TIMEOUT: Duration = Duration::from_millis(50);

pub const TCP: &str = "tcp://";

const CONNECT_TIMEOUT: Duration = Duration::from_secs(5);

pub trait Connection: Read + Write + Send + fmt::Debug {}

impl<C: Read + Write + Send + fmt::Debug + ?Sized> Connection for C {}

/// A port and its settings: 8 data bits, no parity, 1 stop bit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PortOptions {
    pub port: String,
    pub baud: u32,
    pub flow_control: FlowControl,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct PortInfo {
    pub port: String,
    /// `usb`, `bluetooth`, `pci` or `unknown`.
    pub kind: &'static str,
    pub description: String,
    pub serial: Option<String>,
}

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
    /// Returns whether the port is a TCP connection, which has no speed.
    pub fn is_tcp(&self) -> bool {
        self.port.starts_with(TCP)
    }

    /// Opens the port for exclusive use. Fails with [`LinkError`], which distinguishes a missing
    /// port, a port in use, and a lack of permission.
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
        // Discard stale data that the system has buffered.
        port.clear(serialport::ClearBuffer::Input).map_err(|error| self.explain(&error))?;
        Ok(Box::new(port))
    }

    fn explain(&self, error: &serialport::Error) -> LinkError {
        use std::io::ErrorKind as Io;
        let port = self.port.clone();
        match error.kind() {
            ErrorKind::Io(Io::NotFound) => LinkError::Missing(port),
            ErrorKind::Io(Io::PermissionDenied) => LinkError::Denied(port),
            // The library's error for a locked port, and on Windows for a missing one.
            ErrorKind::NoDevice if cfg!(unix) => LinkError::Busy(port),
            ErrorKind::NoDevice => LinkError::Missing(port),
            _ => LinkError::Open { port, reason: error.to_string() },
        }
    }
}

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

#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct PortState {
    pub port: String,
    pub refusal: Option<LinkError>,
    pub group: Option<String>,
    pub in_group: Option<bool>,
    pub holder: Option<(String, u32)>,
    /// Latency timer of the USB adapter in ms: how long it waits for more bytes before it passes on a few.
    pub latency_ms: Option<u32>,
    pub latency_file: Option<PathBuf>,
}

impl PortState {
    /// Examines a port, and opens it briefly. `root` is `/`, except in tests.
    pub fn new(options: &PortOptions, root: &Path) -> Self {
        let path = fs::canonicalize(&options.port).unwrap_or_else(|_| PathBuf::from(&options.port));
        let latency_file = latency_file(&path, root);
        let latency_ms = latency_file.as_deref().and_then(|file| {
            fs::read_to_string(file).ok().and_then(|text| text.trim().parse().ok())
        });
        let refusal = options.open().err();
        let is_busy = matches!(refusal, Some(LinkError::Busy(_)));
        let holder = if is_busy { holder(&path, root) } else { None };
        let (port, (group, in_group)) = (options.port.clone(), group(&path, root));
        Self { port, refusal, group, in_group, holder, latency_ms, latency_file }
    }
}

fn latency_file(port: &Path, root: &Path) -> Option<PathBuf> {
    let name = port.file_name()?;
    let file = root.join("sys/bus/usb-serial/devices").join(name).join("latency_timer");
    file.exists().then_some(file)
}

/// Returns a process that has the port open; some processes cannot be seen.
fn holder(port: &Path, root: &Path) -> Option<(String, u32)> {
    for entry in fs::read_dir(root.join("proc")).ok()?.flatten() {
        let Some(id) = entry.file_name().to_str().and_then(|name| name.parse().ok()) else {
            continue;
        };
        if id == std::process::id() {
            continue;
        }
        let Ok(files) = fs::read_dir(entry.path().join("fd")) else { continue };
        let is_open = |file: fs::DirEntry| fs::read_link(file.path()).is_ok_and(|to| to == port);
        if files.flatten().any(is_open) {
            let name = fs::read_to_string(entry.path().join("comm")).unwrap_or_default();
            return Some((name.trim().to_owned(), id));
        }
    }
    None
}

/// Returns the port's group, and whether this process is in it.
#[cfg(unix)]
fn group(port: &Path, root: &Path) -> (Option<String>, Option<bool>) {
    use std::os::unix::fs::MetadataExt;
    let Ok(metadata) = fs::metadata(port) else { return (None, None) };
    let number = metadata.gid().to_string();
    let groups = fs::read_to_string(root.join("etc/group")).unwrap_or_default();
    let name = groups.lines().find_map(|line| {
        let mut fields = line.split(':');
        let name = fields.next()?;
        (fields.nth(1)? == number).then(|| name.to_owned())
    });
    let status = fs::read_to_string(root.join("proc/self/status")).unwrap_or_default();
    let ours = status.lines().find_map(|line| line.strip_prefix("Groups:"));
    let in_group = ours.map(|ours| ours.split_whitespace().any(|group| group == number));
    (name, in_group)
}

#[cfg(not(unix))]
fn group(_: &Path, _: &Path) -> (Option<String>, Option<bool>) {
    (None, None)
}

#[cfg(unix)]
#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::{MetadataExt, symlink};

    #[test]
    fn adapter_holder_and_group_are_read_from_the_files_of_the_system() {
        let dir = tempfile::tempdir().unwrap();
        let at = |path: &str| dir.path().join(path);
        let write = |path: &str, text: &str| {
            fs::create_dir_all(at(path).parent().unwrap()).unwrap();
            fs::write(at(path), text).unwrap();
        };
        write("dev/ttyUSB7", "");
        write("sys/bus/usb-serial/devices/ttyUSB7/latency_timer", "16\n");
        write("proc/4242/comm", "minicom\n");
        fs::create_dir_all(at("proc/4242/fd")).unwrap();
        symlink(fs::canonicalize(at("dev/ttyUSB7")).unwrap(), at("proc/4242/fd/3")).unwrap();
        let gid = fs::metadata(at("dev/ttyUSB7")).unwrap().gid();
        write("etc/group", &format!("root:x:{}:\ndialout:x:{gid}:\n", gid + 1));
        write("proc/self/status", &format!("Name:\tx\nGroups:\t{} \n", gid + 1));
        symlink(at("dev/ttyUSB7"), at("adapter")).unwrap();
        let port = at("adapter").display().to_string();
        let options = PortOptions { port, baud: 57_600, flow_control: FlowControl::None };
        let state = PortState::new(&options, dir.path());
        assert_eq!(state.latency_ms, Some(16));
        assert_eq!((state.group.as_deref(), state.in_group), (Some("dialout"), Some(false)));
        assert!(matches!(state.refusal, Some(LinkError::Open { .. })), "{state:?}");
        let canonical = fs::canonicalize(at("adapter")).unwrap();
        assert_eq!(holder(&canonical, dir.path()), Some(("minicom".to_owned(), 4242)));
        assert_eq!(holder(Path::new("/dev/other"), dir.path()), None);
    }
}
