//! Recorded messages (MCAP, ROS 1 bags, ROS 2 bags in SQLite) as one table: ROS wrenches (`WrenchStamped`, `Wrench`),
//! records of this program, and JSON messages.
//!
//! Messages with the same log time form one row. The first pass finds the topics and their column names; the second
//! reads the rows.

mod mcap;
mod message;
mod rosbag;
mod rosbag2;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use self::message::{FieldKind, Message, Unread};
use crate::budget;
use crate::calendar::seconds_of;
use crate::format::{
    Cell, FileSource, FoundTable, RowSource, RowStream, TableColumn, WantedColumn, columns_of_cells,
};
use crate::kind::{FileKind, TableError};

/// Maximum size of a message, bytes.
const MESSAGE: u64 = 16 << 20;

/// Maximum number of rows that wait for messages of other topics.
const WAITING: usize = 4096;

enum Record {
    /// A channel of a topic; `kind` is `None` if its messages are not supported.
    Channel {
        id: u32,
        topic: String,
        kind: Option<FieldKind>,
    },
    Message {
        channel: u32,
        log_time: u64,
        data: Vec<u8>,
    },
    /// The position at which the file is cut off. This record comes last.
    Cut {
        at: u64,
    },
}

/// The records of a file in order. Each call returns the next one; `None` at the end.
type Records = Box<dyn FnMut() -> Result<Option<Record>, TableError> + Send>;

fn records(kind: FileKind, file: &FileSource) -> Result<Records, TableError> {
    match kind {
        FileKind::Rosbag => rosbag::records(file),
        FileKind::Sqlite => rosbag2::records(file),
        _ => mcap::records(file),
    }
}

#[derive(Debug)]
struct Recording {
    kind: FileKind,
    file: FileSource,
    topics: Vec<Topic>,
    columns: usize,
    /// True if the time column is the stamp, not the log time.
    by_stamp: bool,
    /// True if the log time is an additional last column.
    has_log_time: bool,
    /// True if messages are stored in the order of their log time.
    is_sorted: bool,
}

#[derive(Debug)]
struct Topic {
    channels: BTreeSet<u32>,
    name: String,
    fields: FieldKind,
    columns: Vec<String>,
}

