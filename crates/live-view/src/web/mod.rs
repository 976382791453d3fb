//! A server of a web page that sends events to browsers, as Server-Sent Events, and takes orders.
//!
//! ```text
//! publish() ─▶ newest event ─▶ a thread for each listener ─▶ GET /events
//! next_order() ◀─ queue ◀─ POST /ORDER                        GET / is the page
//! ```
//!
//! Publishing never blocks: a slow listener gets the newest event when it is ready, and one that
//! takes none is dropped. Connections, waiting orders and requests are bounded.
//!
//! Every client may read an [`OpenDocument`], even a program without the token. Every other request must carry the
//! token, and a `Host` that no other site can have (`request`). The server speaks plain HTTP 1.1 with one request per
//! connection, without bodies, files or cookies. docs/adr/0009-live-in-a-browser.md explains why it uses no library and
//! no WebSocket.

mod request;

use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};
use std::{fmt, ptr, thread};

use request::{HttpRefusal, LONGEST, end_of_head, is_host_ours, is_same, parse};
use shell_data::lock::lock;

/// Maximum authorised connections; a page needs one, and briefly a second.
const CONNECTIONS: usize = 16;

/// Maximum connections without the token so far; the next replaces the oldest. A client with the
/// token sends it at once, so others cannot lock it out.
const STRANGERS: usize = 32;

const ORDERS: usize = 64;

/// Timeout of a request's arrival, and of a write.
const PATIENCE: Duration = Duration::from_secs(5);

/// Silence after which a listener gets an empty comment, which detects closed connections.
const KEEP_ALIVE: Duration = Duration::from_secs(2);

/// Maximum wait until listeners know of the end.
const GOODBYE: Duration = Duration::from_millis(500);

const STACK: usize = 256 * 1024;

#[derive(Clone)]
pub struct OpenDocument {
    /// Path of the form `/name`.
    pub path: &'static str,
    pub content_type: &'static str,
    pub text: Arc<dyn Fn() -> String + Send + Sync>,
}

impl fmt::Debug for OpenDocument {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("OpenDocument").field("path", &self.path).finish_non_exhaustive()
    }
}

#[derive(Clone, Debug, Default)]
pub struct Site {
    pub page: String,
    /// Nonce of the page's scripts and styles; others are not run.
    pub nonce: String,
    /// `?token=…`, required in every request. If empty, only open documents are served.
    pub token: String,
    /// Names of orders: `mark` is requested by `POST /mark`.
    pub orders: Vec<&'static str>,
    pub open: Vec<OpenDocument>,
}

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
    /// Cloned for each authorised connection, to count these; `listeners` likewise counts listeners.
    connections: Arc<()>,
    listeners: Arc<()>,
}

#[derive(Debug, Default)]
struct ServerState {
    event: Arc<str>,
    number: u64,
    /// Connections without the token, oldest first; their threads own them.
    strangers: VecDeque<Weak<TcpStream>>,
    orders: VecDeque<&'static str>,
    ended: bool,
}

impl Server {
    pub fn start(at: SocketAddr, site: Site) -> io::Result<Self> {
        let listener = TcpListener::bind(at)?;
        let address = listener.local_addr()?;
        let (connections, listeners) = Default::default();
        let (state, changed) = (Mutex::default(), Condvar::new());
        let shared = Arc::new(ServerShared { site, state, changed, connections, listeners });
        let accepting = Arc::clone(&shared);
        let run = move || {
            for stream in listener.incoming() {
                match stream {
                    Ok(stream) => accepting.admit(stream),
                    // Usually a temporary lack of file descriptors.
                    Err(_) => thread::sleep(Duration::from_millis(50)),
                }
            }
        };
        thread::Builder::new().name("web".to_owned()).stack_size(STACK).spawn(run)?;
        Ok(Self { shared, address })
    }

    pub fn address(&self) -> SocketAddr {
        self.address
    }

    pub fn has_listeners(&self) -> bool {
        others(&self.shared.listeners) > 0
    }

    pub fn publish(&self, line: &str) {
        // Text of several lines becomes several data lines.
        let data: String = line.lines().map(|line| format!("data: {line}\n")).collect();
        let mut state = self.shared.state();
        (state.event, state.number) = ((data + "\n").into(), state.number + 1);
        self.shared.changed.notify_all();
    }

    pub fn next_order(&self) -> Option<&'static str> {
        self.shared.state().orders.pop_front()
    }

    /// Tells the listeners of the end, and waits briefly until they know.
    pub fn end(self) {
        self.shared.state().ended = true;
        self.shared.changed.notify_all();
        let deadline = Instant::now() + GOODBYE;
        while self.has_listeners() && Instant::now() < deadline {
            thread::sleep(Duration::from_millis(1));
        }
    }
}

