//! An XBee in API mode at the host, as Digi's programs know it, and the board's XBee at the other end.
//!
//! Both are modules of the series S1 (802.15.4). API frames read and set parameters, of which `AP` and `MY` have an
//! effect. There is no command mode (`+++`), no discovery (`ND`) and no sleep.

use std::collections::BTreeMap;

use shared_proto::xbee::{Address, ApiFrame, Deframer, MAX_PAYLOAD, Mode};

/// Hardware version (`HV`) of an XB24, and the firmware version (`VR`) of 802.15.4 on it.
const HARDWARE: [u8; 2] = [0x17, 0x44];
const FIRMWARE: [u8; 2] = [0x10, 0xEF];

/// First half of Digi's addresses, and the second halves of the modules here.
const SERIAL_HIGH: u32 = 0x0013_A200;
const HERE_LOW: u32 = 0x4100_0001;
const BOARD_LOW: u32 = 0x4100_0002;

/// Addresses for all modules. A module whose own address (`MY`) is 0xFFFF uses its 64-bit address.
const BROADCAST: u16 = 0xFFFF;
const LONG_BROADCAST: u64 = 0xFFFF;

/// Short address that means "unknown" in a frame with both addresses.
const UNKNOWN: u16 = 0xFFFE;

/// Signal strength of the board, −dBm.
const RSSI: u8 = 40;

/// Status codes of answers, and of a transmission that no module acknowledged.
const OK: u8 = 0;
const UNKNOWN_COMMAND: u8 = 2;
const BAD_PARAMETER: u8 = 3;
const NO_ACK: u8 = 1;
const REMOTE_FAILED: u8 = 4;

/// Maximum length of a module's name (`NI`).
const MAX_NAME: usize = 20;

/// A base station in API mode.
#[derive(Clone, Debug)]
pub struct BaseStation {
    mode: Mode,
    deframer: Deframer,
    here: Module,
    board: Module,
}

/// Results of bytes from the host.
#[derive(Debug, Default)]
pub(super) struct Relayed {
    /// Data for the board, one per radio packet.
    pub(super) to_board: Vec<Vec<u8>>,
    /// Frames for the host.
    pub(super) to_host: Vec<u8>,
}

impl BaseStation {
    /// Creates a base station, and a board's module with the address `board`: its `MY` (0xFFFF for the serial number),
    /// or its serial number.
    pub fn new(mode: Mode, board: Address) -> Self {
        let (serial, my) = match board {
            Address::Short(my) => (u64::from(SERIAL_HIGH) << 32 | u64::from(BOARD_LOW), my),
            Address::Long(long) => (long, BROADCAST),
            Address::Zigbee { long, short } => (long, short),
        };
        let mut here = Module::new(u64::from(SERIAL_HIGH) << 32 | u64::from(HERE_LOW), 0, "BASE");
        here.parameters.insert(*b"AP", vec![if mode == Mode::Plain { 1 } else { 2 }]);
        here.parameters.insert(*b"CE", vec![1]);
        let board = Module::new(serial, my, "SHELL");
        Self { mode, deframer: Deframer::new(mode), here, board }
    }

    /// Returns the frames with a packet from the board.
    pub(super) fn receive(&self, packet: &[u8]) -> Vec<u8> {
        let from = match self.board.short() {
            BROADCAST => Address::Long(self.board.long()),
            short => Address::Short(short),
        };
        let frame = |payload| ApiFrame::Receive { from, rssi: Some(RSSI), payload };
        packet.chunks(MAX_PAYLOAD).flat_map(|payload| encoded(&frame(payload), self.mode)).collect()
    }

