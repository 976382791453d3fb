//! The expected ranges and steps of rows: those of the rows so far, and of other accumulators.
//!
//! The plan of centre, limbs and digits is made for these. It decides how much work sums are, and
//! has no influence on them.

use std::sync::Arc;

use super::digits::Numbers;
use super::plan::SummationPlan;
use crate::exact::moments::channel_range::ChannelRange;
use crate::exact::moments::reading_unit::ReadingUnit;

/// Ranges and steps that rows are expected to keep to.
#[derive(Clone, Debug)]
pub(crate) struct ExpectedRows {
    pub(crate) channels: Vec<ChannelRange>,
    pub(crate) numbers: [Numbers; 6],
    /// The latest plan for such rows, in the units of the channels.
    pub(crate) plan: Option<Arc<SummationPlan>>,
}

impl ExpectedRows {
    pub(crate) fn nothing(channels: usize) -> Self {
        let channels = vec![ChannelRange::EMPTY; channels];
        Self { channels, numbers: [Numbers::NONE; 6], plan: None }
    }

    /// Whether readings are in counts. Readings with fractions are too rare for
    /// their ranges to be shared.
    pub(crate) fn in_counts(&self) -> bool {
        self.channels.iter().all(|channel| channel.unit == ReadingUnit::COUNT)
    }

    /// Whether the plan is this very one.
    pub(crate) fn has_plan(&self, plan: Option<&Arc<SummationPlan>>) -> bool {
        self.plan.as_ref().map(Arc::as_ptr) == plan.map(Arc::as_ptr)
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

    /// Expects such a wrench.
    pub(crate) fn expect_wrench<C: AsRef<[f64]>>(&mut self, wrench: &[C]) {
        for (numbers, column) in self.numbers.iter_mut().zip(wrench) {
            *numbers = numbers.and(Numbers::new(column.as_ref()));
        }
    }

    pub(crate) fn merge_numbers(&mut self, other: &[Numbers; 6]) {
        for (own, &other) in self.numbers.iter_mut().zip(other) {
            *own = own.and(other);
        }
    }
}
