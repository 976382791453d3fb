//! MCAP for ROS 2: wrenches, transforms, and named values in a message type with one field each.
//!
//! Any thread can make chunks of rows ([`McapChunk`]). [`McapWriter`] writes them in order, each with an index of its
//! messages, and a summary at the end.

use std::io::{self, Write};

use crate::bytes::ByteWriter;

#[derive(Clone, Debug)]
pub struct McapChannel {
    pub topic: String,
    /// Name and definition of the message type (`ros2msg`).
    pub schema: (&'static str, String),
    pub metadata: Vec<(&'static str, String)>,
}

impl McapChannel {
    pub fn wrench(topic: &str) -> Self {
        Self {
            topic: topic.to_owned(),
            schema: ("geometry_msgs/msg/WrenchStamped", definition(&WRENCH_STAMPED)),
            metadata: Vec::new(),
        }
    }

    /// Makes a channel of transforms between fixed frames.
    pub fn static_transforms() -> Self {
        Self {
            topic: "/tf_static".to_owned(),
            schema: ("tf2_msgs/msg/TFMessage", definition(&TRANSFORMS)),
            metadata: vec![("offered_qos_profiles", LATCHED.to_owned())],
        }
    }

    /// Makes a channel of named values with a time, in a message type with one field per value, in the order of
    /// `fields` (name, and true for a text). Readers use its definition in the file, without a ROS package. It is not
    /// JSON, because `mcap-ros2-support` 0.6.0 stops at the first message that is not a ROS message.
    pub fn record(topic: &str, fields: &[(String, bool)]) -> Self {
        let names = field_names(fields.iter().map(|(name, _)| name));
        let mut own = "std_msgs/Header header\n".to_owned();
        for (name, (_, is_text)) in names.iter().zip(fields) {
            own += &format!("{} {name}\n", if *is_text { "string" } else { "float64" });
        }
        Self {
            topic: topic.to_owned(),
            schema: (RECORD_TYPE, definition(&[&own, STD_HEADER, STAMP])),
            metadata: Vec::new(),
        }
    }
}

pub(crate) const RECORD_TYPE: &str = "shellcal_msgs/msg/Record";

/// Converts names to ROS 2 field names: lower-case letters, digits and single underscores, a letter first. Names that
/// become equal get a number.
fn field_names<'a>(names: impl Iterator<Item = &'a String>) -> Vec<String> {
    let mut found: Vec<String> = vec!["header".to_owned()];
    for name in names {
        let is_kept = |letter: char| letter.is_ascii_alphanumeric();
        let words = name.split(|letter| !is_kept(letter)).filter(|word| !word.is_empty());
        let mut field = words.collect::<Vec<_>>().join("_").to_ascii_lowercase();
        if !field.starts_with(|letter: char| letter.is_ascii_lowercase()) {
            field.insert(0, 'c');
        }
        let is_new = |field: &String| !found.contains(field);
        let numbered = (2..).map(|number| format!("{field}_{number}"));
        let unique = std::iter::once(field.clone()).chain(numbered).find(is_new);
        found.extend(unique);
    }
    found.split_off(1)
}

/// Definitions of ROS 2 types that other types contain.
const STD_HEADER: &str = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n";
const STAMP: &str = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";
const VECTOR3: &str = "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n";

const WRENCH_STAMPED: [&str; 5] = [
    "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n",
    STD_HEADER,
    STAMP,
    "MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n",
    VECTOR3,
];

const TRANSFORMS: [&str; 7] = [
    "geometry_msgs/TransformStamped[] transforms\n",
    "MSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
    STD_HEADER,
    STAMP,
    "MSG: geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
    VECTOR3,
    "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
];

/// Returns a schema: the type and those that it refers to, in the form of rosbag2.
fn definition(types: &[&str]) -> String {
    types.join(&("=".repeat(80) + "\n"))
}

/// Quality of service of ROS 2's static transform broadcaster: also delivers to late subscribers (transient local).
const LATCHED: &str = "\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline:
    sec: 2147483647
    nsec: 4294967295
  lifespan:
    sec: 2147483647
    nsec: 4294967295
  liveliness: 1
  liveliness_lease_duration:
    sec: 2147483647
    nsec: 4294967295
  avoid_ros_namespace_conventions: false
";

/// Appends a wrench at a time in the encoding of ROS 2 (CDR, little-endian).
pub fn wrench_stamped(message: &mut Vec<u8>, time_ns: u64, frame_id: &str, wrench: [f64; 6]) {
    message.extend([0, 1, 0, 0]);
    let start = message.len();
    stamp(message, time_ns);
    string(message, frame_id);
    doubles(message, start, &wrench);
}

/// Appends a message of [`McapChannel::record`]: time and frame, numbers, then texts in the order of its fields (CDR,
/// little-endian).
pub fn record_stamped<'a>(
    message: &mut Vec<u8>,
    time_ns: u64,
    frame_id: &str,
    numbers: impl Iterator<Item = f64>,
    texts: impl Iterator<Item = &'a [u8]>,
) {
    message.extend([0, 1, 0, 0]);
    let start = message.len();
    stamp(message, time_ns);
    string(message, frame_id);
    align(message, start, 8);
    numbers.for_each(|number| message.extend(number.to_le_bytes()));
    for text in texts {
        align(message, start, 4);
        message.extend((text.len() as u32 + 1).to_le_bytes());
        message.extend(text);
        message.push(0);
    }
}

