//! `shellcal ports`: the serial ports of this computer.

use board_link::ports;

use crate::outcome::Outcome;
use crate::printer::Printer;

#[derive(Debug, clap::Args)]
pub(crate) struct PortsArgs {}

impl PortsArgs {
    pub(crate) fn run(&self, printer: &mut Printer) -> anyhow::Result<Outcome> {
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
