//! What a client of Foxglove's protocol gets, written by hand from its specification ("Foxglove WebSocket Protocol",
//! docs/ws-protocol) and RFC 6455.

#![allow(clippy::disallowed_types, reason = "a viewer connects to the port")]
#![allow(clippy::unwrap_used)]

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use foxglove_view::FoxgloveServer;
use serde_json::{Value, json};

/// The least client: it takes text and messages, and subscribes.
struct Client(TcpStream);

/// What a server sends.
#[derive(Debug, PartialEq)]
enum Frame {
    Text(Value),
    Binary(Vec<u8>),
}

impl Client {
    fn connect(at: SocketAddr) -> Self {
        let mut stream = TcpStream::connect(at).unwrap();
        // Long enough for a busy machine: only a failure takes it.
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        let key = "dGhlIHNhbXBsZSBub25jZQ==";
        write!(
            stream,
            "GET / HTTP/1.1\r\nHost: {at}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n\
             Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n"
        )
        .unwrap();
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            stream.read_exact(&mut byte).unwrap();
            head.push(byte[0]);
        }
        let head = String::from_utf8(head).unwrap().to_lowercase();
        assert!(head.starts_with("http/1.1 101"), "{head}");
        // The answer to this key is RFC 6455's own example.
        assert!(head.contains("s3pplmbitxaq9kygzzhzrbk+xoo="), "{head}");
        assert!(head.contains("sec-websocket-protocol: foxglove.sdk.v1"), "{head}");
        Self(stream)
    }

    /// Sends text: one frame, masked by zeros.
    fn tell(&mut self, message: &Value) {
        let text = message.to_string();
        let length = u8::try_from(text.len()).ok().filter(|length| *length < 126).unwrap();
        let mut frame = vec![0x81, 0x80 | length, 0, 0, 0, 0];
        frame.extend(text.as_bytes());
        self.0.write_all(&frame).unwrap();
    }

    fn next(&mut self) -> Frame {
        let mut head = [0; 2];
        self.0.read_exact(&mut head).unwrap();
        let length = match head[1] {
            126 => {
                let mut length = [0; 2];
                self.0.read_exact(&mut length).unwrap();
                usize::from(u16::from_be_bytes(length))
            }
            length => usize::from(length),
        };
        let mut content = vec![0; length];
        self.0.read_exact(&mut content).unwrap();
        match head[0] {
            0x81 => Frame::Text(serde_json::from_slice(&content).unwrap()),
            0x82 => Frame::Binary(content),
            other => panic!("frame {other:#x}"),
        }
    }

    /// The next text of a kind.
    fn text(&mut self, kind: &str) -> Value {
        loop {
            match self.next() {
                Frame::Text(text) if text["op"] == kind => return text,
                _ => {}
            }
        }
    }

    /// The next message: of which subscription, its time in ns, and what it carries.
    fn message(&mut self) -> (u32, u64, Vec<u8>) {
        loop {
            if let Frame::Binary(bytes) = self.next()
                && bytes[0] == 0x01
            {
                let subscription = u32::from_le_bytes(bytes[1..5].try_into().unwrap());
                let time_ns = u64::from_le_bytes(bytes[5..13].try_into().unwrap());
                return (subscription, time_ns, bytes[13..].to_vec());
            }
        }
    }
}

fn server() -> FoxgloveServer {
    FoxgloveServer::start("127.0.0.1:0".parse().unwrap(), "test", "shell").unwrap()
}

#[test]
fn a_client_gets_wrenches_and_readings_with_their_times() {
    let mut server = server();
    let mut client = Client::connect(server.address());
    assert_eq!(client.text("serverInfo")["name"], "test");
    let time_ns = 1_700_000_000_123_456_789;
    let mut publish = move || {
        let details = [("s1", 1645.0), ("s2", f64::NAN)];
        server.publish(time_ns, Some([1.0, -2.0, 3.5, 0.1, 0.2, -0.3]), &details);
    };
    // Topics are there from the first row on.
    publish();
    // Channels may come in one advertisement or in several.
    let mut channels = Vec::new();
    while channels.len() < 2 {
        channels.extend(client.text("advertise")["channels"].as_array().unwrap().clone());
    }
    let find = |topic: &str| channels.iter().find(|channel| channel["topic"] == topic).unwrap();
    let (wrench, details) = (find("/wrench"), find("/wrench/details"));
    assert_eq!(
        (&wrench["encoding"], &wrench["schemaName"]),
        (&json!("cdr"), &json!("geometry_msgs/msg/WrenchStamped"))
    );
    assert_eq!(details["encoding"], "json");
    let subscribe = |client: &mut Client, number: u32, channel: &Value| {
        let subscriptions = json!([{ "id": number, "channelId": channel["id"] }]);
        client.tell(&json!({ "op": "subscribe", "subscriptions": subscriptions }));
    };
    subscribe(&mut client, 7, wrench);
    subscribe(&mut client, 8, details);

    // A subscription takes effect when it is read, which nothing confirms: rows are sent until both arrive.
    let (stop, stopped) = mpsc::channel::<()>();
    let publisher = thread::spawn(move || {
        while stopped.recv_timeout(Duration::from_millis(5)) == Err(RecvTimeoutError::Timeout) {
            publish();
        }
    });
    let mut met = [false; 2];
    while met != [true; 2] {
        let (subscription, time, content) = client.message();
        assert_eq!(time, time_ns);
        match subscription {
            7 => {
                // CDR: four bytes of head, stamp, the length and text of the frame, and doubles at multiples of eight.
                assert_eq!(content[4..8], 1_700_000_000_u32.to_le_bytes());
                assert_eq!(content[8..12], 123_456_789_u32.to_le_bytes());
                assert_eq!(&content[12..22], b"\x06\0\0\0shell\0");
                let doubles: Vec<f64> = content[content.len() - 48..]
                    .chunks(8)
                    .map(|bytes| f64::from_le_bytes(bytes.try_into().unwrap()))
                    .collect();
                assert_eq!(doubles, [1.0, -2.0, 3.5, 0.1, 0.2, -0.3]);
                met[0] = true;
            }
            8 => {
                let details: Value = serde_json::from_slice(&content).unwrap();
                assert_eq!(details, json!({ "s1": 1645.0, "s2": null }));
                met[1] = true;
            }
            other => panic!("nobody asked for {other}"),
        }
    }
    drop(stop);
    publisher.join().unwrap();
}

#[test]
fn without_wrenches_there_is_no_such_topic() {
    let mut server = server();
    server.publish(1, None, &[("s1", 2.0)]);
    let mut client = Client::connect(server.address());
    let channels = client.text("advertise")["channels"].as_array().unwrap().clone();
    assert_eq!(channels.len(), 1);
    assert_eq!(channels[0]["topic"], "/wrench/details");
    server.stop();
}

#[test]
fn an_address_in_use_is_named() {
    let server = server();
    let error = FoxgloveServer::start(server.address(), "second", "shell").unwrap_err();
    assert!(error.to_string().contains(&server.address().to_string()), "{error}");
    server.stop();
}
