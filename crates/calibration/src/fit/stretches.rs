//! Stretches of rows that a model does not follow: a sensor that slipped, a log that begins with another pose.

use super::choice::Training;
use super::evaluation::BlockErrors;
use super::outliers::RowPlace;
use crate::quality::significant;
use shell_data::wrench::{Axis, PerAxis};

/// Rows of a window, and the windows that it takes.
pub(super) const WINDOW: usize = 64;
const WINDOWS: usize = 8;

/// How many times as large as elsewhere the error of a window is that is not followed. Of recordings of continuous motion
/// some windows err five times as much, where the motion is fastest.
const TIMES: f64 = 6.0;

/// Mean squares of the errors in a window.
#[derive(Clone, Copy, Debug)]
pub(super) struct ErrorWindow {
    /// Its first row.
    pub(super) first: RowPlace,
    pub(super) rows: usize,
    /// N² and (N·m)².
    pub(super) squares: PerAxis<f64>,
}

impl ErrorWindow {
    /// Those of a block.
    pub(super) fn of_block(log: usize, place: u64, errors: &BlockErrors) -> Vec<Self> {
        let window = |(at, squares): (usize, &PerAxis<f64>)| {
            let row = WINDOW * at;
            let rows = WINDOW.min(errors.rows as usize - row);
            Self { first: RowPlace { log, place, row }, rows, squares: *squares }
        };
        errors.windows.iter().enumerate().map(window).collect()
    }
}

/// A stretch of rows that the model does not follow, the worst of those that there are.
#[derive(Clone, Debug, PartialEq)]
pub struct ErrorStretch {
    /// The first and the last row.
    pub ends: [RowPlace; 2],
    /// The axis that errs most.
    pub axis: Axis,
    /// Root mean square error there, and in all rows that are followed, N or N·m.
    pub rms: [f64; 2],
    /// How many more stretches there are.
    pub others: usize,
}

impl ErrorStretch {
    /// The worst, of windows in the order of the rows.
    pub(super) fn worst(windows: &[ErrorWindow]) -> Option<Self> {
        if windows.len() < WINDOWS {
            return None;
        }
        let mut is_followed = vec![true; windows.len()];
        let mut elsewhere: PerAxis<f64>;
        loop {
            elsewhere = mean_squares(windows, &is_followed);
            let times = |window: &ErrorWindow| worst_axis(window, &elsewhere).1;
            let next: Vec<bool> =
                windows.iter().map(|window| times(window) <= TIMES * TIMES).collect();
            // None comes back: the others' errors only become smaller.
            let next: Vec<bool> = next.iter().zip(&is_followed).map(|(a, b)| a & b).collect();
            if std::mem::replace(&mut is_followed, next) == is_followed {
                break;
            }
        }
        let is_new = |&at: &usize| {
            let continues = |before: usize| {
                !is_followed[before] && windows[before].first.log == windows[at].first.log
            };
            !is_followed[at] && !at.checked_sub(1).is_some_and(continues)
        };
        let starts: Vec<usize> = (0..windows.len()).filter(is_new).collect();
        let by_size = |&at: &usize| worst_axis(&windows[at], &elsewhere).1;
        let worst = (0..windows.len())
            .filter(|&at| !is_followed[at])
            .max_by(|a, b| by_size(a).total_cmp(&by_size(b)))?;
        let start = *starts.iter().rev().find(|&&start| start <= worst)?;
        let end = starts.iter().find(|&&next| next > start).copied().unwrap_or(windows.len());
        let of: Vec<ErrorWindow> =
            (start..end).filter(|&at| !is_followed[at]).map(|at| windows[at]).collect();
        let (first, last) = (of.first()?, of.last()?);
        let all = mean_squares(&of, &vec![true; of.len()]);
        let (axis, _) = worst_axis(&windows[worst], &elsewhere);
        let end = RowPlace { row: last.first.row + last.rows - 1, ..last.first };
        Some(Self {
            ends: [first.first, end],
            axis: Axis::ALL[axis],
            rms: [all[axis].sqrt(), elsewhere[axis].sqrt()],
            others: starts.len() - 1,
        })
    }

