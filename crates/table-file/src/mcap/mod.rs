//! Recordings in MCAP ("MCAP File Format Specification") as one table: ROS wrenches (`WrenchStamped` and
//! `Wrench`), records of this program, and JSON messages.
//!
//! Messages of several topics with the same log time form one row. The first pass finds the topics and their
//! column names; the second reads the rows.

mod message;
mod records;

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use self::message::{FieldKind, Message, Unread};
use self::records::{McapRecord, Records};
use crate::budget;
use crate::calendar::seconds_of;
use crate::format::{
    Cell, FileSource, FoundTable, RowSource, RowStream, TableColumn, WantedColumn, columns_of_cells,
};
use crate::kind::{FileKind, TableError};

const KIND: FileKind = FileKind::Mcap;

/// Maximum number of rows that wait for messages of other topics.
const WAITING: usize = 4096;

#[derive(Debug)]
struct McapRecording {
    file: FileSource,
    topics: Vec<Topic>,
    columns: usize,
    /// True if the time column is the messages' time stamp, not their log time.
    by_stamp: bool,
    /// True if the log time is an additional column at the end.
    has_log_time: bool,
    /// True if messages are stored in the order of their log time.
    is_sorted: bool,
}

/// A topic whose messages are read.
#[derive(Debug)]
struct Topic {
    /// The channel ids of the topic.
    channels: BTreeSet<u16>,
    name: String,
    kind: FieldKind,
    columns: Vec<String>,
}

pub(crate) fn open(file: &FileSource, part: Option<&str>) -> Result<FoundTable, TableError> {
    let mut records = Records::open(file)?;
    let mut schemas = HashMap::new();
    let mut topics: Vec<Topic> = Vec::new();
    let mut others = BTreeSet::new();
    let (mut stamps, mut is_sorted, mut before) = (Stamps::default(), true, 0);
    while let Some(record) = records.next()? {
        match record {
            McapRecord::Schema { id, name, definition } => {
                schemas.insert(id, (name, definition));
            }
            McapRecord::Channel { id, schema, topic, encoding } => {
                let (schema, definition) =
                    schemas.get(&schema).map_or(("", ""), |(name, text)| (name, text));
                let known = topics.iter_mut().find(|known| known.name == topic);
                match (known, FieldKind::new(schema, definition, &encoding)) {
                    // Every chunk lists its channels again.
                    (Some(known), Some(kind)) if known.kind == kind => {
                        known.channels.insert(id);
                    }
                    (_, Some(kind)) => {
                        let (channels, columns) = (BTreeSet::from([id]), Vec::new());
                        topics.push(Topic { channels, name: topic, kind, columns });
                        budget::check_columns(KIND, topics.len())?;
                    }
                    (_, None) => {
                        others.insert(topic);
                        budget::check_columns(KIND, others.len())?;
                    }
                }
            }
            McapRecord::Message { channel, log_time, data } => {
                let topic = topics.iter_mut().find(|topic| topic.channels.contains(&channel));
                let Some(topic) = topic.filter(|it| part.is_none_or(|part| it.name == part)) else {
                    continue;
                };
                is_sorted &= log_time >= before;
                before = log_time;
                if topic.kind == FieldKind::Json && !topic.columns.is_empty() {
                    continue;
                }
                let message =
                    topic.kind.decode(&data).map_err(|why| wrong(topic, log_time, why))?;
                stamps.add(message.stamp_ns);
                topic.columns = message.columns.into_iter().map(|(name, _)| name).collect();
                budget::check_columns(KIND, topic.columns.len())?;
            }
        }
    }
    let cut_at = records.cut_at;
    let found: Vec<String> = topics.iter().map(|topic| topic.name.clone()).collect();
    topics.retain(|topic| !topic.columns.is_empty() && part.is_none_or(|part| topic.name == part));
    if let (true, None, Some(byte)) = (topics.is_empty(), part, cut_at) {
        let what = format!("it is cut off at byte {byte}, before the first message of a force");
        return Err(KIND.damaged(what));
    }
    if topics.is_empty() && part.is_none() {
        let others = Vec::from_iter(others);
        return Err(KIND.unsupported(format!(
            "no messages of type geometry_msgs/msg/WrenchStamped or in JSON; its topics are {others:?}"
        )));
    }
    if topics.is_empty() {
        return Err(KIND.choice("topic", part, found));
    }
    let wrenches = topics.iter().filter(|topic| topic.kind.is_wrench());
    let wrenches: Vec<String> = wrenches.map(|topic| topic.name.clone()).collect();
    if wrenches.len() > 1 {
        return Err(KIND.choice("topic of wrenches", None, wrenches));
    }
    let mut names = vec!["t_s".to_owned()];
    names.extend(topics.iter().flat_map(|topic| topic.columns.iter().cloned()));
    let has_log_time = stamps.count > 0 && topics.iter().all(|topic| topic.kind.is_wrench());
    if has_log_time {
        names.push("log".to_owned());
    }
    budget::check_columns(KIND, names.len())?;
    let is_time = |name: &String| {
        ["t", "time", "timestamp", "t_s", "time_s", "t_us", "time_us"]
            .contains(&&*name.to_lowercase())
    };
    if names[1..].iter().any(is_time) {
        "log_time".clone_into(&mut names[0]);
    }
    let columns = names.len();
    let (file, by_stamp) = (file.clone(), stamps.are_times());
    let recording = McapRecording { file, topics, columns, by_stamp, has_log_time, is_sorted };
    let columns = names.into_iter().map(TableColumn::from).collect();
    let mut found = FoundTable::new(Some(columns), recording);
    if stamps.count > 0 && !by_stamp {
        found.notes.push(
            "the stamps of its messages do not move: times are when they were logged".to_owned(),
        );
    }
    if !is_sorted {
        found
            .notes
            .push("its messages are out of order, and sorted by when they were logged".to_owned());
    }
    found.is_cut_off = cut_at.is_some();
    Ok(found)
}

