//! The server: a thread that accepts, and one for each connection.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use super::access::{is_host_ours, is_same};
use super::request::{HttpRefusal, LONGEST, Request, RequestMethod, end_of_head, parse};
use shell_data::lock::lock;

/// Connections that may see something, at a time; a page needs one, and a second for a moment.
const CONNECTIONS: usize = 16;

/// Connections that have not yet sent a request with the token, at a time. One more takes the place of the oldest:
/// who has the token sends it at once, so that others cannot lock the page out.
const STRANGERS: usize = 32;

/// Orders that wait.
const ORDERS: usize = 64;

/// How long a request may take to arrive, and a write to be taken.
const PATIENCE: Duration = Duration::from_secs(5);

/// After so long without an event a listener gets an empty line: who has gone is found out.
const KEEP_ALIVE: Duration = Duration::from_secs(2);

/// How long the end waits for listeners to be told.
const GOODBYE: Duration = Duration::from_millis(500);

/// Of a connection's thread, bytes.
const STACK: usize = 256 * 1024;

/// What is served.
#[derive(Clone, Debug)]
pub struct Site {
    /// The page, HTML.
    pub page: String,
    /// What the page's own scripts and styles are marked with; no others are run.
    pub nonce: String,
    /// What every request has to carry, in the address: `?token=…`.
    pub token: String,
    /// The orders there are: `mark` is `POST /mark`.
    pub orders: Vec<&'static str>,
}

/// A server, which listens until the process ends.
#[derive(Debug)]
pub struct Server {
    shared: Arc<ServerShared>,
    address: SocketAddr,
}

#[derive(Debug)]
struct ServerShared {
    site: Site,
    state: Mutex<ServerState>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct ServerState {
    /// The newest event as it goes over the wire, and its number.
    event: Arc<str>,
    number: u64,
    connections: usize,
    /// Connections without a request yet, the oldest first, by their numbers.
    strangers: VecDeque<(u64, TcpStream)>,
    strangers_seen: u64,
    listeners: usize,
    orders: VecDeque<&'static str>,
    ended: bool,
}

impl Server {
    /// Listens at an address, on a port that is free where it is 0.
    ///
    /// # Errors
    /// What the system says.
    pub fn start(at: SocketAddr, site: Site) -> io::Result<Self> {
        let listener = TcpListener::bind(at)?;
        let address = listener.local_addr()?;
        let (state, changed) = (Mutex::default(), Condvar::new());
        let shared = Arc::new(ServerShared { site, state, changed });
        let accepting = Arc::clone(&shared);
        let run = move || {
            for stream in listener.incoming() {
                match stream {
                    Ok(stream) => accepting.admit(stream),
                    // Out of descriptors, as a rule, which passes.
                    Err(_) => thread::sleep(Duration::from_millis(50)),
                }
            }
        };
        thread::Builder::new().name("web".to_owned()).stack_size(STACK).spawn(run)?;
        Ok(Self { shared, address })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Whether anybody takes events.
    pub fn has_listeners(&self) -> bool {
        self.shared.state().listeners > 0
    }

    /// Makes a line of text the newest event.
    pub fn publish(&self, line: &str) {
        let mut event = String::with_capacity(line.len() + 8);
        // A text of several lines is several lines of data.
        line.lines().for_each(|line| {
            let _ = writeln!(event, "data: {line}");
        });
        event.push('\n');
        let mut state = self.shared.state();
        (state.event, state.number) = (event.into(), state.number + 1);
        self.shared.changed.notify_all();
    }

    /// The order that has waited longest.
    pub fn next_order(&self) -> Option<&'static str> {
        self.shared.state().orders.pop_front()
    }

