//! Times of measurement on this computer's clock, estimated from the arrivals of samples.
//!
//! ```text
//! arrival = a + b · tick + delay,  delay ≥ 0
//! ```
//!
//! `tick` is the sensor's time or sample number, b the duration of a tick. A radio, a queue or a
//! busy program delays samples. The fastest samples determine the clock: the line lies below all
//! arrivals, along the edge of their lower convex hull that spans the middle of the observed time
//! (S. Moon, P. Skelly, D. Towsley: Estimation and removal of clock skew from network delay
//! measurements, INFOCOM 1999). A delayed sample thus gets its time of measurement. The delay of
//! the fastest sample itself cannot be determined from arrivals.

use std::collections::VecDeque;

/// Time span of the arrivals used, s: resolves a skew of 1e-5 under delays of 1 ms, and is short
/// compared with the warm-up of a clock.
const SPAN_S: f64 = 60.0;

/// Minimum time span before the line is used, s: if the duration of a tick is known, and if not.
const SETTLED_S: [f64; 2] = [0.3, 0.6];

/// Time span after which the duration of a tick counts as known, s.
const SURE_S: f64 = 1.0;

/// Relative tolerance of that duration: the error from delays of some ms in [`SURE_S`].
const SAME_TICK: f64 = 5e-3;

/// Time for which all samples must lie off the line to mean another clock, s.
const PATIENCE_S: f64 = 0.5;

const DELAYS: usize = 255;

#[derive(Clone, Debug, Default)]
pub struct ArrivalClock {
    /// Vertices of the lower hull of (tick, arrival).
    hull: VecDeque<(f64, f64)>,
    newest: Option<(f64, f64)>,
    /// Duration of a tick, s, and its relative tolerance, if known.
    known: Option<(f64, f64)>,
    /// The line: a tick, its time and the duration of a tick, s.
    line: Option<(f64, f64, f64)>,
    delays: VecDeque<f64>,
    /// The newest samples (tick, arrival), if all are too far above the line for this clock.
    adrift: Vec<(f64, f64)>,
}

impl ArrivalClock {
    /// Creates a clock whose tick lasts `tick_s` within the relative `tolerance`.
    pub fn known(tick_s: f64, tolerance: f64) -> Self {
        Self { known: Some((tick_s, tolerance)), ..Self::default() }
    }

    /// Creates a clock for a restarted count; keeps a known duration of a tick.
    pub fn begun_anew(&self) -> Self {
        let tick_s = self.tick_s().filter(|_| self.span_s() >= SURE_S);
        tick_s.map_or_else(Self::default, |tick_s| Self::known(tick_s, SAME_TICK))
    }

    /// Adds the arrival of a sample. Samples whose tick does not increase are ignored. The clock counts as set if all
    /// samples of half a second lie more than `jump_s` above the line, or one that far below it. For a sensor that
    /// counts samples, `jump_s` is about their period.
    pub fn push(&mut self, tick: f64, arrival_s: f64, jump_s: f64) {
        if self.newest.is_some_and(|(last, _)| tick <= last) {
            return;
        }
        self.newest = Some((tick, arrival_s));
        let delay = self.time_s(tick).map(|time| arrival_s - time);
        if let Some(delay) = delay.filter(|_| self.is_settled()) {
            // Far ahead of the line: the clock was set, or all earlier samples were delayed.
            if delay < -jump_s && self.span_s() >= SURE_S {
                *self = self.begun_anew();
                return self.push(tick, arrival_s, jump_s);
            }
            if delay > jump_s {
                self.adrift.push((tick, arrival_s));
            } else {
                self.adrift.clear();
            }
            let since = self.adrift.first().map_or(0.0, |(_, since)| arrival_s - since);
            if since > PATIENCE_S || self.adrift.len() > 8192 {
                let anew = std::mem::take(&mut self.adrift);
                *self = Self::default();
                anew.into_iter().for_each(|(tick, arrival_s)| self.push(tick, arrival_s, jump_s));
                return;
            }
            self.delays.push_back(delay.max(0.0));
            if self.delays.len() > DELAYS {
                self.delays.pop_front();
            }
        }
        while let [.., before, last] = self.hull.make_contiguous()
            && !is_convex(*before, *last, (tick, arrival_s))
        {
            self.hull.pop_back();
        }
        self.hull.push_back((tick, arrival_s));
        while self.hull.len() > 3 && arrival_s - self.hull[1].1 > SPAN_S {
            self.hull.pop_front();
        }
        self.line = self.fitted();
    }

    fn fitted(&self) -> Option<(f64, f64, f64)> {
        let (first, last) = (self.hull.front()?, self.hull.back()?);
        // Take the middle of the arrivals: delayed samples that arrived all at once are then at one end.
        let middle = f64::midpoint(first.1, last.1);
        let after = self.hull.partition_point(|(_, arrival_s)| *arrival_s < middle).max(1);
        let (&left, &right) = (self.hull.get(after - 1)?, self.hull.get(after)?);
        let per_tick = (right.1 - left.1) / (right.0 - left.0);
        let Some((tick_s, tolerance)) = self.known else { return Some((left.0, left.1, per_tick)) };
        let within = per_tick.clamp(tick_s * (1.0 - tolerance), tick_s * (1.0 + tolerance));
        if within == per_tick {
            return Some((left.0, left.1, per_tick));
        }
        let above =
            |(tick, arrival_s): &(f64, f64)| (arrival_s - left.1) - within * (tick - left.0);
        let touched = self.hull.iter().min_by(|a, b| above(a).total_cmp(&above(b)))?;
        Some((touched.0, touched.1, within))
    }

