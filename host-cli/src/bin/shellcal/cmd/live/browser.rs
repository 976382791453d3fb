//! A live view in browsers: a page, and pictures to whoever has opened it.

use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::thread;
use std::time::Instant;

use anyhow::Context;
use live_view::web::{Server, Site};
use live_view::{GuideView, Picture};
use serde::Serialize;

use super::session::{LiveAction, LiveSession, PERIOD, Until};

const PAGE: &str = include_str!("../../../../../assets/live/page.html");
const STYLE: &str = include_str!("../../../../../assets/live/live.css");
const SCRIPT: &str = include_str!("../../../../../assets/live/live.js");

/// Where there is no other word: this machine alone, on a port that is free.
pub(super) const LOOPBACK: &str = "127.0.0.1:0";

/// What the page can ask for.
const ORDERS: [&str; 9] =
    ["tare", "untare", "pause", "zoom-in", "zoom-out", "mark", "record", "skip", "back"];

/// What a browser is told.
#[derive(Serialize)]
struct Shown<'a> {
    source: &'a str,
    state: String,
    recording: Option<&'a str>,
    can_record: bool,
    message: &'a str,
    /// The next planned load.
    guide: Option<GuideView>,
    picture: Picture,
}

/// A server for browsers, and the address to open.
pub(super) fn start(at: SocketAddr) -> anyhow::Result<(Server, String)> {
    let (token, nonce) = (random()?, random()?);
    let page = PAGE.replace("{style}", STYLE).replace("{script}", SCRIPT);
    let page = page.replace("{nonce}", &nonce);
    let site = Site { page, nonce, token: token.clone(), orders: &ORDERS };
    let server = Server::start(at, site).with_context(|| format!("cannot listen at {at}"))?;
    let mut address = server.address();
    if let Some(own) = address.ip().is_unspecified().then(own_address).flatten() {
        address.set_ip(own);
    }
    Ok((server, format!("http://{address}/?token={token}")))
}

/// Shows what comes until a signal or the end of the source ends it.
pub(super) fn run(
    session: &mut LiveSession,
    server: Server,
    until: &Until<'_>,
) -> anyhow::Result<()> {
    let mut due = Instant::now();
    while session.advance(until)? {
        while let Some(order) = server.next_order() {
            session.obey(action(order));
        }
        if server.has_listeners() {
            let shown = Shown {
                source: &session.name,
                state: session.state(),
                recording: session.recording(),
                can_record: session.can_record(),
                message: &session.message,
                guide: session.guide(),
                picture: session.model.picture(),
            };
            server.publish(&serde_json::to_string(&shown)?);
            session.pictures += 1;
        }
        due = (due + PERIOD).max(Instant::now());
        thread::sleep(due.saturating_duration_since(Instant::now()));
    }
    server.end();
    Ok(())
}

fn action(order: &str) -> LiveAction {
    match order {
        "tare" => LiveAction::Tare,
        "untare" => LiveAction::Untare,
        "pause" => LiveAction::Pause,
        "zoom-in" => LiveAction::ZoomIn,
        "zoom-out" => LiveAction::ZoomOut,
        "mark" => LiveAction::Mark,
        "skip" => LiveAction::Skip,
        "back" => LiveAction::Back,
        // The server takes no others.
        _ => LiveAction::Record,
    }
}

/// 128 random bits, in hexadecimal digits.
fn random() -> anyhow::Result<String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).context("the system gives no random bytes")?;
    Ok(format!("{:032x}", u128::from_le_bytes(bytes)))
}

/// An address that others may reach this machine by: the one that it would send from. Nothing is sent.
fn own_address() -> Option<IpAddr> {
    let socket = UdpSocket::bind("0.0.0.0:0").ok()?;
    // An address for documentation (RFC 5737), which is on no network.
    socket.connect("192.0.2.1:9").ok()?;
    Some(socket.local_addr().ok()?.ip()).filter(|address| !address.is_unspecified())
}
