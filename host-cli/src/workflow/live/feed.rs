//! What passes between the thread that records and the one that shows.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use board_link::recording::BoardFrame;
use board_link::{RecordCommand, RecordingProgress, Watcher};
use shell_data::lock::lock;

/// Frames that wait to be shown, at most: half a minute at 1 kHz.
const WAITING: usize = 32_768;

/// The way between two threads. Clones are ends of the same; [`board_link::record`] takes one as its watcher.
#[derive(Clone, Debug, Default)]
pub struct Feed(Arc<Mutex<FeedState>>);

#[derive(Debug, Default)]
struct FeedState {
    frames: VecDeque<BoardFrame>,
    /// Frames that were not shown because nobody fetched them.
    left_out: u64,
    progress: Option<RecordingProgress>,
    commands: VecDeque<RecordCommand>,
    /// Set while a log is not to be played on.
    is_held: bool,
}

impl Feed {
    /// Fetches the frames that wait, in place of those in `frames`.
    pub fn fetch(&self, frames: &mut Vec<BoardFrame>) {
        frames.clear();
        self.with(|state| frames.extend(state.frames.drain(..)));
    }

    /// Frames that wait.
    pub fn waiting(&self) -> usize {
        self.with(|state| state.frames.len())
    }

    /// Frames that were not shown because nobody fetched them.
    pub fn left_out(&self) -> u64 {
        self.with(|state| state.left_out)
    }

    /// Says how the recording goes.
    pub fn report(&self, progress: &RecordingProgress) {
        self.with(|state| state.progress = Some(progress.clone()));
    }

    /// How the recording goes.
    pub fn progress(&self) -> Option<RecordingProgress> {
        self.with(|state| state.progress.clone())
    }

    /// Asks for something to happen to the log.
    pub fn ask(&self, command: RecordCommand) {
        self.with(|state| state.commands.push_back(command));
    }

    /// Holds a log that is played, or lets it go on.
    pub fn hold(&self, held: bool) {
        self.with(|state| state.is_held = held);
    }

    /// Whether a log is held.
    pub fn is_held(&self) -> bool {
        self.with(|state| state.is_held)
    }

    fn with<T>(&self, act: impl FnOnce(&mut FeedState) -> T) -> T {
        // A thread that has ended badly has left the state whole: nothing in here can fail half way.
        act(&mut lock(&self.0))
    }
}

impl Watcher for Feed {
    fn see(&mut self, frames: &[BoardFrame]) {
        self.with(|state| {
            state.frames.extend(frames.iter().cloned());
            let over = state.frames.len().saturating_sub(WAITING);
            state.frames.drain(..over);
            state.left_out += over as u64;
        });
    }

    fn next_command(&mut self) -> Option<RecordCommand> {
        self.with(|state| state.commands.pop_front())
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
        let mut frames = Vec::new();
        feed.fetch(&mut frames);
        assert_eq!(frames.len(), WAITING);
        assert_eq!(frames.last().map(|frame| frame.index), Some(39_999));
        assert_eq!(feed.left_out(), 40_000 - WAITING as u64);
        feed.fetch(&mut frames);
        assert!(frames.is_empty());
    }
}
