//! A live view apart from where it is shown: frames come in, and what the user wants is done.

use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use board_link::recording::{FrameLabel, protocol_name};
use board_link::{AppendWriter, RecordCommand, RecordingProgress};
use live_view::{Guide, GuidePhase, GuideView, HeldLoad, LiveModel, LiveRow};
use output_file::OutputError;
use shellcal::workflow::live::{Feed, LiveRows};

use super::super::record::{clock, list_losses};

/// Time from picture to picture: thirty a second.
pub(super) const PERIOD: Duration = Duration::from_micros(33_333);

/// What a user can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LiveAction {
    Tare,
    Untare,
    Pause,
    ZoomIn,
    ZoomOut,
    Mark,
    Record,
    /// Goes on to the next planned load.
    Skip,
    /// Goes back to the one before.
    Back,
}

/// A live view and what it is of.
pub(super) struct LiveSession {
    pub(super) model: LiveModel,
    guide: Option<Guide>,
    rows: LiveRows,
    feed: Feed,
    /// The logs that are written; `None` where nothing can be recorded.
    logs: Option<LogSeries>,
    pub(super) name: String,
    duration: Option<Duration>,
    started: Instant,
    elapsed: Duration,
    /// What has come since the last picture.
    pub(super) news: Vec<LiveRow>,
    /// Frames so far, and pictures of them.
    frames: u64,
    pub(super) pictures: u64,
    /// Whether the source has ended.
    is_over: bool,
    /// What has just been done.
    pub(super) message: String,
}

/// What tells a view to end: whoever runs it, and its source.
pub(super) struct Until<'a> {
    pub(super) is_stopped: &'a dyn Fn() -> bool,
    pub(super) is_over: &'a dyn Fn() -> bool,
}

/// The logs that one view writes, one after the other.
#[derive(Debug)]
pub(super) struct LogSeries {
    path: Option<PathBuf>,
    overwrite: bool,
    written: Vec<String>,
    is_on: bool,
}

impl LogSeries {
    /// The first of them, if it has a name.
    pub(super) fn new(path: Option<PathBuf>, overwrite: bool) -> Self {
        Self { path, overwrite, written: Vec::new(), is_on: false }
    }

    /// Makes the next: `log.csv`, then the first of `log-2.csv`, `log-3.csv`, … that is not there.
    pub(super) fn next(&mut self) -> anyhow::Result<AppendWriter> {
        let base = self.path.clone().unwrap_or_else(|| PathBuf::from("live.csv"));
        let mut number = self.written.len() + 1;
        loop {
            let path = numbered(&base, number);
            // A name that was given is meant; one that was made must not be in the way.
            let is_given = number == 1 && self.path.is_some();
            match AppendWriter::create(&path, self.overwrite && is_given) {
                Err(OutputError::Failed { source, .. })
                    if !is_given && source.kind() == io::ErrorKind::AlreadyExists =>
                {
                    number += 1;
                }
                writer => {
                    let writer = writer?;
                    self.written.push(path.display().to_string());
                    self.is_on = true;
                    return Ok(writer);
                }
            }
        }
    }

    fn current(&self) -> Option<&str> {
        self.written.last().filter(|_| self.is_on).map(String::as_str)
    }
}

fn numbered(base: &Path, number: usize) -> PathBuf {
    if number == 1 {
        return base.to_path_buf();
    }
    let stem = base.file_stem().unwrap_or_default().to_string_lossy();
    let ending = base.extension().map(|ending| format!(".{}", ending.to_string_lossy()));
    base.with_file_name(format!("{stem}-{number}{}", ending.unwrap_or_default()))
}

impl LiveSession {
    pub(super) fn new(
        model: LiveModel,
        rows: LiveRows,
        feed: Feed,
        logs: Option<LogSeries>,
        name: String,
        duration: Option<Duration>,
    ) -> Self {
        Self {
            model,
            guide: None,
            rows,
            feed,
            logs,
            name,
            duration,
            started: Instant::now(),
            elapsed: Duration::ZERO,
            news: Vec::new(),
            frames: 0,
            pictures: 0,
            is_over: false,
            message: String::new(),
        }
    }

    /// With a guide through planned loads.
    pub(super) fn guided(self, guide: Option<Guide>) -> Self {
        Self { guide, ..self }
    }

    /// The guide as it is shown.
    pub(super) fn guide(&self) -> Option<GuideView> {
        self.guide.as_ref().map(Guide::view)
    }

    /// Has the rows of a load that was held labelled.
    fn label(&mut self, held: HeldLoad) {
        let HeldLoad { from, until, group } = held;
        let is_recorded = self.recording().is_some();
        self.message = match is_recorded {
            true => format!("recorded `{group}`"),
            false if self.logs.is_some() => {
                format!(
                    "`{group}` was held, but no log is being recorded: r begins one, b goes back"
                )
            }
            false => format!("`{group}` was held"),
        };
        self.feed.ask(RecordCommand::Label(FrameLabel { from, until, group }));
    }

