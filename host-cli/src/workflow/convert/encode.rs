//! Encoding of converted frames, on any thread, and their output in order.

use std::borrow::Cow;
use std::io::{self, Write};

use table_file::write::mcap::{
    McapChannel, McapChunk, McapWriter, record_stamped, static_transform, wrench_stamped,
};
use table_file::write::{Cells, ParquetWriter, write_matlab, write_numpy};

use super::frames::ConvertedFrames;
use super::options::{OutputFormat, RecordingFrame};
use super::table::WrenchTable;
use crate::workflow::WorkflowError;

const WRENCH_TOPIC: &str = "/wrench";
const DETAILS_TOPIC: &str = "/wrench/details";

/// Number of rows per part of a table that has parts.
const PART_ROWS: usize = 1 << 16;

pub(super) struct Encoder<'a> {
    pub(super) table: WrenchTable,
    pub(super) format: &'a OutputFormat,
}

pub(super) enum EncodedFrames {
    Text(Vec<u8>),
    Columns(Vec<Cells<'static>>),
    Chunk(McapChunk),
}

impl Encoder<'_> {
    pub(super) fn encode(&self, frames: &ConvertedFrames) -> Result<EncodedFrames, WorkflowError> {
        Ok(match self.format {
            OutputFormat::Csv => {
                let mut text = Vec::new();
                self.table.rows(frames, &mut text);
                EncodedFrames::Text(text)
            }
            OutputFormat::Mcap(frame) => EncodedFrames::Chunk(self.chunk(frames, &frame.id)?),
            _ => {
                let numbers = self.table.numbers(frames).into_iter();
                let numbers = numbers.map(|column| Cells::Full(column.into_owned().into()));
                let texts = self.table.texts(frames).into_iter();
                let texts = texts.map(|column| Cells::Text(column.into()));
                EncodedFrames::Columns(numbers.chain(texts).collect())
            }
        })
    }

    fn chunk(&self, frames: &ConvertedFrames, frame_id: &str) -> Result<McapChunk, WorkflowError> {
        let numbers = self.table.numbers(frames);
        let readings = frames.readings.iter().map(Vec::as_slice);
        let columns: Vec<&[f64]> = readings.chain(numbers[7..].iter().map(|it| &**it)).collect();
        // Two messages with their headers.
        let bytes = 200 + 2 * frame_id.len() + 8 * columns.len() + 40 * frames.texts.len();
        let mut chunk = McapChunk::with_capacity(frames.len() * bytes);
        let mut flags = Vec::new();
        for row in 0..frames.len() {
            let time_s = frames.time_s[row];
            let time_ns = nanoseconds(time_s).ok_or_else(|| {
                let message =
                    format!("the time `{time_s}` s is none since 1970 that a message can carry");
                WorkflowError::refused(message, None)
            })?;
            let wrench = frames.wrench.each_ref().map(|axis| axis[row]);
            chunk.message(0, time_ns, |message| {
                wrench_stamped(message, time_ns, frame_id, wrench);
            });
            flags.clear();
            self.table.write_flags(frames, row, &mut flags);
            let texts = frames.texts.iter().map(|values| values[row].as_bytes());
            chunk.message(1, time_ns, |message| {
                let numbers = columns.iter().map(|values| values[row]);
                let texts = texts.chain([flags.as_slice()]);
                record_stamped(message, time_ns, frame_id, numbers, texts);
            });
        }
        Ok(chunk)
    }

    /// The columns other than time and wrench, and whether each is text: readings, then numbers, then texts, flags last.
    fn details(&self) -> Vec<(String, bool)> {
        let readings = self.table.readings.iter().map(|name| (name.clone(), false));
        readings.chain(self.table.names().into_iter().skip(7)).collect()
    }
}

/// Time in whole nanoseconds, exact to its decimal digits. 0 becomes 1 ns, because ROS reads a stamp of 0
/// as "no time".
fn nanoseconds(time_s: f64) -> Option<u64> {
    // The time stamp of a message has 31 bits of seconds.
    if !(0.0..2_147_483_648.0).contains(&time_s) {
        return None;
    }
    let mut digits = zmij::Buffer::new();
    let text = digits.format(time_s);
    let exact = text.split_once('.').and_then(|(seconds, fraction)| {
        let finer = 9_u32.checked_sub(u32::try_from(fraction.len()).ok()?)?;
        let nanoseconds = fraction.parse::<u64>().ok()? * 10_u64.pow(finer);
        Some(seconds.parse::<u64>().ok()? * 1_000_000_000 + nanoseconds)
    });
    Some(exact.unwrap_or((time_s * 1e9).round() as u64).max(1))
}

