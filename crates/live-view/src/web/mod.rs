//! One page for browsers: events to them, as Server-Sent Events, and short orders back.
//!
//! ```text
//! publish() ─▶ newest event ─▶ a thread for each listener ─▶ GET /events
//! next_order() ◀─ queue ◀─ POST /ORDER                        GET / is the page
//! ```
//!
//! Whoever publishes never waits: a listener that is slow gets the newest event when it can take one, and one
//! that takes none is dropped. Memory is bounded by the number of connections, of orders that wait, and of bytes
//! of a request.
//!
//! Plain HTTP 1.1, one request for each connection, and nothing of it that this does not need: no bodies, no
//! files, no cookies. Every request has to carry the token of the server, and a `Host` that no other site
//! can have (`request`). It knows nothing of what is shown; docs/adr/0009-live-in-a-browser.md says why it is
//! own code, and why it is no WebSocket.

mod request;
mod server;

pub use server::{Server, Site};
