//! The live view in the terminal, which draws and takes keys, and in browsers, which receive a page and pictures.

use std::io::{self, Write};
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::thread;
use std::time::Instant;

use anyhow::Context;
use crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use crossterm::terminal::{
    self, Clear, ClearType, EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode,
    enable_raw_mode,
};
use crossterm::{cursor, execute, queue};
use live_view::LoadGuide;
use live_view::web::{Server, Site};
use shellcal::workflow::live::{LiveAction, LiveSession, PERIOD};

use super::cells::CellGrid;
use super::screen::LiveScreen;

/// Takes the frames that have arrived; returns true if the view goes on.
pub(super) type Advance<'a, G> = &'a dyn Fn(&mut LiveSession<G>) -> anyhow::Result<bool>;

/// Size of the VT100, for a terminal that does not tell its size.
const UNKNOWN_SIZE: (u16, u16) = (80, 24);

/// True if the locale can show more than ASCII.
pub(super) fn is_utf8() -> bool {
    let set = |name: &str| std::env::var(name).ok().filter(|value| !value.is_empty());
    let locale = ["LC_ALL", "LC_CTYPE", "LANG"].into_iter().find_map(set);
    cfg!(windows)
        || locale.is_some_and(|locale| locale.to_lowercase().replace('-', "").contains("utf8"))
}

struct RawTerminal {
    shown: CellGrid,
}

impl RawTerminal {
    fn enter() -> anyhow::Result<Self> {
        enable_raw_mode().context("cannot take keys from the terminal")?;
        execute!(io::stdout(), EnterAlternateScreen, cursor::Hide)?;
        Ok(Self { shown: CellGrid::new((0, 0)) })
    }

    fn show(&mut self, screen: &LiveScreen<'_>) -> io::Result<()> {
        // A console on a serial port reports zero columns and rows.
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
        // Errors are ignored: there is nowhere to report them.
        let _ = execute!(io::stdout(), LeaveAlternateScreen, cursor::Show);
        let _ = disable_raw_mode();
    }
}

pub(super) fn run<G: LoadGuide>(
    session: &mut LiveSession<G>,
    ascii: bool,
    color: bool,
    advance: Advance<'_, G>,
) -> anyhow::Result<()> {
    let mut stage = RawTerminal::enter()?;
    let mut due = Instant::now();
    while advance(session)? {
        let (state, guide) = (session.state(), session.guide());
        let screen = LiveScreen {
            display: &session.display,
            guide: guide.as_ref(),
            source: &session.name,
            state: &state,
            recording: session.recording(),
            message: &session.message,
            ascii,
            color,
        };
        stage.show(&screen)?;
        session.pictures += 1;
        due = (due + PERIOD).max(Instant::now());
        // Keys take effect at once, and show in the next picture.
        while event::poll(due.saturating_duration_since(Instant::now()))? {
            let Event::Key(key) = event::read()? else { continue };
            if key.kind == KeyEventKind::Release {
                continue;
            }
            let is_control = key.modifiers.contains(KeyModifiers::CONTROL);
            match key.code {
                KeyCode::Char('q') | KeyCode::Esc => return Ok(()),
                KeyCode::Char('c') if is_control => return Ok(()),
                code => action(code).into_iter().for_each(|action| session.obey(action)),
            }
        }
    }
    Ok(())
}

fn action(key: KeyCode) -> Option<LiveAction> {
    Some(match key {
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

const PAGE: &str = include_str!("../../../../../assets/live/page.html");
const STYLE: &str = include_str!("../../../../../assets/live/live.css");
const VIEW: &str = include_str!("../../../../../assets/live/view.html");
const SCRIPT: &str = include_str!("../../../../../assets/live/live.js");
const CONNECT: &str = include_str!("../../../../../assets/live/connect.js");

/// Default address: this machine only, on a free port.
pub(super) const LOOPBACK: &str = "127.0.0.1:0";

pub(super) fn serve(at: SocketAddr) -> anyhow::Result<(Server, String)> {
    let (token, nonce) = (random()?, random()?);
    let page = PAGE.replace("{style}", STYLE).replace("{view}", VIEW);
    let page = page.replace("{script}", SCRIPT).replace("{connect}", CONNECT);
    let page = page.replace("{nonce}", &nonce);
    let orders = LiveAction::NAMED.map(|(name, _)| name).to_vec();
    let site = Site { page, nonce, token: token.clone(), orders, open: Vec::new() };
    let server = Server::start(at, site).with_context(|| format!("cannot listen at {at}"))?;
    let mut address = server.address();
    if let Some(own) = address.ip().is_unspecified().then(own_address).flatten() {
        address.set_ip(own);
    }
    Ok((server, format!("http://{address}/?token={token}")))
}

pub(super) fn run_in_browser<G: LoadGuide>(
    session: &mut LiveSession<G>,
    server: Server,
    advance: Advance<'_, G>,
) -> anyhow::Result<()> {
    let mut due = Instant::now();
    while advance(session)? {
        while let Some(order) = server.next_order() {
            LiveAction::named(order).into_iter().for_each(|action| session.obey(action));
        }
        if server.has_listeners() {
            server.publish(&session.shown().to_string());
        }
        due = (due + PERIOD).max(Instant::now());
        thread::sleep(due.saturating_duration_since(Instant::now()));
    }
    server.end();
    Ok(())
}

/// 128 random bits, as hexadecimal digits.
fn random() -> anyhow::Result<String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).context("the system gives no random bytes")?;
    Ok(format!("{:032x}", u128::from_le_bytes(bytes)))
}

/// The address by which others may reach this machine: the one that it would send from. No packet is sent.
fn own_address() -> Option<IpAddr> {
    let socket = UdpSocket::bind("0.0.0.0:0").ok()?;
    // An address for documentation (RFC 5737), which belongs to no network.
    socket.connect("192.0.2.1:9").ok()?;
    Some(socket.local_addr().ok()?.ip()).filter(|address| !address.is_unspecified())
}
