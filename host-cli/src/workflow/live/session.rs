//! A live view without its display: takes frames in, and carries out the user's actions.

use std::time::Duration;

use board_link::recording::{BoardFrame, Measured, RunningForces, protocol_name};
use board_link::{LogSink, RecordCommand, RecordingProgress};
use forces::ForceError;
use live_view::{Guide, GuidePhase, GuideView, GuidedLoad, LiveDisplay, LiveRow, LoadGuide};
use load_table::{HungLoad, HungLoads};
use output_file::OutputError;
use serde_json::{Value, json};
use shell_data::block::FrameLabel;

use super::Feed;

/// Time between two pictures: thirty a second.
pub const PERIOD: Duration = Duration::from_micros(33_333);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LiveAction {
    /// Takes the current values as the zero of the display.
    Tare,
    Untare,
    Pause,
    ZoomIn,
    ZoomOut,
    Mark,
    Record,
    Skip,
    Back,
}

impl LiveAction {
    pub const NAMED: [(&str, Self); 9] = [
        ("tare", Self::Tare),
        ("untare", Self::Untare),
        ("pause", Self::Pause),
        ("zoom-in", Self::ZoomIn),
        ("zoom-out", Self::ZoomOut),
        ("mark", Self::Mark),
        ("record", Self::Record),
        ("skip", Self::Skip),
        ("back", Self::Back),
    ];

    pub fn named(name: &str) -> Option<Self> {
        Self::NAMED.into_iter().find_map(|(known, action)| (known == name).then_some(action))
    }
}

/// Creates the next log; its argument is the number of logs created so far.
pub type LogMaker = Box<dyn Fn(usize) -> Result<Box<dyn LogSink>, OutputError>>;

pub struct LogSeries {
    maker: LogMaker,
    written: Vec<String>,
    is_on: bool,
}

impl LogSeries {
    pub fn new(maker: LogMaker) -> Self {
        Self { maker, written: Vec::new(), is_on: false }
    }

    pub fn begin(&mut self) -> Result<Box<dyn LogSink>, OutputError> {
        let log = (self.maker)(self.written.len())?;
        self.written.push(log.path().display().to_string());
        self.is_on = true;
        Ok(log)
    }

    fn current(&self) -> Option<&str> {
        self.written.last().filter(|_| self.is_on).map(String::as_str)
    }
}

/// A live view and its source, with a guide through loads if there is one.
pub struct LiveSession<G = Guide> {
    pub display: LiveDisplay,
    pub guide: Option<G>,
    forces: Option<RunningForces>,
    feed: Feed,
    /// The logs that are written; `None` if recording is not possible.
    logs: Option<LogSeries>,
    pub name: String,
    elapsed: Duration,
    frames: u64,
    pub pictures: u64,
    is_over: bool,
    pub message: String,
}

impl<G: LoadGuide> LiveSession<G> {
    /// A live view of the source `name`, with a guide if loads are planned, and forces if there is a
    /// calibration. `logs` is `None` if recording is not possible.
    pub fn new(
        display: LiveDisplay,
        guide: Option<G>,
        forces: Option<RunningForces>,
        feed: Feed,
        logs: Option<LogSeries>,
        name: String,
    ) -> Self {
        Self {
            display,
            guide,
            forces,
            feed,
            logs,
            name,
            elapsed: Duration::ZERO,
            frames: 0,
            pictures: 0,
            is_over: false,
            message: String::new(),
        }
    }

    pub fn shown(&mut self) -> Value {
        self.pictures += 1;
        json!({
            "source": self.name,
            "state": self.state(),
            "recording": self.recording(),
            "can_record": self.logs.is_some(),
            "message": self.message,
            "guide": self.guide(),
            "picture": self.display.picture(),
        })
    }

    pub fn guide(&self) -> Option<GuideView> {
        self.guide.as_ref().map(LoadGuide::view)
    }

    fn label(&mut self, held: FrameLabel) {
        let group = &held.group;
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
        self.feed.ask(RecordCommand::Label(held));
    }

    /// Takes the frames that arrived until `elapsed` after the start. Returns true if the view has to end because its
    /// source is gone for good; after a played log, the last picture stays. Fails with [`ForceError`] if the
    /// requested low-pass is impossible at the rate of the frames.
    pub fn advance(&mut self, elapsed: Duration, is_source_over: bool) -> Result<bool, ForceError> {
        let (frames, reference) = {
            let mut state = self.feed.state();
            (state.frames.drain(..).collect::<Vec<_>>(), state.reference)
        };
        let mut news = self.rows(&frames)?;
        if reference.is_some() {
            // Samples and frames that arrive together are of about the same time.
            news.iter_mut().for_each(|row| row.wrench = reference);
        }
        news.iter().for_each(|row| self.display.push(*row));
        if let Some(guide) = &mut self.guide {
            let held: Vec<FrameLabel> = news.iter().filter_map(|row| guide.push(row)).collect();
            let first_unsettled = guide.first_unsettled();
            held.into_iter().for_each(|held| self.label(held));
            first_unsettled.into_iter().for_each(|i| self.feed.ask(RecordCommand::Settled(i)));
        }
        self.frames += frames.len() as u64;
        self.elapsed = elapsed;
        self.is_over = is_source_over && self.feed.state().frames.is_empty();
        // A port that is gone for good has an error to report, which a screen would hide.
        Ok(self.is_over && self.logs.is_some())
    }