    /// Takes the frames that have come; whether to go on. A log that has been played to its end stays.
    pub(super) fn advance(&mut self, until: &Until<'_>) -> anyhow::Result<bool> {
        let mut frames = Vec::new();
        self.feed.fetch(&mut frames);
        self.news = self.rows.of(&frames)?;
        self.news.iter().for_each(|row| self.model.push(*row));
        if let Some(guide) = &mut self.guide {
            let held: Vec<HeldLoad> = self.news.iter().filter_map(|row| guide.push(row)).collect();
            let first_unsettled = guide.first_unsettled();
            held.into_iter().for_each(|held| self.label(held));
            first_unsettled.into_iter().for_each(|i| self.feed.ask(RecordCommand::Settled(i)));
        }
        self.frames += frames.len() as u64;
        self.elapsed = self.started.elapsed();
        self.is_over = (until.is_over)() && self.feed.waiting() == 0;
        // A port that is gone for good has something to say, which a screen would hide.
        let is_gone = self.is_over && self.logs.is_some();
        let is_out_of_time = self.duration.is_some_and(|end| self.elapsed >= end);
        Ok(!((until.is_stopped)() || is_out_of_time || is_gone))
    }

    /// Whether there is something to record.
    pub(super) fn can_record(&self) -> bool {
        self.logs.is_some()
    }

    /// The log that is being written.
    pub(super) fn recording(&self) -> Option<&str> {
        self.logs.as_ref().and_then(LogSeries::current)
    }

    pub(super) fn obey(&mut self, action: LiveAction) {
        self.message = match action {
            LiveAction::Tare => {
                self.model.begin_tare();
                "taring what is shown; a log keeps its own tare".to_owned()
            }
            LiveAction::Untare => {
                self.model.end_tare();
                "no tare but that of the calibration's first frames".to_owned()
            }
            LiveAction::Pause => {
                self.model.toggle_pause();
                self.feed.hold(self.model.is_paused());
                let more = if self.logs.is_some() { "; recording goes on" } else { "" };
                match self.model.is_paused() {
                    true => format!("paused{more}"),
                    false => String::new(),
                }
            }
            LiveAction::ZoomIn => {
                self.model.zoom_in();
                String::new()
            }
            LiveAction::ZoomOut => {
                self.model.zoom_out();
                String::new()
            }
            LiveAction::Mark => match self.model.mark() {
                Some(mark) => {
                    self.feed.ask(RecordCommand::Mark { index: mark.index, number: mark.number });
                    format!("mark {} at {:.3} s", mark.number, mark.time_s)
                }
                None => return,
            },
            LiveAction::Record => self.toggle_recording(),
            LiveAction::Skip | LiveAction::Back => {
                let Some(guide) = &mut self.guide else { return };
                match action {
                    LiveAction::Skip => guide.skip(),
                    _ => guide.back(),
                }
                match guide.view() {
                    GuideView { phase: GuidePhase::Done, .. } => String::new(),
                    GuideView { group, .. } => format!("next: `{group}`"),
                }
            }
        };
    }

    fn toggle_recording(&mut self) -> String {
        let Some(logs) = &mut self.logs else {
            return "a log that is played is not recorded again".to_owned();
        };
        if let Some(log) = logs.current() {
            let said = format!("recorded `{log}`");
            logs.is_on = false;
            self.feed.ask(RecordCommand::StopLog);
            return said;
        }
        match logs.next() {
            Ok(writer) => {
                self.feed.ask(RecordCommand::Record(writer));
                format!("recording to `{}`", logs.current().unwrap_or_default())
            }
            Err(error) => format!("{error:#}"),
        }
    }

    /// How it goes, in a line.
    pub(super) fn state(&self) -> String {
        if self.logs.is_none() {
            return match self.is_over {
                true => "played to its end".to_owned(),
                false => format!("playing, {}", clock(self.elapsed)),
            };
        }
        let Some(progress) = self.feed.progress() else { return "waiting".to_owned() };
        let RecordingProgress { rate_hz, frames, bytes, ref losses, .. } = progress;
        let time = clock(progress.elapsed);
        match progress.protocol {
            _ if !progress.connected => format!("{time}  port is gone, waiting for it"),
            None if bytes == 0 => format!("{time}  nothing arrives; `--start` starts a board"),
            None => format!("{time}  {bytes} bytes, no frame so far"),
            Some(protocol) => {
                let lost = list_losses(losses);
                let lost = if lost.is_empty() { "nothing lost" } else { &lost };
                format!(
                    "{}  {time}  {rate_hz:.1} Hz  {frames} frames  {lost}",
                    protocol_name(protocol)
                )
            }
        }
    }

    /// What is said at the end.
    pub(super) fn report(&self) -> Vec<String> {
        let Self { frames, pictures, elapsed, .. } = self;
        let seconds = elapsed.as_secs_f64();
        let mut lines = vec![format!(
            "{frames} frames in {seconds:.1} s, {pictures} pictures, {} frames not shown",
            self.feed.left_out()
        )];
        let logs = self.logs.iter().flat_map(|logs| &logs.written);
        lines.extend(logs.map(|log| format!("recorded `{log}`")));
        lines.extend(
            self.guide()
                .map(|guide| format!("{} of {} loads recorded", guide.recorded, guide.count)),
        );
        let marks = self.model.marks().iter();
        lines.extend(marks.map(|mark| format!("mark {} at {:.3} s", mark.number, mark.time_s)));
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn logs_are_numbered_and_none_is_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run.csv");
        std::fs::write(dir.path().join("run-2.csv"), "mine").unwrap();
        let mut logs = LogSeries::new(Some(path.clone()), false);
        let mut writers = vec![logs.next().unwrap(), logs.next().unwrap()];
        let names: Vec<_> =
            logs.written.iter().map(Path::new).map(|p| p.file_name().unwrap()).collect();
        assert_eq!(names, ["run.csv", "run-3.csv"]);
        assert_eq!(std::fs::read(dir.path().join("run-2.csv")).unwrap(), b"mine");
        writers.clear();
        assert!(
            LogSeries::new(Some(path), false).next().is_err(),
            "a name that was given is taken"
        );
    }
}
