//! A live view in the terminal: draw, obey keys.

use std::io::{self, IsTerminal, Stdout};
use std::time::Instant;

use anyhow::Context;
use ratatui_core::backend::Backend;
use ratatui_core::layout::{Rect, Size};
use ratatui_core::terminal::{Terminal, TerminalOptions, Viewport};
use ratatui_crossterm::CrosstermBackend;
use ratatui_crossterm::crossterm::event::{
    self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers,
};
use ratatui_crossterm::crossterm::terminal::{
    EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};
use ratatui_crossterm::crossterm::{cursor, execute};
use shellcal::workflow::live::{LiveAction, LiveSession, PERIOD};

use super::log_files::Until;
use super::screen::LiveScreen;

/// The screen of a terminal that does not tell its size, as VT100 had it.
const UNKNOWN_SIZE: Rect = Rect::new(0, 0, 80, 24);

/// How a terminal is drawn on.
#[derive(Clone, Copy, Debug)]
pub(super) struct Appearance {
    pub(super) is_ascii: bool,
    pub(super) color: bool,
}

/// A terminal is drawn on, and asked for keys.
pub(super) fn require_terminal() -> anyhow::Result<()> {
    match io::stdout().is_terminal() && io::stdin().is_terminal() {
        true => Ok(()),
        false => anyhow::bail!(
            "a live view needs a terminal; `--serve` shows it in a browser, `shellcal record` needs neither"
        ),
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
struct RawTerminal(Terminal<CrosstermBackend<Stdout>>);

impl RawTerminal {
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

impl Drop for RawTerminal {
    fn drop(&mut self) {
        // Nobody is left to tell.
        let _ = execute!(io::stdout(), LeaveAlternateScreen, cursor::Show);
        let _ = disable_raw_mode();
    }
}

/// Shows what comes until a key, a signal or the end of the source ends it.
pub(super) fn run(
    session: &mut LiveSession,
    look: Appearance,
    until: &Until<'_>,
) -> anyhow::Result<()> {
    let mut stage = RawTerminal::enter()?;
    let mut due = Instant::now();
    while until.advance(session)? {
        let (state, guide) = (session.state(), session.guide());
        let screen = LiveScreen {
            model: session.model(),
            guide: guide.as_ref(),
            source: session.name(),
            state: &state,
            recording: session.recording(),
            message: session.message(),
            ascii: look.is_ascii,
            color: look.color,
        };
        stage.0.draw(|frame| screen.draw(frame.buffer_mut()))?;
        session.count_picture();
        due = (due + PERIOD).max(Instant::now());
        // Keys are obeyed at once, and seen in the next picture.
        while event::poll(due.saturating_duration_since(Instant::now()))? {
            let Event::Key(key) = event::read()? else { continue };
            if key.kind == KeyEventKind::Release {
                continue;
            }
            if is_end(&key) {
                return Ok(());
            }
            if let Some(action) = action(&key) {
                session.obey(action);
            }
        }
    }
    Ok(())
}

fn action(key: &KeyEvent) -> Option<LiveAction> {
    Some(match key.code {
        KeyCode::Char('t') => LiveAction::Tare,
        KeyCode::Char('T') => LiveAction::Untare,
        KeyCode::Char(' ') => LiveAction::Pause,
        KeyCode::Char('+' | '=') => LiveAction::ZoomIn,
        KeyCode::Char('-') => LiveAction::ZoomOut,
        KeyCode::Char('m') => LiveAction::Mark,
        KeyCode::Char('r') => LiveAction::Record,
        KeyCode::Char('n') => LiveAction::Skip,
        KeyCode::Char('b') => LiveAction::Back,
        _ => return None,
    })
}

fn is_end(key: &KeyEvent) -> bool {
    let control = key.modifiers.contains(KeyModifiers::CONTROL);
    match key.code {
        KeyCode::Char('q') | KeyCode::Esc => true,
        KeyCode::Char('c') => control,
        _ => false,
    }
}
