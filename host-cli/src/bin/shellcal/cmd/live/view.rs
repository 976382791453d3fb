//! The loop of the view: fetch frames, draw, obey keys.

use std::io::{self, IsTerminal, Stdout};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Context;
use ratatui::backend::{Backend, CrosstermBackend};
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use ratatui::crossterm::terminal::{
    EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};
use ratatui::crossterm::{cursor, execute};
use ratatui::layout::{Rect, Size};
use ratatui::{Terminal, TerminalOptions, Viewport};
use shellcal::link::{Journal, Progress, Wish};
use shellcal::live::LiveModel;
use shellcal::output::OutputError;
use shellcal::recording::protocol_name;
use shellcal::workflow::live::{Feed, LiveRows};

use super::super::record::{clock, list_losses};
use super::screen::Screen;

/// Time from picture to picture: thirty a second.
const PERIOD: Duration = Duration::from_micros(33_333);

/// The screen of a terminal that does not tell its size, as VT100 had it.
const UNKNOWN_SIZE: Rect = Rect::new(0, 0, 80, 24);

/// The view and what it is of.
pub(super) struct View {
    pub(super) model: LiveModel,
    pub(super) rows: LiveRows,
    pub(super) feed: Feed,
    /// The logs that are written; `None` where nothing can be recorded.
    pub(super) logs: Option<Logs>,
    pub(super) name: String,
    pub(super) is_ascii: bool,
    pub(super) color: bool,
    pub(super) duration: Option<Duration>,
}

/// What was shown.
#[derive(Debug)]
pub(super) struct Shown {
    rows: u64,
    pictures: u64,
    elapsed: Duration,
}

/// The logs that one view writes, one after the other.
#[derive(Debug)]
pub(super) struct Logs {
    path: Option<PathBuf>,
    overwrite: bool,
    written: Vec<String>,
    is_on: bool,
}

impl Logs {
    /// The first of them, if it has a name.
    pub(super) fn new(path: Option<PathBuf>, overwrite: bool) -> Self {
        Self { path, overwrite, written: Vec::new(), is_on: false }
    }

