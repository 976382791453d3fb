//! Queues of frames for the link.

use crate::board::SeenEdge;
use heapless::Deque;
use shared_proto::{Answer, Edge, Frame, Health, Packet, PacketOrigin, Sample};

/// Capacity for samples: 160 ms at 100 Hz. A health report takes the place of a sample.
pub(crate) const SAMPLES: usize = 16;

/// The host sends one request at a time.
const ANSWERS: usize = 4;

pub(crate) const EDGES: usize = 8;

/// Outgoing frames: answers before samples, and samples before edges.
///
/// The oldest sample is dropped and counted when the next does not fit, so that the host gets the
/// latest ones after a stalled link. A sample gets its sequence number when it leaves: a gap in the
/// sequence is a loss on the link, a step of `dropped` a loss on the board. Edges use the capacity
/// that samples leave; the next edge's number shows how many did not fit.
#[derive(Clone, Debug, Default)]
pub(crate) struct Outbox {
    origin: PacketOrigin,
    answers: Deque<Frame, ANSWERS>,
    stream: Deque<Packet, SAMPLES>,
    edges: Deque<Edge, EDGES>,
    seen_edges: u16,
    sequence: u16,
    /// Samples dropped so far; wraps.
    pub(crate) overflowed: u32,
}

impl Outbox {
    pub(crate) fn new(origin: PacketOrigin) -> Self {
        Self { origin, ..Self::default() }
    }

    /// Queues a sample, or a health report that precedes later samples. A sample's `dropped` counts
    /// the frames not taken; its sequence number is set when it leaves.
    pub(crate) fn push_in_turn(&mut self, packet: Packet) {
        if self.stream.is_full() {
            let dropped = self.stream.pop_front();
            let is_sample = matches!(dropped, Some(Packet::Sample(_)));
            self.overflowed = self.overflowed.wrapping_add(u32::from(is_sample));
        }
        _ = self.stream.push_back(packet);
    }

    pub(crate) fn push_edge(&mut self, seen: SeenEdge) {
        let number = self.seen_edges.wrapping_add(seen.missed);
        self.seen_edges = number.wrapping_add(1);
        // Without room, the gap in the numbers shows the loss.
        _ = self.edges.push_back(Edge { number, clock_us: seen.at_us as u32 });
    }

    pub(crate) fn answer(&mut self, number: u16, answer: Answer) {
        self.push_now(Packet::Answer { number, answer });
    }

    /// Queues a packet ahead of all samples. If the queue is full, the packet is dropped, and the host will repeat its
    /// request.
    pub(crate) fn push_now(&mut self, packet: Packet) {
        _ = self.answers.push_back(packet.encode_from(self.origin));
    }

    pub(crate) fn pop_answer(&mut self) -> Option<Frame> {
        self.answers.pop_front()
    }

    /// Takes the next frame that is not an answer.
    pub(crate) fn pop(&mut self) -> Option<Frame> {
        let origin = self.origin;
        let edge = |edge| Packet::Edge(edge).encode_from(origin);
        self.pop_stream().or_else(|| self.edges.pop_front().map(edge))
    }

