//! Queue between the recording thread and the display thread.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard};

use board_link::recording::BoardFrame;
use board_link::{RecordCommand, RecordingProgress, Watcher};
use shell_data::lock::lock;

/// Maximum number of frames that wait for display: half a minute at 1 kHz.
const WAITING: usize = 32_768;

/// Queue between two threads. Clones share the queue; [`board_link::record`] takes one as its watcher.
#[derive(Clone, Debug, Default)]
pub struct Feed(Arc<Mutex<FeedState>>);

/// Frames and commands in the queue.
#[derive(Debug, Default)]
pub struct FeedState {
    /// Frames that wait for display.
    pub frames: VecDeque<BoardFrame>,
    /// Number of frames dropped from the display because it fell behind.
    pub left_out: u64,
    /// Progress of the recording.
    pub progress: Option<RecordingProgress>,
    /// Pending commands for the log.
    pub commands: VecDeque<RecordCommand>,
    /// True if playback is paused.
    pub is_held: bool,
}

impl Feed {
    /// Locks the state of the queue.
    pub fn state(&self) -> MutexGuard<'_, FeedState> {
        // A thread that panicked has left the state intact: no operation here can fail half way.
        lock(&self.0)
    }

    /// Queues a command for the log.
    pub fn ask(&self, command: RecordCommand) {
        self.state().commands.push_back(command);
    }
}

impl Watcher for Feed {
    fn see(&mut self, frames: &[BoardFrame]) {
        let mut state = self.state();
        state.frames.extend(frames.iter().cloned());
        let over = state.frames.len().saturating_sub(WAITING);
        state.frames.drain(..over);
        state.left_out += over as u64;
    }

    fn next_command(&mut self) -> Option<RecordCommand> {
        self.state().commands.pop_front()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use board_link::recording::Measured;

    #[test]
    fn who_does_not_fetch_misses_the_oldest_and_is_told_how_many() {
        let mut feed = Feed::default();
        let frame = |index: i64| BoardFrame::new(index * 1000, index, Measured::Wrench([0.0; 6]));
        for start in (0..40_000).step_by(100) {
            let frames: Vec<_> = (start..start + 100).map(frame).collect();
            feed.see(&frames);
        }
        let state = feed.state();
        assert_eq!(state.frames.len(), WAITING);
        assert_eq!(state.frames.back().map(|frame| frame.index), Some(39_999));
        assert_eq!(state.left_out, 40_000 - WAITING as u64);
    }
}
