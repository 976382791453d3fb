//! Sends wrenches and readings to Foxglove while they are recorded, over its WebSocket protocol
//! ("Foxglove WebSocket Protocol", `foxglove.sdk.v1`).
//!
//! Topics, types and field names are those of a recording that `shellcal convert` writes as MCAP, so one layout of
//! Foxglove serves both: `/wrench` carries `geometry_msgs/msg/WrenchStamped`, `/wrench/details` numbers by
//! name, as JSON. Whoever is slow misses messages, the oldest first; a publisher never waits.

#![allow(clippy::disallowed_methods, clippy::disallowed_types, reason = "serves a port")]

use std::net::SocketAddr;
use std::sync::Arc;

use foxglove::{
    ChannelBuilder, Context, FoxgloveError, PartialMetadata, RawChannel, Schema, WebSocketServer,
    WebSocketServerHandle,
};
use serde_json::{Map, Value, json};
use table_file::write::mcap::{McapChannel, wrench_stamped};

const WRENCH_TOPIC: &str = "/wrench";
const DETAILS_TOPIC: &str = "/wrench/details";

/// Why nothing can be sent.
#[derive(Debug, thiserror::Error)]
#[error("cannot serve Foxglove at {at}: {reason}")]
pub struct StartError {
    at: SocketAddr,
    #[source]
    reason: FoxgloveError,
}

/// A server that Foxglove connects to. A topic is there from its first message on.
#[derive(Debug)]
pub struct FoxgloveServer {
    handle: WebSocketServerHandle,
    address: SocketAddr,
    context: Arc<Context>,
    frame_id: String,
    wrench: Option<Arc<RawChannel>>,
    details: Option<Arc<RawChannel>>,
}

impl FoxgloveServer {
    /// Listens at an address, where a port of 0 stands for any that is free. `name` is shown to users,
    /// `frame_id` is the frame of the wrenches.
    ///
    /// # Errors
    ///
    /// If the address cannot be listened at.
    pub fn start(at: SocketAddr, name: &str, frame_id: &str) -> Result<Self, StartError> {
        // A context of its own: several servers in a process do not get each other's messages.
        let context = Context::new();
        let server = WebSocketServer::new().name(name).context(&context);
        let server = server.bind(at.ip().to_string(), at.port());
        let handle = server.start_blocking().map_err(|reason| StartError { at, reason })?;
        let address = SocketAddr::new(at.ip(), handle.port());
        let frame_id = frame_id.to_owned();
        Ok(Self { handle, address, context, frame_id, wrench: None, details: None })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Sends a row: its time in ns since 1970, N and N·m, and other numbers by name, the same names in every row.
    /// What is not a finite number is null.
    pub fn publish(&mut self, time_ns: u64, wrench: Option<[f64; 6]>, details: &[(&str, f64)]) {
        let time = PartialMetadata::with_log_time(time_ns);
        if let Some(wrench) = wrench {
            let mut message = Vec::new();
            wrench_stamped(&mut message, time_ns, &self.frame_id, wrench);
            let channel = self.wrench.get_or_insert_with(|| wrench_channel(&self.context));
            channel.log_with_meta(&message, time);
        }
        if !details.is_empty() {
            let fields = details.iter().map(|&(name, number)| (name.to_owned(), json!(number)));
            let message = Value::Object(fields.collect()).to_string();
            let channel =
                self.details.get_or_insert_with(|| details_channel(&self.context, details));
            channel.log_with_meta(message.as_bytes(), time);
        }
    }

    /// Lets everyone go.
    pub fn stop(self) {
        self.handle.stop().wait_blocking();
    }
}

fn wrench_channel(context: &Arc<Context>) -> Arc<RawChannel> {
    let McapChannel { topic, schema, encoding, .. } = McapChannel::wrench(WRENCH_TOPIC);
    let schema = schema.map(|[name, language, text]| Schema::new(name, language, text.as_bytes()));
    channel(context, &topic, encoding, schema)
}

fn details_channel(context: &Arc<Context>, details: &[(&str, f64)]) -> Arc<RawChannel> {
    let property = |&(name, _): &(&str, f64)| (name.to_owned(), json!({ "type": "number" }));
    let properties: Map<_, _> = details.iter().map(property).collect();
    let text = json!({ "type": "object", "properties": properties }).to_string();
    let schema = Schema::new("what goes with a wrench", "jsonschema", text.into_bytes());
    channel(context, DETAILS_TOPIC, "json", Some(schema))
}

fn channel(
    context: &Arc<Context>,
    topic: &str,
    encoding: &str,
    schema: Option<Schema>,
) -> Arc<RawChannel> {
    let builder = ChannelBuilder::new(topic).message_encoding(encoding).schema(schema);
    // An encoding is all that it can lack.
    builder.context(context).build_raw().expect("a channel has an encoding")
}
