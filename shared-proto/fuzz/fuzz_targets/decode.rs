//! Feeds arbitrary bytes, cut as the first byte selects, into every decoder.
//!
//! Cuts must not change the events, and decoded packets must survive another round trip.
#![no_main]

use libfuzzer_sys::fuzz_target;
use shared_proto::xbee::Mode;
use shared_proto::{Decoder, Event, Framing, Packet, ReceivedPacket, skinproc};

fn decode(framing: Framing, bytes: &[u8], piece: usize) -> Vec<Event> {
    let (mut decoder, mut events) = (Decoder::new(framing), Vec::new());
    for piece in bytes.chunks(piece) {
        decoder.feed(piece, |event| events.push(event));
    }
    events
}

fuzz_target!(|bytes: &[u8]| {
    let Some((&cut, bytes)) = bytes.split_first() else { return };
    let piece = usize::from(cut) + 1;
    for framing in [Framing::Cobs, Framing::Xbee(Mode::Plain), Framing::Xbee(Mode::Escaped)] {
        let events = decode(framing, bytes, piece);
        let whole = decode(framing, bytes, bytes.len().max(1));
        assert_eq!(format!("{events:?}"), format!("{whole:?}"));
        for event in events {
            let Event::Packet(received @ ReceivedPacket { origin: Some(origin), packet }) = event else {
                continue;
            };
            if !matches!(packet, Packet::Sample(_) | Packet::Edge(_)) {
                continue;
            }
            let frame = packet.encode_from(origin);
            let again = Packet::decode(&frame[..frame.len() - 1]);
            assert_eq!(format!("{again:?}"), format!("{:?}", Ok::<_, ()>(received)));
        }
    }
    let mut original = skinproc::Decoder::new();
    let mut scans = 0;
    bytes.chunks(piece).for_each(|piece| original.feed(piece, |_| scans += 1));
    original.finish(|_| scans += 1);
    assert_eq!(scans * skinproc::SCAN_LEN as u64 + original.skipped, bytes.len() as u64);
});