    /// What is to be said of it. Its ends are these lines of a file.
    pub fn in_words(&self, file: &str, [first, last]: [u64; 2]) -> String {
        let Self { axis, rms: [rms, elsewhere], others, .. } = self;
        let others = match others {
            0 => String::new(),
            1 => "; there is one more such stretch".to_owned(),
            others => format!("; there are {others} more such stretches"),
        };
        format!(
            "`{file}` lines {first} to {last}: the model does not follow these rows, {} errs by {} {} RMS there, {} \
             elsewhere{others}",
            axis.name(),
            significant(*rms, 3),
            axis.unit(),
            significant(*elsewhere, 3),
        )
    }
}

impl Training<'_> {
    /// A stretch of the rows that are used, with its ends as the rows were read.
    pub(super) fn locate(&self, stretch: ErrorStretch) -> Option<ErrorStretch> {
        let [first, last] = stretch.ends.map(|end| {
            let blocks = &self.data.logs[end.log].blocks;
            let block = &blocks.iter().find(|block| block.rows.place == end.place)?.rows;
            let fresh = self.fresh.then(|| block.fresh_rows());
            let is_used = |&row: &usize| {
                fresh.as_ref().is_none_or(|fresh| fresh[row])
                    && !self.excluded.contains(end.log, end.place, row)
            };
            let row = (0..block.rows).filter(is_used).nth(end.row)?;
            Some(RowPlace { row, ..end })
        });
        Some(ErrorStretch { ends: [first?, last?], ..stretch })
    }
}

/// Of those windows that are wanted.
fn mean_squares(windows: &[ErrorWindow], wanted: &[bool]) -> PerAxis<f64> {
    let (mut sums, mut rows) = (PerAxis::default(), 0.0);
    for (window, _) in windows.iter().zip(wanted).filter(|(_, wanted)| **wanted) {
        let weight = window.rows as f64;
        sums.iter_mut().zip(&window.squares).for_each(|(sum, square)| *sum += weight * square);
        rows += weight;
    }
    sums.map(|sum: f64| if rows > 0.0 { sum / rows } else { 0.0 })
}

/// The axis whose mean square is most times as large as elsewhere, and how many.
fn worst_axis(window: &ErrorWindow, elsewhere: &PerAxis<f64>) -> (usize, f64) {
    let times = |axis: usize| match elsewhere[axis] > 0.0 {
        true => window.squares[axis] / elsewhere[axis],
        false => 0.0,
    };
    let worst = (0..6).max_by(|&a, &b| times(a).total_cmp(&times(b))).unwrap_or(0);
    (worst, times(worst))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stretch_is_found_once_with_its_ends() {
        let window = |at: usize| {
            let first = RowPlace { log: at / 50, place: 0, row: WINDOW * (at % 50) };
            let error: f64 = if (60..63).contains(&at) || at == 70 { 10.0 } else { 1.0 };
            ErrorWindow { first, rows: WINDOW, squares: [1.0, error * error, 1.0, 1.0, 1.0, 1.0] }
        };
        let windows: Vec<ErrorWindow> = (0..100).map(window).collect();
        let stretch = ErrorStretch::worst(&windows).unwrap();
        assert!(stretch.ends.iter().all(|end| end.log == 1));
        assert_eq!((stretch.axis, stretch.others), (Axis::Fy, 1));
        assert_eq!(stretch.rms, [10.0, 1.0]);
        let rows = stretch.ends.map(|end| end.row / WINDOW);
        assert!(rows == [10, 12] || rows == [20, 20], "{rows:?}");
        assert_eq!(ErrorStretch::worst(&windows[..50]), None);
    }
}
