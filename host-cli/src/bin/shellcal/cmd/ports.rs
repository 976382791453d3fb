//! Serial ports: `shellcal ports` lists them; and whether a name on the command line is that of one.

use std::path::Path;

use board_link::{TCP, ports};

use crate::printer::Printer;

#[derive(Debug, clap::Args)]
pub(crate) struct PortsArgs {}

impl PortsArgs {
    pub(crate) fn run(&self, printer: &Printer) -> anyhow::Result<()> {
        let ports = ports()?;
        printer.finish(&ports, |printer| {
            if ports.is_empty() {
                printer.note("no serial ports; is the adapter plugged in?");
            }
            ports.iter().try_for_each(|port| {
                let serial = port.serial.as_deref().map(|serial| format!("serial {serial}"));
                let description = (!port.description.is_empty()).then(|| port.description.clone());
                let parts =
                    [Some(port.port.clone()), Some(port.kind.to_owned()), description, serial];
                printer.line(parts.into_iter().flatten().collect::<Vec<_>>().join("  "))
            })
        })
    }
}

/// Whether a name is that of a port, there or not.
pub(super) fn is_port(path: &Path) -> bool {
    if let Ok(metadata) = std::fs::metadata(path) {
        return is_device(&metadata);
    }
    let text = path.to_string_lossy();
    let is_com = text.strip_prefix("COM").is_some_and(|rest| rest.parse::<u16>().is_ok());
    is_com || text.starts_with("/dev/") || text.starts_with(TCP)
}

#[cfg(unix)]
fn is_device(metadata: &std::fs::Metadata) -> bool {
    use std::os::unix::fs::FileTypeExt;
    metadata.file_type().is_char_device()
}

#[cfg(not(unix))]
fn is_device(metadata: &std::fs::Metadata) -> bool {
    !metadata.is_file() && !metadata.is_dir()
}
