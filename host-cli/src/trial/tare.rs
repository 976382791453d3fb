//! What is taken as unloaded.

use super::error::TrialError;
use super::leg::unwrap;
use super::options::{Rule, TareRule};

/// The frames that a tare is taken from, found while a log is read.
#[derive(Clone, Debug, PartialEq)]
pub struct TareSearch {
    rule: TareRule,
    rows: Rule,
    /// Readings of the frames found, counts, one column a channel.
    readings: Vec<Vec<f64>>,
    /// Time of each frame, s.
    times_s: Vec<f64>,
    /// Position of the right leg at each frame, counts; empty if not known.
    leg: Vec<f64>,
    is_done: bool,
}

/// The frames that were found.
#[derive(Clone, Debug, PartialEq)]
pub struct TareFrames {
    /// Readings, counts, one column a channel.
    pub readings: Vec<Vec<f64>>,
    /// Time of each, s.
    pub times_s: Vec<f64>,
    /// Position of the right leg at each, counts; empty if not known.
    pub leg: Vec<f64>,
}

impl TareSearch {
    /// Nothing found yet.
    pub fn new(rule: TareRule, rows: Rule) -> Self {
        let is_done = rule == TareRule::Untared;
        let (readings, times_s, leg) = Default::default();
        Self { rule, rows, readings, times_s, leg, is_done }
    }

    /// Whether rows that end at `last_s` may be among what is looked for.
    pub fn wants(&self, last_s: f64) -> bool {
        match self.rule {
            TareRule::Between(start_s, _) => !self.is_done && last_s >= start_s,
            _ => !self.is_done,
        }
    }

    /// Looks at the next rows that are wanted, in order; `leg` is the position of the right leg, if
    /// there is one.
    pub fn look_at(
        &mut self,
        times_s: &[f64],
        readings: &[Vec<f64>],
        fresh: &[bool],
        leg: Option<&[f64]>,
    ) {
        self.readings.resize_with(readings.len(), Vec::new);
        for (row, &time) in times_s.iter().enumerate() {
            match self.rule {
                TareRule::Untared => return,
                TareRule::First(frames) => {
                    self.is_done = self.found() >= frames;
                }
                TareRule::Between(_, end_s) => self.is_done = time > end_s,
            }
            if self.is_done {
                return;
            }
            let early = matches!(self.rule, TareRule::Between(start_s, _) if time < start_s);
            if early || (self.rows == Rule::Time && !fresh[row]) {
                continue;
            }
            for (column, readings) in self.readings.iter_mut().zip(readings) {
                column.push(readings[row]);
            }
            self.times_s.push(time);
            self.leg.extend(leg.map(|leg| leg[row]));
        }
    }

    fn found(&self) -> usize {
        self.readings.first().map_or(0, Vec::len)
    }

    /// The frames; `None` where none are to be taken.
    ///
    /// # Errors
    /// [`TrialError::TareFrames`] if there are too few.
    pub fn finish(self) -> Result<Option<TareFrames>, TrialError> {
        let found = self.found();
        let wanted = match self.rule {
            TareRule::Untared => return Ok(None),
            TareRule::First(frames) => frames,
            TareRule::Between(..) => 1,
        };
        if found < wanted.max(1) {
            return Err(TrialError::TareFrames { wanted, found });
        }
        let Self { readings, times_s, leg, .. } = self;
        Ok(Some(TareFrames { readings, times_s, leg }))
    }
}

impl TareFrames {
    /// Time of the last frame, s.
    pub fn end_s(&self) -> f64 {
        self.times_s.last().copied().unwrap_or(f64::NEG_INFINITY)
    }

    /// By how much the right leg moves, rad; 0 if that is not known.
    pub(super) fn turned_rad(&self, rad_per_count: f64) -> f64 {
        let angle = unwrap(&self.times_s[..self.leg.len()], &self.leg, rad_per_count);
        let span = |(low, high): (f64, f64), a: &f64| (low.min(*a), high.max(*a));
        let (low, high) = angle.iter().fold((f64::INFINITY, f64::NEG_INFINITY), span);
        (high - low).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn search(rule: TareRule, rows: Rule) -> Result<Option<TareFrames>, TrialError> {
        let mut search = TareSearch::new(rule, rows);
        let times: Vec<f64> = (0..12).map(f64::from).collect();
        let readings = [times.iter().map(|t| (t / 2.0).floor()).collect::<Vec<_>>()];
        let fresh: Vec<bool> = (0..12).map(|i| i % 2 == 0).collect();
        for start in (0..12).step_by(5) {
            let end = (start + 5).min(12);
            if search.wants(times[end - 1]) {
                let piece = [readings[0][start..end].to_vec()];
                search.look_at(&times[start..end], &piece, &fresh[start..end], None);
            }
        }
        search.finish()
    }

    #[test]
    fn first_frames_count_once_by_time_and_rows_count_by_row() {
        let tare = search(TareRule::First(4), Rule::Time).unwrap().unwrap();
        assert_eq!(tare.readings, [[0.0, 1.0, 2.0, 3.0]]);
        assert_eq!((tare.times_s[0], tare.end_s()), (0.0, 6.0));
        let tare = search(TareRule::First(4), Rule::Rows).unwrap().unwrap();
        assert_eq!(tare.readings, [[0.0, 0.0, 1.0, 1.0]]);
        assert_eq!(search(TareRule::Untared, Rule::Time), Ok(None));
        let error = search(TareRule::First(7), Rule::Time).unwrap_err();
        assert_eq!(error, TrialError::TareFrames { wanted: 7, found: 6 });
    }

    #[test]
    fn a_tare_by_time_takes_the_frames_between() {
        let tare = search(TareRule::Between(3.0, 8.5), Rule::Time).unwrap().unwrap();
        assert_eq!(tare.readings, [[2.0, 3.0, 4.0]]);
        assert!(search(TareRule::Between(20.0, 30.0), Rule::Time).is_err());
    }
}
