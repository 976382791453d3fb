//! Framing of packets: a mask that avoids certain bytes, and COBS with a zero delimiter.
//!
//! COBS (Cheshire and Baker, "Consistent Overhead Byte Stuffing", IEEE/ACM Transactions on
//! Networking 7(2), 1999) removes the zeros from a packet at the cost of one byte, so that a zero
//! can mark the end of a frame.
//!
//! Escaped XBee API mode spends a second byte on each of four values. The first byte of a packet is
//! a mask that is XORed into all other bytes except the CRC, so that the frame contains none of the
//! four and its length does not depend on the readings. The CRC covers the bytes as sent, with the
//! mask. Each byte rules out at most five of the 256 masks (those that turn it into one of the four
//! values or into zero), so a mask exists for packets of up to 51 bytes. For a sample, at least a
//! hundred masks remain; the two CRC bytes rule out one in thirty of them.

use crate::field::Bytes;

/// The reason why bytes are no packet of this version.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[expect(missing_docs, reason = "a variant says what its fields are")]
pub enum DecodeError {
    /// The bytes are not COBS, or are too short or too long for a packet.
    Framing,
    /// The CRC does not match.
    Crc,
    /// The version differs. Its kinds may differ, too, except that of a command.
    UnknownVersion { version: u8, kind: u8 },
    /// The kind is unknown, although CRC and version match.
    UnknownKind(u8),
    /// CRC and kind are right, but the body does not match the kind.
    Body,
}

/// Longest packet in bytes, with mask and CRC: the longest for which a mask always exists.
pub const MAX_PACKET: usize = 51;

/// Longest frame in bytes: a packet, the COBS code and the delimiter.
pub const MAX_FRAME: usize = MAX_PACKET + 2;

/// An encoded packet: COBS and the zero at the end.
pub type Frame = Bytes<MAX_FRAME>;

/// A packet whose first byte is the mask, or zero without a mask.
pub(crate) type Plain = Bytes<MAX_PACKET>;

/// Bytes that escaped API mode escapes: start, escape, XON and XOFF.
pub(crate) const fn is_escaped(byte: u8) -> bool {
    matches!(byte, 0x7E | 0x7D | 0x11 | 0x13)
}

/// Masks a plain packet, appends the CRC, and frames both.
pub(crate) fn encode(packet: Plain, crc: impl Fn(&[u8]) -> u16) -> Frame {
    let masks = (0..=255).filter(|&mask| last_code(&packet, mask).is_some());
    let mut tries = masks.map(|mask| masked(packet, mask, &crc));
    let is_good = |packet: &Plain| last_code(packet, 0).is_some_and(|code| !is_escaped(code));
    // A packet of 16 or 18 bytes has no such mask if its COBS code is one of the four values. No
    // sample has that length, and one more escape does no harm.
    let first = tries.next().unwrap_or_else(|| masked(packet, 0, &crc));
    let packet = [first].into_iter().chain(tries).find(is_good).unwrap_or(first);
    cobs(&packet)
}

fn masked(mut packet: Plain, mask: u8, crc: impl Fn(&[u8]) -> u16) -> Plain {
    packet.as_mut_slice().iter_mut().for_each(|byte| *byte ^= mask);
    let crc = crc(&packet);
    packet.extend(&crc.to_le_bytes());
    packet
}

/// Returns the COBS code of the last block of the packet; `None` if a byte or an earlier code needs
/// an escape.
fn last_code(packet: &[u8], mask: u8) -> Option<u8> {
    let mut code = 1;
    for byte in packet {
        let byte = byte ^ mask;
        if is_escaped(if byte == 0 { code } else { byte }) {
            return None;
        }
        code = if byte == 0 { 1 } else { code + 1 };
    }
    Some(code)
}

fn cobs(packet: &[u8]) -> Frame {
    let mut frame = Frame::new();
    // Each zero ends a block, and the packet counts as if one more zero followed it. No block
    // reaches 254 bytes, the length at which a COBS block ends without a zero.
    for block in packet.split(|&byte| byte == 0) {
        frame.push(block.len() as u8 + 1);
        frame.extend(block);
    }
    frame.push(0);
    frame
}

