//! What rows are expected to be like: those so far, and what other accumulators have met.
//!
//! The choice of centre, limbs and digits is made for these. It decides how much work sums are, and
//! has no influence on them.

use std::sync::Arc;

use super::choice::Choice;
use super::digits::Numbers;
use crate::exact::moments::channel::Channel;
use crate::exact::moments::channel::survey;
use crate::exact::moments::unit::Unit;

/// Ranges and steps that rows are expected to keep to.
#[derive(Clone, Debug)]
pub(crate) struct Expected {
    pub(crate) channels: Vec<Channel>,
    pub(crate) numbers: [Numbers; 6],
    /// The latest choice that was made for such rows, in the units of the channels.
    pub(crate) choice: Option<Arc<Choice>>,
}

impl Expected {
    pub(crate) fn nothing(channels: usize) -> Self {
        let channels = vec![Channel::EMPTY; channels];
        Self { channels, numbers: [Numbers::NONE; 6], choice: None }
    }

    /// Whether readings are in counts. Those with fractions are too rare for what is learnt of them
    /// to be passed on.
    pub(crate) fn in_counts(&self) -> bool {
        self.channels.iter().all(|channel| channel.unit == Unit::COUNT)
    }

    /// Expects what `other` expects, too.
    pub(crate) fn learn(&mut self, other: &Self) {
        if self.in_counts() && other.in_counts() {
            for (own, other) in self.channels.iter_mut().zip(&other.channels) {
                own.merge(other);
            }
        }
        self.merge_numbers(&other.numbers);
    }

    /// Expects such readings. Those that cannot be summed exactly are of no account yet.
    pub(crate) fn expect_readings<C: AsRef<[f64]>>(&mut self, readings: &[C]) {
        for (expected, column) in self.channels.iter_mut().zip(readings) {
            if let Ok(found) = survey(column.as_ref(), Unit::COUNT) {
                expected.merge(&found);
            }
        }
    }

    /// Expects such a wrench.
    pub(crate) fn expect_wrench<C: AsRef<[f64]>>(&mut self, wrench: &[C]) {
        for (numbers, column) in self.numbers.iter_mut().zip(wrench) {
            *numbers = numbers.and(Numbers::of(column.as_ref()));
        }
    }

    pub(crate) fn merge_numbers(&mut self, other: &[Numbers; 6]) {
        for (own, &other) in self.numbers.iter_mut().zip(other) {
            *own = own.and(other);
        }
    }
}
