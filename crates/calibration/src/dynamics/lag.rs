//! The time between readings and reference.

use crate::memory::TimeBase;

/// How much later the reference shows a load than the readings of the same row do.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ReferenceLag {
    /// What time is counted in.
    pub time_base: TimeBase,
    /// In units of the time base; negative if the readings lag behind the reference.
    pub by: f64,
}

/// A time between two rows.
#[derive(Clone, Copy, Debug)]
pub(super) struct BetweenRows {
    before: usize,
    after: usize,
    /// How far from the one to the other.
    share: f64,
}

impl BetweenRows {
    /// For each of some rows, in ascending order, where the time `by` after its own lies: between two rows, or up to one
    /// row beyond the ends of its segment; further out the last value is held. `times` ascend within each of `segments`,
    /// which are the first rows of stretches without a gap.
    pub(super) fn later(
        times: &[f64],
        segments: &[usize],
        by: f64,
        rows: impl IntoIterator<Item = usize>,
    ) -> Vec<Self> {
        let ends = segments.iter().skip(1).copied().chain([times.len()]);
        let mut stretches = segments.iter().copied().zip(ends);
        let mut stretch = (0, 0);
        let of_row = |row: usize| {
            while row >= stretch.1
                && let Some(next) = stretches.next()
            {
                stretch = next;
            }
            let (start, end) = stretch;
            let wanted = times[row] + by;
            let last = end.saturating_sub(2).max(start);
            let mut before = row.min(last);
            while before < last && times[before + 1] <= wanted {
                before += 1;
            }
            while before > start && times[before] > wanted {
                before -= 1;
            }
            let after = (before + 1).min(end - 1);
            let span = times[after] - times[before];
            let share = if span > 0.0 { (wanted - times[before]) / span } else { 0.0 };
            Self { before, after, share: share.clamp(-1.0, 2.0) }
        };
        rows.into_iter().map(of_row).collect()
    }

    /// The value of a column at that time, linear between the rows.
    pub(super) fn value(&self, column: &[f64]) -> f64 {
        column[self.before] + self.share * (column[self.after] - column[self.before])
    }
}

/// The first rows of stretches in which time does not go back or jump by more than `gap`, if that is given.
pub(super) fn segments(times: &[f64], gap: Option<f64>) -> Vec<usize> {
    let is_cut = |row: &usize| {
        let step = times[*row] - times[*row - 1];
        !(step >= 0.0 && gap.is_none_or(|gap| step <= gap))
    };
    let first = (!times.is_empty()).then_some(0);
    first.into_iter().chain((1..times.len()).filter(is_cut)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_straight_line_is_moved_along_itself_and_held_beyond_the_ends_of_segments() {
        let times = [0.0, 1.0, 1.5, 3.0, 50.0, 51.0];
        let segments = segments(&times, Some(10.0));
        assert_eq!(segments, [0, 4]);
        let column = times.map(|time| 2.0 * time);
        let shifted = |by: f64| -> Vec<f64> {
            let then = BetweenRows::later(&times, &segments, by, 0..times.len());
            then.iter().map(|then| then.value(&column)).collect()
        };
        let later = shifted(0.25);
        assert_eq!(later, [0.5, 2.5, 3.5, 6.5, 100.5, 102.5]);
        let earlier = shifted(-0.75);
        assert_eq!(earlier, [-1.5, 0.5, 1.5, 4.5, 98.5, 100.5]);
        let much_later = shifted(5.0);
        assert_eq!(much_later, [9.0, 9.0, 9.0, 9.0, 104.0, 104.0]);
        let some = BetweenRows::later(&times, &segments, 0.25, [1, 4]);
        assert_eq!([some[0].value(&column), some[1].value(&column)], [2.5, 100.5]);
    }

    #[test]
    fn time_that_goes_back_begins_a_segment() {
        assert_eq!(segments(&[5.0, 5.0, 6.0, 2.0, 3.0], None), [0, 3]);
        assert!(segments(&[], None).is_empty());
    }
}
