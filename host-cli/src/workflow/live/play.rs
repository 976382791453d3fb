//! Playback of a log as if it were being recorded now.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use log_file::{Log, ReadOptions, Wanted};
use shared_proto::CHANNELS;
use shell_data::block::Block;

use crate::workflow::WorkflowError;
use crate::workflow::selection::passed;
use board_link::recording::{BoardFrame, Measured};

/// How often the clock is checked.
const TICK: Duration = Duration::from_millis(10);

/// Maximum time between two checks that playback catches up on; more passes while the computer sleeps.
const LONGEST: Duration = Duration::from_secs(1);

/// A longer step between two rows is skipped instead of waited for, s of the log.
const JUMP_S: f64 = 1.0;

/// Plays a log at `speed` times its own pace, until its end or until `stop` is set. Hands its frames to `see` when
/// they are due, and pauses while `is_held`. If the log has readings and a wrench, it plays the readings if
/// `readings` is set. Fails if the log cannot be read, or has neither eight channels nor a wrench.
pub fn play(
    log: &Log,
    read: &ReadOptions<'_>,
    readings: bool,
    speed: f64,
    is_held: &dyn Fn() -> bool,
    stop: &AtomicBool,
    see: &mut dyn FnMut(&[BoardFrame]),
) -> Result<(), WorkflowError> {
    let has_channels = log.channels() == CHANNELS;
    let is_readings = has_channels && (readings || !log.has_wrench());
    if !is_readings && !log.has_wrench() {
        let (path, found) = (log.path().display(), log.channels());
        let message =
            format!("`{path}` has {found} channels, a view is of {CHANNELS}, or of a wrench");
        return Err(WorkflowError::refused(message, None));
    }
    let wanted =
        Wanted { time: true, readings: is_readings, wrench: !is_readings, ..Wanted::default() };
    let (mut clock, mut index) = (PlayClock::new(speed), 0);
    let play = |block: Block| {
        let mut sent = 0;
        while sent < block.rows {
            if stop.load(Ordering::Relaxed) {
                return Err(None);
            }
            let due = clock.due(Instant::now(), &block.time_s[sent..], is_held());
            let frames =
                (index..).zip(sent..sent + due).map(|(index, row)| frame(&block, row, index));
            see(&frames.collect::<Vec<_>>());
            (sent, index) = (sent + due, index + due as i64);
            if due == 0 {
                std::thread::sleep(TICK);
            }
        }
        Ok(())
    };
    Ok(passed(log.read(&wanted, read, std::mem::take, play))?)
}

fn frame(block: &Block, row: usize, index: i64) -> BoardFrame {
    let measured = match block.readings.is_empty() {
        false => Measured::Readings(std::array::from_fn(|c| block.readings[c][row])),
        true => Measured::Wrench(std::array::from_fn(|axis| block.wrench[axis][row])),
    };
    let saturated = match &measured {
        Measured::Readings(readings) => saturated(readings),
        Measured::Wrench(_) => 0,
    };
    let time_us = (block.time_s[row] * 1e6).round() as i64;
    BoardFrame { saturated, ..BoardFrame::new(time_us, index, measured) }
}

/// The channels at an end of a converter of 12 or 16 bits: bit i is set for channel i.
pub(in crate::workflow) fn saturated(readings: &[f64; CHANNELS]) -> u8 {
    let is_at_end = |channel: &usize| [0.0, 4095.0, 65_535.0].contains(&readings[*channel]);
    (0..CHANNELS).filter(is_at_end).fold(0, |mask, channel| mask | 1 << channel)
}

/// Clock that decides which rows are due. If the time of the log jumps backwards, or forwards after a pause in
/// the recording, playback continues at once.
#[derive(Debug)]
struct PlayClock {
    speed: f64,
    set: Option<(Instant, f64)>,
    last_s: Option<f64>,
}

impl PlayClock {
    fn new(speed: f64) -> Self {
        Self { speed, set: None, last_s: None }
    }

    /// The number of rows due, of the next ones with times `next_s`. The clock stops while `is_held`.
    fn due(&mut self, now: Instant, next_s: &[f64], is_held: bool) -> usize {
        let Some(&first_s) = next_s.first() else { return 0 };
        let is_jump = |last_s: f64, time_s: f64| (time_s - last_s).abs() > JUMP_S;
        let (at, from_s) = self.set.unwrap_or((now, first_s));
        if is_held {
            self.set = Some((now, from_s));
            return 0;
        }
        let now_s = if is_jump(self.last_s.unwrap_or(first_s), first_s) {
            first_s
        } else {
            from_s + now.duration_since(at).min(LONGEST).as_secs_f64() * self.speed
        };
        self.set = Some((now, now_s));
        let mut due = 0;
        for &time_s in next_s.iter().take_while(|&&time_s| time_s <= now_s) {
            // The next call sets the clock to the time after the jump.
            if due > 0 && self.last_s.is_some_and(|last_s| is_jump(last_s, time_s)) {
                break;
            }
            self.last_s = Some(time_s);
            due += 1;
        }
        due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_due_at_the_speed_for_any_blocks() {
        let (start, tick) = (Instant::now(), Duration::from_millis(10));
        for rows_of_block in [1, 64, 5000] {
            let mut clock = PlayClock::new(1000.0);
            // 100 Hz for 40 s: four ticks and the first poll.
            let times: Vec<f64> = (0..4000).map(|row| f64::from(row) / 100.0).collect();
            let mut ticks = 0;
            for block in times.chunks(rows_of_block) {
                let mut sent = 0;
                while sent < block.len() {
                    let due = clock.due(start + tick * ticks, &block[sent..], false);
                    sent += due;
                    ticks += u32::from(due == 0);
                }
            }
            assert_eq!(ticks, 4, "{rows_of_block}");
        }
    }

    #[test]
    fn a_log_that_jumps_goes_on_at_once_and_one_that_is_held_stands() {
        let (start, second) = (Instant::now(), Duration::from_secs(1));
        let mut clock = PlayClock::new(1.0);
        assert_eq!(clock.due(start, &[5.0, 5.4, 5.6], false), 1);
        assert_eq!(clock.due(start + second / 2, &[5.4, 5.6], false), 1);
        assert_eq!(clock.due(start + second, &[5.6], true), 0);
        assert_eq!(clock.due(start + second * 2, &[5.6], true), 0);
        assert_eq!(clock.due(start + second * 3, &[5.6], false), 1);
        assert_eq!(clock.due(start + second * 3, &[90.0, 90.1], false), 1);
        assert_eq!(clock.due(start + second * 4, &[90.1, 3.0, 3.5], false), 1);
        assert_eq!(clock.due(start + second * 4, &[3.0, 3.5], false), 1);
        assert_eq!(clock.due(start + second * 4, &[3.5], false), 0);
    }
}
