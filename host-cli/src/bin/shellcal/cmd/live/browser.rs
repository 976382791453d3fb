//! A live view in browsers: a page, and pictures to whoever has opened it.

use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::thread;
use std::time::Instant;

use anyhow::Context;
use live_view::web::{Server, Site};
use shellcal::workflow::live::{LiveAction, LiveSession, PERIOD};

use super::log_files::Until;

const PAGE: &str = include_str!("../../../../../assets/live/page.html");
const STYLE: &str = include_str!("../../../../../assets/live/live.css");
const VIEW: &str = include_str!("../../../../../assets/live/view.html");
const SCRIPT: &str = include_str!("../../../../../assets/live/live.js");
const CONNECT: &str = include_str!("../../../../../assets/live/connect.js");

/// Where there is no other word: this machine alone, on a port that is free.
pub(super) const LOOPBACK: &str = "127.0.0.1:0";

/// A server for browsers, and the address to open.
pub(super) fn start(at: SocketAddr) -> anyhow::Result<(Server, String)> {
    let (token, nonce) = (random()?, random()?);
    let page = PAGE.replace("{style}", STYLE).replace("{view}", VIEW);
    let page = page.replace("{script}", SCRIPT).replace("{connect}", CONNECT);
    let page = page.replace("{nonce}", &nonce);
    let orders = LiveAction::NAMED.map(|(name, _)| name).to_vec();
    let site = Site { page, nonce, token: token.clone(), orders };
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
    while until.advance(session)? {
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