/// Opens the messages of the topic `part`, or of all topics that are read.
pub(crate) fn open(
    kind: FileKind,
    file: &FileSource,
    part: Option<&str>,
) -> Result<FoundTable, TableError> {
    let mut next = records(kind, file)?;
    let mut topics: Vec<Topic> = Vec::new();
    let mut others = BTreeSet::new();
    let (mut stamps, mut is_sorted, mut before) = (Stamps::default(), true, 0);
    let mut cut_at = None;
    while let Some(record) = next()? {
        match record {
            Record::Cut { at } => cut_at = Some(at),
            Record::Channel { id, topic, kind: fields } => {
                let known = topics.iter_mut().find(|known| known.name == topic);
                match (known, fields) {
                    // Every chunk lists its channels again.
                    (Some(known), Some(fields)) if known.fields == fields => {
                        known.channels.insert(id);
                    }
                    (_, Some(fields)) if !others.contains(&topic) => {
                        let (channels, columns) = (BTreeSet::from([id]), Vec::new());
                        topics.push(Topic { channels, name: topic, fields, columns });
                        budget::check_columns(kind, topics.len())?;
                    }
                    _ => {
                        others.insert(topic);
                        budget::check_columns(kind, others.len())?;
                    }
                }
            }
            Record::Message { channel, log_time, data } => {
                let at = topics.iter().position(|topic| topic.channels.contains(&channel));
                let is_wanted = |at: &usize| part.is_none_or(|part| topics[*at].name == part);
                let Some(at) = at.filter(is_wanted) else { continue };
                let topic = &mut topics[at];
                if !topic.fields.is_object() || topic.columns.is_empty() {
                    let message = match topic.fields.decode(&data) {
                        // Texts that are not JSON objects are remarks.
                        Err(_) if topic.fields.is_text() => {
                            others.insert(topics.remove(at).name);
                            continue;
                        }
                        decoded => {
                            decoded.map_err(|why| wrong(kind, &topic.name, log_time, why))?
                        }
                    };
                    stamps.add(message.stamp_ns, log_time);
                    topic.columns = message.columns.into_iter().map(|(name, _)| name).collect();
                    budget::check_columns(kind, topic.columns.len())?;
                }
                is_sorted &= log_time >= before;
                before = log_time;
            }
        }
    }
    let found: Vec<String> = topics.iter().map(|topic| topic.name.clone()).collect();
    topics.retain(|topic| !topic.columns.is_empty() && part.is_none_or(|part| topic.name == part));
    if let (true, None, Some(byte)) = (topics.is_empty(), part, cut_at) {
        let what = format!("it is cut off at byte {byte}, before the first message of a force");
        return Err(kind.damaged(what));
    }
    if topics.is_empty() && part.is_none() {
        let others = Vec::from_iter(others);
        return Err(kind.unsupported(format!(
            "no messages of type geometry_msgs/msg/WrenchStamped or in JSON; its topics are {others:?}"
        )));
    }
    if topics.is_empty() {
        return Err(kind.choice("topic", part, found));
    }
    let wrenches = topics.iter().filter(|topic| topic.fields.is_wrench());
    let wrenches: Vec<String> = wrenches.map(|topic| topic.name.clone()).collect();
    if wrenches.len() > 1 {
        return Err(kind.choice("topic of wrenches", None, wrenches));
    }
    let mut names = vec!["t_s".to_owned()];
    names.extend(topics.iter().flat_map(|topic| topic.columns.iter().cloned()));
    let has_log_time = topics.iter().any(|topic| topic.fields.is_wrench())
        && stamps.count > 0
        && !names.iter().any(|name| name == "log");
    if has_log_time {
        names.push("log".to_owned());
    }
    budget::check_columns(kind, names.len())?;
    let is_time = |name: &String| {
        ["t", "time", "timestamp", "t_s", "time_s", "t_us", "time_us"]
            .contains(&&*name.to_lowercase())
    };
    if names[1..].iter().any(is_time) {
        "log_time".clone_into(&mut names[0]);
    }
    let columns = names.len();
    let (file, fault) = (file.clone(), stamps.fault());
    let by_stamp = stamps.count > 0 && fault.is_none();
    let recording = Recording { kind, file, topics, columns, by_stamp, has_log_time, is_sorted };
    let columns = names.into_iter().map(TableColumn::from).collect();
    let mut found = FoundTable::new(Some(columns), recording);
    if let Some(fault) = fault.filter(|_| stamps.count > 0) {
        found
            .notes
            .push(format!("the stamps of its messages {fault}: times are when they were logged"));
    }
    if !is_sorted {
        found
            .notes
            .push("its messages are out of order, and sorted by when they were logged".to_owned());
    }
    found.is_cut_off = cut_at.is_some();
    Ok(found)
}

/// Statistics of the stamps of messages, which show if a clock set them.
#[derive(Default)]
struct Stamps {
    count: u64,
    /// Number of stamps that differ from the previous one.
    moves: u64,
    is_negative: bool,
    last: i64,
    /// The log time of the first message with the current stamp, in ns.
    since: u64,
    /// The longest log time during which the stamp was the same, in ns.
    longest_rest: u64,
}

/// The longest time in ns for which stamps of a clock may be equal while messages are logged.
const REST: u64 = 1_000_000_000;

impl Stamps {
    fn add(&mut self, stamp: Option<i64>, log_time: u64) {
        let Some(stamp) = stamp else { return };
        if self.count > 0 && stamp == self.last {
            self.longest_rest = self.longest_rest.max(log_time.saturating_sub(self.since));
        } else {
            self.moves += u64::from(self.count > 0);
            (self.last, self.since) = (stamp, log_time);
        }
        self.count += 1;
        self.is_negative |= stamp < 0;
    }

    /// Returns the reason if the stamps are not times.
    fn fault(&self) -> Option<&'static str> {
        match self.count {
            _ if self.is_negative => Some("are negative"),
            0 => None,
            1 => (self.last == 0).then_some("are not set"),
            _ if self.moves == 0 => Some("do not move"),
            count if 2 * self.moves < count || self.longest_rest > REST => Some("get stuck"),
            _ => None,
        }
    }
}