/// Appends the pose of `child` in `parent` in CDR: a position in metres, and a unit quaternion (x, y, z, w).
pub fn static_transform(
    message: &mut Vec<u8>,
    time_ns: u64,
    [parent, child]: [&str; 2],
    position_m: [f64; 3],
    rotation: [f64; 4],
) {
    message.extend([0, 1, 0, 0]);
    let start = message.len();
    // Number of transforms.
    message.extend(1_u32.to_le_bytes());
    stamp(message, time_ns);
    string(message, parent);
    align(message, start, 4);
    string(message, child);
    doubles(message, start, &position_m);
    doubles(message, start, &rotation);
}

fn stamp(message: &mut Vec<u8>, time_ns: u64) {
    let (seconds, nanoseconds) = (time_ns / 1_000_000_000, time_ns % 1_000_000_000);
    message.extend((seconds as u32).to_le_bytes());
    message.extend((nanoseconds as u32).to_le_bytes());
}

fn string(message: &mut Vec<u8>, text: &str) {
    message.extend((text.len() as u32 + 1).to_le_bytes());
    message.extend(text.as_bytes());
    message.push(0);
}

/// Pads with zeros to a multiple of `step` bytes after `start`.
fn align(message: &mut Vec<u8>, start: usize, step: usize) {
    message.resize(start + (message.len() - start).next_multiple_of(step), 0);
}

fn doubles(message: &mut Vec<u8>, start: usize, values: &[f64]) {
    align(message, start, 8);
    values.iter().for_each(|value| message.extend(value.to_le_bytes()));
}

/// Messages that are written together. They are not compressed, as is ROS 2's default: LZ4 would take longer than
/// making the messages.
#[derive(Debug, Default)]
pub struct McapChunk {
    records: Vec<u8>,
    index: Vec<MessageIndex>,
    /// Times of the first and the last message.
    times: Option<(u64, u64)>,
}

/// A channel's message index in a chunk, in file format: times and positions.
type MessageIndex = Vec<u8>;

const INDEX_BYTES: usize = 16;

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

const UNCOMPRESSED: &str = "";

fn record(kind: u8, content: ByteWriter) -> Vec<u8> {
    let head = ByteWriter(vec![kind]).u64(content.0.len() as u64);
    head.bytes(&content.0).0
}

fn with_times(times: Option<(u64, u64)>, others: (u64, u64)) -> (u64, u64) {
    let (first, last) = times.unwrap_or(others);
    (first.min(others.0), last.max(others.1))
}

impl McapChunk {
    pub fn with_capacity(bytes: usize) -> Self {
        Self { records: Vec::with_capacity(bytes), ..Self::default() }
    }

    /// Adds a message to a channel, counted from 0; `write` appends the content.
    pub fn message(&mut self, channel: u16, time_ns: u64, write: impl FnOnce(&mut Vec<u8>)) {
        let position = usize::from(channel);
        self.index.resize_with(self.index.len().max(position + 1), Vec::new);
        let start = self.records.len();
        self.index[position].extend_from_slice(&time_ns.to_le_bytes());
        self.index[position].extend_from_slice(&(start as u64).to_le_bytes());
        self.times = Some(with_times(self.times, (time_ns, time_ns)));
        // Length (filled in later), channel, no sequence number, log time and publish time.
        let records = ByteWriter(std::mem::take(&mut self.records)).bytes(&[MESSAGE]).u64(0);
        self.records = records.u16(channel + 1).u32(0).u64(time_ns).u64(time_ns).0;
        write(&mut self.records);
        let length = (self.records.len() - start - 9) as u64;
        self.records[start + 1..start + 9].copy_from_slice(&length.to_le_bytes());
    }

    /// Returns the time of the first message; `None` without messages.
    pub fn start_ns(&self) -> Option<u64> {
        self.times.map(|(first, _)| first)
    }
}

pub struct McapWriter<W> {
    out: W,
    at: u64,
    channels: Vec<McapChannel>,
    counts: Vec<u64>,
    times: Option<(u64, u64)>,
    chunks: Vec<Vec<u8>>,
}