    pub fn is_settled(&self) -> bool {
        self.line.is_some() && self.span_s() >= SETTLED_S[usize::from(self.known.is_none())]
    }

    fn span_s(&self) -> f64 {
        let span = self.hull.front().zip(self.hull.back());
        span.map_or(0.0, |(first, last)| last.1 - first.1)
    }

    pub fn time_s(&self, tick: f64) -> Option<f64> {
        let (origin, time_s, per_tick) = self.line?;
        Some(time_s + per_tick * (tick - origin))
    }

    pub fn tick_s(&self) -> Option<f64> {
        self.line.map(|(.., per_tick)| per_tick)
    }

    /// Returns the error of the times, s: the median delay above the line.
    pub fn error_s(&self) -> f64 {
        let mut delays: Vec<f64> = self.delays.iter().copied().collect();
        let middle = delays.len() / 2;
        if delays.is_empty() {
            return 0.0;
        }
        *delays.select_nth_unstable_by(middle, f64::total_cmp).1
    }
}

/// Returns true if the middle point lies below the line through the outer ones.
fn is_convex(left: (f64, f64), middle: (f64, f64), right: (f64, f64)) -> bool {
    (middle.0 - left.0) * (right.1 - left.1) > (middle.1 - left.1) * (right.0 - left.0)
}

#[cfg(test)]
mod tests {
    use shell_data::random::{Purpose, RandomStream};

    use super::*;

    #[test]
    fn skew_and_offset_are_found_under_delays() {
        for seed in 0..5 {
            let (mut clock, mut random) =
                (ArrivalClock::default(), RandomStream::new(seed, Purpose::Radio, 0));
            let mut worst: f64 = 0.0;
            for tick in 0..60_000_u32 {
                let sent = 17.3 + f64::from(tick) * 1e-3 * (1.0 + 80e-6);
                // The delay has a mean of half a millisecond, plus 300 ms now and then.
                let delay = -5e-4 * (1.0 - random.uniform()).ln();
                let delay = if tick % 7000 > 6700 { delay + 0.3 } else { delay };
                clock.push(f64::from(tick), sent + delay, 1.0);
                if clock.is_settled() && tick > 2000 {
                    worst = worst.max((clock.time_s(f64::from(tick)).unwrap() - sent).abs());
                }
            }
            assert!(worst < 1e-3, "seed {seed}: {worst}");
            let tick = clock.tick_s().unwrap();
            assert!((tick / 1e-3 - 1.0 - 80e-6).abs() < 5e-6, "seed {seed}: {tick}");
            assert!((1e-4..6e-4).contains(&clock.error_s()), "{}", clock.error_s());
        }
    }

    #[test]
    fn bytes_that_waited_unread_keep_their_age() {
        let mut clock = ArrivalClock::default();
        for tick in 0..2000_u32 {
            let sent = f64::from(tick) * 1e-3;
            // The first 0.3 s of samples arrive at 1.25 s; those in between are lost.
            if !(300..1250).contains(&tick) {
                clock.push(f64::from(tick), sent.max(1.25), 1.5e-3);
            }
        }
        assert!(clock.is_settled());
        assert!(clock.time_s(0.0).unwrap().abs() < 1e-6, "{:?}", clock.time_s(0.0));
    }

    #[test]
    fn tick_duration_is_stable_while_delays_shrink() {
        let mut clock = ArrivalClock::known(1e-3, SAME_TICK);
        for tick in 0..400_u32 {
            let sent = f64::from(tick) * 1e-3;
            // The delay shrinks as a machine catches up.
            clock.push(f64::from(tick), sent + 0.02 - sent / 20.0, 1.5e-3);
        }
        assert!(clock.is_settled());
        assert!(clock.time_s(0.0).unwrap().abs() < 2.5e-3, "{:?}", clock.time_s(0.0));
    }

    #[test]
    fn a_clock_that_was_set_is_followed_after_half_a_second() {
        let mut clock = ArrivalClock::default();
        let mut arrival = 0.0;
        for tick in 0..3000_u32 {
            arrival = f64::from(tick) * 1e-3;
            // First, 40 samples are lost without being counted. Later, 60 are counted that were never sent.
            let lost = if tick > 1000 { 40.0 } else { 0.0 } - if tick > 2000 { 60.0 } else { 0.0 };
            let tick = f64::from(tick) - lost;
            clock.push(tick, arrival, 1.5e-3);
            if clock.newest.unwrap().0 == tick && (900.0..950.0).contains(&tick) {
                assert!((clock.time_s(tick).unwrap() - arrival).abs() < 1e-6);
            }
        }
        let newest = clock.newest.unwrap();
        assert!((clock.time_s(newest.0).unwrap() - arrival).abs() < 1e-6);
    }
}
