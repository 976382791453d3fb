//! API frames of an XBee, which a base station in API mode sends and receives.
//!
//! A frame is 0x7E, a big-endian length, that many bytes of data and a checksum that makes the sum of data and
//! checksum 0xFF. With escapes (AP=2), 0x7E, 0x7D, 0x11 and 0x13 after the start are sent as 0x7D and the byte XOR
//! 0x20, so that 0x7E always starts a frame; without (AP=1) it can occur anywhere. Source: Digi, "XBee/XBee-PRO S1
//! 802.15.4 (Legacy) User Guide", 90000982, chapter "API operation"; for 0x10, 0x90 and 0x91 the "XBee/XBee-PRO S2C
//! Zigbee User Guide", 90002002.

use crate::field::{Bytes, Reader};
use crate::frame::is_escaped;

/// Maximum data bytes in one radio packet of an 802.15.4 XBee.
pub const MAX_PAYLOAD: usize = 100;

const START: u8 = 0x7E;
const ESCAPE: u8 = 0x7D;
const ESCAPED_BY: u8 = 0x20;

/// Maximum number of bytes before the payload.
const MAX_HEADER: usize = 15;

/// An encoded frame; in the worst case every byte but the start is escaped.
pub type Encoded = Bytes<{ 1 + 2 * (2 + MAX_HEADER + MAX_PAYLOAD + 1) }>;

/// Endpoints, cluster and profile of data in a frame of kind 0x91; other messages of a network have others.
const DATA_CLUSTER: [u8; 6] = [0xE8, 0xE8, 0x00, 0x11, 0xC1, 0x05];

/// The module's API mode (parameter AP).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// AP=1.
    Plain,
    /// AP=2: with escapes.
    Escaped,
}

/// A module's address.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "a variant says what its fields are")]
pub enum Address {
    /// 16 bits (802.15.4: frames 0x01, 0x81).
    Short(u16),
    /// 64 bits (802.15.4: frames 0x00, 0x80).
    Long(u64),
    /// Both (Zigbee and DigiMesh: frames 0x10, 0x90); the short one is 0xFFFE if unknown.
    Zigbee { long: u64, short: u16 },
}