impl<W: Write> McapWriter<W> {
    /// Starts a recording with these channels.
    ///
    /// # Errors
    /// [`io::Error`] of the system.
    pub fn new(out: W, library: &str, channels: Vec<McapChannel>) -> io::Result<Self> {
        let counts = vec![0; channels.len()];
        let mut writer = Self { out, at: 0, channels, counts, times: None, chunks: Vec::new() };
        writer.bytes(b"\x89MCAP0\r\n")?;
        writer.bytes(&record(HEADER, ByteWriter::default().text("ros2").text(library)))?;
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
        let schema = |(position, channel): (usize, &McapChannel)| {
            let (name, definition) = &channel.schema;
            let content = ByteWriter::default().u16(position as u16 + 1);
            record(SCHEMA, content.text(name).text("ros2msg").text(definition))
        };
        self.channels.iter().enumerate().flat_map(schema).collect()
    }

    fn channels(&self) -> Vec<u8> {
        let channel = |(position, channel): (usize, &McapChannel)| {
            let number = position as u16 + 1;
            // A schema and its channel have the same number.
            let content = ByteWriter::default().u16(number).u16(number);
            let content = content.text(&channel.topic).text("cdr");
            let metadata = channel.metadata.iter();
            let metadata = metadata
                .fold(ByteWriter::default(), |all, (name, value)| all.text(name).text(value));
            record(CHANNEL, content.block(&metadata.0))
        };
        self.channels.iter().enumerate().flat_map(channel).collect()
    }

    /// Writes a chunk and the index of its messages, if it has any.
    ///
    /// # Errors
    /// [`io::Error`] of the system.
    pub fn write(&mut self, chunk: &McapChunk) -> io::Result<()> {
        let Some((first, last)) = chunk.times else { return Ok(()) };
        let (start, bytes) = (self.at, chunk.records.len() as u64);
        let head = ByteWriter::default().u64(first).u64(last).u64(bytes);
        let head = head.u32(crc32fast::hash(&chunk.records)).text(UNCOMPRESSED).u64(bytes).0;
        self.bytes(&ByteWriter(vec![CHUNK]).u64(head.len() as u64 + bytes).bytes(&head).0)?;
        self.bytes(&chunk.records)?;
        let index_start = self.at;
        let mut offsets = ByteWriter::default();
        for (position, messages) in chunk.index.iter().enumerate().filter(|(_, it)| !it.is_empty())
        {
            let number = position as u16 + 1;
            offsets = offsets.u16(number).u64(self.at);
            let content = ByteWriter::default().u16(number).block(messages);
            self.bytes(&record(MESSAGE_INDEX, content))?;
            self.counts[position] += (messages.len() / INDEX_BYTES) as u64;
        }
        let content = ByteWriter::default().u64(first).u64(last).u64(start);
        let content = content.u64(index_start - start).block(&offsets.0);
        // Compressed and uncompressed size.
        let content = content.u64(self.at - index_start).text(UNCOMPRESSED).u64(bytes).u64(bytes);
        self.chunks.push(record(CHUNK_INDEX, content));
        self.times = Some(with_times(self.times, (first, last)));
        Ok(())
    }

    /// Writes the summary and the end of the file.
    ///
    /// # Errors
    /// [`io::Error`] of the system.
    pub fn finish(&mut self) -> io::Result<()> {
        // No checksum of the data section, because each chunk has one.
        self.bytes(&record(DATA_END, ByteWriter::default().u32(0)))?;
        let start = self.at;
        let groups = [
            (SCHEMA, self.schemas()),
            (CHANNEL, self.channels()),
            (STATISTICS, self.statistics()),
            (CHUNK_INDEX, self.chunks.concat()),
        ];
        let (mut summary, mut offsets) = (Vec::new(), Vec::new());
        for (kind, records) in groups.iter().filter(|(_, records)| !records.is_empty()) {
            let content = ByteWriter(vec![*kind]).u64(start + summary.len() as u64);
            offsets.extend(record(SUMMARY_OFFSET, content.u64(records.len() as u64)));
            summary.extend(records);
        }
        let offsets_start = start + summary.len() as u64;
        summary.extend(offsets);
        // The checksum covers the summary and the footer up to the checksum.
        let summary = ByteWriter(summary).bytes(&[FOOTER]).u64(20).u64(start).u64(offsets_start);
        let checksum = crc32fast::hash(&summary.0);
        self.bytes(&summary.u32(checksum).bytes(b"\x89MCAP0\r\n").0)?;
        self.out.flush()
    }

    fn statistics(&self) -> Vec<u8> {
        let (first, last) = self.times.unwrap_or_default();
        let schemas = self.channels.len();
        let content = ByteWriter::default().u64(self.counts.iter().sum()).u16(schemas as u16);
        // No attachments and no metadata.
        let content = content.u32(self.channels.len() as u32).u32(0).u32(0);
        let content = content.u32(self.chunks.len() as u32).u64(first).u64(last);
        let numbered = (1..).zip(&self.counts);
        let counts = numbered
            .fold(ByteWriter::default(), |all, (number, count)| all.u16(number).u64(*count));
        record(STATISTICS, content.block(&counts.0))
    }
}
