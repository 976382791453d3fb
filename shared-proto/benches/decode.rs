//! Decoder throughput on streams of samples as a board sends them.
#![allow(missing_docs, reason = "no one reads the documentation of a benchmark")]

use divan::{Bencher, black_box, counter::BytesCount};
use shared_proto::xbee::{Address, ApiFrame};
use shared_proto::{
    Decoder, Event, Framing, Packet, READINGS_FRAME, ReceivedPacket, Sample, Values,
};

const PIECE: usize = 4096;

fn main() {
    divan::main();
}

fn stream(framing: Framing) -> Vec<u8> {
    let mut stream = Vec::new();
    for i in 0..20_000_u32 {
        let readings = std::array::from_fn(|c| (i * 131 + c as u32 * 7919) as u16);
        let sample = Sample {
            sequence: i as u16,
            clock_us: i * 10_000,
            values: Values::Readings(readings),
            saturated: 0,
            dropped: 0,
        };
        let payload = Packet::Sample(sample).encode();
        match framing {
            Framing::Cobs => stream.extend_from_slice(&payload),
            Framing::Xbee(mode) => {
                let from = Address::Short(0x2052);
                let frame = ApiFrame::Receive { from, rssi: Some(40), payload: &payload };
                stream.extend_from_slice(&frame.encode(mode).expect("a short payload"));
            }
        }
    }
    stream
}

#[divan::bench(args = Framing::ALL)]
fn samples(bencher: Bencher<'_, '_>, framing: Framing) {
    let stream = stream(framing);
    bencher.counter(BytesCount::of_slice(&stream)).bench_local(|| {
        let mut decoder = Decoder::new(framing);
        let mut sum = 0_u64;
        for piece in black_box(&stream).chunks(PIECE) {
            decoder.feed(piece, |event| {
                if let Event::Packet(ReceivedPacket { packet: Packet::Sample(sample), .. }) = event
                {
                    sum += u64::from(sample.clock_us);
                }
            });
        }
        (sum, decoder.counters)
    });
}

#[divan::bench]
fn noise(bencher: Bencher<'_, '_>) {
    let mut state = 1_u64;
    let noise: Vec<u8> = std::iter::repeat_with(|| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 56) as u8
    })
    .take(1 << 20)
    .collect();
    bencher.counter(BytesCount::of_slice(&noise)).bench_local(|| {
        let mut decoder = Decoder::new(Framing::Cobs);
        black_box(&noise).chunks(PIECE).for_each(|piece| decoder.feed(piece, |_| {}));
        decoder.counters
    });
}

#[divan::bench]
fn encode(bencher: Bencher<'_, '_>) {
    let samples: Vec<Sample> = (0..20_000_u32)
        .map(|i| Sample {
            sequence: i as u16,
            clock_us: i * 10_000,
            values: Values::Readings(std::array::from_fn(|c| (i * 131 + c as u32 * 7919) as u16)),
            saturated: 0,
            dropped: 0,
        })
        .collect();
    bencher.counter(BytesCount::new(READINGS_FRAME * samples.len())).bench_local(|| {
        black_box(&samples)
            .iter()
            .map(|&sample| Packet::Sample(sample).encode().len())
            .sum::<usize>()
    });
}