/// One API frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[expect(missing_docs, reason = "a variant says what its fields are")]
pub enum ApiFrame<'a> {
    /// Data to the other side, at most [`MAX_PAYLOAD`] bytes: 0x00, 0x01 or 0x10, by address. The status repeats the
    /// id; 0 requests none.
    Transmit { id: u8, to: Address, payload: &'a [u8] },
    /// Data from the other side: 0x80, 0x81, or 0x90 and 0x91, by address. Signal strength in −dBm, absent in Zigbee.
    Receive { from: Address, rssi: Option<u8>, payload: &'a [u8] },
    /// Fate of a transmission, 0 if it was received: 0x89.
    Sent { id: u8, status: u8 },
    /// Reads a parameter of the host's module, or sets it to a value: 0x08, or 0x09. With an address (64 and 16 bits),
    /// does so at a module on the other side: 0x17.
    Command { id: u8, to: Option<(u64, u16)>, name: [u8; 2], value: &'a [u8] },
    /// Answer to a command, with status 0 unless it was refused: 0x88 or 0x97.
    Answer { id: u8, from: Option<(u64, u16)>, name: [u8; 2], status: u8, value: &'a [u8] },
}

impl<'a> ApiFrame<'a> {
    /// Parses the bytes between length and checksum; `None` for another kind or too few bytes.
    pub fn parse(data: &'a [u8]) -> Option<Self> {
        let mut rest = Reader(data);
        let kind: u8 = rest.get()?;
        match kind {
            0x00 | 0x01 | 0x10 => {
                let (id, to) = (rest.get()?, Address::read(kind, &mut rest)?);
                let _options: u8 = rest.get()?;
                if kind == 0x10 {
                    let _radius: u8 = rest.get()?;
                }
                Some(Self::Transmit { id, to, payload: rest.0 })
            }
            0x80 | 0x81 | 0x90 | 0x91 => {
                let from = Address::read(kind, &mut rest)?;
                let rssi = if kind >= 0x90 { None } else { Some(rest.get()?) };
                if kind == 0x91 && rest.array()? != DATA_CLUSTER {
                    return None;
                }
                let _options: u8 = rest.get()?;
                Some(Self::Receive { from, rssi, payload: rest.0 })
            }
            0x89 => Some(Self::Sent { id: rest.get()?, status: rest.get()? }),
            0x08 | 0x09 | 0x17 => {
                let id = rest.get()?;
                let to = if kind == 0x17 { Some(both(&mut rest)?) } else { None };
                if kind == 0x17 {
                    let _options: u8 = rest.get()?;
                }
                Some(Self::Command { id, to, name: rest.array()?, value: rest.0 })
            }
            0x88 | 0x97 => {
                let id = rest.get()?;
                let from = if kind == 0x97 { Some(both(&mut rest)?) } else { None };
                let (name, status) = (rest.array()?, rest.get()?);
                Some(Self::Answer { id, from, name, status, value: rest.0 })
            }
            _ => None,
        }
    }

    /// Encodes the frame for the serial line; `None` if the payload is too long.
    pub fn encode(&self, mode: Mode) -> Option<Encoded> {
        let mut header = Bytes::<MAX_HEADER>::new();
        let payload = match *self {
            Self::Transmit { id, to, payload } => {
                header.push(to.kinds().0);
                header.push(id);
                to.write(&mut header);
                if matches!(to, Address::Zigbee { .. }) {
                    header.push(0); // the network's maximum number of hops
                }
                header.push(0); // no options
                payload
            }
            Self::Receive { from, rssi, payload } => {
                header.push(from.kinds().1);
                from.write(&mut header);
                if !matches!(from, Address::Zigbee { .. }) {
                    header.push(rssi.unwrap_or(0));
                }
                header.push(0);
                payload
            }
            Self::Sent { id, status } => {
                header.extend(&[0x89, id, status]);
                &[]
            }
            Self::Command { id, to, name, value } => {
                header.extend(&[if to.is_some() { 0x17 } else { 0x08 }, id]);
                if let Some((long, short)) = to {
                    Address::Zigbee { long, short }.write(&mut header);
                    header.push(2); // the parameter takes effect at once
                }
                header.extend(&name);
                value
            }
            Self::Answer { id, from, name, status, value } => {
                header.extend(&[if from.is_some() { 0x97 } else { 0x88 }, id]);
                if let Some((long, short)) = from {
                    Address::Zigbee { long, short }.write(&mut header);
                }
                header.extend(&name);
                header.push(status);
                value
            }
        };
        if payload.len() > MAX_PAYLOAD {
            return None;
        }
        let data = || header.iter().chain(payload).copied();
        let len = (header.len() + payload.len()) as u16;
        let checksum = 0xFF - data().fold(0, u8::wrapping_add);
        let mut out = Encoded::new();
        out.push(START);
        for byte in len.to_be_bytes().into_iter().chain(data()).chain([checksum]) {
            if mode == Mode::Escaped && is_escaped(byte) {
                out.extend(&[ESCAPE, byte ^ ESCAPED_BY]);
            } else {
                out.push(byte);
            }
        }
        Some(out)
    }
}

impl Address {
    fn read(kind: u8, rest: &mut Reader<'_>) -> Option<Self> {
        Some(match kind {
            0x00 | 0x80 => Self::Long(rest.array().map(u64::from_be_bytes)?),
            0x01 | 0x81 => Self::Short(rest.array().map(u16::from_be_bytes)?),
            _ => {
                let (long, short) = both(rest)?;
                Self::Zigbee { long, short }
            }
        })
    }

    const fn kinds(self) -> (u8, u8) {
        match self {
            Self::Long(_) => (0x00, 0x80),
            Self::Short(_) => (0x01, 0x81),
            Self::Zigbee { .. } => (0x10, 0x90),
        }
    }

    fn write<const N: usize>(self, out: &mut Bytes<N>) {
        match self {
            Self::Short(short) => out.extend(&short.to_be_bytes()),
            Self::Long(long) => out.extend(&long.to_be_bytes()),
            Self::Zigbee { long, short } => {
                out.extend(&long.to_be_bytes());
                out.extend(&short.to_be_bytes());
            }
        }
    }
}

fn both(rest: &mut Reader<'_>) -> Option<(u64, u16)> {
    Some((rest.array().map(u64::from_be_bytes)?, rest.array().map(u16::from_be_bytes)?))
}

/// Maximum bytes between length and checksum that the decoder follows. The longest frame with a payload has 18 bytes
/// of header; the rest is room for other kinds.
const MAX_DATA: usize = 128;

const MAX_RAW: usize = MAX_DATA + 4;

/// Decodes a byte stream to API frames.
///
/// Without escapes a start byte can occur anywhere. A damaged frame is searched for the next start, in case a wrong
/// length swallowed it. A frame with a start byte in its data might be two, the first with a wrong length; it is
/// accepted only if another start follows.
#[derive(Clone, Debug)]
pub struct Deframer {
    mode: Mode,
    /// Unescaped bytes from a start byte on.
    pending: Bytes<{ MAX_RAW + 1 }>,
    /// Bytes of `pending` that belong to a frame already counted as damaged.
    condemned: usize,
    /// True within damage already counted, or before the first frame.
    skipping: bool,
    escape: bool,
    /// Frames with a wrong start, length or checksum, or cut short.
    pub damaged: u64,
}

impl Deframer {
    /// Creates a deframer.
    pub const fn new(mode: Mode) -> Self {
        let pending = Bytes::new();
        Self { mode, pending, condemned: 0, skipping: true, escape: false, damaged: 0 }
    }

    /// Decodes bytes, in slices of any size, and calls `sink` with every frame.
    pub fn feed(&mut self, mut bytes: &[u8], mut sink: impl FnMut(ApiFrame<'_>)) {
        while let Some((&byte, rest)) = bytes.split_first() {
            let whole = if self.pending.is_empty() { whole_frame(bytes) } else { None };
            bytes = whole.map_or(rest, |(_, after)| after);
            if let Some((data, _)) = whole {
                self.skipping = false;
                give(data, &mut sink);
            } else if self.pending.is_empty() && byte != START {
                // Damage counts once, even if it leaves several bytes.
                self.damaged += u64::from(!self.skipping);
                self.skipping = true;
            } else {
                self.take(byte, &mut sink);
            }
        }
    }

    /// Accepts a whole frame that still waits for the start byte of the next one, since the line is at rest.
    pub fn rest(&mut self, mut sink: impl FnMut(ApiFrame<'_>)) {
        let is_whole = match progress(&self.pending) {
            Deframed::Whole(data) if self.pending.len() == data.len() + 4 => {
                give(data, &mut sink);
                true
            }
            _ => false,
        };
        if is_whole {
            self.pending = Bytes::new();
            self.skipping = false;
        }
    }

    fn take(&mut self, byte: u8, sink: &mut impl FnMut(ApiFrame<'_>)) {
        let is_plain = self.mode == Mode::Plain;
        if !is_plain && byte == START {
            self.damaged += u64::from(!self.pending.is_empty());
            self.pending = Bytes::new();
            self.escape = false;
        } else if !is_plain && byte == ESCAPE {
            self.escape = true;
            return;
        }
        self.pending.push(if self.escape { byte ^ ESCAPED_BY } else { byte });
        self.escape = false;
        while !self.pending.is_empty() {
            let (len, good) = match progress(&self.pending) {
                Deframed::Incomplete => return,
                Deframed::Damaged { len } => (len, false),
                Deframed::Whole(data) => {
                    let len = data.len() + 4;
                    let next = self.pending.get(len);
                    let suspect = is_plain && data.contains(&START);
                    if suspect && next.is_none() {
                        return;
                    }
                    let good = !suspect || next == Some(&START);
                    if good {
                        give(data, sink);
                    }
                    (len, good)
                }
            };
            if !good && self.condemned == 0 {
                self.damaged += 1;
                self.condemned = len;
            }
            self.skipping = !good;
            let len = if good { len } else { 1 };
            // In escaped mode, a start byte in the rest was data.
            let is_start = |&byte: &u8| is_plain && byte == START;
            let next = self.pending.iter().skip(len).position(is_start);
            let gone = next.map_or(self.pending.len(), |next| len + next);
            self.pending.remove_front(gone);
            self.condemned = self.condemned.saturating_sub(gone);
        }
    }
}

enum Deframed<'a> {
    Incomplete,
    Whole(&'a [u8]),
    Damaged { len: usize },
}

fn progress(bytes: &[u8]) -> Deframed<'_> {
    let [_, high, low, rest @ ..] = bytes else { return Deframed::Incomplete };
    let len = usize::from(u16::from_be_bytes([*high, *low]));
    if len == 0 || len > MAX_DATA {
        return Deframed::Damaged { len: 3 };
    }
    let Some(sealed) = rest.get(..=len) else { return Deframed::Incomplete };
    match sealed.iter().copied().fold(0, u8::wrapping_add) {
        0xFF => Deframed::Whole(&sealed[..len]),
        _ => Deframed::Damaged { len: len + 4 },
    }
}

/// Returns the data of a valid frame that reads the same in both modes (most do), and the bytes after it. Takes a
/// quarter of the time of decoding byte by byte.
fn whole_frame(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let Deframed::Whole(data) = progress(bytes) else { return None };
    let (frame, after) = bytes.split_at_checked(data.len() + 4)?;
    let (&start, rest) = frame.split_first()?;
    let as_it_is = start == START && !rest.iter().any(|byte| matches!(*byte, START | ESCAPE));
    as_it_is.then_some((data, after))
}

fn give(data: &[u8], sink: &mut impl FnMut(ApiFrame<'_>)) {
    // Another kind of frame, or a short one, is not damage, but has no content to read.
    ApiFrame::parse(data).into_iter().for_each(sink);
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    /// Frames as text, since they borrow from the decoder.
    fn frames(mode: Mode, stream: &[u8], piece: usize) -> (Vec<std::string::String>, u64) {
        let (mut deframer, mut frames) = (Deframer::new(mode), Vec::new());
        for bytes in stream.chunks(piece) {
            deframer.feed(bytes, |frame| frames.push(std::format!("{frame:?}")));
        }
        (frames, deframer.damaged)
    }

    fn text(frame: &ApiFrame<'_>) -> std::string::String {
        std::format!("{frame:?}")
    }

    fn receive(payload: &[u8]) -> ApiFrame<'_> {
        ApiFrame::Receive { from: Address::Short(0x2052), rssi: Some(40), payload }
    }

    // Examples in Digi's user guides.
    #[test]
    fn frames_equal_those_of_the_manual() {
        // 90002002, "Transmit Request frame - 0x10".
        let payload = b"TxData0A";
        let to = Address::Zigbee { long: 0x0013_A200_400A_0127, short: 0xFFFE };
        let expected = [
            0x7E, 0x00, 0x16, 0x10, 0x01, 0x00, 0x13, 0xA2, 0x00, 0x40, 0x0A, 0x01, 0x27, 0xFF,
            0xFE, 0x00, 0x00, 0x54, 0x78, 0x44, 0x61, 0x74, 0x61, 0x30, 0x41, 0x13,
        ];
        let plain = ApiFrame::Transmit { id: 1, to, payload }.encode(Mode::Plain).unwrap();
        assert_eq!(&*plain, expected);
        // The frame with escapes: 0x13 in the address and as the checksum.
        let escaped = ApiFrame::Transmit { id: 1, to, payload }.encode(Mode::Escaped).unwrap();
        let expected = [
            0x7E, 0x00, 0x16, 0x10, 0x01, 0x00, 0x7D, 0x33, 0xA2, 0x00, 0x40, 0x0A, 0x01, 0x27,
            0xFF, 0xFE, 0x00, 0x00, 0x54, 0x78, 0x44, 0x61, 0x74, 0x61, 0x30, 0x41, 0x7D, 0x33,
        ];
        assert_eq!(&*escaped, expected);
        // "AT Command frame - 0x08", "AT Command Response frame - 0x88", "Remote AT Command Request frame - 0x17",
        // "Remote Command Response frame - 0x97", and of 90000982 "TX Status - 0x89".
        let (far, near) = ((0x0013_A200_4040_1122, 0xFFFE), (0x0013_A200_4052_2BAA, 0x7D84));
        let [nj, bd, bh, sl] = [*b"NJ", *b"BD", *b"BH", *b"SL"];
        let serial = [0x40, 0x52, 0x2B, 0xAA];
        for (frame, expected) in [
            (
                ApiFrame::Command { id: 0x52, to: None, name: nj, value: &[] },
                &[0x7E, 0x00, 0x04, 0x08, 0x52, 0x4E, 0x4A, 0x0D][..],
            ),
            (
                ApiFrame::Answer { id: 1, from: None, name: bd, status: 0, value: &[] },
                &[0x7E, 0x00, 0x05, 0x88, 0x01, 0x42, 0x44, 0x00, 0xF0],
            ),
            (
                ApiFrame::Command { id: 1, to: Some(far), name: bh, value: &[1] },
                &[
                    0x7E, 0x00, 0x10, 0x17, 0x01, 0x00, 0x13, 0xA2, 0x00, 0x40, 0x40, 0x11, 0x22,
                    0xFF, 0xFE, 0x02, 0x42, 0x48, 0x01, 0xF5,
                ],
            ),
            (
                ApiFrame::Answer {
                    id: 0x55,
                    from: Some(near),
                    name: sl,
                    status: 0,
                    value: &serial,
                },
                &[
                    0x7E, 0x00, 0x13, 0x97, 0x55, 0x00, 0x13, 0xA2, 0x00, 0x40, 0x52, 0x2B, 0xAA,
                    0x7D, 0x84, 0x53, 0x4C, 0x00, 0x40, 0x52, 0x2B, 0xAA, 0xF0,
                ],
            ),
            (ApiFrame::Sent { id: 1, status: 0 }, &[0x7E, 0x00, 0x03, 0x89, 0x01, 0x00, 0x75]),
        ] {
            assert_eq!(&*frame.encode(Mode::Plain).unwrap(), expected, "{frame:?}");
        }
    }

    // 90002002, "Explicit Receive Indicator frame - 0x91", with the endpoints and the cluster of data.
    #[test]
    fn data_of_explicit_frames_are_data_and_other_messages_are_not() {
        let header = [0x91, 0x00, 0x13, 0xA2, 0x00, 0x40, 0x52, 0x2B, 0xAA, 0x7D, 0x84];
        let data = [&header[..], &DATA_CLUSTER, &[0x02], b"RxData"].concat();
        let from = Address::Zigbee { long: 0x0013_A200_4052_2BAA, short: 0x7D84 };
        let payload = &b"RxData"[..];
        assert_eq!(ApiFrame::parse(&data), Some(ApiFrame::Receive { from, rssi: None, payload }));
        let other = [&header[..], &[0, 0, 0x80, 0x31, 0, 0], &[0x02], b"RxData"].concat();
        assert_eq!(ApiFrame::parse(&other), None);
    }

    #[test]
    fn frames_without_data_of_the_other_side_are_passed_over() {
        assert_eq!(ApiFrame::parse(&[0x8A, 6]), None);
        assert_eq!(ApiFrame::parse(&[0x81, 0x20, 0x52, 40]), None);
        // A modem status: the module has started.
        let started = [START, 0, 2, 0x8A, 0, 0x75];
        let data = receive(b"data");
        let stream = [&started[..], &data.encode(Mode::Plain).unwrap()].concat();
        assert_eq!(frames(Mode::Plain, &stream, 7), ([text(&data)].into(), 0));
    }

    #[test]
    fn a_frame_with_a_start_byte_in_it_is_accepted_once_the_line_is_at_rest() {
        let question = ApiFrame::Command { id: START, to: None, name: *b"AP", value: &[] };
        let bytes = question.encode(Mode::Plain).unwrap();
        let (mut deframer, mut seen) = (Deframer::new(Mode::Plain), Vec::new());
        for part in [&bytes[..5], &bytes[5..]] {
            deframer.feed(part, |frame| seen.push(text(&frame)));
            assert_eq!(seen.len(), 0);
            deframer.rest(|frame| seen.push(text(&frame)));
        }
        deframer.feed(&bytes, |frame| seen.push(text(&frame)));
        assert_eq!((seen, deframer.damaged), ([text(&question)].into(), 0));
    }

    #[test]
    fn a_payload_too_long_for_the_radio_is_refused() {
        assert!(receive(&[0; MAX_PAYLOAD]).encode(Mode::Escaped).is_some());
        assert_eq!(receive(&[0; MAX_PAYLOAD + 1]).encode(Mode::Plain), None);
    }

    fn any_address() -> impl Strategy<Value = Address> {
        prop_oneof![
            any::<u16>().prop_map(Address::Short),
            any::<u64>().prop_map(Address::Long),
            any::<(u64, u16)>().prop_map(|(long, short)| Address::Zigbee { long, short }),
        ]
    }

    proptest! {
        #[test]
        fn frames_survive_any_splitting(
            payload in prop::collection::vec(prop_oneof![Just(0x7E), any::<u8>()], 0..=MAX_PAYLOAD),
            address in any_address(),
            id: u8,
            escaped: bool,
            piece in 1..300_usize,
        ) {
            let mode = if escaped { Mode::Escaped } else { Mode::Plain };
            let rssi = (!matches!(address, Address::Zigbee { .. })).then_some(id);
            let (name, value) = (*b"NI", &payload[..]);
            let remote = match address {
                Address::Zigbee { long, short } => Some((long, short)),
                _ => None,
            };
            let sent = [
                ApiFrame::Transmit { id, to: address, payload: &payload },
                ApiFrame::Receive { from: address, rssi, payload: &payload },
                ApiFrame::Sent { id, status: 1 },
                ApiFrame::Command { id, to: remote, name, value },
                ApiFrame::Answer { id, from: remote, name, status: 0, value },
            ];
            let mut stream: Vec<u8> =
                sent.iter().flat_map(|frame| frame.encode(mode).unwrap().to_vec()).collect();
            stream.push(START); // the last frame may have a start byte in its data
            let expected: Vec<_> = sent.iter().map(text).collect();
            let (frames, damaged) = frames(mode, &stream, piece);
            prop_assert_eq!((frames, damaged), (expected, 0));
        }

        #[test]
        fn a_damaged_byte_costs_no_more_than_its_frame(
            at in 0..20_usize,
            by in 1..=255_u8,
            escaped: bool,
            piece in 1..100_usize,
        ) {
            let mode = if escaped { Mode::Escaped } else { Mode::Plain };
            let [first, second, third] = [b"01234567890", b"abcdefghijk", b"ABCDEFGHIJK"];
            let encoded = [first, second, third].map(|p| receive(p).encode(mode).unwrap());
            let mut stream: Vec<u8> = encoded.iter().flat_map(|bytes| bytes.to_vec()).collect();
            stream[encoded[0].len() + at] ^= by;
            // Zeros complete any frame that still waits for its length.
            stream.extend([0; 132]);
            let (frames, damaged) = frames(mode, &stream, piece);
            prop_assert!(frames.contains(&text(&receive(first))));
            prop_assert!(frames.contains(&text(&receive(third))));
            // A byte that became a start splits a frame in two; the zeros count as well.
            prop_assert!(damaged <= 3);
        }
    }
}
