//! The damage that the CRC detects, and the effect of noise.

use shared_proto::{Decoder, Framing, Packet, Sample, Values};
use system_tests::random::Random;

fn sample(random: &mut Random) -> Packet {
    Packet::Sample(Sample {
        sequence: random.next() as u16,
        clock_us: random.next() as u32,
        values: Values::Readings(std::array::from_fn(|_| random.next() as u16)),
        saturated: 0,
        dropped: random.next() as u8,
    })
}

/// CRC-16/M17 by the definition, bit by bit.
fn crc(content: &[u8]) -> u16 {
    content.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte) << 8, |crc, _| {
            crc << 1 ^ if crc & 0x8000 != 0 { 0x5935 } else { 0 }
        })
    })
}

/// Effect of flipping each bit on the XOR of computed and received CRC, which by linearity is the same for any content.
fn syndromes(content: usize) -> Vec<u16> {
    let zero = crc(&vec![0; content]);
    let mut syndromes: Vec<u16> = (0..8 * content)
        .map(|bit| {
            let mut flipped = vec![0; content];
            flipped[bit / 8] ^= 0x80 >> (bit % 8);
            crc(&flipped) ^ zero
        })
        .collect();
    syndromes.extend((0..16).map(|bit| 1 << bit));
    syndromes
}

// Up to four bits are undetected only if the syndromes of two sets of at most two are equal.
#[test]
fn every_error_of_up_to_four_bits_in_a_sample_of_readings_is_found() {
    let packet = sample(&mut Random(1)).encode();
    // Without the CRC, the COBS code and the delimiter.
    let single = syndromes(packet.len() - 4);
    let mut seen = vec![false; 1 << 16];
    seen[0] = true;
    for &syndrome in &single {
        assert!(!std::mem::replace(&mut seen[usize::from(syndrome)], true));
    }
    for (i, a) in single.iter().enumerate() {
        for b in &single[..i] {
            assert!(!std::mem::replace(&mut seen[usize::from(a ^ b)], true));
        }
    }
}

// The first byte is the COBS code; a bit can turn version 3 into version 2, with another CRC.
#[test]
fn no_error_of_up_to_three_bits_of_a_frame_passes_as_another_packet() {
    let sent = sample(&mut Random(5));
    let frame = sent.encode();
    let body = &frame[..frame.len() - 1];
    let flip = |bytes: &mut [u8], bit: usize| bytes[bit / 8] ^= 1 << (bit % 8);
    let bits = 8 * body.len();
    let mut passed = 0;
    for first in 0..bits {
        for second in first..bits {
            // Every seventh position of the third bit, with a different phase for each pair.
            for third in (second + (first + second) % 7..bits).step_by(7) {
                let mut damaged = body.to_vec();
                [first, second, third].into_iter().for_each(|bit| flip(&mut damaged, bit));
                let is_other = damaged != body && !damaged.contains(&0);
                passed += u32::from(is_other && Packet::decode(&damaged).is_ok());
            }
        }
    }
    assert_eq!(passed, 0);
}

// Two to thirty replaced bytes make the CRC random: it misses 1 in 65,536, 15.3 ± 3.9 of a million
// frames; six standard deviations above are 39.
#[test]
fn of_frames_damaged_beyond_recognition_no_more_pass_than_the_crc_allows() {
    let mut random = Random(1);
    let mut passed = 0;
    for _ in 0..1_000_000 {
        let packet = sample(&mut random);
        let frame = packet.encode();
        let mut frame = frame[..frame.len() - 1].to_vec();
        for _ in 0..2 + random.below(29) {
            let at = random.below(frame.len() as u64) as usize;
            frame[at] = 1 + random.below(255) as u8;
        }
        passed += u32::from(Packet::decode(&frame).is_ok_and(|decoded| decoded.packet != packet));
    }
    assert!(passed <= 39, "{passed}");
}

// Random bytes, and bytes many of which have a meaning.
#[test]
fn ten_million_random_strings_do_no_harm() {
    const MEANINGFUL: [u8; 12] =
        [0x00, 0x7E, 0x7D, 0x14, 0x18, 0x19, 0x81, 0x01, 0x03, 0x20, b'E', 20];
    let mut random = Random(2);
    let mut decoders = Framing::ALL.map(Decoder::new);
    let mut original = shared_proto::skinproc::Decoder::new();
    let mut string = [0; 64];
    let mut events = 0_u64;
    for i in 0..10_000_000_u32 {
        let len = random.below(33) as usize;
        for chunk in string[..len].chunks_mut(8) {
            chunk.copy_from_slice(&random.next().to_le_bytes()[..chunk.len()]);
        }
        if i % 2 == 0 {
            string[..len].iter_mut().filter(|byte| **byte & 1 != 0).for_each(|byte| {
                *byte = MEANINGFUL[usize::from(*byte >> 1) % MEANINGFUL.len()];
            });
        }
        match decoders.get_mut(i as usize % 4) {
            Some(decoder) => decoder.feed(&string[..len], |_| events += 1),
            None => original.feed(&string[..len], |_| events += 1),
        }
    }
    // One piece in 256 has a matching length and header, and one in 65,536 of these a matching CRC.
    assert!(events < 100, "{events}");
    // All state is inline: a decoder cannot grow.
    assert!(size_of::<Decoder>() <= 640);
}
