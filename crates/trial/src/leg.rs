//! Leg angles from encoder counts, and the strides that follow from them.

use std::f64::consts::TAU;

use super::integral::rows_around;
use shell_data::statistics::{extremes, upper_median};

/// Time over which a leg's speed is measured to predict its angle, s: long for encoder noise, short for gait changes.
const SPEED_OVER_S: f64 = 0.02;

/// Minimum rotation of a leg that does not count as still, rad.
pub(super) const STILL_RAD: f64 = 0.1;

/// Longest step between rows that tells turns, in turns: at half a turn, either direction is as likely.
const LONGEST_STEP: f64 = 1.0 / 3.0;

/// Unwrapped angle of a leg at each row, rad, from an encoder that wraps after a turn or after 2³² counts. Each angle
/// is the one nearest to an extrapolation of the last 20 ms, so a leg may deviate from it by half a turn in a gap.
pub(super) fn unwrap(times: &[f64], counts: &[f64], rad_per_count: f64) -> Vec<f64> {
    let wraps = wraps_each_turn(counts, rad_per_count);
    let wrap = if wraps { TAU / rad_per_count } else { 2.0_f64.powi(32) };
    let mut unwrapped: Vec<f64> = Vec::with_capacity(counts.len());
    let mut past = 0;
    for (row, (&time, &count)) in times.iter().zip(counts).enumerate() {
        let Some(&last) = unwrapped.last() else {
            unwrapped.push(count);
            continue;
        };
        while past + 1 < row && times[row - 1] - times[past + 1] >= SPEED_OVER_S {
            past += 1;
        }
        let over = times[row - 1] - times[past];
        let speed = if over > 0.0 { (last - unwrapped[past]) / over } else { 0.0 };
        let expected = last + speed * (time - times[row - 1]);
        unwrapped.push(count + wrap * ((expected - count) / wrap).round());
    }
    unwrapped.iter_mut().for_each(|angle| *angle *= rad_per_count);
    unwrapped
}

fn wraps_each_turn(counts: &[f64], rad_per_count: f64) -> bool {
    let (low, high) = extremes(counts.iter().copied());
    high - low < 1.5 * TAU / rad_per_count
}

/// The usual step between rows in which the leg moves, in turns, if it is too long: `angle` (rad) is then one of
/// several that the `counts` fit, which wrap after each turn.
pub(super) fn ambiguous_step(counts: &[f64], angle: &[f64], rad_per_count: f64) -> Option<f64> {
    let steps = angle.windows(2).map(|pair| (pair[1] - pair[0]).abs() / TAU);
    let mut steps: Vec<f64> = steps.filter(|step| *step > 0.0).collect();
    let usual = upper_median(&mut steps)?;
    (usual > LONGEST_STEP && wraps_each_turn(counts, rad_per_count)).then_some(usual)
}

#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Strides {
    /// Start of each whole stride, and the end of the last, s; empty without strides.
    pub(super) times_s: Vec<f64>,
    pub(super) longest_still_s: f64,
}