    /// Takes bytes from the host.
    pub(super) fn take(&mut self, bytes: &[u8]) -> Relayed {
        let mut relayed = Relayed::default();
        let Self { mode, deframer, here, board } = self;
        let mut obey = |frame: ApiFrame<'_>| match frame {
            ApiFrame::Transmit { id, to, payload } => {
                let heard = match to {
                    Address::Short(to) => to == BROADCAST || to == board.short(),
                    Address::Long(to) => to == LONG_BROADCAST || to == board.long(),
                    // The series S1 does not know this frame.
                    Address::Zigbee { .. } => return,
                };
                if heard {
                    relayed.to_board.push(payload.to_vec());
                }
                if id != 0 {
                    let status = if heard { OK } else { NO_ACK };
                    relayed.to_host.extend(encoded(&ApiFrame::Sent { id, status }, *mode));
                }
            }
            ApiFrame::Command { id, to, name, value } => {
                let (status, value) = match to {
                    None => here.run(name, value),
                    Some(to) if board.is_at(to) => board.run(name, value),
                    Some(_) => (REMOTE_FAILED, Vec::new()),
                };
                if id != 0 {
                    let from = to.map(|_| (board.long(), board.short()));
                    let answer = ApiFrame::Answer { id, from, name, status, value: &value };
                    relayed.to_host.extend(encoded(&answer, *mode));
                }
            }
            _ => {}
        };
        deframer.feed(bytes, &mut obey);
        // A host writes whole frames, so no further byte of a frame will come.
        deframer.rest(obey);
        let set = if here.number(b"AP") == 1 { Mode::Plain } else { Mode::Escaped };
        if set != *mode {
            (*mode, *deframer) = (set, Deframer::new(set));
        }
        relayed
    }
}

fn encoded(frame: &ApiFrame<'_>, mode: Mode) -> Vec<u8> {
    frame.encode(mode).map_or_else(Vec::new, |bytes| bytes.to_vec())
}

/// A radio module with its parameters, big-endian numbers or text.
#[derive(Clone, Debug)]
struct Module {
    parameters: BTreeMap<[u8; 2], Vec<u8>>,
}

impl Module {
    fn new(serial: u64, my: u16, name: &str) -> Self {
        let (high, low) = ((serial >> 32) as u32, serial as u32);
        // As delivered, except for the board's rate of 57,600 baud.
        let parameters: [(_, &[u8]); 20] = [
            (*b"AP", &[0]),
            (*b"A1", &[0]),
            (*b"A2", &[0]),
            (*b"BD", &[0, 0, 0, 6]),
            (*b"CE", &[0]),
            (*b"CH", &[0x0C]),
            (*b"DB", &[RSSI]),
            (*b"DH", &[0; 4]),
            (*b"DL", &[0; 4]),
            (*b"HV", &HARDWARE),
            (*b"ID", &[0x33, 0x32]),
            (*b"MM", &[0]),
            (*b"MY", &my.to_be_bytes()),
            (*b"NI", name.as_bytes()),
            (*b"PL", &[4]),
            (*b"RO", &[3]),
            (*b"SH", &high.to_be_bytes()),
            (*b"SL", &low.to_be_bytes()),
            (*b"SM", &[0]),
            (*b"VR", &FIRMWARE),
        ];
        let parameters = parameters.into_iter().map(|(name, value)| (name, value.to_vec()));
        Self { parameters: parameters.collect() }
    }

    fn number(&self, name: &[u8; 2]) -> u64 {
        let bytes = self.parameters.get(name).into_iter().flatten();
        bytes.fold(0, |number, &byte| number << 8 | u64::from(byte))
    }

    fn long(&self) -> u64 {
        self.number(b"SH") << 32 | self.number(b"SL")
    }

    fn short(&self) -> u16 {
        self.number(b"MY") as u16
    }

    /// Returns true if a frame with both addresses is for this module; a known long address decides.
    fn is_at(&self, (long, short): (u64, u16)) -> bool {
        match long {
            u64::MAX | 0 => short != UNKNOWN && short == self.short(),
            LONG_BROADCAST => true,
            long => long == self.long(),
        }
    }

