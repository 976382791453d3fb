//! Detection of a stream's protocol from any starting point.

use shared_proto::xbee::{Address, ApiFrame, Mode};
use shared_proto::{Framing, Packet, Protocol, Sample, Values, detect, skinproc::Scan};
use system_tests::random::Random;

use crate::common::on_the_wire;

fn packet(i: u16, random: &mut Random) -> Packet {
    Packet::Sample(Sample {
        sequence: i,
        clock_us: u32::from(i) * 10_000,
        values: Values::Readings(std::array::from_fn(|_| random.next() as u16)),
        saturated: 0,
        dropped: 0,
    })
}

#[test]
fn every_framing_is_found_from_any_start() {
    let mut random = Random(1);
    for framing in Framing::ALL {
        // This address needs an escape; without an escape, an escaped stream is also a plain stream.
        let stream: Vec<u8> = (0..50)
            .flat_map(|i| match framing {
                Framing::Xbee(mode) => {
                    let payload = packet(i, &mut random).encode();
                    let from = Address::Long(0x0013_A200_400A_0127);
                    let frame = ApiFrame::Receive { from, rssi: Some(40), payload: &payload };
                    frame.encode(mode).unwrap().to_vec()
                }
                Framing::Cobs => on_the_wire(&packet(i, &mut random), framing),
            })
            .collect();
        for start in 0..60 {
            assert_eq!(detect(&stream[start..]), Some(Protocol::Packets(framing)), "{start}");
        }
    }
}

#[test]
fn a_stream_in_api_mode_that_never_needed_an_escape_is_taken_as_plain() {
    let mut random = Random(2);
    let framing = Framing::Xbee(Mode::Escaped);
    let stream = on_the_wire(&packet(0, &mut random), framing);
    assert_eq!(stream.len(), 43, "this frame has no escape");
    assert_eq!(detect(&stream), Some(Protocol::Packets(Framing::Xbee(Mode::Plain))));
}

#[test]
fn the_original_board_is_found_from_any_start() {
    let scan = |i: u32| Scan {
        readings: std::array::from_fn(|c| (2_000 + 37 * c as u32 + i % 100) as u16),
        clock_us: i * 5_493,
    };
    let stream: Vec<u8> = (0..50).flat_map(|i| scan(i).encode()).collect();
    for start in 0..22 {
        assert_eq!(detect(&stream[start..]), Some(Protocol::Original), "{start}");
    }
}

#[test]
fn no_framing_is_found_in_silence_and_noise() {
    let mut random = Random(3);
    let noise: Vec<u8> = (0..100_000).map(|_| random.next() as u8).collect();
    assert_eq!(detect(&noise), None);
    assert_eq!(detect(&[]), None);
}