impl Strides {
    /// Finds the whole turns of `angle` in a window, from phase 0 to phase 0, in the overall direction. A turn ends
    /// when the leg first reaches its end. Motion over ground lost to a backward motion does not count again, so noise, a
    /// stall or a reversal creates no strides.
    pub(super) fn new(times: &[f64], angle: &[f64], from_s: f64, to_s: f64) -> Self {
        let Some(rows) = rows_around(times, from_s, to_s) else { return Self::default() };
        let (times, angle) = (&times[rows.clone()], &angle[rows]);
        let last = times.len() - 1;
        let start = between((times[0], angle[0]), (times[1], angle[1]), from_s);
        let end = between((times[last - 1], angle[last - 1]), (times[last], angle[last]), to_s);
        let way = if end < start { -1.0 } else { 1.0 };
        let mut strides = Self::default();
        let mut furthest = (from_s, way * start);
        let mut next = (furthest.1 / TAU).ceil() * TAU;
        let mut moved = furthest;
        let inner = times.iter().zip(angle).skip(1).take(last - 1).map(|(&t, &a)| (t, way * a));
        for (time, angle) in inner.chain([(to_s, way * end)]) {
            if angle > furthest.1 {
                let steps = (time - furthest.0) / (angle - furthest.1);
                while next <= angle {
                    strides.times_s.push(furthest.0 + (next - furthest.1) * steps);
                    next += TAU;
                }
                furthest = (time, angle);
            } else if time > furthest.0 {
                // From here on the leg makes up the lost angle.
                furthest.0 = time;
            }
            if furthest.1 - moved.1 >= STILL_RAD {
                strides.longest_still_s = strides.longest_still_s.max(time - moved.0);
                moved = furthest;
            }
        }
        strides.longest_still_s = strides.longest_still_s.max(to_s - moved.0);
        if strides.times_s.len() < 2 {
            strides.times_s.clear();
        }
        strides
    }

    pub(super) fn spans(&self) -> impl Iterator<Item = (f64, f64)> {
        self.times_s.windows(2).map(|pair| (pair[0], pair[1]))
    }

    pub(super) fn count(&self) -> usize {
        self.times_s.len().saturating_sub(1)
    }

    pub(super) fn frequency_hz(&self) -> Option<f64> {
        let (first, last) = (self.times_s.first()?, self.times_s.last()?);
        Some(self.count() as f64 / (last - first)).filter(|hz| hz.is_finite())
    }
}