    /// Reads a parameter, or sets it if there is a value; returns status and value of the answer.
    fn run(&mut self, name: [u8; 2], value: &[u8]) -> (u8, Vec<u8>) {
        // Commands to keep the parameters and to apply them have no effect here.
        if matches!(&name, b"WR" | b"AC") {
            return (OK, Vec::new());
        }
        let Some(parameter) = self.parameters.get_mut(&name) else {
            return (UNKNOWN_COMMAND, Vec::new());
        };
        if value.is_empty() {
            return (OK, parameter.clone());
        }
        let is_text = &name == b"NI";
        let most = if is_text { MAX_NAME } else { parameter.len() };
        let is_valid = match &name {
            b"HV" | b"VR" | b"SH" | b"SL" | b"DB" => false,
            // Without API frames (`AP` 0) there would only be command mode.
            b"AP" => matches!(value, [1 | 2]),
            _ => value.len() <= most,
        };
        if !is_valid {
            return (BAD_PARAMETER, Vec::new());
        }
        let zeros = if is_text { 0 } else { most - value.len() };
        *parameter = [vec![0; zeros], value.to_vec()].concat();
        (OK, Vec::new())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MODES: [Mode; 2] = [Mode::Plain, Mode::Escaped];

    /// Asks the base station for a parameter; returns the status and the value.
    fn ask(
        station: &mut BaseStation,
        mode: Mode,
        to: Option<(u64, u16)>,
        name: &[u8; 2],
        value: &[u8],
    ) -> (u8, Vec<u8>) {
        let command = ApiFrame::Command { id: 9, to, name: *name, value };
        let answer = station.take(&command.encode(mode).unwrap()).to_host;
        let mut found = None;
        Deframer::new(mode).feed(&answer, |frame| match frame {
            ApiFrame::Answer { id: 9, name: of, status, value, .. } if of == *name => {
                found = Some((status, value.to_vec()));
            }
            other => panic!("{other:?}"),
        });
        found.unwrap()
    }

    #[test]
    fn parameters_are_read_and_set_and_the_mode_changes_after_the_answer() {
        let mut station = BaseStation::new(Mode::Plain, Address::Short(0x2052));
        let mut ask = |mode, name, value: &[u8]| ask(&mut station, mode, None, name, value);
        assert_eq!(ask(Mode::Plain, b"AP", &[]), (OK, vec![1]));
        assert_eq!(ask(Mode::Plain, b"ID", &[7]), (OK, vec![]));
        assert_eq!(ask(Mode::Plain, b"ID", &[]), (OK, vec![0, 7]));
        assert_eq!(ask(Mode::Plain, b"SL", &[1, 2, 3, 4]), (BAD_PARAMETER, vec![]));
        assert_eq!(ask(Mode::Plain, b"AP", &[0]), (BAD_PARAMETER, vec![]));
        assert_eq!(ask(Mode::Plain, b"AO", &[]), (UNKNOWN_COMMAND, vec![]));
        assert_eq!(ask(Mode::Plain, b"AP", &[2]), (OK, vec![]));
        assert_eq!(ask(Mode::Escaped, b"SH", &[]), (OK, vec![0x00, 0x13, 0xA2, 0x00]));
    }

    #[test]
    fn the_module_at_the_board_is_reached_by_either_address_and_no_other_is() {
        for mode in MODES {
            let mut station = BaseStation::new(mode, Address::Short(0x2052));
            let long = station.board.long();
            for to in [(long, UNKNOWN), (u64::MAX, 0x2052)] {
                assert_eq!(ask(&mut station, mode, Some(to), b"NI", &[]), (OK, b"SHELL".to_vec()));
            }
            let (status, _) = ask(&mut station, mode, Some((long + 1, UNKNOWN)), b"NI", &[]);
            assert_eq!(status, REMOTE_FAILED);
            for (to, heard) in [
                (Address::Short(0x2052), true),
                (Address::Short(BROADCAST), true),
                (Address::Short(0x2053), false),
                (Address::Long(long), true),
                (Address::Long(LONG_BROADCAST), true),
                (Address::Long(long + 1), false),
            ] {
                let sent = ApiFrame::Transmit { id: 5, to, payload: b"data" };
                let Relayed { to_board, to_host } = station.take(&sent.encode(mode).unwrap());
                assert_eq!(to_board, vec![b"data".to_vec(); usize::from(heard)]);
                let status = if heard { OK } else { NO_ACK };
                assert_eq!(to_host, encoded(&ApiFrame::Sent { id: 5, status }, mode));
            }
        }
    }

    #[test]
    fn data_come_from_the_address_that_the_module_has() {
        let mut station = BaseStation::new(Mode::Escaped, Address::Short(BROADCAST));
        let sender = |station: &BaseStation| {
            let mut senders = Vec::new();
            let bytes = station.receive(&[0x7E; MAX_PAYLOAD + 1]);
            Deframer::new(Mode::Escaped).feed(&bytes, |frame| {
                let ApiFrame::Receive { from, rssi: Some(RSSI), payload } = frame else {
                    panic!("{frame:?}")
                };
                senders.push((from, payload.len()));
            });
            senders
        };
        let long = Address::Long(station.board.long());
        assert_eq!(sender(&station), [(long, MAX_PAYLOAD), (long, 1)]);
        let to = Some((station.board.long(), UNKNOWN));
        assert_eq!(ask(&mut station, Mode::Escaped, to, b"MY", &[0x20, 0x52]), (OK, vec![]));
        let short = Address::Short(0x2052);
        assert_eq!(sender(&station), [(short, MAX_PAYLOAD), (short, 1)]);
    }
}