    /// Tells the listeners that there is nothing more, and waits a moment for it to arrive.
    pub fn end(self) {
        let mut state = self.shared.state();
        state.ended = true;
        self.shared.changed.notify_all();
        let deadline = Instant::now() + GOODBYE;
        while state.listeners > 0 {
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            let waited = self.shared.changed.wait_timeout(state, left);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl ServerShared {
    /// A thread that has ended badly has left the state whole: nothing under the lock can fail half way.
    fn state(&self) -> MutexGuard<'_, ServerState> {
        lock(&self.state)
    }

    /// Gives a connection a thread.
    fn admit(self: &Arc<Self>, mut stream: TcpStream) {
        // A connection without limits of time is none.
        if stream.set_write_timeout(Some(PATIENCE)).is_err() || stream.set_nodelay(true).is_err() {
            return;
        }
        let Ok(stranger) = Stranger::admit(self, &stream) else { return };
        let serve = move || {
            let shared = Arc::clone(&stranger.shared);
            // A browser that has gone, as a rule: nobody is left to tell.
            let _ = shared.serve(&mut stream, stranger);
        };
        // Where there is no thread, the connection is closed, and the browser tries again.
        let _ = thread::Builder::new().name("browser".to_owned()).stack_size(STACK).spawn(serve);
    }

    /// Reads the request of a stranger, who is one until it is allowed, and answers it.
    fn serve(self: &Arc<Self>, stream: &mut TcpStream, stranger: Stranger) -> io::Result<()> {
        let mut buffer = [0; LONGEST];
        let request = match read_head(stream, &mut buffer) {
            Ok(None) | Err(None) => return Ok(()),
            Err(Some(refusal)) => Err(refusal),
            Ok(Some(head)) => parse(head).and_then(|request| self.allow(request)),
        };
        let seat = || Counted::new(self, |state| &mut state.connections, CONNECTIONS);
        let seat = request.is_ok().then(seat).flatten();
        let answered = match (request, &seat) {
            (Err(refusal), _) => Err(refusal),
            (Ok(_), None) => Err(HttpRefusal::Busy),
            (Ok(request), Some(_)) => {
                drop(stranger);
                self.answer(stream, &request)?
            }
        };
        if let Err(refusal) = answered {
            refuse(stream, refusal)?;
        }
        close(stream, &mut buffer)
    }

    fn allow<'a>(&self, request: Request<'a>) -> Result<Request<'a>, HttpRefusal> {
        match () {
            () if !is_host_ours(request.host) => Err(HttpRefusal::Host),
            () if !is_same(request.token, &self.site.token) => Err(HttpRefusal::NoToken),
            () => Ok(request),
        }
    }

    fn answer(
        &self,
        stream: &mut TcpStream,
        request: &Request<'_>,
    ) -> io::Result<Result<(), HttpRefusal>> {
        let order = request.path.strip_prefix('/');
        let order = self.site.orders.iter().find(|&&known| Some(known) == order);
        match (request.method, request.path, order) {
            (RequestMethod::Get, "/", _) => self.send_page(stream)?,
            (RequestMethod::Get, "/events", _) => self.send_events(stream)?,
            (RequestMethod::Post, _, Some(order)) => {
                {
                    let mut state = self.state();
                    if state.orders.len() >= ORDERS {
                        return Ok(Err(HttpRefusal::Busy));
                    }
                    state.orders.push_back(order);
                }
                send_head(stream, "204 No Content", "")?;
            }
            (RequestMethod::Post, "/" | "/events", _) | (RequestMethod::Get, _, Some(_)) => {
                return Ok(Err(HttpRefusal::RequestMethod));
            }
            _ => return Ok(Err(HttpRefusal::NotFound)),
        }
        Ok(Ok(()))
    }

    fn send_page(&self, stream: &mut TcpStream) -> io::Result<()> {
        let Site { page, nonce, .. } = &self.site;
        let more = format!(
            "Content-Type: text/html; charset=utf-8\r\nContent-Length: {}\r\n\
             Content-Security-Policy: default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; \
             connect-src 'self'; img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n",
            page.len()
        );
        send_head(stream, "200 OK", &more)?;
        stream.write_all(page.as_bytes())
    }

    fn send_events(&self, stream: &mut TcpStream) -> io::Result<()> {
        send_head(stream, "200 OK", "Content-Type: text/event-stream\r\n")?;
        // How soon to come back after a connection was lost, ms.
        stream.write_all(b"retry: 500\n\n")?;
        // What has come before is old where nobody has listened.
        let mut seen = self.state().number;
        let _listener = Counted::new(self, |state| &mut state.listeners, usize::MAX);
        while let Some(event) = self.next_event(&mut seen) {
            stream.write_all(event.as_bytes())?;
        }
        stream.write_all(b"event: end\ndata:\n\n")
    }

