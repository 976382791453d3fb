//! Decoding messages into named values.

use serde_json::Value;

use crate::bytes::ByteReader;
use crate::format::Cell;
use crate::write::mcap::RECORD_TYPE;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum FieldKind {
    /// `geometry_msgs/Wrench` or `geometry_msgs/WrenchStamped`, in the encoding of ROS 2 (CDR) or ROS 1.
    Wrench { is_stamped: bool, is_ros1: bool },
    /// Numbers and texts after a header, as [`write::mcap`](crate::write::mcap) writes them: names, and true for a
    /// text.
    Record(Vec<(String, bool)>),
    /// JSON objects.
    Json,
    /// JSON objects in `std_msgs/String`.
    Text { is_ros1: bool },
}

pub(super) struct Message {
    /// Time of measurement in ns, if the message states it.
    pub(super) stamp_ns: Option<i64>,
    pub(super) columns: Vec<(String, Cell)>,
}

pub(super) enum Unread {
    Damaged(String),
    /// The message has an encoding that is not supported.
    Unsupported(String),
}

const AXES: [&str; 6] = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"];

const DEPTH: usize = 8;

impl FieldKind {
    /// Returns `None` if messages of this schema and encoding are not supported.
    pub(super) fn new(schema: &str, definition: &str, encoding: &str) -> Option<Self> {
        let is_ros1 = match encoding {
            "json" => return Some(Self::Json),
            "cdr" => false,
            "ros1" => true,
            _ => return None,
        };
        if schema == RECORD_TYPE && !is_ros1 {
            return record_fields(definition).map(Self::Record);
        }
        let is_stamped = match schema.replace("/msg/", "/").as_str() {
            "geometry_msgs/WrenchStamped" => true,
            "geometry_msgs/Wrench" => false,
            "std_msgs/String" => return Some(Self::Text { is_ros1 }),
            _ => return None,
        };
        Some(Self::Wrench { is_stamped, is_ros1 })
    }

    pub(super) fn decode(&self, data: &[u8]) -> Result<Message, Unread> {
        let not_a = |kind: &str| Unread::Damaged(format!("no `{kind}`"));
        match self {
            Self::Json => json(data).map_err(Unread::Damaged),
            Self::Text { is_ros1 } => {
                let text = text(data, *is_ros1).ok_or_else(|| not_a("String"))?;
                json(text).map_err(Unread::Damaged)
            }
            Self::Record(fields) => record(data, fields).ok_or_else(|| not_a(RECORD_TYPE)),
            Self::Wrench { is_stamped, is_ros1: true } => {
                ros1_wrench(data, *is_stamped).ok_or_else(|| not_a(wrench_type(*is_stamped)))
            }
            Self::Wrench { is_stamped, is_ros1: false } => {
                let kind = wrench_type(*is_stamped);
                let (header, content) = data.split_first_chunk().ok_or_else(|| not_a(kind))?;
                let layout = Layout::of_cdr(*header)?;
                wrench(content, &layout, *is_stamped).ok_or_else(|| not_a(kind))
            }
        }
    }

    pub(super) fn is_wrench(&self) -> bool {
        matches!(self, Self::Wrench { .. })
    }

    pub(super) fn is_object(&self) -> bool {
        matches!(self, Self::Json) || self.is_text()
    }

    pub(super) fn is_text(&self) -> bool {
        matches!(self, Self::Text { .. })
    }
}

/// Returns the fields after the header in a definition; `None` if a field is neither `float64` nor `string`.
fn record_fields(definition: &str) -> Option<Vec<(String, bool)>> {
    let mut lines = definition.lines().take_while(|line| !line.starts_with('='));
    if lines.next()? != "std_msgs/Header header" {
        return None;
    }
    let field = |line: &str| match line.split_once(' ')? {
        ("float64", name) => Some((name.to_owned(), false)),
        ("string", name) => Some((name.to_owned(), true)),
        _ => None,
    };
    lines.map(field).collect()
}

/// Decodes a [`FieldKind::Record`] (CDR, little-endian).
fn record(data: &[u8], fields: &[(String, bool)]) -> Option<Message> {
    let data = data.strip_prefix(&[0, 1, 0, 0])?;
    let mut bytes = ByteReader::new(data);
    let align = |bytes: &mut ByteReader<'_>, step: usize| {
        let read = data.len() - bytes.rest.len();
        bytes.take(read.next_multiple_of(step) - read).map(drop)
    };
    let text = |bytes: &mut ByteReader<'_>| {
        align(bytes, 4)?;
        let length = usize::try_from(bytes.u32()?).ok()?;
        // A text ends with a zero.
        let text = bytes.take(length)?.split_last()?.1;
        Some(String::from_utf8_lossy(text).into_owned())
    };
    let (seconds, nanoseconds) = (bytes.u32()?, bytes.u32()?);
    text(&mut bytes)?;
    let mut columns = Vec::with_capacity(fields.len());
    for (name, is_text) in fields {
        let cell = if *is_text {
            Cell::Text(text(&mut bytes)?)
        } else {
            align(&mut bytes, 8)?;
            Cell::Real(f64::from_bits(bytes.u64()?))
        };
        columns.push((name.clone(), cell));
    }
    Some(Message { stamp_ns: Some(stamp(seconds, nanoseconds, false)), columns })
}

/// Returns a stamp in ns; its seconds are signed in ROS 2.
fn stamp(seconds: u32, nanoseconds: u32, is_ros1: bool) -> i64 {
    let seconds = if is_ros1 { i64::from(seconds) } else { i64::from(seconds as i32) };
    seconds * 1_000_000_000 + i64::from(nanoseconds)
}