pub(super) enum EncodedOutput<'a> {
    Text(&'a mut dyn Write),
    /// The writer, and the rows that are still to be written.
    Parquet(ParquetWriter<&'a mut dyn Write>, Columns),
    /// A table that begins with the number of rows: the output, all rows, and the function that writes them.
    Whole(&'a mut dyn Write, Columns, WriteWhole),
    /// The writer, and the frame of reference whose mount is still to be written.
    Recording(McapWriter<&'a mut dyn Write>, Option<RecordingFrame>),
}

type Columns = Vec<(String, Cells<'static>)>;

type WriteWhole = fn(&mut dyn Write, &[(String, Cells<'_>)]) -> io::Result<()>;

impl<'a> EncodedOutput<'a> {
    pub(super) fn new(encoder: &Encoder<'_>, out: &'a mut dyn Write) -> io::Result<Self> {
        let column = |(name, is_text)| match is_text {
            true => (name, Cells::Text(Cow::default())),
            false => (name, Cells::Full(Cow::default())),
        };
        let columns: Columns = encoder.table.names().into_iter().map(column).collect();
        Ok(match encoder.format {
            OutputFormat::Csv => {
                out.write_all(encoder.table.header().as_bytes())?;
                Self::Text(out)
            }
            OutputFormat::Mcap(frame) => {
                let mut channels = vec![
                    McapChannel::wrench(WRENCH_TOPIC),
                    McapChannel::record(DETAILS_TOPIC, &encoder.details()),
                ];
                channels.extend(frame.mount.as_ref().map(|_| McapChannel::static_transforms()));
                let writer = McapWriter::new(out, crate::PROGRAM, channels)?;
                Self::Recording(writer, Some(frame.clone()))
            }
            OutputFormat::Parquet => Self::Parquet(ParquetWriter::new(out, &columns)?, columns),
            OutputFormat::Matlab => Self::Whole(out, columns, write_matlab),
            OutputFormat::NumPy => Self::Whole(out, columns, write_numpy),
        })
    }

    pub(super) fn write(&mut self, count: usize, encoded: EncodedFrames) -> io::Result<()> {
        match (self, encoded) {
            (Self::Text(out), EncodedFrames::Text(text)) => out.write_all(&text),
            (Self::Recording(writer, frame), EncodedFrames::Chunk(chunk)) => {
                if let Some(time_ns) = chunk.start_ns()
                    && let Some(frame) = frame.take()
                {
                    writer.write(&transform(&frame, time_ns))?;
                }
                writer.write(&chunk)
            }
            // An empty block may lack columns.
            (_, EncodedFrames::Columns(_)) if count == 0 => Ok(()),
            (Self::Whole(_, rows, _), EncodedFrames::Columns(next)) => {
                rows.iter_mut().zip(next).for_each(|((_, all), next)| append(all, next));
                Ok(())
            }
            (Self::Parquet(writer, rows), EncodedFrames::Columns(next)) => {
                rows.iter_mut().zip(next).for_each(|((_, all), next)| append(all, next));
                if rows[0].1.rows() >= PART_ROWS {
                    writer.write(rows, 0..rows[0].1.rows())?;
                    rows.iter_mut().for_each(|(_, cells)| clear(cells));
                }
                Ok(())
            }
            _ => Err(io::Error::other("frames were encoded for another kind of file")),
        }
    }

    pub(super) fn finish(self) -> io::Result<()> {
        match self {
            Self::Text(_) => Ok(()),
            Self::Recording(mut writer, _) => writer.finish(),
            Self::Parquet(mut writer, rows) => {
                writer.write(&rows, 0..rows[0].1.rows())?;
                writer.finish()
            }
            Self::Whole(out, rows, write) => {
                write(out, &rows)?;
                out.flush()
            }
        }
    }
}

/// The static transform of the wrench's frame of reference from this time on; empty if its mount is unknown.
fn transform(frame: &RecordingFrame, time_ns: u64) -> McapChunk {
    let mut chunk = McapChunk::default();
    if let Some(mount) = &frame.mount {
        let frames = [mount.parent.as_str(), frame.id.as_str()];
        chunk.message(2, time_ns, |message| {
            static_transform(message, time_ns, frames, mount.position_m, mount.quaternion());
        });
    }
    chunk
}

fn append(column: &mut Cells<'static>, next: Cells<'static>) {
    match (column, next) {
        (Cells::Full(column), Cells::Full(next)) => column.to_mut().extend(next.iter()),
        (Cells::Text(column), Cells::Text(next)) => column.to_mut().extend(next.into_owned()),
        _ => unreachable!("a column keeps its kind"),
    }
}

fn clear(column: &mut Cells<'static>) {
    match column {
        Cells::Text(column) => column.to_mut().clear(),
        Cells::Full(column) => column.to_mut().clear(),
        _ => unreachable!("a frame has numbers and texts"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_nanoseconds_by_their_digits() {
        for (time_s, expected) in [
            (0.0, Some(1)),
            (1.5, Some(1_500_000_000)),
            (1_425_168_310.852_012, Some(1_425_168_310_852_012_000)),
            (1e-9, Some(1)),
            (1.0 / 3.0, Some(333_333_333)),
            (-1.0, None),
            (1e10, None),
        ] {
            assert_eq!(nanoseconds(time_s), expected, "{time_s}");
        }
    }
}
