//! The boards behind a port, each with its own stream. A base station in API mode names each packet's module, so
//! modules are decoded separately. Behind a transparent base station, packets name their board from version 3 of the
//! protocol on.

use std::collections::VecDeque;
use std::time::Duration;

use super::reception::{BoardFrame, Losses, Reception};
use shared_proto::xbee::{Address, ApiFrame, Deframer, Mode};
use shared_proto::{Decoder, Event, Framing, Protocol, Status, skinproc};

/// Maximum number of modules, and of boards: more than a radio channel has capacity for.
const MOST: usize = 256;

#[derive(Clone, Debug)]
pub(crate) struct PacketWire {
    framing: Framing,
    /// For a base station in API mode.
    deframer: Option<Deframer>,
    /// A second decoder, for frames with escapes, while all bytes so far mean the same in both modes, as most bytes do.
    escaped: Option<EscapedFrames>,
    /// One decoder per module behind the base station, or the single decoder of a wire or transparent radio.
    modules: Vec<(Option<Address>, Decoder)>,
}

#[derive(Clone, Debug)]
struct EscapedFrames {
    deframer: Deframer,
    /// Frames decoded with escapes, but not yet without.
    ahead: VecDeque<(Address, Option<u8>, Vec<u8>)>,
    /// Number of frames decoded without escapes, but not yet with them. One such frame may only lack a byte: with
    /// escapes, a checksum of 0x7D is 0x7D 0x5D.
    behind: usize,
}

impl PacketWire {
    /// Creates a wire with this framing. Framing without escapes changes to framing with escapes at the first escape.
    pub(crate) fn new(framing: Framing) -> Self {
        let deframer = match framing {
            Framing::Cobs => None,
            Framing::Xbee(mode) => Some(Deframer::new(mode)),
        };
        let is_plain = framing == Framing::Xbee(Mode::Plain);
        let escaped = is_plain.then(|| EscapedFrames {
            deframer: Deframer::new(Mode::Escaped),
            ahead: VecDeque::new(),
            behind: 0,
        });
        Self { framing, deframer, escaped, modules: Vec::new() }
    }

