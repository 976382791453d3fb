//! The time between readings and reference.

use crate::memory::TimeBase;

/// How much later the reference shows a load than the readings of the same row do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReferenceLag {
    /// What time is counted in.
    pub time_base: TimeBase,
    /// In units of the time base; negative if the readings lag behind the reference.
    pub by: f64,
}

/// The columns at times that are later `by` so much, straight between rows and up to one row beyond the ends of a segment;
/// further out the value is held. `times` ascend within each of `segments`, the first rows of stretches without a gap.
pub(super) fn shifted(times: &[f64], segments: &[usize], by: f64, column: &[f64]) -> Vec<f64> {
    let mut moved = Vec::with_capacity(column.len());
    let ends = segments.iter().skip(1).copied().chain([times.len()]);
    for (&start, end) in segments.iter().zip(ends) {
        let mut before = start;
        for row in start..end {
            let wanted = times[row] + by;
            while before + 2 < end && times[before + 1] <= wanted {
                before += 1;
            }
            let after = (before + 1).min(end - 1);
            let span = times[after] - times[before];
            let share = if span > 0.0 { (wanted - times[before]) / span } else { 0.0 };
            let share = share.clamp(-1.0, 2.0);
            moved.push(column[before] + share * (column[after] - column[before]));
        }
    }
    moved
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
        let later = shifted(&times, &segments, 0.25, &column);
        assert_eq!(later, [0.5, 2.5, 3.5, 6.5, 100.5, 102.5]);
        let earlier = shifted(&times, &segments, -0.75, &column);
        assert_eq!(earlier, [-1.5, 0.5, 1.5, 4.5, 98.5, 100.5]);
        let much_later = shifted(&times, &segments, 5.0, &column);
        assert_eq!(much_later, [9.0, 9.0, 9.0, 9.0, 104.0, 104.0]);
    }

    #[test]
    fn time_that_goes_back_begins_a_segment() {
        assert_eq!(segments(&[5.0, 5.0, 6.0, 2.0, 3.0], None), [0, 3]);
        assert!(segments(&[], None).is_empty());
    }
}
