//! Low-pass over one signal, given row by row on an even grid of time; slots of the grid may lack rows.
//!
//! The grid is divided into blocks of `2·m` slots, where m is the filter's memory. The filter of block b starts at slot
//! `2·m·b − m` and, if it also runs backward, ends m slots after the block. Outputs depend only on nearby slots of
//! fixed blocks. So a log read from its start and the rows around a window give the same bits.

use super::filter::{Butterworth, Filter, FilterError};

/// Tolerated difference from a filter over the whole log, as a share of the signal's largest change: far below a
/// converter step.
const FORGOTTEN: f64 = 1e-12;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct BlockPlan {
    design: Butterworth,
    zero_phase: bool,
    /// Starts a causal filter at zero, as the lab's `lfilter` did after taring, rather than settled
    /// at the first value.
    starts_at_zero: bool,
    /// Number of slots after which the filter has forgotten the past; a longer gap is a pause.
    memory: u64,
}

/// State of the low-pass: the signal since the last pause if zero-phase, a running filter if causal.
#[derive(Clone, Debug)]
pub(super) struct SignalFilter {
    plan: BlockPlan,
    segment: Option<Segment>,
    running: Option<Running>,
}

impl BlockPlan {
    pub(super) fn new(design: Butterworth, zero_phase: bool, starts_at_zero: bool) -> Self {
        let memory = design.memory(FORGOTTEN).max(design.zero_phase_reach() + 1) as u64;
        Self { design, zero_phase, starts_at_zero, memory }
    }

    fn block(&self, slot: u64) -> u64 {
        slot / self.length()
    }

    fn length(&self) -> u64 {
        2 * self.memory
    }

    fn span(&self, block: u64) -> std::ops::Range<u64> {
        let start = block * self.length();
        let end = start + self.length();
        let after = if self.zero_phase { self.memory } else { 0 };
        start.saturating_sub(self.memory)..end + after
    }

    /// Slots that the outputs from slot `first` to slot `last` depend on, plus enough on either
    /// side to detect a pause.
    pub(super) fn needed(&self, first: u64, last: u64) -> std::ops::Range<u64> {
        let (start, end) = (self.span(self.block(first)).start, self.span(self.block(last)).end);
        start.saturating_sub(self.memory)..end + self.memory + 1
    }

    /// Outputs the rows of a block; the segment holds the slots of its span that exist.
    fn output_block(
        &self,
        segment: &mut Segment,
        block: u64,
        outputs: &mut Vec<f64>,
    ) -> Result<(), FilterError> {
        let span = self.span(block);
        let (start, end) = (span.start.max(segment.base), span.end.min(segment.end()));
        let mut even =
            segment.even[(start - segment.base) as usize..][..(end - start) as usize].to_vec();
        self.design.zero_phase(&mut even)?;
        let block_end = (block + 1) * self.length();
        let count = segment.waiting.partition_point(|&slot| slot < block_end);
        outputs.extend(segment.waiting.drain(..count).map(|slot| even[(slot - start) as usize]));
        Ok(())
    }

    fn started(&self, slot: u64, value: f64) -> Filter {
        Filter::settled(&self.design, if self.starts_at_zero && slot == 0 { 0.0 } else { value })
    }
}

impl SignalFilter {
    pub(super) fn new(plan: BlockPlan) -> Self {
        Self { plan, segment: None, running: None }
    }

    /// Takes the next values, at ascending slots, and appends the known outputs to `outputs`, one
    /// per value, in order. A causal filter outputs them all. If values share a slot, the last one
    /// counts for later outputs.
    ///
    /// # Errors
    /// Never for a causal filter.
    pub(super) fn push(
        &mut self,
        slots: &[u64],
        values: &[f64],
        outputs: &mut Vec<f64>,
    ) -> Result<(), FilterError> {
        for (&slot, &value) in slots.iter().zip(values) {
            match self.plan.zero_phase {
                true => self.push_zero_phase(slot, value, outputs)?,
                false => self.push_causal(slot, value, outputs),
            }
        }
        Ok(())
    }

    /// # Errors
    /// [`FilterError::TooFewSamples`] if the whole log is too short.
    pub(super) fn finish(&mut self, outputs: &mut Vec<f64>) -> Result<(), FilterError> {
        let is_whole_log = self.segment.as_ref().is_some_and(|segment| segment.start == 0);
        self.close(is_whole_log, outputs)
    }