/// The layout of numbers in a message.
struct Layout {
    is_little: bool,
    /// Doubles are aligned to a multiple of this many bytes.
    step: usize,
}

impl Layout {
    /// Returns the layout that the first two bytes of a CDR message specify (DDS-XTypes 1.3, table 60).
    fn of_cdr([high, low, ..]: [u8; 4]) -> Result<Self, Unread> {
        let is_little = low % 2 == 1;
        let name = match (high, low) {
            (0, 0 | 1) => return Ok(Self { is_little, step: 8 }),
            (0, 6 | 7) => return Ok(Self { is_little, step: 4 }),
            (0, 2 | 3) => "parameter lists (PL_CDR)",
            (0, 8 | 9) => "delimiters (D_CDR2, XCDR version 2)",
            (0, 10 | 11) => "parameter lists (PL_CDR2, XCDR version 2)",
            _ => {
                let what = format!("its encoding has the unknown number 0x{high:02x}{low:02x}");
                return Err(Unread::Damaged(what));
            }
        };
        Err(Unread::Unsupported(format!(
            "it is encoded with {name}; only plain CDR is read, which ROS 2 writes for its final types"
        )))
    }
}

fn wrench_type(is_stamped: bool) -> &'static str {
    if is_stamped { "WrenchStamped" } else { "Wrench" }
}

/// Decodes force and torque in ROS 1, which has no alignment, with or without a header.
fn ros1_wrench(data: &[u8], is_stamped: bool) -> Option<Message> {
    // A sequence number begins the header.
    let content = if is_stamped { data.get(4..)? } else { data };
    wrench(content, &Layout { is_little: true, step: 1 }, is_stamped)
}

/// Decodes force and torque, with or without a header.
fn wrench(data: &[u8], layout: &Layout, is_stamped: bool) -> Option<Message> {
    let Layout { is_little, step } = *layout;
    let mut bytes = ByteReader::new(data);
    let word = |bytes: &mut ByteReader<'_>| {
        let word = bytes.u32()?;
        Some(if is_little { word } else { word.swap_bytes() })
    };
    let mut stamp_ns = None;
    if is_stamped {
        let (seconds, nanoseconds) = (word(&mut bytes)?, word(&mut bytes)?);
        // Only ROS 1 packs its numbers.
        stamp_ns = Some(stamp(seconds, nanoseconds, step == 1));
        let length = usize::try_from(word(&mut bytes)?).ok()?;
        bytes.take(length)?;
        let read = data.len() - bytes.rest.len();
        bytes.take(read.next_multiple_of(step) - read)?;
    }
    let number = |bytes: &mut ByteReader<'_>| {
        let bits = bytes.u64()?;
        Some(f64::from_bits(if is_little { bits } else { bits.swap_bytes() }))
    };
    let columns = AXES.iter().map(|&name| Some((name.to_owned(), Cell::Real(number(&mut bytes)?))));
    Some(Message { stamp_ns, columns: columns.collect::<Option<_>>()? })
}

/// Returns the content of a `std_msgs/String`: after the header of CDR, a length and the bytes.
fn text(data: &[u8], is_ros1: bool) -> Option<&[u8]> {
    let (order, data) = if is_ros1 { (&[0, 1][..], data) } else { data.split_at_checked(4)? };
    let mut bytes = ByteReader::new(data);
    let length = bytes.u32()?;
    let length = if order.get(1)? & 1 == 1 { length } else { length.swap_bytes() };
    let text = bytes.take(usize::try_from(length).ok()?)?;
    Some(text.strip_suffix(&[0]).unwrap_or(text))
}

fn json(data: &[u8]) -> Result<Message, String> {
    let value: Value = serde_json::from_slice(data).map_err(|error| error.to_string())?;
    let Value::Object(_) = value else { return Err("expected an object".to_owned()) };
    let mut columns = Vec::new();
    flatten(String::new(), value, DEPTH, &mut columns)?;
    Ok(Message { stamp_ns: None, columns })
}

/// Adds the values of an object or list, named like `outer.inner`; list positions count from 1.
fn flatten(
    name: String,
    value: Value,
    depth: usize,
    columns: &mut Vec<(String, Cell)>,
) -> Result<(), String> {
    let cell = match value {
        Value::Null => Cell::Missing,
        Value::Bool(truth) => Cell::Whole(i64::from(truth)),
        Value::Number(number) => match number.as_i64() {
            Some(whole) => Cell::Whole(whole),
            None => Cell::Real(number.as_f64().unwrap_or(f64::NAN)),
        },
        Value::String(text) => Cell::Text(text),
        Value::Array(_) | Value::Object(_) if depth == 0 => {
            return Err(format!("`{name}` is nested more than {DEPTH} deep"));
        }
        Value::Array(values) => {
            for (position, value) in values.into_iter().enumerate() {
                flatten(format!("{name}{}", position + 1), value, depth - 1, columns)?;
            }
            return Ok(());
        }
        Value::Object(entries) => {
            for (key, value) in entries {
                let name = if name.is_empty() { key } else { format!("{name}.{key}") };
                flatten(name, value, depth - 1, columns)?;
            }
            return Ok(());
        }
    };
    if columns.len() >= crate::budget::COLUMNS {
        return Err(format!("more than {} values", crate::budget::COLUMNS));
    }
    columns.push((name, cell));
    Ok(())
}
