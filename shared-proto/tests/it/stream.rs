//! Decoding does not depend on cuts, and damage affects only the packets that it hits.

use proptest::prelude::*;
use shared_proto::{Decoder, Event, Framing, MAX_FRAME, Packet, ReceivedPacket};

use crate::common::{any_packet, any_sample, decode, on_the_wire};

fn packet(event: &Event) -> Packet {
    match *event {
        Event::Packet(ReceivedPacket { packet, .. }) => packet,
        ref other => panic!("not a packet of this version: {other:?}"),
    }
}

fn packets(decoder: &mut Decoder, bytes: &[u8]) -> Vec<Packet> {
    decode(decoder, bytes).iter().map(packet).collect()
}

/// Compares bytes, since a NaN in a wrench differs from itself.
fn encoded(packets: &[Packet]) -> Vec<Vec<u8>> {
    packets.iter().map(|packet| packet.encode().to_vec()).collect()
}

proptest! {
    #[test]
    fn every_packet_is_decoded_for_any_cuts_of_the_stream(
        sent in prop::collection::vec(any_packet(), 0..30),
        framing in prop::sample::select(&Framing::ALL[..]),
        pieces in prop::collection::vec(1..90_usize, 1..20),
    ) {
        let stream: Vec<u8> = sent.iter().flat_map(|p| on_the_wire(p, framing)).collect();
        let mut decoder = Decoder::new(framing);
        let (mut rest, mut received) = (&stream[..], Vec::new());
        for piece in pieces.iter().cycle() {
            let (bytes, after) = rest.split_at(rest.len().min(*piece));
            received.extend(packets(&mut decoder, bytes));
            rest = after;
            if rest.is_empty() {
                break;
            }
        }
        prop_assert_eq!(encoded(&received), encoded(&sent));
        let counters = decoder.counters;
        prop_assert_eq!(counters.packets, sent.len() as u64);
        prop_assert_eq!((counters.bad_crc, counters.malformed, counters.bad_api_frames), (0, 0, 0));
    }

    #[test]
    fn a_damaged_byte_costs_one_packet_and_only_that(
        sent in prop::collection::vec(any_packet(), 3),
        at in any::<prop::sample::Index>(),
        by in 1..=255_u8,
        piece in 1..200_usize,
    ) {
        let wires: Vec<_> = sent.iter().map(|p| on_the_wire(p, Framing::Cobs)).collect();
        let mut damaged = wires.clone();
        let at = at.index(damaged[1].len());
        damaged[1][at] ^= by;
        let mut decoder = Decoder::new(Framing::Cobs);
        let received: Vec<_> =
            damaged.concat().chunks(piece).flat_map(|bytes| packets(&mut decoder, bytes)).collect();
        prop_assert_eq!(encoded(&received), encoded(&[sent[0], sent[2]]));
        let counters = decoder.counters;
        // A byte that becomes a delimiter splits the packet in two, unless it is next to a delimiter.
        let pieces = damaged[1].split(|&byte| byte == 0).filter(|piece| !piece.is_empty());
        prop_assert_eq!(counters.bad_crc + counters.malformed, pieces.count() as u64);
    }

    #[test]
    fn lost_bytes_cost_only_their_packets(
        sent in prop::collection::vec(any_packet(), 3),
        from in any::<prop::sample::Index>(),
        count in 1..40_usize,
        framing in prop::sample::select(&Framing::ALL[..]),
    ) {
        let wires: Vec<_> = sent.iter().map(|p| on_the_wire(p, framing)).collect();
        let from = from.index(wires[1].len());
        let to = (from + count).min(wires[1].len());
        let mut cut = wires.clone();
        cut[1].drain(from..to);
        let mut decoder = Decoder::new(framing);
        // In plain API mode a truncated frame waits for bytes; more bytes push it out.
        let mut stream = cut.concat();
        stream.extend([0; 140]);
        let received = packets(&mut decoder, &stream);
        prop_assert_eq!(encoded(&received), encoded(&[sent[0], sent[2]]));
    }

    #[test]
    fn a_transparent_module_may_cut_the_stream_into_radio_packets_anywhere(
        sent in prop::collection::vec(any_sample(), 1..20),
        cuts in prop::collection::vec(1..=100_usize, 1..20),
    ) {
        use shared_proto::xbee::{Address, ApiFrame, Mode};
        let sent: Vec<_> = sent.into_iter().map(Packet::Sample).collect();
        let stream: Vec<u8> = sent.iter().flat_map(|p| p.encode().to_vec()).collect();
        let mut decoder = Decoder::new(Framing::Xbee(Mode::Escaped));
        let (mut rest, mut received) = (&stream[..], Vec::new());
        for cut in cuts.iter().cycle() {
            let (payload, after) = rest.split_at(rest.len().min(*cut));
            let from = Address::Long(0x0013_A200_400A_0127);
            let frame = ApiFrame::Receive { from, rssi: None, payload };
            received.extend(packets(&mut decoder, &frame.encode(Mode::Escaped).unwrap()));
            rest = after;
            if rest.is_empty() {
                break;
            }
        }
        prop_assert_eq!(encoded(&received), encoded(&sent));
    }

    #[test]
    fn listening_in_at_any_point_loses_only_the_packet_under_way(
        sent in prop::collection::vec(any_packet(), 2),
        from in any::<prop::sample::Index>(),
    ) {
        let wires: Vec<_> = sent.iter().map(|p| on_the_wire(p, Framing::Cobs)).collect();
        let from = 1 + from.index(wires[0].len() - 1);
        let mut decoder = Decoder::new(Framing::Cobs);
        let received = packets(&mut decoder, &wires.concat()[from..]);
        prop_assert_eq!(encoded(&received), encoded(&sent[1..]));
        prop_assert_eq!((decoder.counters.bad_crc, decoder.counters.malformed), (0, 0));
    }
}

#[test]
fn a_packet_right_after_endless_noise_without_a_delimiter_is_found() {
    let packet = Packet::Command { number: 1, to: None, command: shared_proto::Command::Start };
    let mut decoder = Decoder::new(Framing::Cobs);
    assert!(decode(&mut decoder, &[0]).is_empty());
    for _ in 0..1000 {
        assert!(decode(&mut decoder, &[0xFF; MAX_FRAME + 7]).is_empty());
    }
    assert_eq!(packets(&mut decoder, &packet.encode()), [packet]);
    assert_eq!(decoder.counters.malformed, 1);
}