#[derive(Default)]
struct Stamps {
    count: u64,
    first: u64,
    have_moved: bool,
}

impl Stamps {
    fn add(&mut self, stamp: Option<u64>) {
        let Some(stamp) = stamp else { return };
        if self.count == 0 {
            self.first = stamp;
        }
        self.count += 1;
        self.have_moved |= stamp != self.first;
    }

    /// Returns true if the stamps come from a clock, not from an unset field.
    fn are_times(&self) -> bool {
        self.have_moved || self.count == 1 && self.first > 0
    }
}

fn wrong(topic: &Topic, log_time: u64, why: Unread) -> TableError {
    let message = format!("topic `{}`, the message at {} s", topic.name, seconds(log_time));
    match why {
        Unread::Damaged(what) => KIND.damaged(format!("{message}: {what}")),
        Unread::Unsupported(what) => KIND.unsupported(format!("{message}: {what}")),
    }
}

/// Formats nanoseconds as a decimal number of seconds.
fn seconds(ns: u64) -> String {
    format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000)
}

impl RowSource for McapRecording {
    fn columns(&self) -> usize {
        self.columns
    }

    fn rows(self: Arc<Self>, wanted: Vec<WantedColumn>) -> Result<RowStream, TableError> {
        let mut records = Records::open(&self.file)?;
        // Messages of incomplete rows, by log time and topic.
        let mut waiting: BTreeMap<u64, Vec<Option<Message>>> = BTreeMap::new();
        let is_sorted = self.is_sorted;
        let mut next = move || {
            let topics = &self.topics;
            loop {
                let Some(record) = records.next()? else {
                    // A recording may end in the middle of a row.
                    return if waiting.len() > 1 { Err(self.apart()) } else { Ok(None) };
                };
                let McapRecord::Message { channel, log_time, data } = record else { continue };
                let at = topics.iter().position(|topic| topic.channels.contains(&channel));
                let Some(at) = at else { continue };
                let topic = &topics[at];
                let message =
                    topic.kind.decode(&data).map_err(|why| wrong(topic, log_time, why))?;
                let row = waiting.entry(log_time).or_default();
                row.resize_with(topics.len(), || None);
                if row[at].replace(message).is_some() {
                    let (topic, time) = (&topic.name, seconds(log_time));
                    let what = format!("topic `{topic}` has several messages at {time} s");
                    return Err(KIND.unsupported(what));
                }
                if row.iter().all(Option::is_some)
                    && let Some(row) = waiting.remove(&log_time)
                {
                    let mut stamps = row.iter().flatten().filter_map(|message| message.stamp_ns);
                    let stamp = stamps.next_back().filter(|_| self.by_stamp);
                    let ns = i64::try_from(stamp.unwrap_or(log_time)).unwrap_or(i64::MAX);
                    let mut cells = vec![time(ns)];
                    for (topic, message) in topics.iter().zip(row.into_iter().flatten()) {
                        topic.push(message, &mut cells);
                    }
                    let logged = i64::try_from(log_time).unwrap_or(i64::MAX);
                    cells.extend(self.has_log_time.then(|| time(logged)));
                    return Ok(Some((log_time, cells)));
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
    /// Adds the values of a message to a row.
    fn push(&self, message: Message, row: &mut Vec<Cell>) {
        let mut values = message.columns;
        for (position, name) in self.columns.iter().enumerate() {
            // The order usually matches.
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

impl McapRecording {
    /// Returns the error for topics without common log times.
    fn apart(&self) -> TableError {
        let names: Vec<&str> = self.topics.iter().map(|topic| topic.name.as_str()).collect();
        KIND.unsupported(format!(
            "its topics {names:?} were logged at times of their own: choose one"
        ))
    }
}
