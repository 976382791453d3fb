//! A live view in the terminal: draw, obey keys.

use std::io::{self, IsTerminal, Write};
use std::time::Instant;

use anyhow::Context;
use crossterm::event::{self, Event, KeyCode, KeyEvent, KeyEventKind, KeyModifiers};
use crossterm::terminal::{
    self, Clear, ClearType, EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode,
    enable_raw_mode,
};
use crossterm::{cursor, execute, queue};
use shellcal::workflow::live::{LiveAction, LiveSession, PERIOD};

use super::cells::CellGrid;
use super::log_files::Until;
use super::screen::LiveScreen;

/// The screen of a terminal that does not tell its size, as VT100 had it.
const UNKNOWN_SIZE: (u16, u16) = (80, 24);

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
struct RawTerminal {
    shown: CellGrid,
}

impl RawTerminal {
    fn enter() -> anyhow::Result<Self> {
        enable_raw_mode().context("cannot take keys from the terminal")?;
        execute!(io::stdout(), EnterAlternateScreen, cursor::Hide)?;
        Ok(Self { shown: CellGrid::new((0, 0)) })
    }

    /// Draws the screen, and writes the lines that have changed in one piece.
    fn show(&mut self, screen: &LiveScreen<'_>) -> io::Result<()> {
        // A console on a serial port says that it has no columns and no rows.
        let size = match terminal::size()? {
            (0, _) | (_, 0) => UNKNOWN_SIZE,
            size => size,
        };
        let mut written = Vec::new();
        let mut picture = CellGrid::new(size);
        if self.shown.size() != size {
            self.shown = CellGrid::new(size);
            queue!(written, Clear(ClearType::All))?;
        }
        screen.draw(&mut picture);
        picture.write_over(&self.shown, &mut written)?;
        self.shown = picture;
        let mut terminal = io::stdout().lock();
        terminal.write_all(&written)?;
        terminal.flush()
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
            model: &session.model,
            guide: guide.as_ref(),
            source: &session.name,
            state: &state,
            recording: session.recording(),
            message: &session.message,
            ascii: look.is_ascii,
            color: look.color,
        };
        stage.show(&screen)?;
        session.pictures += 1;
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
