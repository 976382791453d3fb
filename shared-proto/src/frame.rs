//! Packets to frames: a mask that avoids awkward bytes, and COBS with a zero delimiter.
//!
//! COBS (Cheshire and Baker, "Consistent Overhead Byte Stuffing", IEEE/ACM Transactions on
//! Networking 7(2), 1999) removes the zeros from a packet at the cost of one byte, so that a zero
//! marks the end of a frame and nothing else.
//!
//! Escaped XBee API mode spends a second byte on each of four byte values. The first byte of a
//! packet is a mask, to which all others are exclusive-ored, chosen so that the frame holds none
//! of the four: the length on the wire does not depend on the readings. Such a mask exists: of its
//! 256 values each byte of a packet rules out five at most (those that turn it into one of the
//! four, or into zero), which leaves one for packets of up to 51 bytes.

use crate::bytes::Bytes;
use crate::error::DecodeError;

/// Longest packet in bytes, mask and CRC included: the longest for which a mask always exists.
pub const MAX_PACKET: usize = 51;

/// Longest frame in bytes: a packet, the COBS code and the delimiter.
pub const MAX_FRAME: usize = MAX_PACKET + 2;

/// A packet as it goes out: COBS and the zero at the end.
pub type Frame = Bytes<MAX_FRAME>;

/// A packet; the first byte is the mask, still zero while the packet is plain.
pub(crate) type Plain = Bytes<MAX_PACKET>;

/// The bytes that escaped API mode escapes: start, escape, XON and XOFF.
pub(crate) const fn is_escaped(byte: u8) -> bool {
    matches!(byte, 0x7E | 0x7D | 0x11 | 0x13)
}

/// Masks and frames a plain packet.
pub(crate) fn encode(mut packet: Plain) -> Frame {
    // A length of 16 or 18 bytes can be left without a mask, for its COBS code can be one of the
    // four; no sample has such a length, and an escape more does no harm elsewhere.
    let mask = (0..=255).find(|&mask| is_free_of_escapes(&packet, mask)).unwrap_or(0);
    packet.as_mut_slice().iter_mut().for_each(|byte| *byte ^= mask);
    cobs(&packet)
}

fn is_free_of_escapes(packet: &[u8], mask: u8) -> bool {
    let mut code = 1;
    for byte in packet {
        let byte = byte ^ mask;
        if is_escaped(if byte == 0 { code } else { byte }) {
            return false;
        }
        code = if byte == 0 { 1 } else { code + 1 };
    }
    !is_escaped(code)
}

fn cobs(packet: &[u8]) -> Frame {
    let mut frame = Frame::new();
    // One block per zero, as if another zero stood after the packet. No block reaches the 254
    // bytes that would need a block without a zero.
    for block in packet.split(|&byte| byte == 0) {
        frame.push(block.len() as u8 + 1);
        frame.extend(block);
    }
    frame.push(0);
    frame
}

/// The plain packet in a frame, which is given without its delimiter.
pub(crate) fn decode(frame: &[u8]) -> Result<Plain, DecodeError> {
    // Every byte but the first code stands where it belongs; the other codes stand for zeros.
    let (&code, bytes) = frame.split_first().ok_or(DecodeError::Framing)?;
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
    let mask = *packet.first().ok_or(DecodeError::Framing)?;
    packet.as_mut_slice().iter_mut().for_each(|byte| *byte ^= mask);
    Ok(packet)
}

/// The header byte that a frame has if it is one and its header is not zero, found without
/// decoding it.
pub(crate) fn header(frame: &[u8]) -> Option<u8> {
    let &[code, first, second, ..] = frame else { return None };
    Some(match code {
        1 => second,         // the mask is zero
        2 => first,          // the masked header is zero, so it equals the mask
        _ => first ^ second, // mask and masked header
    })
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec;

    fn plain(content: &[u8]) -> Plain {
        let mut packet = Plain::new();
        assert!(packet.push(0) && packet.extend(content));
        packet
    }

    proptest! {
        #[test]
        fn decoding_undoes_encoding(content in prop::collection::vec(any::<u8>(), 0..MAX_PACKET)) {
            let packet = plain(&content);
            let frame = encode(packet);
            let (&end, body) = frame.split_last().unwrap();
            prop_assert_eq!(end, 0);
            prop_assert!(!body.contains(&0));
            prop_assert_eq!(decode(body), Ok(packet));
        }

        #[test]
        fn the_header_is_found_without_decoding(
            header in 1_u8..,
            content in prop::collection::vec(any::<u8>(), 2..30),
        ) {
            let frame = encode(plain(&[&[header][..], &content].concat()));
            prop_assert_eq!(super::header(&frame), Some(header));
        }

        // The cobs crate is an independent implementation.
        #[test]
        fn framing_is_cobs(content in prop::collection::vec(0..4_u8, 1..MAX_PACKET)) {
            let ours = cobs(&content);
            let mut theirs = [0; MAX_FRAME];
            let len = ::cobs::encode(&content, &mut theirs);
            prop_assert_eq!(&ours[..ours.len() - 1], &theirs[..len]);
        }

        #[test]
        fn what_is_no_cobs_is_refused(frame in prop::collection::vec(1..9_u8, 2..40)) {
            let mut theirs = [0; 64];
            let theirs = ::cobs::decode(&frame, &mut theirs).ok().map(|report| {
                let packet = &theirs[..report.frame_size()];
                packet.iter().map(|byte| byte ^ packet[0]).collect::<Vec<_>>()
            });
            prop_assert_eq!(decode(&frame).ok().map(|packet| packet.to_vec()), theirs);
        }
    }

    #[test]
    fn packets_whose_bytes_all_need_escapes_get_a_mask_that_needs_none() {
        let awkward = [0x7E, 0x7D, 0x11, 0x13, 0x00];
        for len in (1..MAX_PACKET).filter(|len| ![16, 18].contains(&(len + 1))) {
            let content: Vec<u8> = awkward.iter().copied().cycle().take(len).collect();
            assert!(!encode(plain(&content)).iter().any(|&byte| is_escaped(byte)), "{len}");
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