    fn pop_stream(&mut self) -> Option<Frame> {
        let sequence = self.sequence;
        let packet = match self.stream.pop_front()? {
            Packet::Health(health) => Packet::Health(Health { sequence, ..health }),
            Packet::Sample(sample) => {
                self.sequence = sequence.wrapping_add(1);
                let dropped = sample.dropped.wrapping_add(self.overflowed as u8);
                Packet::Sample(Sample { sequence, dropped, ..sample })
            }
            other => other,
        };
        Some(packet.encode_from(self.origin))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use shared_proto::{Timing, Values, Vitals};
    use std::vec::Vec;

    const ORIGIN: PacketOrigin = PacketOrigin { board: 7, start: 9 };

    fn sent(outbox: &mut Outbox) -> Vec<Packet> {
        let frames = core::iter::from_fn(|| outbox.pop_answer().or_else(|| outbox.pop()));
        let packet = |frame: Frame| {
            let received = Packet::decode(&frame[..frame.len() - 1]).unwrap();
            assert_eq!(received.origin, Some(ORIGIN));
            received.packet
        };
        frames.map(packet).collect()
    }

    fn push(outbox: &mut Outbox, count: u16, late: u32) {
        for i in 0..count {
            let (clock_us, values) = (u32::from(i), Values::Readings([i; 8]));
            let dropped = late as u8;
            let sample = Sample { sequence: 0, clock_us, values, saturated: 0, dropped };
            outbox.push_in_turn(Packet::Sample(sample));
        }
    }

    fn samples(packets: &[Packet]) -> Vec<(u16, u32, u8)> {
        let samples = packets.iter().map(|packet| match packet {
            Packet::Sample(sample) => (sample.sequence, sample.clock_us, sample.dropped),
            other => panic!("{other:?}"),
        });
        samples.collect()
    }

    #[test]
    fn the_oldest_is_dropped_and_counted_and_leaves_no_gap_in_the_sequence() {
        let mut outbox = Outbox::new(ORIGIN);
        push(&mut outbox, SAMPLES as u16 + 3, 0);
        assert_eq!(outbox.overflowed, 3);
        let expected: Vec<_> = (0..SAMPLES as u16).map(|i| (i, u32::from(i) + 3, 3)).collect();
        assert_eq!(samples(&sent(&mut outbox)), expected);
        push(&mut outbox, 1, 2);
        assert_eq!(samples(&sent(&mut outbox)), [(SAMPLES as u16, 0, 5)]);
    }

    #[test]
    fn a_frame_that_was_late_is_counted_from_the_sample_after_it() {
        let mut outbox = Outbox::new(ORIGIN);
        push(&mut outbox, 1, 0);
        push(&mut outbox, 1, 4);
        assert_eq!(samples(&sent(&mut outbox)), [(0, 0, 0), (1, 0, 4)]);
    }

    #[test]
    fn health_keeps_its_place_among_the_samples_and_costs_none_of_the_counts() {
        let mut outbox = Outbox::new(ORIGIN);
        push(&mut outbox, 2, 0);
        let vitals = Vitals { temperature_cdeg: Some(2_512), ..Vitals::default() };
        let timing = Timing { first_us: 300, step_us: 500 };
        let health = Health { sequence: 0, clock_us: 7, timing, vitals, dark: [9; 8] };
        outbox.push_in_turn(Packet::Health(health));
        push(&mut outbox, 1, 0);
        let health = Health { sequence: 2, ..health };
        let out = sent(&mut outbox);
        assert_eq!(out[2], Packet::Health(health));
        assert!(matches!(out[3], Packet::Sample(Sample { sequence: 2, .. })));
        outbox.push_in_turn(Packet::Health(Health { clock_us: 8, ..health }));
        push(&mut outbox, SAMPLES as u16, 0);
        assert_eq!(outbox.overflowed, 0);
    }

    #[test]
    fn edges_go_after_samples_and_those_without_room_leave_a_gap_in_the_numbers() {
        let mut outbox = Outbox::new(ORIGIN);
        let edge = |at_us, missed| SeenEdge { at_us, missed };
        outbox.push_edge(edge(1, 0));
        push(&mut outbox, 2, 0);
        let out = sent(&mut outbox);
        assert_eq!(samples(&out[..2]).len(), 2);
        assert_eq!(out[2], Packet::Edge(Edge { number: 0, clock_us: 1 }));
        // Three edges missed, eight that fit, two that do not.
        for i in 0..10 {
            outbox.push_edge(edge(10 + i, if i == 0 { 3 } else { 0 }));
        }
        let numbers = sent(&mut outbox).into_iter().map(|packet| match packet {
            Packet::Edge(edge) => edge.number,
            other => panic!("{other:?}"),
        });
        assert_eq!(numbers.collect::<Vec<_>>(), (4..12).collect::<Vec<_>>());
        outbox.push_edge(edge(1 << 33 | 7, 0));
        assert_eq!(sent(&mut outbox), [Packet::Edge(Edge { number: 14, clock_us: 7 })]);
    }

    #[test]
    fn answers_go_before_samples_and_are_not_kept_out_by_them() {
        let mut outbox = Outbox::new(ORIGIN);
        push(&mut outbox, SAMPLES as u16, 0);
        outbox.answer(9, Answer::Done);
        assert_eq!(sent(&mut outbox)[0], Packet::Answer { number: 9, answer: Answer::Done });
    }
}