    /// The newest event, or an empty one if none that was not seen has come for a while; `None` at the end.
    fn next_event(&self, seen: &mut u64) -> Option<Arc<str>> {
        let state = self.state();
        let is_idle = |state: &mut ServerState| state.number == *seen && !state.ended;
        let waited = self.changed.wait_timeout_while(state, KEEP_ALIVE, is_idle);
        let (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        if state.ended {
            return None;
        }
        if state.number == *seen {
            return Some(":\n\n".into());
        }
        *seen = state.number;
        Some(Arc::clone(&state.event))
    }
}

/// A connection that has not sent the token yet.
struct Stranger {
    shared: Arc<ServerShared>,
    number: u64,
}

impl Stranger {
    /// Takes a connection in; where there are too many, the oldest is closed, and its thread ends.
    fn admit(shared: &Arc<ServerShared>, stream: &TcpStream) -> io::Result<Self> {
        let stream = stream.try_clone()?;
        let mut state = shared.state();
        if state.strangers.len() >= STRANGERS
            && let Some((_, oldest)) = state.strangers.pop_front()
        {
            // Where it is closed already, so much the better.
            let _ = oldest.shutdown(Shutdown::Both);
        }
        state.strangers_seen += 1;
        let number = state.strangers_seen;
        state.strangers.push_back((number, stream));
        Ok(Self { shared: Arc::clone(shared), number })
    }
}

impl Drop for Stranger {
    fn drop(&mut self) {
        self.shared.state().strangers.retain(|(number, _)| *number != self.number);
    }
}

/// Counts a connection or a listener until it is dropped.
struct Counted<'a> {
    shared: &'a ServerShared,
    count: fn(&mut ServerState) -> &mut usize,
}

impl<'a> Counted<'a> {
    /// Counts one more, unless there are `most` already.
    fn new(
        shared: &'a ServerShared,
        count: fn(&mut ServerState) -> &mut usize,
        most: usize,
    ) -> Option<Self> {
        let mut state = shared.state();
        let counted = count(&mut state);
        if *counted >= most {
            return None;
        }
        *counted += 1;
        Some(Self { shared, count })
    }
}

impl Drop for Counted<'_> {
    fn drop(&mut self) {
        *(self.count)(&mut self.shared.state()) -= 1;
        self.shared.changed.notify_all();
    }
}

/// Reads up to the empty line; `None` where nothing was said. The error is `None` where the connection is gone.
fn read_head<'a>(
    stream: &mut TcpStream,
    buffer: &'a mut [u8; LONGEST],
) -> Result<Option<&'a [u8]>, Option<HttpRefusal>> {
    let deadline = Instant::now() + PATIENCE;
    let mut length = 0;
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(Some(HttpRefusal::TooSlow));
        }
        stream.set_read_timeout(Some(left)).map_err(|_| None)?;
        let looked_at = length;
        match stream.read(&mut buffer[length..]) {
            Ok(0) if length == 0 => return Ok(None),
            Ok(0) => return Err(Some(HttpRefusal::Malformed)),
            Ok(count) => length += count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
            Err(error) if is_timeout(&error) => return Err(Some(HttpRefusal::TooSlow)),
            Err(_) => return Err(None),
        }
        if let Some(end) = end_of_head(&buffer[..length], looked_at) {
            return Ok(Some(&buffer[..end]));
        }
        if length == buffer.len() {
            return Err(Some(HttpRefusal::TooLong));
        }
    }
}

fn is_timeout(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut)
}

/// Nothing of it is kept anywhere, and the address, which has the token in it, is told to no other site.
fn send_head(stream: &mut TcpStream, status: &str, more: &str) -> io::Result<()> {
    let head = format!(
        "HTTP/1.1 {status}\r\nConnection: close\r\nCache-Control: no-store\r\nReferrer-Policy: no-referrer\r\n\
         X-Content-Type-Options: nosniff\r\n{more}\r\n"
    );
    stream.write_all(head.as_bytes())
}

fn refuse(stream: &mut TcpStream, refusal: HttpRefusal) -> io::Result<()> {
    let (status, text) = refusal.status();
    let allow = if refusal == HttpRefusal::RequestMethod { "Allow: GET, POST\r\n" } else { "" };
    let length = text.len() + 1;
    let more =
        format!("{allow}Content-Type: text/plain; charset=utf-8\r\nContent-Length: {length}\r\n");
    send_head(stream, status, &more)?;
    stream.write_all(format!("{text}\n").as_bytes())
}