    /// Frames as rows to show. Frames of a board that converts on its own already have their wrench.
    fn rows(&mut self, frames: &[BoardFrame]) -> Result<Vec<LiveRow>, ForceError> {
        let mut rows: Vec<LiveRow> = frames.iter().map(row).collect();
        if let Some(running) = &mut self.forces
            && !frames.is_empty()
            && rows.iter().all(|row| row.readings.is_some())
        {
            for (row, force) in rows.iter_mut().zip(running.of(frames)?) {
                row.wrench = Some(force.wrench);
                row.out_of_range = force.out_of_range as u8;
            }
        }
        Ok(rows)
    }

    pub fn recording(&self) -> Option<&str> {
        self.logs.as_ref().and_then(LogSeries::current)
    }

    pub fn obey(&mut self, action: LiveAction) {
        self.message = match action {
            LiveAction::Tare => {
                self.display.tare.begin();
                "taring what is shown; a log keeps its own tare".to_owned()
            }
            LiveAction::Untare => {
                self.display.tare = Default::default();
                "no tare but that of the calibration's first frames".to_owned()
            }
            LiveAction::Pause => {
                self.display.toggle_pause();
                self.feed.state().is_held = self.display.is_paused();
                let more = if self.logs.is_some() { "; recording goes on" } else { "" };
                match self.display.is_paused() {
                    true => format!("paused{more}"),
                    false => String::new(),
                }
            }
            LiveAction::ZoomIn => {
                self.display.zoom_in();
                String::new()
            }
            LiveAction::ZoomOut => {
                self.display.zoom_out();
                String::new()
            }
            LiveAction::Mark => match self.display.mark() {
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
        match logs.begin() {
            Ok(writer) => {
                self.feed.ask(RecordCommand::Record(writer));
                format!("recording to `{}`", logs.current().unwrap_or_default())
            }
            Err(error) => error.to_string(),
        }
    }

    pub fn state(&self) -> String {
        if self.logs.is_none() {
            return match self.is_over {
                true => "played to its end".to_owned(),
                false => format!("playing, {}", clock(self.elapsed)),
            };
        }
        let progress = self.feed.state().progress.clone();
        let Some(progress) = progress else { return "waiting".to_owned() };
        let RecordingProgress { rate_hz, frames, bytes, ref losses, .. } = progress;
        let time = clock(progress.elapsed);
        match progress.protocol {
            _ if !progress.connected => format!("{time}  port is gone, waiting for it"),
            None if bytes == 0 => format!("{time}  nothing arrives; `--start` starts a board"),
            None => format!("{time}  {bytes} bytes, no frame so far"),
            Some(protocol) => {
                let (name, lost) = (protocol_name(protocol), losses.in_words());
                format!("{name}  {time}  {rate_hz:.1} Hz  {frames} frames  {lost}")
            }
        }
    }

    pub fn report(&self) -> Vec<String> {
        let Self { frames, pictures, elapsed, .. } = self;
        let seconds = elapsed.as_secs_f64();
        let mut lines = vec![format!(
            "{frames} frames in {seconds:.1} s, {pictures} pictures, {} frames not shown",
            self.feed.state().left_out
        )];
        let logs = self.logs.iter().flat_map(|logs| &logs.written);
        lines.extend(logs.map(|log| format!("recorded `{log}`")));
        lines.extend(
            self.guide()
                .map(|guide| format!("{} of {} loads recorded", guide.recorded, guide.count)),
        );
        let marks = self.display.marks.iter();
        lines.extend(marks.map(|mark| format!("mark {} at {:.3} s", mark.number, mark.time_s)));
        lines
    }
}

fn row(frame: &BoardFrame) -> LiveRow {
    let (readings, wrench) = match frame.measured {
        Measured::Readings(readings) => (Some(readings), None),
        Measured::Wrench(wrench) => (None, Some(wrench)),
    };
    LiveRow {
        time_s: frame.time_us as f64 / 1e6,
        index: frame.index,
        readings,
        wrench,
        saturated: frame.saturated,
        out_of_range: 0,
    }
}

/// A guide through the loads of a table, in its order. The expected information gain of each is in the column
/// `plan_gain_nats`, which `shellcal plan` writes; a table without it counts loads.
pub fn guide_through(table: &HungLoads) -> Guide {
    let gains: Vec<f64> = match table.column("plan_gain_nats") {
        Some(cells) => cells.map(|cell| cell.parse().unwrap_or(0.0)).collect(),
        None => vec![0.0; table.loads().len()],
    };
    let guided = |(load, gain): (&HungLoad, f64)| GuidedLoad {
        group: load.group.clone(),
        text: load.to_string(),
        wrench: load.wrench(),
        gain,
    };
    Guide::new(table.loads().iter().zip(gains).map(guided).collect())
}

pub fn clock(time: Duration) -> String {
    let seconds = time.as_secs();
    format!("{:02}:{:02}:{:02}", seconds / 3600, seconds / 60 % 60, seconds % 60)
}
