//! A log, played as if it were recorded now.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use log_file::{Log, LogError, ReadOptions, Wanted};
use shared_proto::CHANNELS;
use shell_data::block::Block;

use board_link::recording::{BoardFrame, Measured};

/// How often the clock is looked at.
const TICK: Duration = Duration::from_millis(10);

/// A longer time between two looks, when the computer was asleep, is not caught up on.
const LONGEST: Duration = Duration::from_secs(1);

/// Why a log cannot be played.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PlayError {
    /// It cannot be read.
    #[error(transparent)]
    Log(#[from] LogError),
    /// It is of another instrument.
    #[error("`{path}` has {found} channels, a view is of {CHANNELS}, or of a wrench")]
    Channels {
        /// The log.
        path: String,
        /// How many it has.
        found: usize,
    },
}

/// Plays a log at `speed` times its own pace, until its end or until `stop` is set: hands its frames to `see`
/// when they are due, and holds it while `is_held`. Where it has readings and a wrench, the readings are played if
/// `readings` are wanted.
///
/// # Errors
/// [`PlayError`] if it cannot be read, or has neither eight channels nor a wrench.
pub fn play(
    log: &Log,
    read: &ReadOptions<'_>,
    readings: bool,
    speed: f64,
    is_held: &dyn Fn() -> bool,
    stop: &AtomicBool,
    see: &mut dyn FnMut(&[BoardFrame]),
) -> Result<u64, PlayError> {
    let has_channels = log.channels() == CHANNELS;
    let is_readings = has_channels && (readings || !log.has_wrench());
    if !is_readings && !log.has_wrench() {
        let (path, found) = (log.path().display().to_string(), log.channels());
        return Err(PlayError::Channels { path, found });
    }
    let wanted =
        Wanted { time: true, readings: is_readings, wrench: !is_readings, ..Wanted::default() };
    let mut player = Player { see, is_held, stop, speed, clock: None, index: 0 };
    let played = log.read(&wanted, read, std::mem::take, |block| player.play(&block));
    match played {
        Ok(_) | Err(Ended::Stopped) => Ok(player.index as u64),
        Err(Ended::Log(error)) => Err(error.into()),
    }
}

/// Why a log is not read on.
enum Ended {
    Stopped,
    Log(LogError),
}

impl From<LogError> for Ended {
    fn from(error: LogError) -> Self {
        Self::Log(error)
    }
}

struct Player<'a> {
    see: &'a mut dyn FnMut(&[BoardFrame]),
    is_held: &'a dyn Fn() -> bool,
    stop: &'a AtomicBool,
    speed: f64,
    /// When the row of a time is due: a moment, and the time of the log then.
    clock: Option<(Instant, f64)>,
    index: i64,
}

impl Player<'_> {
    fn play(&mut self, block: &Block) -> Result<(), Ended> {
        let mut sent = 0;
        while sent < block.rows {
            if self.stop.load(Ordering::Relaxed) {
                return Err(Ended::Stopped);
            }
            let next_s = block.time_s[sent];
            let now_s = self.now_s(next_s);
            let due = block.time_s[sent..].iter().take_while(|&&time_s| time_s <= now_s).count();
            let frames: Vec<BoardFrame> =
                (sent..sent + due).map(|row| self.frame(block, row)).collect();
            (self.see)(&frames);
            sent += due;
            if due == 0 {
                std::thread::sleep(TICK);
            }
        }
        Ok(())
    }

    /// The time of the log now. While it is held the clock stands still; where the log jumps, by a pause in
    /// the recording or back, it goes on at once.
    fn now_s(&mut self, next_s: f64) -> f64 {
        let now = Instant::now();
        let (at, from_s) = *self.clock.get_or_insert((now, next_s));
        let now_s = if (self.is_held)() {
            from_s
        } else if next_s < from_s - 1.0 || next_s > from_s + 1.0 {
            next_s
        } else {
            from_s + now.duration_since(at).min(LONGEST).as_secs_f64() * self.speed
        };
        self.clock = Some((now, now_s));
        now_s
    }

    fn frame(&mut self, block: &Block, row: usize) -> BoardFrame {
        let index = self.index;
        self.index += 1;
        let measured = match block.readings.is_empty() {
            false => Measured::Readings(std::array::from_fn(|c| block.readings[c][row])),
            true => Measured::Wrench(std::array::from_fn(|axis| block.wrench[axis][row])),
        };
        let saturated = match &measured {
            Measured::Readings(readings) => (0..CHANNELS)
                .filter(|&channel| [0.0, 4095.0, 65_535.0].contains(&readings[channel]))
                .fold(0, |mask, channel| mask | 1 << channel),
            Measured::Wrench(_) => 0,
        };
        let time_us = (block.time_s[row] * 1e6).round() as i64;
        BoardFrame { saturated, ..BoardFrame::new(time_us, index, measured) }
    }
}