    /// Makes the next: `log.csv`, then the first of `log-2.csv`, `log-3.csv`, … that is not there.
    pub(super) fn next(&mut self) -> anyhow::Result<Journal> {
        let base = self.path.clone().unwrap_or_else(|| PathBuf::from("live.csv"));
        let mut number = self.written.len() + 1;
        loop {
            let path = numbered(&base, number);
            // A name that was given is meant; one that was made must not be in the way.
            let is_given = number == 1 && self.path.is_some();
            match Journal::create(&path, self.overwrite && is_given) {
                Err(OutputError::Failed { source, .. })
                    if !is_given && source.kind() == io::ErrorKind::AlreadyExists =>
                {
                    number += 1;
                }
                journal => {
                    let journal = journal?;
                    self.written.push(path.display().to_string());
                    self.is_on = true;
                    return Ok(journal);
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

/// A terminal is drawn on, and asked for keys.
pub(super) fn require_terminal() -> anyhow::Result<()> {
    match io::stdout().is_terminal() && io::stdin().is_terminal() {
        true => Ok(()),
        false => anyhow::bail!("a live view needs a terminal; `shellcal record` needs none"),
    }
}

/// Whether the locale can show more than ASCII.
pub(super) fn is_utf8() -> bool {
    let set = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
    let locale = ["LC_ALL", "LC_CTYPE", "LANG"].into_iter().find_map(set);
    cfg!(windows)
        || locale.is_some_and(|locale| locale.to_lowercase().replace('-', "").contains("utf8"))
}

/// The terminal while it is drawn on; dropped, it is as it was.
struct Stage(Terminal<CrosstermBackend<Stdout>>);

impl Stage {
    fn enter() -> anyhow::Result<Self> {
        enable_raw_mode().context("cannot take keys from the terminal")?;
        execute!(io::stdout(), EnterAlternateScreen, cursor::Hide)?;
        let backend = CrosstermBackend::new(io::stdout());
        // A console on a serial port says that it has no columns and no rows.
        let viewport = match backend.size()? {
            Size { width: 0, .. } | Size { height: 0, .. } => Viewport::Fixed(UNKNOWN_SIZE),
            _ => Viewport::Fullscreen,
        };
        Ok(Self(Terminal::with_options(backend, TerminalOptions { viewport })?))
    }
}

impl Drop for Stage {
    fn drop(&mut self) {
        // Nobody is left to tell.
        let _ = execute!(io::stdout(), LeaveAlternateScreen, cursor::Show);
        let _ = disable_raw_mode();
    }
}

impl View {
    /// Shows what comes until a key, a signal or the end of the source ends it. A log that has been played
    /// to its end stays on the screen.
    pub(super) fn run(
        &mut self,
        ends: &dyn Fn() -> bool,
        is_over: &dyn Fn() -> bool,
    ) -> anyhow::Result<Shown> {
        let mut stage = Stage::enter()?;
        let started = Instant::now();
        let mut shown = Shown { rows: 0, pictures: 0, elapsed: Duration::ZERO };
        let (mut message, mut frames, mut due) = (String::new(), Vec::new(), started);
        loop {
            self.feed.fetch(&mut frames);
            for row in self.rows.of(&frames)? {
                self.model.push(row);
            }
            shown.rows += frames.len() as u64;
            let over = is_over() && self.feed.waiting() == 0;
            // A port that is gone for good has something to say, which the screen would hide.
            let is_out_of_time = self.duration.is_some_and(|end| started.elapsed() >= end);
            if ends() || is_out_of_time || over && self.logs.is_some() {
                break;
            }
            let state = self.state(started.elapsed(), over);
            let screen = Screen {
                model: &self.model,
                source: &self.name,
                state: &state,
                recording: self.logs.as_ref().and_then(Logs::current),
                message: &message,
                ascii: self.is_ascii,
                color: self.color,
            };
            stage.0.draw(|frame| screen.draw(frame.buffer_mut()))?;
            shown.pictures += 1;
            due = (due + PERIOD).max(Instant::now());
            // Keys are obeyed at once, and seen in the next picture.
            while event::poll(due.saturating_duration_since(Instant::now()))? {
                let Event::Key(key) = event::read()? else { continue };
                if key.kind == KeyEventKind::Release {
                    continue;
                }
                if is_end(&key) {
                    shown.elapsed = started.elapsed();
                    return Ok(shown);
                }
                if let Some(said) = self.obey(&key) {
                    message = said;
                }
            }
        }
        shown.elapsed = started.elapsed();
        Ok(shown)
    }

    fn obey(&mut self, key: &KeyEvent) -> Option<String> {
        Some(match key.code {
            KeyCode::Char('t') => {
                self.model.begin_tare();
                "taring what is shown; a log keeps its own tare".to_owned()
            }
            KeyCode::Char('T') => {
                self.model.end_tare();
                "no tare but that of the calibration's first frames".to_owned()
            }
            KeyCode::Char(' ') => {
                self.model.toggle_pause();
                self.feed.hold(self.model.is_paused());
                let more = if self.logs.is_some() { "; recording goes on" } else { "" };
                match self.model.is_paused() {
                    true => format!("paused{more}"),
                    false => String::new(),
                }
            }
            KeyCode::Char('+' | '=') => {
                self.model.zoom_in();
                String::new()
            }
            KeyCode::Char('-') => {
                self.model.zoom_out();
                String::new()
            }
            KeyCode::Char('m') => {
                let mark = self.model.mark()?;
                self.feed.ask(Wish::Mark { index: mark.index, number: mark.number });
                format!("mark {} at {:.3} s", mark.number, mark.time_s)
            }
            KeyCode::Char('r') => self.toggle_recording(),
            _ => return None,
        })
    }

    fn toggle_recording(&mut self) -> String {
        let Some(logs) = &mut self.logs else {
            return "a log that is played is not recorded again".to_owned();
        };
        if let Some(log) = logs.current() {
            let said = format!("recorded `{log}`");
            logs.is_on = false;
            self.feed.ask(Wish::Rest);
            return said;
        }
        match logs.next() {
            Ok(journal) => {
                self.feed.ask(Wish::Record(journal));
                format!("recording to `{}`", logs.current().unwrap_or_default())
            }
            Err(error) => format!("{error:#}"),
        }
    }

    /// How it goes, in a line.
    fn state(&self, elapsed: Duration, over: bool) -> String {
        if self.logs.is_none() {
            return match over {
                true => "played to its end".to_owned(),
                false => format!("playing, {}", clock(elapsed)),
            };
        }
        let Some(progress) = self.feed.progress() else { return "waiting".to_owned() };
        let Progress { rate_hz, frames, bytes, ref losses, .. } = progress;
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

    /// What is said when the screen is gone.
    pub(super) fn report(&self, shown: &Shown) -> Vec<String> {
        let Shown { rows, pictures, elapsed } = shown;
        let seconds = elapsed.as_secs_f64();
        let mut lines = vec![format!(
            "{rows} frames in {seconds:.1} s, {pictures} pictures, {} frames not shown",
            self.feed.left_out()
        )];
        let logs = self.logs.iter().flat_map(|logs| &logs.written);
        lines.extend(logs.map(|log| format!("recorded `{log}`")));
        let marks = self.model.marks().iter();
        lines.extend(marks.map(|mark| format!("mark {} at {:.3} s", mark.number, mark.time_s)));
        lines
    }
}

fn is_end(key: &KeyEvent) -> bool {
    let control = key.modifiers.contains(KeyModifiers::CONTROL);
    match key.code {
        KeyCode::Char('q') | KeyCode::Esc => true,
        KeyCode::Char('c') => control,
        _ => false,
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
        let mut logs = Logs::new(Some(path.clone()), false);
        let mut journals = vec![logs.next().unwrap(), logs.next().unwrap()];
        let names: Vec<_> =
            logs.written.iter().map(Path::new).map(|p| p.file_name().unwrap()).collect();
        assert_eq!(names, ["run.csv", "run-3.csv"]);
        assert_eq!(std::fs::read(dir.path().join("run-2.csv")).unwrap(), b"mine");
        journals.clear();
        assert!(Logs::new(Some(path), false).next().is_err(), "a name that was given is taken");
    }
}