fn wrong(kind: FileKind, topic: &str, log_time: u64, why: Unread) -> TableError {
    let message = format!("topic `{topic}`, the message at {} s", seconds(log_time));
    match why {
        Unread::Damaged(what) => kind.damaged(format!("{message}: {what}")),
        Unread::Unsupported(what) => kind.unsupported(format!("{message}: {what}")),
    }
}

fn seconds(ns: u64) -> String {
    format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
}

impl RowSource for Recording {
    fn columns(&self) -> usize {
        self.columns
    }

    fn rows(self: Arc<Self>, wanted: Vec<WantedColumn>) -> Result<RowStream, TableError> {
        let mut records = records(self.kind, &self.file)?;
        // Messages of incomplete rows, by log time and topic.
        let mut waiting: BTreeMap<u64, Vec<Option<Message>>> = BTreeMap::new();
        let (is_sorted, kind) = (self.is_sorted, self.kind);
        let mut next = move || {
            let topics = &self.topics;
            loop {
                let Some(record) = records()? else {
                    // A recording may end in the middle of a row.
                    return if waiting.len() > 1 { Err(self.apart()) } else { Ok(None) };
                };
                let Record::Message { channel, log_time, data } = record else { continue };
                let at = topics.iter().position(|topic| topic.channels.contains(&channel));
                let Some(at) = at else { continue };
                let topic = &topics[at];
                let message = topic.fields.decode(&data);
                let message = message.map_err(|why| wrong(kind, &topic.name, log_time, why))?;
                if topics.len() == 1 {
                    return Ok(Some((log_time, self.row(log_time, vec![message]))));
                }
                let row = waiting.entry(log_time).or_default();
                row.resize_with(topics.len(), || None);
                if row[at].replace(message).is_some() {
                    let (topic, time) = (&topic.name, seconds(log_time));
                    let what = format!("topic `{topic}` has several messages at {time} s");
                    return Err(kind.unsupported(what));
                }
                if row.iter().all(Option::is_some)
                    && let Some(row) = waiting.remove(&log_time)
                {
                    let row = row.into_iter().flatten().collect();
                    return Ok(Some((log_time, self.row(log_time, row))));
                }
                if waiting.len() > WAITING {
                    return Err(self.apart());
                }
            }
        };
        if is_sorted {
            let next = move || Ok(next()?.map(|(_, cells)| cells));
            return Ok(columns_of_cells(Box::new(next), wanted, |_| false));
        }
        let mut rows = Vec::new();
        while let Some(row) = next()? {
            rows.push(row);
        }
        rows.sort_by_key(|(log_time, _)| *log_time);
        let mut rows = rows.into_iter().map(|(_, cells)| cells);
        Ok(columns_of_cells(Box::new(move || Ok(rows.next())), wanted, |_| false))
    }
}

fn time(ns: i64) -> Cell {
    Cell::Real(seconds_of(ns, 1_000_000_000))
}

impl Topic {
    fn push(&self, message: Message, row: &mut Vec<Cell>) {
        let mut values = message.columns;
        for (position, name) in self.columns.iter().enumerate() {
            // The columns usually have the same order as the message.
            let is_same = |entry: &(String, Cell)| entry.0 == *name;
            let found = match values.get(position).is_some_and(is_same) {
                true => Some(position),
                false => values.iter().position(is_same),
            };
            let cell = found.map(|found| std::mem::take(&mut values[found].1));
            row.push(cell.unwrap_or_default());
        }
    }
}

impl Recording {
    /// Returns the cells of a row: the time, the values of a message of each topic, and the log time.
    fn row(&self, log_time: u64, messages: Vec<Message>) -> Vec<Cell> {
        let logged = i64::try_from(log_time).unwrap_or(i64::MAX);
        let stamp = messages.iter().filter_map(|message| message.stamp_ns).next_back();
        let mut cells = vec![time(stamp.filter(|_| self.by_stamp).unwrap_or(logged))];
        for (topic, message) in self.topics.iter().zip(messages) {
            topic.push(message, &mut cells);
        }
        cells.extend(self.has_log_time.then(|| time(logged)));
        cells
    }

    fn apart(&self) -> TableError {
        let names: Vec<&str> = self.topics.iter().map(|topic| topic.name.as_str()).collect();
        self.kind.unsupported(format!(
            "its topics {names:?} were logged at times of their own: choose one"
        ))
    }
}