fn between(a: (f64, f64), b: (f64, f64), time: f64) -> f64 {
    if b.0 > a.0 { a.1 + (b.1 - a.1) * (time - a.0) / (b.0 - a.0) } else { b.1 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCALE: f64 = 95.8738e-6;

    /// Rows one millisecond apart over `duration_s`, with a leg at `angle(t)` in whole counts.
    fn record(duration_s: f64, angle: impl Fn(f64) -> f64) -> (Vec<f64>, Vec<f64>) {
        let times: Vec<f64> = (0..(duration_s * 1e3) as i32).map(|i| f64::from(i) * 1e-3).collect();
        let counts = times.iter().map(|&t| (angle(t) / SCALE).round()).collect();
        (times, counts)
    }

    #[test]
    fn a_wrapped_encoder_unwraps_to_the_original() {
        let (times, counts) = record(2.0, |t| 0.3 + TAU * (5.0 * t + 0.2 * (40.0 * t).sin()));
        let turn = TAU / SCALE;
        let expected = unwrap(&times, &counts, SCALE);
        for (wrap, low) in [(turn, 0.0), (turn, -turn / 2.0)] {
            let wrapped: Vec<f64> =
                counts.iter().map(|c| (c - low).rem_euclid(wrap) + low).collect();
            let found = unwrap(&times, &wrapped, SCALE);
            let shift = found[0] - expected[0];
            assert!((shift / TAU - (shift / TAU).round()).abs() < 1e-9);
            for (a, b) in found.iter().zip(&expected) {
                assert!((a - b - shift).abs() < 1e-9);
            }
        }
        // A 32-bit counter that overflows during the run.
        let top = 2.0_f64.powi(31);
        let overflow = |c: &f64| (c + top - 100_000.0 + top).rem_euclid(2.0 * top) - top;
        let found = unwrap(&times, &counts.iter().map(overflow).collect::<Vec<_>>(), SCALE);
        let turned = |angle: &[f64]| angle[angle.len() - 1] - angle[0];
        assert!((turned(&found) - turned(&expected)).abs() < 1e-6);
    }

    #[test]
    fn a_gap_of_a_whole_turn_in_a_wrapped_encoder_is_bridged_by_the_speed() {
        let (times, counts) = record(1.0, |t| TAU * 13.0 * t);
        let wrapped: Vec<f64> = counts.iter().map(|c| c.rem_euclid(TAU / SCALE)).collect();
        let keep = |i: &usize| !(300..380).contains(i);
        let rows: Vec<usize> = (0..times.len()).filter(keep).collect();
        let at = |column: &[f64]| rows.iter().map(|&i| column[i]).collect::<Vec<_>>();
        let found = unwrap(&at(&times), &at(&wrapped), SCALE);
        assert!((found[found.len() - 1] - TAU * 13.0 * 0.999).abs() < 1e-3);
    }

    #[test]
    fn a_leg_that_turns_too_far_between_rows_is_found() {
        // 13 turns/s at 20 rows/s are 0.65 turns per row, which wrap to 0.35 backward; 4 turns/s are 0.2.
        for (turns_hz, expected) in [(13.0, Some(0.35)), (4.0, None)] {
            let times: Vec<f64> = (0..100).map(|row| f64::from(row) / 20.0).collect();
            let counts: Vec<f64> = times.iter().map(|t| (turns_hz * t).rem_euclid(1.0)).collect();
            let angle = unwrap(&times, &counts, TAU);
            let found = ambiguous_step(&counts, &angle, TAU);
            assert_eq!(found.is_some(), expected.is_some());
            let off = found.unwrap_or_default() - expected.unwrap_or_default();
            assert!(off.abs() < 1e-9, "{found:?}, to roundings of a turn");
        }
    }

    #[test]
    fn strides_start_and_end_at_phase_zero_either_way() {
        for way in [1.0, -1.0] {
            let (times, counts) = record(1.0, |t| way * TAU * (10.0 * t + 0.25));
            let angle = unwrap(&times, &counts, SCALE);
            let strides = Strides::new(&times, &angle, 0.1, 0.9);
            // Phase 0 is at 0.075 + 0.1·k s in either direction: within the window from 0.175 to 0.875 s.
            assert_eq!(strides.count(), 7);
            for (k, time) in strides.times_s.iter().enumerate() {
                // Half a count at 10 turns/s is 0.8 µs.
                assert!((time - (0.175 + 0.1 * k as f64)).abs() < 1e-6, "{time}");
            }
            assert!((strides.frequency_hz().unwrap() - 10.0).abs() < 1e-3);
        }
    }

    #[test]
    fn noise_a_stall_and_a_reversal_make_no_strides() {
        // Ten turns in a second, a stall of 0.5 s at phase 0, half a turn back, then forward again.
        let path = |t: f64| match t {
            t if t < 1.0 => 10.0 * t + 0.001,
            t if t < 1.5 => 10.001,
            t if t < 1.6 => 10.001 - 5.0 * (t - 1.5),
            t => 9.501 + 10.0 * (t - 1.6),
        };
        let (times, mut counts) = record(2.0, |t| TAU * path(t));
        for (i, count) in counts.iter_mut().enumerate() {
            *count += ((i * 7919) % 33) as f64 - 16.0;
        }
        let strides = Strides::new(&times, &unwrap(&times, &counts, SCALE), 0.05, 1.99);
        // From 1 to 13 turns.
        assert_eq!(strides.count(), 12);
        assert!((strides.times_s[9] - 0.9999).abs() < 1e-3, "turn 10 ends before the stall");
        // Turn 11 ends at 1.6 + 1.499/10 s.
        assert!((strides.times_s[10] - 1.7499).abs() < 1e-3, "{:?}", strides.times_s);
        assert!((strides.longest_still_s - 0.65).abs() < 0.02, "{}", strides.longest_still_s);
    }

    #[test]
    fn less_than_a_turn_from_phase_zero_is_no_stride() {
        let (times, counts) = record(1.0, |t| TAU * (1.8 * t + 0.1));
        let strides = Strides::new(&times, &unwrap(&times, &counts, SCALE), 0.0, 0.999);
        assert_eq!((strides.count(), strides.frequency_hz()), (0, None));
    }
}