    /// Decodes bytes, in slices of any size. `sink` gets every event, with the address and signal
    /// strength of its module if known.
    pub(crate) fn feed(
        &mut self,
        bytes: &[u8],
        mut sink: impl FnMut(Option<Address>, Option<u8>, Event),
    ) {
        let Self { framing, deframer, escaped, modules } = self;
        let mut feed = |address, rssi, payload: &[u8]| {
            let known = modules.iter().position(|(known, _)| *known == address);
            let at = known.unwrap_or_else(|| {
                modules.truncate(MOST);
                modules.push((address, Decoder::new(Framing::Cobs)));
                modules.len() - 1
            });
            modules[at].1.feed(payload, |event| sink(address, rssi, event));
        };
        let Some(deframer) = deframer else { return feed(None, None, bytes) };
        let mut both = escaped.take();
        if let Some(EscapedFrames { deframer, ahead, behind }) = &mut both {
            deframer.feed(bytes, |frame| match frame {
                ApiFrame::Receive { .. } if *behind > 0 => *behind -= 1,
                ApiFrame::Receive { from, rssi, payload } => {
                    ahead.push_back((from, rssi, payload.to_vec()));
                }
                _ => {}
            });
        }
        deframer.feed(bytes, |frame| {
            let ApiFrame::Receive { from, rssi, payload } = frame else { return };
            if let Some(EscapedFrames { ahead, behind, .. }) = &mut both {
                let is_this = |(address, strength, data): &(Address, Option<u8>, Vec<u8>)| {
                    (*address, *strength, &data[..]) == (from, rssi, payload)
                };
                match ahead.iter().position(is_this) {
                    Some(0) => drop(ahead.pop_front()),
                    // The frames before it were decoded only with escapes, so all of `ahead` are taken below, in order.
                    Some(_) => return,
                    None => *behind += 1,
                }
            }
            feed(Some(from), rssi, payload);
        });
        match both.filter(|both| both.behind <= 1) {
            Some(EscapedFrames { deframer: other, ahead, behind })
                if deframer.damaged > 0
                    && (!ahead.is_empty() || other.damaged == 0 && behind == 0) =>
            {
                *framing = Framing::Xbee(Mode::Escaped);
                *deframer = other;
                ahead.into_iter().for_each(|(from, rssi, data)| feed(Some(from), rssi, &data));
            }
            undecided => *escaped = undecided,
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BoardSource {
    /// Address of the module, if the base station is in API mode.
    pub address: Option<Address>,
    /// The board's name in its packets, behind a transparent base station.
    pub board: Option<u16>,
}

#[derive(Clone, Debug)]
pub struct HeardBoard {
    pub sender: BoardSource,
    pub frames: Vec<BoardFrame>,
    pub(crate) reception: Reception,
    pub(crate) heard_at: Option<Duration>,
    /// The initial state of the stream, if this program started it.
    pub(crate) started: Option<Status>,
}

#[derive(Clone, Debug)]
pub struct Boards {
    wire: Wire,
    /// The boards in the order in which they were first heard.
    pub heard: Vec<HeardBoard>,
    /// Packets of boards beyond [`MOST`].
    beyond: u64,
}

#[derive(Clone, Debug)]
enum Wire {
    Packets(Box<PacketWire>),
    Original(skinproc::Decoder),
}

impl Boards {
    pub fn new(protocol: Protocol) -> Self {
        let wire = match protocol {
            Protocol::Packets(framing) => Wire::Packets(Box::new(PacketWire::new(framing))),
            Protocol::Original => Wire::Original(skinproc::Decoder::new()),
        };
        Self { wire, heard: Vec::new(), beyond: 0 }
    }

    /// Returns the protocol. Its framing changes to one with escapes when the first escape arrives.
    pub fn protocol(&self) -> Protocol {
        match &self.wire {
            Wire::Packets(wire) => Protocol::Packets(wire.framing),
            Wire::Original(_) => Protocol::Original,
        }
    }

    /// Decodes bytes, in slices of any size, with their arrival time if known, see [`Reception::arrived_at`].
    pub fn feed(&mut self, bytes: &[u8], arrival: Option<Duration>) {
        let Self { wire, heard, beyond } = self;
        let take = |address: Option<Address>, rssi, event: Event| {
            let Event::Packet(received) = event else { return };
            let board = received.origin.map(|origin| origin.board).filter(|_| address.is_none());
            match board_of(heard, BoardSource { address, board }) {
                None => *beyond += 1,
                Some(HeardBoard { frames, reception, heard_at, .. }) => {
                    *heard_at = arrival;
                    arrival.into_iter().for_each(|now| reception.arrived_at(now));
                    reception.take(received, rssi, frames);
                }
            }
        };
        match wire {
            Wire::Packets(packets) => packets.feed(bytes, take),
            Wire::Original(decoder) => {
                let Some(HeardBoard { frames, reception, .. }) =
                    board_of(heard, BoardSource::default())
                else {
                    return;
                };
                decoder.feed(bytes, |scan| reception.take_scan(&scan, frames));
            }
        }
    }

    /// Ends the stream: releases the original board's last scan, see also [`Reception::finish`].
    pub fn finish(&mut self) {
        if let (Wire::Original(decoder), [board]) = (&mut self.wire, &mut self.heard[..]) {
            decoder.finish(|scan| board.reception.take_scan(&scan, &mut board.frames));
        }
        // Next to other boards, a single frame may be damage.
        let is_alone = self.heard.len() == 1;
        for board in &mut self.heard {
            if is_alone || board.reception.has_begun() {
                board.reception.finish(&mut board.frames);
            }
        }
    }

    /// Returns the losses of a board. On a wire, damaged bytes cannot be attributed to a board.
    pub fn losses_of(&self, sender: BoardSource) -> Losses {
        let board = self.heard.iter().find(|board| board.sender == sender);
        let mut losses = board.map(|board| board.reception.losses()).unwrap_or_default();
        if let (Wire::Packets(packets), Some(_)) = (&self.wire, sender.address) {
            let module = packets.modules.iter().find(|(module, _)| *module == sender.address);
            module.into_iter().for_each(|(_, decoder)| losses += damage(decoder));
        }
        losses
    }

    pub fn losses(&self) -> Losses {
        let mut losses = Losses { unknown: self.beyond, ..Losses::default() };
        self.heard.iter().for_each(|board| losses += board.reception.losses());
        match &self.wire {
            Wire::Packets(wire) => {
                let PacketWire { deframer, modules, .. } = &**wire;
                losses.damaged += deframer.as_ref().map_or(0, |deframer| deframer.damaged);
                modules.iter().for_each(|(_, decoder)| losses += damage(decoder));
            }
            Wire::Original(decoder) => {
                let Losses { restarts, .. } = losses;
                return Losses { restarts, skipped_bytes: decoder.skipped, ..Losses::default() };
            }
        }
        losses
    }
}

/// Finds or adds a board; `None` if there are too many.
fn board_of(heard: &mut Vec<HeardBoard>, sender: BoardSource) -> Option<&mut HeardBoard> {
    let known = heard.iter().position(|board| board.sender == sender);
    if known.is_none() && heard.len() < MOST {
        let (frames, reception) = (Vec::new(), Reception::default());
        heard.push(HeardBoard { sender, frames, reception, heard_at: None, started: None });
    }
    let at = known.unwrap_or(heard.len() - 1);
    heard.get_mut(at).filter(|board| board.sender == sender)
}

fn damage(decoder: &Decoder) -> Losses {
    let counters = decoder.counters;
    Losses {
        bad_crc: counters.bad_crc,
        damaged: counters.malformed,
        unknown: counters.unknown_version + counters.unknown_kind,
        ..Losses::default()
    }
}

impl BoardSource {
    pub(crate) fn text(self) -> String {
        // Hexadecimal, as in `X-CTU` and the manuals.
        match self.address {
            Some(Address::Short(short)) => format!("{short:04x}"),
            Some(Address::Long(long) | Address::Zigbee { long, .. }) => format!("{long:016x}"),
            None => self.board.map_or_else(String::new, |board| format!("{board:04x}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use shared_proto::{Packet, PacketOrigin, Sample, Values};

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

    /// Bytes of boards that take turns; their modules cut the streams into pieces of `cut` bytes.
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
    fn every_board_has_a_separate_stream() {
        let addresses = [Address::Short(0x2052), Address::Short(0x2053), Address::Long(7)];
        for mode in [Mode::Plain, Mode::Escaped] {
            for cut in [1, 13, 30, 37, 100] {
                let sent: Vec<_> = addresses
                    .iter()
                    .zip([0..50, 20..90, 7..9])
                    .zip(1..)
                    .map(|((&from, frames), board)| (from, bytes_of(board, frames)))
                    .collect();
                let bytes = on_the_air(mode, &sent, cut);
                let mut boards = Boards::new(Protocol::Packets(Framing::Xbee(mode)));
                bytes.chunks(11).for_each(|bytes| boards.feed(bytes, None));
                boards.finish();
                let found: Vec<_> = boards.heard.iter().map(|board| board.sender.address).collect();
                assert_eq!(found, addresses.map(Some));
                for (board, (number, frames)) in
                    boards.heard.iter().zip([(1, 0..50), (2, 20..90), (3, 7..9)])
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

    /// Most frames read the same in both modes, since the packets' masks avoid escapes.
    #[test]
    fn a_stream_that_looks_plain_loses_nothing_at_its_first_escape() {
        // The escape is in the signal strength, in the length of the frames, or in both.
        for (rssi, cut) in
            [(0x11, 30), (0x7E, 30), (47, 0x11 - 5), (47, 0x13 - 5), (0x7D, 0x13 - 5)]
        {
            let mut bytes = Vec::new();
            for (rssi, cut, frames) in [(47, 30, 0..20), (rssi, cut, 20..60)] {
                for payload in bytes_of(3, frames).chunks(cut) {
                    let frame =
                        ApiFrame::Receive { from: Address::Short(9), rssi: Some(rssi), payload };
                    bytes.extend(frame.encode(Mode::Escaped).unwrap().iter());
                }
            }
            for slice in [1, 11, 4096] {
                let mut boards = Boards::new(Protocol::Packets(Framing::Xbee(Mode::Plain)));
                bytes.chunks(slice).for_each(|bytes| boards.feed(bytes, None));
                boards.finish();
                let indices: Vec<i64> =
                    boards.heard[0].frames.iter().map(|frame| frame.index).collect();
                assert_eq!(indices, (0..60).collect::<Vec<_>>(), "{rssi} {cut} {slice}");
                assert_eq!((boards.losses(), boards.heard.len()), (Losses::default(), 1));
                assert_eq!(boards.protocol(), Protocol::Packets(Framing::Xbee(Mode::Escaped)));
            }
        }
    }

    /// A single escape in the middle of a slice, and a checksum of 0x7D: the frame is valid in both modes, but only in
    /// one does the byte after it belong to it.
    #[test]
    fn one_escape_shows_the_mode_wherever_it_is() {
        let frame = |rssi: u8, payload: &[u8]| {
            let frame = ApiFrame::Receive { from: Address::Short(9), rssi: Some(rssi), payload };
            frame.encode(Mode::Escaped).unwrap().to_vec()
        };
        let payloads = bytes_of(3, 0..60);
        let payloads: Vec<_> = payloads.chunks(30).collect();
        let middle = payloads.len() / 2;
        let checksum = (0..=255).find(|&rssi| frame(rssi, payloads[middle]).ends_with(b"\x7D\x5D"));
        for rssi in [0x11, 0x7E, checksum.unwrap()] {
            let frames = payloads.iter().enumerate();
            let bytes: Vec<u8> = frames
                .flat_map(|(at, payload)| frame(if at == middle { rssi } else { 47 }, payload))
                .collect();
            for slice in [1, 11, 4096] {
                let mut boards = Boards::new(Protocol::Packets(Framing::Xbee(Mode::Plain)));
                bytes.chunks(slice).for_each(|bytes| boards.feed(bytes, None));
                boards.finish();
                let frames = &boards.heard[0].frames;
                let indices: Vec<i64> = frames.iter().map(|frame| frame.index).collect();
                assert_eq!(indices, (0..60).collect::<Vec<_>>(), "{rssi} {slice}");
                assert_eq!(boards.losses(), Losses::default(), "{rssi} {slice}");
                assert_eq!(boards.protocol(), Protocol::Packets(Framing::Xbee(Mode::Escaped)));
            }
        }
    }

    #[test]
    fn boards_on_one_transparent_link_have_separate_streams_and_damage_adds_no_board() {
        let packet = |sequence: u16, board| {
            let sample = Sample {
                sequence,
                clock_us: u32::from(sequence) * 10_000 + u32::from(board),
                values: Values::Readings([board; 8]),
                saturated: 0,
                dropped: 0,
            };
            Packet::Sample(sample).encode_from(PacketOrigin { board, start: board }).to_vec()
        };
        let mut boards = Boards::new(Protocol::Packets(Framing::Cobs));
        for sequence in 0..50 {
            [7, 9].into_iter().for_each(|board| boards.feed(&packet(sequence, board), None));
            if sequence == 20 {
                boards.feed(&packet(21, 11), None);
            }
        }
        boards.finish();
        let frames: Vec<_> = boards.heard.iter().map(|board| board.frames.len()).collect();
        assert_eq!(frames, [50, 50, 0]);
        assert_eq!(boards.losses(), Losses::default());
    }

    #[test]
    fn losses_of_all_boards_are_added_up() {
        let missing = [bytes_of(1, 0..3), bytes_of(1, 5..6)].concat();
        let sent = [(Address::Short(1), missing.clone()), (Address::Short(2), missing)];
        let mut boards = Boards::new(Protocol::Packets(Framing::Xbee(Mode::Plain)));
        boards.feed(&on_the_air(Mode::Plain, &sent, 30), None);
        assert_eq!((boards.losses().missing, boards.losses().gaps), (4, 2));
    }
}