    /// Filters forward and backward, as soon as everything that a block depends on is known.
    fn push_zero_phase(
        &mut self,
        slot: u64,
        value: f64,
        outputs: &mut Vec<f64>,
    ) -> Result<(), FilterError> {
        let paused = |segment: &Segment| slot - (segment.end() - 1) > self.plan.memory;
        if self.segment.as_ref().is_some_and(paused) {
            self.close(false, outputs)?;
        }
        let plan = &self.plan;
        let Some(segment) = &mut self.segment else {
            self.segment = Some(Segment::new(slot, value));
            return Ok(());
        };
        // Output the blocks that no later value can change.
        while let Some(&first) = segment.waiting.first() {
            let block = plan.block(first);
            let end = plan.span(block).end;
            if slot < end {
                break;
            }
            segment.hold_until(end);
            plan.output_block(segment, block, outputs)?;
        }
        segment.hold_until(slot);
        let first = *segment.waiting.first().unwrap_or(&slot);
        segment.forget_before(plan.span(plan.block(first)).start);
        if segment.end() > slot {
            let last = segment.even.len() - 1;
            segment.even[last] = value;
        } else {
            segment.even.push(value);
        }
        segment.waiting.push(slot);
        Ok(())
    }

    /// Outputs pending rows. If a segment is too short for the filter and not the whole log, its last value is held.
    fn close(&mut self, is_whole_log: bool, outputs: &mut Vec<f64>) -> Result<(), FilterError> {
        let Some(mut segment) = self.segment.take() else { return Ok(()) };
        let reach = self.plan.design.zero_phase_reach() as u64;
        if !is_whole_log {
            segment.hold_until(segment.start + reach + 1);
        }
        while let Some(&first) = segment.waiting.first() {
            self.plan.output_block(&mut segment, self.plan.block(first), outputs)?;
        }
        Ok(())
    }

    fn push_causal(&mut self, slot: u64, value: f64, outputs: &mut Vec<f64>) {
        let plan = &self.plan;
        let paused = |running: &Running| slot - running.slot > plan.memory;
        let mut running = match self.running.take() {
            Some(running) if !paused(&running) => running,
            _ => {
                Running { start: slot, filter: plan.started(slot, value), next: None, slot, value }
            }
        };
        while running.slot < slot {
            running.step(plan);
        }
        running.value = value;
        outputs.push(running.filter.peek(value));
        self.running = Some(running);
    }
}

#[derive(Clone, Debug)]
struct Segment {
    start: u64,
    base: u64,
    even: Vec<f64>,
    waiting: Vec<u64>,
}

impl Segment {
    fn new(slot: u64, value: f64) -> Self {
        Self { start: slot, base: slot, even: vec![value], waiting: vec![slot] }
    }

    fn end(&self) -> u64 {
        self.base + self.even.len() as u64
    }

    fn hold_until(&mut self, end: u64) {
        let held = self.even[self.even.len() - 1];
        let length = end.saturating_sub(self.base) as usize;
        self.even.resize(length.max(self.even.len()), held);
    }

    fn forget_before(&mut self, slot: u64) {
        if slot > self.base {
            self.even.drain(..(slot - self.base) as usize);
            self.base = slot;
        }
    }
}

#[derive(Clone, Debug)]
struct Running {
    start: u64,
    filter: Filter,
    /// The filter of the next block, once it has begun.
    next: Option<Filter>,
    slot: u64,
    value: f64,
}

