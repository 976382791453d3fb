//! ROS 2 bags in SQLite (`rosbag2_storage_sqlite3`): the tables `topics` and `messages`.

use super::message::FieldKind;
use super::{Record, Records};
use crate::format::FileSource;
use crate::kind::{FileKind, TableError};
use crate::sqlite::{Database, Value};

const KIND: FileKind = FileKind::Sqlite;

/// The first bytes of a message that is compressed with Zstandard.
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

pub(super) fn records(file: &FileSource) -> Result<Records, TableError> {
    let mut database = Database::open(file)?;
    let tables = database.tables()?;
    let root = |name: &str| tables.iter().find(|table| table.name == name).map(|table| table.root);
    let Some((topics, messages)) = root("topics").zip(root("messages")) else {
        let names: Vec<&str> = tables.iter().map(|table| table.name.as_str()).collect();
        return Err(KIND.unsupported(format!(
            "it is no recording of ROS 2, which has `topics` and `messages`; its tables are {names:?}"
        )));
    };
    let mut channels = Vec::new();
    let mut rows = database.rows(topics);
    while let Some((id, row)) = rows.next(&mut database)? {
        let [_, Value::Text(topic), Value::Text(schema), Value::Text(encoding), ..] =
            row.as_slice()
        else {
            return Err(KIND.damaged(format!("row {id} of `topics`")));
        };
        // The definition of a type is empty, because this storage has it in another table or not at all.
        let kind = FieldKind::new(schema, "", encoding);
        channels.push(Record::Channel { id: id as u32, topic: topic.clone(), kind });
    }
    let mut channels = channels.into_iter();
    let mut rows = database.rows(messages);
    Ok(Box::new(move || {
        if let Some(channel) = channels.next() {
            return Ok(Some(channel));
        }
        let Some((id, row)) = rows.next(&mut database)? else { return Ok(None) };
        match row.as_slice() {
            [_, Value::Integer(_), Value::Integer(_), Value::Blob(data), ..]
                if data.starts_with(&ZSTD) =>
            {
                Err(KIND.unsupported(
                    "its messages are compressed with Zstandard: `ros2 bag convert` writes them \
                     without compression",
                ))
            }
            [_, Value::Integer(topic), Value::Integer(time), Value::Blob(data), ..] => {
                Ok(Some(Record::Message {
                    channel: *topic as u32,
                    log_time: u64::try_from(*time).unwrap_or(0),
                    data: data.clone(),
                }))
            }
            _ => Err(KIND.damaged(format!("row {id} of `messages`"))),
        }
    }))
}
