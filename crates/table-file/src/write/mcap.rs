//! Recordings in MCAP, for ROS 2: wrenches, and values beside them as JSON.
//!
//! Chunks are made of rows on any thread ([`ChunkBuilder`]) and written in order ([`McapWriter`]), with an
//! index of their messages and a summary of all at the end.

use std::io::{self, Write};

use lz4_flex::frame::FrameEncoder;

/// What a channel carries.
#[derive(Clone, Debug)]
pub struct Channel {
    /// Its topic.
    pub topic: String,
    /// The schema of its messages: its name, its language, and what it says.
    pub schema: Option<[&'static str; 3]>,
    /// How messages are encoded.
    pub encoding: &'static str,
    /// What else is said of it, by name.
    pub metadata: Vec<(&'static str, String)>,
}

impl Channel {
    /// Wrenches as ROS 2 has them.
    pub fn wrench(topic: &str) -> Self {
        Self {
            topic: topic.to_owned(),
            schema: Some(["geometry_msgs/msg/WrenchStamped", "ros2msg", WRENCH_STAMPED]),
            encoding: "cdr",
            metadata: Vec::new(),
        }
    }

    /// Objects in JSON, described by a JSON schema. It stands in the metadata: `rosbags` opens no
    /// recording with a schema in a language that is not of ROS.
    pub fn json(topic: &str, schema: String) -> Self {
        let metadata = vec![("jsonschema", schema)];
        Self { topic: topic.to_owned(), schema: None, encoding: "json", metadata }
    }
}

const WRENCH_STAMPED: &str = "\
std_msgs/Header header
geometry_msgs/Wrench wrench
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
";

/// A wrench at a time, as ROS 2 sends it (CDR, the lowest byte first).
pub fn wrench_stamped(time_ns: u64, frame_id: &str, wrench: [f64; 6]) -> Vec<u8> {
    let (seconds, nanoseconds) = (time_ns / 1_000_000_000, time_ns % 1_000_000_000);
    let mut bytes = vec![0, 1, 0, 0];
    bytes.extend((seconds as u32).to_le_bytes());
    bytes.extend((nanoseconds as u32).to_le_bytes());
    bytes.extend((frame_id.len() as u32 + 1).to_le_bytes());
    bytes.extend(frame_id.as_bytes());
    bytes.push(0);
    // Doubles stand at multiples of eight bytes after the first four.
    bytes.resize(4 + (bytes.len() - 4).next_multiple_of(8), 0);
    wrench.iter().for_each(|value| bytes.extend(value.to_le_bytes()));
    bytes
}

/// Messages that are written together.
#[derive(Debug, Default)]
pub struct ChunkBuilder {
    records: Vec<u8>,
    /// For each channel, when and where its messages are.
    index: Vec<Vec<(u64, u64)>>,
}

/// A chunk that is ready to be written.
#[derive(Debug)]
pub struct Chunk {
    record: Vec<u8>,
    index: Vec<Vec<(u64, u64)>>,
    times: (u64, u64),
    packed: u64,
    unpacked: u64,
}

const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const MESSAGE_INDEX: u8 = 0x07;
const CHUNK_INDEX: u8 = 0x08;
const STATISTICS: u8 = 0x0b;
const SUMMARY_OFFSET: u8 = 0x0e;
const DATA_END: u8 = 0x0f;
const HEADER: u8 = 0x01;
const FOOTER: u8 = 0x02;

fn record(kind: u8, content: &[u8]) -> Vec<u8> {
    let mut bytes = vec![kind];
    bytes.extend((content.len() as u64).to_le_bytes());
    bytes.extend(content);
    bytes
}

fn text(bytes: &mut Vec<u8>, text: &str) {
    bytes.extend((text.len() as u32).to_le_bytes());
    bytes.extend(text.as_bytes());
}

impl ChunkBuilder {
    /// Adds a message to the channel of that number, from 0.
    pub fn message(&mut self, channel: u16, time_ns: u64, data: &[u8]) {
        let place = usize::from(channel);
        self.index.resize_with(self.index.len().max(place + 1), Vec::new);
        self.index[place].push((time_ns, self.records.len() as u64));
        // Channel, no sequence number, when it was logged and published.
        let mut head = [0; 31];
        head[0] = MESSAGE;
        head[1..9].copy_from_slice(&(22 + data.len() as u64).to_le_bytes());
        head[9..11].copy_from_slice(&(channel + 1).to_le_bytes());
        head[15..23].copy_from_slice(&time_ns.to_le_bytes());
        head[23..31].copy_from_slice(&time_ns.to_le_bytes());
        self.records.extend_from_slice(&head);
        self.records.extend_from_slice(data);
    }

    /// Compresses the messages; `None` if there are none.
    ///
    /// # Errors
    /// What the encoder says.
    pub fn finish(self) -> io::Result<Option<Chunk>> {
        let times = || self.index.iter().flatten().map(|(time, _)| *time);
        let Some(times) = times().min().zip(times().max()) else { return Ok(None) };
        let mut encoder = FrameEncoder::new(Vec::new());
        encoder.write_all(&self.records)?;
        let packed = encoder.finish().map_err(io::Error::other)?;
        let mut content = Vec::with_capacity(packed.len() + 64);
        content.extend(times.0.to_le_bytes());
        content.extend(times.1.to_le_bytes());
        content.extend((self.records.len() as u64).to_le_bytes());
        content.extend(crc32fast::hash(&self.records).to_le_bytes());
        text(&mut content, "lz4");
        content.extend((packed.len() as u64).to_le_bytes());
        content.extend(&packed);
        Ok(Some(Chunk {
            record: record(CHUNK, &content),
            index: self.index,
            times,
            packed: packed.len() as u64,
            unpacked: self.records.len() as u64,
        }))
    }
}

/// Writes a recording.
pub struct McapWriter<W> {
    out: W,
    at: u64,
    channels: Vec<Channel>,
    counts: Vec<u64>,
    times: Option<(u64, u64)>,
    chunks: Vec<Vec<u8>>,
}

impl<W: Write> McapWriter<W> {
    /// A recording of these channels.
    ///
    /// # Errors
    /// What the system says.
    pub fn new(out: W, library: &str, channels: Vec<Channel>) -> io::Result<Self> {
        let counts = vec![0; channels.len()];
        let mut writer = Self { out, at: 0, channels, counts, times: None, chunks: Vec::new() };
        writer.bytes(b"\x89MCAP0\r\n")?;
        let mut header = Vec::new();
        text(&mut header, "ros2");
        text(&mut header, library);
        writer.bytes(&record(HEADER, &header))?;
        let (schemas, channels) = (writer.schemas(), writer.channels());
        writer.bytes(&schemas)?;
        writer.bytes(&channels)?;
        Ok(writer)
    }

    fn bytes(&mut self, bytes: &[u8]) -> io::Result<()> {
        self.at += bytes.len() as u64;
        self.out.write_all(bytes)
    }

    fn schemas(&self) -> Vec<u8> {
        let schema = |(place, channel): (usize, &Channel)| {
            let schema = channel.schema?;
            let mut content = (place as u16 + 1).to_le_bytes().to_vec();
            schema.iter().for_each(|part| text(&mut content, part));
            Some(record(SCHEMA, &content))
        };
        self.channels.iter().enumerate().filter_map(schema).flatten().collect()
    }

    fn channels(&self) -> Vec<u8> {
        let channel = |(place, channel): (usize, &Channel)| {
            let number = place as u16 + 1;
            // No schema is that of number 0.
            let schema = if channel.schema.is_some() { number } else { 0 };
            let mut content = [number.to_le_bytes(), schema.to_le_bytes()].concat();
            text(&mut content, &channel.topic);
            text(&mut content, channel.encoding);
            let mut metadata = Vec::new();
            for (name, value) in &channel.metadata {
                text(&mut metadata, name);
                text(&mut metadata, value);
            }
            content.extend((metadata.len() as u32).to_le_bytes());
            content.extend(metadata);
            record(CHANNEL, &content)
        };
        self.channels.iter().enumerate().flat_map(channel).collect()
    }

    /// Writes a chunk and the index of its messages.
    ///
    /// # Errors
    /// What the system says.
    pub fn write(&mut self, chunk: &Chunk) -> io::Result<()> {
        let start = self.at;
        self.bytes(&chunk.record)?;
        let index_start = self.at;
        let mut offsets = Vec::new();
        for (place, messages) in chunk.index.iter().enumerate().filter(|(_, it)| !it.is_empty()) {
            let number = place as u16 + 1;
            offsets.extend(number.to_le_bytes());
            offsets.extend(self.at.to_le_bytes());
            let mut content = number.to_le_bytes().to_vec();
            content.extend((16 * messages.len() as u32).to_le_bytes());
            for (time, offset) in messages {
                content.extend(time.to_le_bytes());
                content.extend(offset.to_le_bytes());
            }
            self.bytes(&record(MESSAGE_INDEX, &content))?;
            self.counts[place] += messages.len() as u64;
        }
        let mut content = Vec::new();
        for number in [chunk.times.0, chunk.times.1, start, chunk.record.len() as u64] {
            content.extend(number.to_le_bytes());
        }
        content.extend((offsets.len() as u32).to_le_bytes());
        content.extend(offsets);
        content.extend((self.at - index_start).to_le_bytes());
        text(&mut content, "lz4");
        content.extend(chunk.packed.to_le_bytes());
        content.extend(chunk.unpacked.to_le_bytes());
        self.chunks.push(record(CHUNK_INDEX, &content));
        let (first, last) = self.times.unwrap_or(chunk.times);
        self.times = Some((first.min(chunk.times.0), last.max(chunk.times.1)));
        Ok(())
    }

    /// Writes the summary and the end.
    ///
    /// # Errors
    /// What the system says.
    pub fn finish(&mut self) -> io::Result<()> {
        // Without a checksum of the data: each chunk has its own.
        self.bytes(&record(DATA_END, &[0; 4]))?;
        let start = self.at;
        let groups = [
            (SCHEMA, self.schemas()),
            (CHANNEL, self.channels()),
            (STATISTICS, self.statistics()),
            (CHUNK_INDEX, self.chunks.concat()),
        ];
        let (mut summary, mut offsets) = (Vec::new(), Vec::new());
        for (kind, records) in groups.iter().filter(|(_, records)| !records.is_empty()) {
            let mut content = vec![*kind];
            content.extend((start + summary.len() as u64).to_le_bytes());
            content.extend((records.len() as u64).to_le_bytes());
            offsets.extend(record(SUMMARY_OFFSET, &content));
            summary.extend(records);
        }
        let offsets_start = start + summary.len() as u64;
        summary.extend(offsets);
        // The checksum covers the summary and the footer before it.
        summary.push(FOOTER);
        summary.extend(20_u64.to_le_bytes());
        summary.extend(start.to_le_bytes());
        summary.extend(offsets_start.to_le_bytes());
        let checksum = crc32fast::hash(&summary);
        summary.extend(checksum.to_le_bytes());
        summary.extend(b"\x89MCAP0\r\n");
        self.bytes(&summary)?;
        self.out.flush()
    }

    fn statistics(&self) -> Vec<u8> {
        let (first, last) = self.times.unwrap_or_default();
        let mut content = self.counts.iter().sum::<u64>().to_le_bytes().to_vec();
        let schemas = self.channels.iter().filter(|channel| channel.schema.is_some()).count();
        content.extend((schemas as u16).to_le_bytes());
        content.extend((self.channels.len() as u32).to_le_bytes());
        // No attachments, no metadata.
        content.extend([0; 8]);
        content.extend((self.chunks.len() as u32).to_le_bytes());
        content.extend(first.to_le_bytes());
        content.extend(last.to_le_bytes());
        content.extend((10 * self.counts.len() as u32).to_le_bytes());
        for (place, count) in self.counts.iter().enumerate() {
            content.extend((place as u16 + 1).to_le_bytes());
            content.extend(count.to_le_bytes());
        }
        record(STATISTICS, &content)
    }
}