impl ServerShared {
    /// Locks the state, which a panic leaves consistent: no step under the lock can fail half way.
    fn state(&self) -> MutexGuard<'_, ServerState> {
        lock(&self.state)
    }

    /// Starts a thread for a connection. Too many connections without the token close the oldest.
    fn admit(self: &Arc<Self>, stream: TcpStream) {
        if stream.set_write_timeout(Some(PATIENCE)).is_err() || stream.set_nodelay(true).is_err() {
            return;
        }
        let (shared, stream) = (Arc::clone(self), Arc::new(stream));
        let strangers = &mut self.state().strangers;
        strangers.retain(|other| other.strong_count() > 0);
        if strangers.len() >= STRANGERS
            && let Some(oldest) = strangers.pop_front().and_then(|oldest| oldest.upgrade())
        {
            let _ = oldest.shutdown(Shutdown::Both);
        }
        strangers.push_back(Arc::downgrade(&stream));
        let serve = move || {
            let _ = shared.serve(&stream);
        };
        // Without a thread the connection is closed, and the browser tries again.
        let _ = thread::Builder::new().name("browser".to_owned()).stack_size(STACK).spawn(serve);
    }

    fn serve(&self, stream: &TcpStream) -> io::Result<()> {
        let (mut buffer, mut place) = ([0; LONGEST], None);
        match self.answer(stream, &mut place, &mut buffer) {
            Ok(()) => {}
            Err(Some(refusal)) => refuse(stream, refusal)?,
            Err(None) => return Ok(()),
        }
        close(stream, &mut buffer)
    }

    /// Answers a request; `place` is set if authorised. The error is `None` without a request.
    fn answer(
        &self,
        stream: &TcpStream,
        place: &mut Option<Arc<()>>,
        buffer: &mut [u8; LONGEST],
    ) -> Result<(), Option<HttpRefusal>> {
        let request = parse(read_head(stream, buffer)?)?;
        let mut open = self.site.open.iter();
        if let Some(document) = open.find(|it| it.path == request.path && request.method == "GET") {
            *place = Some(self.take_in(stream)?);
            return self.send_document(stream, document).map_err(|_| None);
        }
        // HTTP 1.0 has no required `Host` to check.
        let host = request.host.ok_or(HttpRefusal::VERSION)?;
        if self.site.token.is_empty() {
            return Err(Some(HttpRefusal::NOT_FOUND));
        }
        if !is_host_ours(host) {
            return Err(Some(HttpRefusal::HOST));
        }
        if !is_same(request.token, &self.site.token) {
            return Err(Some(HttpRefusal::NO_TOKEN));
        }
        *place = Some(self.take_in(stream)?);
        let order = request.path.strip_prefix('/');
        let order = self.site.orders.iter().find(|&&known| Some(known) == order);
        let sent = match (request.method, request.path, order) {
            ("GET", "/", _) => self.send_page(stream),
            ("GET", "/events", _) => self.send_events(stream),
            ("POST", _, Some(order)) => {
                self.take_order(order)?;
                send_head(stream, "204 No Content", "")
            }
            ("POST", "/" | "/events", _) | ("GET", _, Some(_)) => {
                return Err(Some(HttpRefusal::METHOD));
            }
            _ => return Err(Some(HttpRefusal::NOT_FOUND)),
        };
        sent.map_err(|_| None)
    }

    fn take_in(&self, stream: &TcpStream) -> Result<Arc<()>, HttpRefusal> {
        let mut state = self.state();
        state.strangers.retain(|other| !ptr::eq(other.as_ptr(), stream));
        match others(&self.connections) < CONNECTIONS {
            true => Ok(Arc::clone(&self.connections)),
            false => Err(HttpRefusal::BUSY),
        }
    }

    fn take_order(&self, order: &'static str) -> Result<(), HttpRefusal> {
        let mut state = self.state();
        if state.orders.len() >= ORDERS {
            return Err(HttpRefusal::BUSY);
        }
        state.orders.push_back(order);
        Ok(())
    }

    fn send_document(&self, mut stream: &TcpStream, document: &OpenDocument) -> io::Result<()> {
        let text = (document.text)();
        let (kind, length) = (document.content_type, text.len());
        let more = format!("Content-Type: {kind}\r\nContent-Length: {length}\r\n");
        send_head(stream, "200 OK", &more)?;
        stream.write_all(text.as_bytes())
    }

    fn send_page(&self, mut stream: &TcpStream) -> io::Result<()> {
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

    fn send_events(&self, mut stream: &TcpStream) -> io::Result<()> {
        send_head(stream, "200 OK", "Content-Type: text/event-stream\r\n")?;
        // Delay in ms before the browser reconnects.
        stream.write_all(b"retry: 500\n\n")?;
        let mut seen = self.state().number;
        let _listener = Arc::clone(&self.listeners);
        while let Some(event) = self.next_event(&mut seen) {
            stream.write_all(event.as_bytes())?;
        }
        stream.write_all(b"event: end\ndata:\n\n")
    }

    /// Returns the newest event not yet seen, or an empty one after a while; `None` at the end.
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

fn others(places: &Arc<()>) -> usize {
    Arc::strong_count(places) - 1
}

/// Reads up to the empty line. The error is `None` without a request.
fn read_head<'a>(
    mut stream: &TcpStream,
    buffer: &'a mut [u8; LONGEST],
) -> Result<&'a [u8], Option<HttpRefusal>> {
    let deadline = Instant::now() + PATIENCE;
    let mut length = 0;
    loop {
        let left = deadline.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(Some(HttpRefusal::TOO_SLOW));
        }
        stream.set_read_timeout(Some(left)).map_err(|_| None)?;
        match stream.read(&mut buffer[length..]) {
            Ok(0) if length == 0 => return Err(None),
            Ok(0) => return Err(Some(HttpRefusal::MALFORMED)),
            Ok(count) => length += count,
            Err(error) => match error.kind() {
                io::ErrorKind::Interrupted => continue,
                io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut => {
                    return Err(Some(HttpRefusal::TOO_SLOW));
                }
                _ => return Err(None),
            },
        }
        if let Some(end) = end_of_head(&buffer[..length]) {
            return Ok(&buffer[..end]);
        }
        if length == buffer.len() {
            return Err(Some(HttpRefusal::TOO_LONG));
        }
    }
}

