//! The boards that a port leads to: one, or all that a base station in API mode hears.
//!
//! Boards number their samples and cut their frames each for itself, so every address has a stream of
//! its own.

use std::time::Duration;

use shared_proto::xbee::{Address, ApiFrame, Deframer};
use shared_proto::{Framing, Protocol};

use super::reception::{BoardFrame, Losses, Reception};

/// Most boards that are told apart: more than a channel has room for.
const MOST: usize = 256;

/// A board that is heard.
#[derive(Clone, Debug)]
pub struct HeardBoard {
    /// Of its module, where the base station is in API mode.
    pub address: Option<Address>,
    /// Frames that nobody has taken yet.
    pub frames: Vec<BoardFrame>,
    reception: Reception,
}

/// Turns the bytes of a port into the frames of each board.
#[derive(Clone, Debug)]
pub struct Boards {
    /// Of a base station in API mode.
    deframer: Option<Deframer>,
    heard: Vec<HeardBoard>,
    arrival: Option<Duration>,
    /// Packets of boards beyond [`MOST`].
    beyond: u64,
}

impl HeardBoard {
    fn new(address: Option<Address>, protocol: Protocol) -> Self {
        Self { address, frames: Vec::new(), reception: Reception::new(protocol) }
    }

    /// Its books.
    pub fn reception(&self) -> &Reception {
        &self.reception
    }

    fn feed(&mut self, bytes: &[u8], rssi: Option<u8>, arrival: Option<Duration>) {
        if let Some(arrival) = arrival {
            self.reception.arrived_at(arrival);
        }
        self.reception.received_with(rssi);
        self.reception.feed(bytes, &mut self.frames);
    }
}

impl Boards {
    /// Nothing has arrived.
    pub fn new(protocol: Protocol) -> Self {
        let (deframer, heard) = match protocol {
            Protocol::Packets(Framing::Xbee(mode)) => (Some(Deframer::new(mode)), Vec::new()),
            wire => (None, vec![HeardBoard::new(None, wire)]),
        };
        Self { deframer, heard, arrival: None, beyond: 0 }
    }

    /// Says when the bytes arrive that are fed from now on, see [`Reception::arrived_at`].
    pub fn arrived_at(&mut self, now: Duration) {
        self.arrival = Some(now);
    }

    /// Takes bytes, in slices of any size.
    pub fn feed(&mut self, bytes: &[u8]) {
        let Self { deframer, heard, arrival, beyond } = self;
        let Some(deframer) = deframer else {
            return heard.iter_mut().for_each(|board| board.feed(bytes, None, *arrival));
        };
        deframer.feed(bytes, |frame| {
            let ApiFrame::Receive { from, rssi, payload } = frame else { return };
            let known = heard.iter().position(|board| board.address == Some(from));
            if known.is_none() && heard.len() >= MOST {
                *beyond += 1;
                return;
            }
            let at = known.unwrap_or_else(|| {
                heard.push(HeardBoard::new(Some(from), Protocol::Packets(Framing::Cobs)));
                heard.len() - 1
            });
            heard[at].feed(payload, rssi, *arrival);
        });
    }

    /// Ends the stream, see [`Reception::finish`].
    pub fn finish(&mut self) {
        self.heard.iter_mut().for_each(|board| board.reception.finish(&mut board.frames));
    }

    /// The boards, in the order in which they were first heard.
    pub fn heard(&self) -> &[HeardBoard] {
        &self.heard
    }

    /// As [`heard`](Self::heard), for who takes their frames.
    pub(crate) fn heard_mut(&mut self) -> &mut [HeardBoard] {
        &mut self.heard
    }

    /// What all of them have lost so far.
    pub fn losses(&self) -> Losses {
        let mut losses = Losses::default();
        self.heard.iter().for_each(|board| losses += board.reception.losses());
        losses.damaged += self.deframer.as_ref().map_or(0, |deframer| deframer.damaged);
        losses.unknown += self.beyond;
        losses
    }
}

/// An address in hexadecimal digits, as `X-CTU` and the manuals write them.
pub(crate) fn address_text(address: Address) -> String {
    match address {
        Address::Short(short) => format!("{short:04x}"),
        Address::Long(long) | Address::Zigbee { long, .. } => format!("{long:016x}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_proto::xbee::Mode;
    use shared_proto::{Packet, Sample, Values};

    fn bytes_of(board: u16, frames: std::ops::Range<u16>) -> Vec<u8> {
        let packets = frames.map(|sequence| {
            Packet::Sample(Sample {
                sequence,
                clock_us: u32::from(sequence) * 10_000,
                values: Values::Readings([board; 8]),
                saturated: 0,
                dropped: 0,
            })
        });
        packets.flat_map(|packet| packet.encode().to_vec()).collect()
    }

    /// Boards whose modules cut their streams anywhere, and take turns.
    fn on_the_air(mode: Mode, boards: &[(Address, Vec<u8>)], cut: usize) -> Vec<u8> {
        let mut pieces: Vec<_> = boards.iter().map(|(from, b)| (*from, b.chunks(cut))).collect();
        let mut bytes = Vec::new();
        loop {
            let before = bytes.len();
            for (from, pieces) in &mut pieces {
                let Some(payload) = pieces.next() else { continue };
                let frame = ApiFrame::Receive { from: *from, rssi: Some(47), payload };
                bytes.extend(frame.encode(mode).unwrap().iter());
            }
            if bytes.len() == before {
                return bytes;
            }
        }
    }

    #[test]
    fn every_board_has_a_stream_of_its_own() {
        let addresses = [Address::Short(0x2052), Address::Short(0x2053), Address::Long(7)];
        for mode in [Mode::Plain, Mode::Escaped] {
            for cut in [1, 13, 30, 37, 100] {
                let sent: Vec<_> = addresses
                    .iter()
                    .zip([0..50, 20..90, 7..8])
                    .zip(1..)
                    .map(|((&from, frames), board)| (from, bytes_of(board, frames)))
                    .collect();
                let bytes = on_the_air(mode, &sent, cut);
                let mut boards = Boards::new(Protocol::Packets(Framing::Xbee(mode)));
                bytes.chunks(11).for_each(|bytes| boards.feed(bytes));
                let found: Vec<_> = boards.heard().iter().map(|board| board.address).collect();
                assert_eq!(found, addresses.map(Some));
                for (board, (number, frames)) in
                    boards.heard().iter().zip([(1, 0..50), (2, 20..90), (3, 7..8)])
                {
                    let indices: Vec<i64> = board.frames.iter().map(|frame| frame.index).collect();
                    assert_eq!(indices, frames.collect::<Vec<_>>());
                    for frame in &board.frames {
                        let reading = f64::from(number) / 16.0;
                        assert_eq!(frame.measured, super::super::Measured::Readings([reading; 8]));
                        assert_eq!(frame.rssi_dbm, Some(-47));
                    }
                }
                assert_eq!(boards.losses(), Losses::default());
            }
        }
    }

    #[test]
    fn losses_of_all_boards_are_added_up() {
        let missing = [bytes_of(1, 0..3), bytes_of(1, 5..6)].concat();
        let sent = [(Address::Short(1), missing.clone()), (Address::Short(2), missing)];
        let mut boards = Boards::new(Protocol::Packets(Framing::Xbee(Mode::Plain)));
        boards.feed(&on_the_air(Mode::Plain, &sent, 30));
        assert_eq!((boards.losses().missing, boards.losses().gaps), (4, 2));
    }
}
