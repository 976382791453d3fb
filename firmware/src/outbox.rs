//! What waits for the link.

use heapless::Deque;
use shared_proto::{Answer, Boot, Frame, Packet, Sample, Values};

/// Samples that can wait: 160 ms at 100 Hz.
pub(crate) const SAMPLES: usize = 16;

/// Answers that can wait. The host asks one thing at a time.
const ANSWERS: usize = 4;

/// Frames on their way out, answers before samples.
///
/// When samples do not fit, the newest is dropped and counted, and does not use up a sequence
/// number: a gap in the sequence is a loss on the way, a step of `dropped` one on the board.
#[derive(Clone, Debug, Default)]
pub(crate) struct Outbox {
    answers: Deque<Frame, ANSWERS>,
    samples: Deque<Frame, SAMPLES>,
    sequence: u16,
    overflowed: u32,
}

impl Outbox {
    /// Nothing waits.
    pub(crate) const fn new() -> Self {
        Self { answers: Deque::new(), samples: Deque::new(), sequence: 0, overflowed: 0 }
    }

    /// Samples dropped so far; wraps.
    pub(crate) fn overflowed(&self) -> u32 {
        self.overflowed
    }

    /// A sample for the host; `late` is how many frames were not taken so far.
    pub(crate) fn push_sample(&mut self, clock_us: u32, values: Values, saturated: u8, late: u32) {
        let dropped = late.wrapping_add(self.overflowed) as u8;
        let sample = Sample { sequence: self.sequence, clock_us, values, saturated, dropped };
        match self.samples.push_back(Packet::Sample(sample).encode()) {
            Ok(()) => self.sequence = self.sequence.wrapping_add(1),
            Err(_) => self.overflowed = self.overflowed.wrapping_add(1),
        }
    }

    /// An answer for the host. If too many wait it is lost, and the host will ask again.
    pub(crate) fn push_answer(&mut self, number: u16, answer: Answer) {
        _ = self.answers.push_back(Packet::Answer { number, answer }.encode());
    }

    /// Word that the board has started.
    pub(crate) fn push_boot(&mut self, boot: Boot) {
        _ = self.answers.push_back(Packet::Boot(boot).encode());
    }

    /// What goes out next.
    pub(crate) fn pop(&mut self) -> Option<Frame> {
        self.answers.pop_front().or_else(|| self.samples.pop_front())
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use super::*;
    use std::vec::Vec;

    fn sent(outbox: &mut Outbox) -> Vec<Packet> {
        let frames = core::iter::from_fn(|| outbox.pop());
        frames.map(|frame| Packet::decode(&frame[..frame.len() - 1]).unwrap()).collect()
    }

    fn push(outbox: &mut Outbox, count: u16, late: u32) {
        for i in 0..count {
            outbox.push_sample(u32::from(i), Values::Readings([i; 8]), 0, late);
        }
    }

    fn sequence_and_dropped(packets: &[Packet]) -> Vec<(u16, u8)> {
        let samples = packets.iter().map(|packet| match packet {
            Packet::Sample(sample) => (sample.sequence, sample.dropped),
            other => panic!("{other:?}"),
        });
        samples.collect()
    }

    #[test]
    fn what_does_not_fit_is_counted_and_leaves_no_gap_in_the_sequence() {
        let mut outbox = Outbox::new();
        push(&mut outbox, SAMPLES as u16 + 3, 0);
        assert_eq!(outbox.overflowed(), 3);
        let packets = sent(&mut outbox);
        let expected: Vec<_> = (0..SAMPLES as u16).map(|i| (i, 0)).collect();
        assert_eq!(sequence_and_dropped(&packets), expected);
        push(&mut outbox, 1, 2);
        assert_eq!(sequence_and_dropped(&sent(&mut outbox)), [(SAMPLES as u16, 5)]);
    }

    #[test]
    fn answers_go_before_samples_and_are_not_kept_out_by_them() {
        let mut outbox = Outbox::new();
        push(&mut outbox, SAMPLES as u16, 0);
        outbox.push_answer(9, Answer::Done);
        assert_eq!(sent(&mut outbox)[0], Packet::Answer { number: 9, answer: Answer::Done });
    }
}