/// Says that nothing more comes, and takes what is still sent, for a moment: a connection that is closed
/// before is reset, and what was answered may be lost.
fn close(stream: &mut TcpStream, buffer: &mut [u8; LONGEST]) -> io::Result<()> {
    stream.shutdown(Shutdown::Write)?;
    stream.set_read_timeout(Some(Duration::from_millis(200)))?;
    for _ in 0..64 {
        if stream.read(buffer)? == 0 {
            break;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::io::{BufRead, BufReader};

    use super::*;

    fn server() -> Server {
        let site = Site {
            page: "<p>page</p>".to_owned(),
            nonce: "n0".to_owned(),
            token: "secret".to_owned(),
            orders: vec!["mark"],
        };
        Server::start("127.0.0.1:0".parse().unwrap(), site).unwrap()
    }

    fn listen(server: &Server) -> TcpStream {
        let mut stream = TcpStream::connect(server.address()).unwrap();
        stream.write_all(b"GET /events?token=secret HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
        stream
    }

    fn wait_for_listeners(server: &Server, wanted: usize) {
        let deadline = Instant::now() + Duration::from_secs(60);
        while server.shared.state().listeners != wanted {
            assert!(Instant::now() < deadline, "never {wanted} listeners");
            thread::sleep(Duration::from_millis(5));
        }
    }

    /// Each would keep a place for [`PATIENCE`].
    #[test]
    fn who_says_nothing_locks_nobody_out() {
        let server = server();
        let silent: Vec<TcpStream> =
            (0..40).map(|_| TcpStream::connect(server.address()).unwrap()).collect();
        for _ in 0..3 {
            let mut stream = TcpStream::connect(server.address()).unwrap();
            stream.write_all(b"GET /?token=secret HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
            let mut answer = String::new();
            stream.read_to_string(&mut answer).unwrap();
            assert!(answer.starts_with("HTTP/1.1 200 OK"), "{answer}");
        }
        drop(silent);
    }

    /// A publisher that waited for one that reads nothing would wait for [`PATIENCE`] each of ten times.
    #[test]
    fn who_takes_nothing_holds_up_nobody_and_is_dropped() {
        let server = server();
        let stuck = listen(&server);
        wait_for_listeners(&server, 1);
        let mut reader = BufReader::new(listen(&server));
        wait_for_listeners(&server, 2);
        // Each is more than a system keeps for a connection.
        let filling = "x".repeat(32 << 20);
        for number in 0..10 {
            server.publish(&format!("{number} {filling}"));
        }
        server.publish("last");
        let mut line = String::new();
        while line != "data: last\n" {
            line.clear();
            assert!(reader.read_line(&mut line).unwrap() > 0, "events end");
        }
        wait_for_listeners(&server, 1);
        drop(stuck);
        // The end is told, and waited for.
        server.end();
        let mut rest = String::new();
        reader.read_to_string(&mut rest).unwrap();
        assert!(rest.ends_with("event: end\ndata:\n\n"), "{rest}");
    }

    #[test]
    fn a_listener_that_has_gone_is_forgotten() {
        let server = server();
        let gone = listen(&server);
        wait_for_listeners(&server, 1);
        drop(gone);
        wait_for_listeners(&server, 0);
        let deadline = Instant::now() + Duration::from_secs(60);
        while server.shared.state().connections > 0 {
            assert!(Instant::now() < deadline, "its seat is kept");
            thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn orders_that_nobody_takes_do_not_pile_up() {
        let server = server();
        let post = || {
            let mut stream = TcpStream::connect(server.address()).unwrap();
            let order = b"POST /mark?token=secret HTTP/1.1\r\nHost: localhost\r\n\r\n";
            stream.write_all(order).unwrap();
            let mut answer = String::new();
            stream.read_to_string(&mut answer).unwrap();
            answer.split(' ').nth(1).unwrap().to_owned()
        };
        for _ in 0..ORDERS {
            assert_eq!(post(), "204");
        }
        assert_eq!(post(), "503");
        assert_eq!(server.next_order(), Some("mark"));
        assert_eq!(post(), "204");
    }
}
