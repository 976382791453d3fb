//! Data passed between the recording thread and the displaying thread.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard};

use board_link::recording::BoardFrame;
use board_link::{RecordCommand, RecordingProgress, Watcher};
use shell_data::lock::lock;
use shell_data::wrench::PerAxis;

/// Capacity of the queue of frames: half a minute at 1 kHz.
const WAITING: usize = 32_768;

/// The channel between two threads. Clones share it; [`board_link::record`] takes one as its watcher.
#[derive(Clone, Debug, Default)]
pub struct Feed(Arc<Mutex<FeedState>>);

#[derive(Debug, Default)]
pub struct FeedState {
    pub frames: VecDeque<BoardFrame>,
    /// The newest wrench of the reference, N and N·m.
    pub reference: Option<PerAxis<f64>>,
    /// Number of frames that were never displayed because the queue was full.
    pub left_out: u64,
    pub progress: Option<RecordingProgress>,
    pub commands: VecDeque<RecordCommand>,
    pub is_held: bool,
}

impl Feed {
    pub fn state(&self) -> MutexGuard<'_, FeedState> {
        // The state is valid even if a thread panicked: no operation on it can fail half-way.
        lock(&self.0)
    }

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

    fn see_reference(&mut self, wrench: PerAxis<f64>) {
        self.state().reference = Some(wrench);
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
    fn a_slow_reader_misses_the_oldest_and_gets_their_number() {
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
