//! What waits for the link.

use heapless::Deque;
use shared_proto::{Answer, Boot, Frame, Packet, Sample, Values};

/// Samples that can wait: 160 ms at 100 Hz.
pub(crate) const SAMPLES: usize = 16;

/// Answers that can wait. The host asks one thing at a time.
const ANSWERS: usize = 4;

/// A sample that waits.
#[derive(Clone, Copy, Debug)]
struct Waiting {
    clock_us: u32,
    values: Values,
    saturated: u8,
    /// Frames not taken until then.
    late: u32,
}

/// Frames on their way out, answers before samples.
///
/// When samples do not fit, the oldest is dropped and counted: after a link was held up, what the
/// host gets first is what has just been measured. A sample is given its sequence number when it
/// goes out, so a gap in the sequence is a loss on the way, and a step of `dropped` one on the board.
#[derive(Clone, Debug, Default)]
pub(crate) struct Outbox {
    answers: Deque<Frame, ANSWERS>,
    samples: Deque<Waiting, SAMPLES>,
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
        if self.samples.is_full() {
            self.samples.pop_front();
            self.overflowed = self.overflowed.wrapping_add(1);
        }
        // There is room now.
        _ = self.samples.push_back(Waiting { clock_us, values, saturated, late });
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
        self.answers.pop_front().or_else(|| self.pop_sample())
    }

    fn pop_sample(&mut self) -> Option<Frame> {
        let Waiting { clock_us, values, saturated, late } = self.samples.pop_front()?;
        // All that were dropped are older than those that wait.
        let dropped = late.wrapping_add(self.overflowed) as u8;
        let sample = Sample { sequence: self.sequence, clock_us, values, saturated, dropped };
        self.sequence = self.sequence.wrapping_add(1);
        Some(Packet::Sample(sample).encode())
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

    /// Sequence number, clock and count of dropped frames of each.
    fn samples(packets: &[Packet]) -> Vec<(u16, u32, u8)> {
        let samples = packets.iter().map(|packet| match packet {
            Packet::Sample(sample) => (sample.sequence, sample.clock_us, sample.dropped),
            other => panic!("{other:?}"),
        });
        samples.collect()
    }

    #[test]
    fn the_oldest_is_dropped_and_counted_and_leaves_no_gap_in_the_sequence() {
        let mut outbox = Outbox::new();
        push(&mut outbox, SAMPLES as u16 + 3, 0);
        assert_eq!(outbox.overflowed(), 3);
        let expected: Vec<_> = (0..SAMPLES as u16).map(|i| (i, u32::from(i) + 3, 3)).collect();
        assert_eq!(samples(&sent(&mut outbox)), expected);
        push(&mut outbox, 1, 2);
        assert_eq!(samples(&sent(&mut outbox)), [(SAMPLES as u16, 0, 5)]);
    }

    #[test]
    fn a_frame_that_was_late_is_counted_from_the_sample_after_it() {
        let mut outbox = Outbox::new();
        push(&mut outbox, 1, 0);
        push(&mut outbox, 1, 4);
        assert_eq!(samples(&sent(&mut outbox)), [(0, 0, 0), (1, 0, 4)]);
    }

    #[test]
    fn answers_go_before_samples_and_are_not_kept_out_by_them() {
        let mut outbox = Outbox::new();
        push(&mut outbox, SAMPLES as u16, 0);
        outbox.push_answer(9, Answer::Done);
        assert_eq!(sent(&mut outbox)[0], Packet::Answer { number: 9, answer: Answer::Done });
    }
}