impl Running {
    fn step(&mut self, plan: &BlockPlan) {
        let (slot, value) = (self.slot, self.value);
        self.filter.process(&mut [value]);
        let after = plan.block(slot) + 1;
        if slot >= plan.span(after).start.max(self.start) {
            let next = self.next.get_or_insert_with(|| plan.started(slot, value));
            next.process(&mut [value]);
        }
        self.slot += 1;
        if plan.block(self.slot) == after
            && let Some(next) = self.next.take()
        {
            self.filter = next;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(zero_phase: bool) -> BlockPlan {
        BlockPlan::new(Butterworth::low_pass(4, 20.0, 1000.0).unwrap(), zero_phase, true)
    }

    fn rows(count: u64) -> (Vec<u64>, Vec<f64>) {
        let slots: Vec<u64> = (0..count)
            .filter(|i| i % 7 != 3)
            .map(|i| if i % 11 == 4 { i - 1 } else { i })
            .collect();
        let signal = slots.iter().enumerate();
        let signal =
            signal.map(|(i, slot)| ((i * i * 37) % 101) as f64 - (*slot as f64 / 300.0).sin());
        (slots.clone(), signal.collect())
    }

    fn filtered(plan: BlockPlan, slots: &[u64], values: &[f64], piece: usize) -> Vec<f64> {
        let mut filter = SignalFilter::new(plan);
        let mut outputs = Vec::new();
        for (slots, values) in slots.chunks(piece).zip(values.chunks(piece)) {
            filter.push(slots, values, &mut outputs).unwrap();
        }
        filter.finish(&mut outputs).unwrap();
        assert_eq!(outputs.len(), values.len());
        outputs
    }

    /// Signal on the grid: empty slots hold the value before them, and the last row of a slot counts.
    fn spread(slots: &[u64], values: &[f64]) -> Vec<f64> {
        let mut even: Vec<f64> = Vec::new();
        for (&slot, &value) in slots.iter().zip(values) {
            let held = even.last().copied().unwrap_or(value);
            even.truncate(slot as usize);
            even.resize(slot as usize, held);
            even.push(value);
        }
        even
    }

    #[test]
    fn output_equals_the_filter_over_the_whole_log() {
        let (slots, values) = rows(9000);
        let even = spread(&slots, &values);
        let mut zero_phase = even.clone();
        plan(true).design.zero_phase(&mut zero_phase).unwrap();
        let found = filtered(plan(true), &slots, &values, 100);
        for (found, slot) in found.iter().zip(&slots) {
            // The filter's memory is cut at 1e-12 of a range of 102; rounding is of the same size.
            assert!((found - zero_phase[*slot as usize]).abs() < 1e-10);
        }
        let mut causal = even;
        Filter::new(&plan(false).design).process(&mut causal);
        let found = filtered(plan(false), &slots, &values, 100);
        for (i, (found, slot)) in found.iter().zip(&slots).enumerate() {
            // The first of two rows in a slot gets its output before the second is known.
            if slots.get(i + 1) != Some(slot) {
                assert!((found - causal[*slot as usize]).abs() < 1e-10, "{slot}");
            }
        }
    }

    #[test]
    fn a_log_within_one_block_has_the_bits_of_the_filter() {
        let (slots, values) = rows(1000);
        assert!(plan(true).length() > 1000, "{}", plan(true).length());
        let mut even = spread(&slots, &values);
        plan(true).design.zero_phase(&mut even).unwrap();
        let expected: Vec<f64> = slots.iter().map(|&slot| even[slot as usize]).collect();
        assert_eq!(filtered(plan(true), &slots, &values, 33), expected);
    }

    #[test]
    fn pieces_and_windows_give_the_same_bits() {
        let (mut slots, values) = rows(12_000);
        // A pause in the middle, longer than the filter remembers, and a shorter gap.
        slots.iter_mut().filter(|slot| **slot > 5000).for_each(|slot| *slot += 4000);
        slots.iter_mut().filter(|slot| **slot > 14_000).for_each(|slot| *slot += 300);
        for zero_phase in [true, false] {
            let plan = plan(zero_phase);
            let whole = filtered(plan.clone(), &slots, &values, slots.len());
            assert_eq!(filtered(plan.clone(), &slots, &values, 1), whole);
            for (first, last) in
                [(0, 50), (3000, 5000), (4990, 9500), (9010, 12_000), (14_250, 15_000)]
            {
                let needed = plan.needed(first, last);
                let rows = slots.partition_point(|s| *s < needed.start)
                    ..slots.partition_point(|s| *s < needed.end);
                let part = filtered(plan.clone(), &slots[rows.clone()], &values[rows.clone()], 97);
                for row in rows.clone().filter(|&row| (first..=last).contains(&slots[row])) {
                    assert_eq!(part[row - rows.start], whole[row], "{zero_phase} {first} {row}");
                }
            }
        }
    }

    #[test]
    fn a_pause_of_years_takes_no_memory_and_splits_the_recording() {
        let slots = [0, 1, 2, u64::MAX / 4, u64::MAX / 4 + 1];
        let found = filtered(plan(true), &slots, &[1.0, 1.0, 1.0, 5.0, 5.0], 5);
        assert_eq!(found, [1.0, 1.0, 1.0, 5.0, 5.0]);
        let found = filtered(plan(false), &slots, &[0.0, 0.0, 0.0, 5.0, 5.0], 5);
        assert_eq!(found, [0.0, 0.0, 0.0, 5.0, 5.0]);
    }

    #[test]
    fn a_whole_log_that_is_too_short_is_refused() {
        let mut filter = SignalFilter::new(plan(true));
        let mut outputs = Vec::new();
        filter.push(&[0, 1, 2], &[1.0; 3], &mut outputs).unwrap();
        let error = filter.finish(&mut outputs).unwrap_err();
        assert_eq!(error, FilterError::TooFewSamples { samples: 3, needed: 16 });
    }
}