/// Sends a head that forbids caching, and disclosing the address with its token to other sites.
fn send_head(mut stream: &TcpStream, status: &str, more: &str) -> io::Result<()> {
    let head = format!(
        "HTTP/1.1 {status}\r\nConnection: close\r\nCache-Control: no-store\r\nReferrer-Policy: no-referrer\r\n\
         X-Content-Type-Options: nosniff\r\n{more}\r\n"
    );
    stream.write_all(head.as_bytes())
}

fn refuse(mut stream: &TcpStream, refusal: HttpRefusal) -> io::Result<()> {
    let HttpRefusal(status, text) = refusal;
    let allow = if refusal == HttpRefusal::METHOD { "Allow: GET, POST\r\n" } else { "" };
    let length = text.len() + 1;
    let more =
        format!("{allow}Content-Type: text/plain; charset=utf-8\r\nContent-Length: {length}\r\n");
    send_head(stream, status, &more)?;
    stream.write_all(format!("{text}\n").as_bytes())
}

/// Ends the response, and reads the client's remaining data for a moment: an early close would
/// reset the connection and lose the response.
fn close(mut stream: &TcpStream, buffer: &mut [u8; LONGEST]) -> io::Result<()> {
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
            open: vec![OpenDocument {
                path: "/page.xml",
                content_type: "text/xml",
                text: Arc::new(|| "<open/>".to_owned()),
            }],
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
        while others(&server.shared.listeners) != wanted {
            assert!(Instant::now() < deadline, "never {wanted} listeners");
            thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn a_silent_client_does_not_block_others() {
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

    #[test]
    fn only_the_open_document_allows_requests_without_token() {
        let server = server();
        let ask = |request: &str| {
            let mut stream = TcpStream::connect(server.address()).unwrap();
            stream.write_all(request.as_bytes()).unwrap();
            let mut answer = String::new();
            stream.read_to_string(&mut answer).unwrap();
            answer
        };
        for request in [
            "GET /page.xml HTTP/1.0\r\n\r\n",
            "GET /page.xml?index=0 HTTP/1.1\r\nHost: box.lab\r\n\r\n",
        ] {
            let answer = ask(request);
            assert!(
                answer.starts_with("HTTP/1.1 200 OK") && answer.ends_with("<open/>"),
                "{answer}"
            );
        }
        for (request, status) in [
            ("GET / HTTP/1.0\r\n\r\n", " 505 "),
            ("GET /?token=secret HTTP/1.0\r\n\r\n", " 505 "),
            ("GET /?token=no HTTP/1.1\r\nHost: localhost\r\n\r\n", " 403 "),
        ] {
            assert!(ask(request).contains(status), "{request}");
        }
    }

    #[test]
    fn a_client_that_does_not_read_is_dropped_and_delays_no_other() {
        let server = server();
        let stuck = listen(&server);
        wait_for_listeners(&server, 1);
        let mut reader = BufReader::new(listen(&server));
        wait_for_listeners(&server, 2);
        // Each event exceeds the system's buffer of a connection.
        let filling = "x".repeat(32 << 20);
        thread::scope(|scope| {
            // Reads all the time, so as not to be dropped if publishing takes long.
            scope.spawn(|| {
                let mut line = String::new();
                while line != "data: last\n" {
                    line.clear();
                    assert!(reader.read_line(&mut line).unwrap() > 0, "events end");
                }
            });
            for number in 0..10 {
                server.publish(&format!("{number} {filling}"));
            }
            server.publish("last");
        });
        wait_for_listeners(&server, 1);
        drop(stuck);
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
        while others(&server.shared.connections) > 0 {
            assert!(Instant::now() < deadline, "its seat is kept");
            thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn orders_that_are_not_taken_are_dropped() {
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