/// Returns the packet, still masked, in a frame without its delimiter.
pub(crate) fn decode(frame: &[u8]) -> Result<Plain, DecodeError> {
    // Every byte after the first code is in place; the other codes replace zeros.
    let (&code, bytes) = frame.split_first().ok_or(DecodeError::Framing)?;
    if bytes.is_empty() {
        return Err(DecodeError::Framing); // the mask is missing
    }
    let mut packet = Plain::copy_of(bytes).ok_or(DecodeError::Framing)?;
    let packet_bytes = packet.as_mut_slice();
    let mut next = usize::from(code);
    while let Some(zero) = next.checked_sub(1).and_then(|at| packet_bytes.get_mut(at)) {
        let code = core::mem::take(zero);
        if code == 0 {
            return Err(DecodeError::Framing);
        }
        next += usize::from(code);
    }
    if next != bytes.len() + 1 {
        return Err(DecodeError::Framing);
    }
    Ok(packet)
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn crc(bytes: &[u8]) -> u16 {
        bytes.iter().fold(0xFFFF, |sum, &byte| sum.rotate_left(3) ^ u16::from(byte))
    }

    fn plain(content: &[u8]) -> Plain {
        let mut packet = Plain::new();
        packet.push(0);
        assert!(packet.try_extend(content));
        packet
    }

    proptest! {
        #[test]
        fn decoding_undoes_encoding(content in prop::collection::vec(any::<u8>(), 0..MAX_PACKET - 2)) {
            let packet = plain(&content);
            let frame = encode(packet, crc);
            let (&end, body) = frame.split_last().unwrap();
            prop_assert_eq!(end, 0);
            prop_assert!(!body.contains(&0));
            let wire = decode(body).unwrap();
            let (sent, check) = wire.split_last_chunk().unwrap();
            prop_assert_eq!(crc(sent).to_le_bytes(), *check);
            let unmasked: Vec<u8> = sent.iter().map(|byte| byte ^ sent[0]).collect();
            prop_assert_eq!(&unmasked[..], &packet[..]);
        }

        #[test]
        fn framing_is_cobs(content in prop::collection::vec(0..4_u8, 1..MAX_PACKET)) {
            let ours = cobs(&content);
            let mut theirs = [0; MAX_FRAME];
            let len = ::cobs::encode(&content, &mut theirs);
            prop_assert_eq!(&ours[..ours.len() - 1], &theirs[..len]);
        }

        #[test]
        fn invalid_cobs_is_refused(frame in prop::collection::vec(1..9_u8, 2..40)) {
            let mut theirs = [0; 64];
            let theirs = ::cobs::decode(&frame, &mut theirs).ok().map(|report| {
                theirs[..report.frame_size()].to_vec()
            });
            prop_assert_eq!(decode(&frame).ok().map(|packet| packet.to_vec()), theirs);
        }
    }

    #[test]
    fn packets_whose_bytes_all_need_escapes_get_a_mask_that_needs_none() {
        let awkward = [0x7E, 0x7D, 0x11, 0x13, 0x00];
        for len in (1..MAX_PACKET - 2).filter(|len| ![16, 18].contains(&(len + 3))) {
            let content: Vec<u8> = awkward.iter().copied().cycle().take(len).collect();
            assert!(!encode(plain(&content), crc).iter().any(|&byte| is_escaped(byte)), "{len}");
        }
    }

    #[test]
    fn too_long_and_cut_frames_are_refused() {
        assert_eq!(decode(&[]), Err(DecodeError::Framing));
        assert_eq!(decode(&[1]), Err(DecodeError::Framing));
        assert_eq!(decode(&[5, 1, 2]), Err(DecodeError::Framing));
        assert_eq!(decode(&[1, 0, 2]), Err(DecodeError::Framing));
        assert_eq!(decode(&[0, 1, 2]), Err(DecodeError::Framing));
        assert_eq!(decode(&[1; MAX_FRAME + 1]), Err(DecodeError::Framing));
        let mut long = [7; MAX_PACKET + 2];
        long[0] = MAX_PACKET as u8 + 2;
        assert_eq!(decode(&long), Err(DecodeError::Framing));
    }
}
