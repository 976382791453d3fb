//! Recordings of Lab Streaming Layer: streams of samples with time stamps ("XDF Specification 1.0").
//!
//! ```text
//! "XDF:" · chunks: length (1, 4 or 8 bytes) · tag u16 · content
//! ```
//!
//! Time stamps are used as recorded, without a fitted line, which would hide a pause. Stamps of another computer are
//! converted to the recorder's clock by a least-squares line through the recorded clock offsets. A sample without a
//! stamp, as the format allows, is one nominal period after the previous one.
//!
//! A table holds one stream: the named one, the one with readings (`s1`, `s2`, …), or the only one with numbers.
//! Forces and moments of other streams are added to readings by linear interpolation between the two samples around
//! each time. Rows before, after and in pauses of these streams are left out.

use std::io::Read;
use std::sync::Arc;

use crate::budget;
use crate::bytes::ByteReader;
use crate::element::Element;
use crate::format::{
    Cell, FileSource, FoundTable, RowSource, RowStream, TableColumn, WantedColumn, columns_of_cells,
};
use crate::kind::{FileKind, TableError};
use crate::xml::Xml;

const KIND: FileKind = FileKind::Xdf;

const STREAMS: usize = 256;

/// Maximum distance of two samples for interpolation, in median periods.
const PAUSE_PERIODS: f64 = 5.0;

#[derive(Debug, Default)]
struct LslStream {
    id: u32,
    name: String,
    channels: Vec<TableColumn>,
    rate_hz: f64,
    /// The type of values; `None` for text.
    element: Option<Element>,
    times_s: Vec<f64>,
    values: Vec<Vec<f64>>,
    /// Clock offsets, s: the stream's time, and the offset to add to it.
    offsets: Vec<(f64, f64)>,
}

#[derive(Debug)]
struct XdfRows(Vec<Vec<f64>>);

impl RowSource for XdfRows {
    fn columns(&self) -> usize {
        self.0.len()
    }

    fn rows(self: Arc<Self>, wanted: Vec<WantedColumn>) -> Result<RowStream, TableError> {
        let mut at = 0;
        let next = move || {
            let row: Option<Vec<Cell>> =
                self.0.iter().map(|column| column.get(at).copied().map(Cell::Real)).collect();
            at += 1;
            Ok(row.filter(|row| !row.is_empty()))
        };
        Ok(columns_of_cells(Box::new(next), wanted, |_| false))
    }
}

pub(crate) fn open(source: &FileSource, part: Option<&str>) -> Result<FoundTable, TableError> {
    let length = source.length()?;
    budget::within(KIND, "the file", length, budget::IN_MEMORY)?;
    let mut bytes = Vec::new();
    source.open()?.take(length).read_to_end(&mut bytes)?;
    let mut notes = Vec::new();
    let (streams, is_cut_off) = read(&bytes)?;
    drop(bytes);
    let base = choose(&streams, part)?;
    let (columns, rows) = table(&streams, base, part.is_none(), &mut notes);
    budget::check_columns(KIND, columns.len())?;
    let (columns, rows) = (Some(columns), Arc::new(XdfRows(rows)));
    Ok(FoundTable { columns, rows, notes, is_cut_off, attributes: Vec::new() })
}

/// Reads all streams, in the recorder's time; returns true if the file is cut off.
fn read(bytes: &[u8]) -> Result<(Vec<LslStream>, bool), TableError> {
    let mut file = ByteReader::new(bytes);
    if file.take(4) != Some(b"XDF:") {
        return Err(KIND.damaged("it does not begin with `XDF:`"));
    }
    let (mut streams, mut is_cut_off): (Vec<LslStream>, _) = (Vec::new(), false);
    while !file.rest.is_empty() {
        let at = bytes.len() - file.rest.len();
        let content = length(&mut file).and_then(|length| file.take(usize::try_from(length).ok()?));
        let Some(content) = content else {
            // The recorder was killed while it wrote this chunk.
            is_cut_off = true;
            break;
        };
        let wrong = || KIND.damaged(format!("the piece at byte {at}"));
        read_chunk(&mut streams, content).ok_or_else(wrong)??;
    }
    for stream in &mut streams {
        if let Some(line) = line(&stream.offsets) {
            stream.times_s.iter_mut().for_each(|time_s| *time_s += line.0 + line.1 * *time_s);
        }
    }
    Ok((streams, is_cut_off))
}

/// Reads the number of bytes of a length (1, 4 or 8), then the length.
fn length(bytes: &mut ByteReader<'_>) -> Option<u64> {
    match bytes.u8()? {
        1 => bytes.u8().map(u64::from),
        4 => bytes.u32().map(u64::from),
        8 => bytes.u64(),
        _ => None,
    }
}

fn double(bytes: &mut ByteReader<'_>) -> Option<f64> {
    bytes.u64().map(f64::from_bits)
}

/// Reads a chunk; `None` if it is damaged.
fn read_chunk(streams: &mut Vec<LslStream>, content: &[u8]) -> Option<Result<(), TableError>> {
    let mut content = ByteReader::new(content);
    let tag = content.u16()?;
    // The file's header, boundaries and footers are skipped.
    if !(2..=4).contains(&tag) {
        return Some(Ok(()));
    }
    let id = content.u32()?;
    let is_full = streams.len() >= STREAMS;
    let known = streams.iter_mut().find(|stream| stream.id == id);
    match (tag, known) {
        (2, None) if !is_full => match header(id, content.rest) {
            Ok(stream) => streams.push(stream),
            Err(problem) => return Some(Err(problem)),
        },
        (3, Some(stream)) => return samples(stream, &mut content).map(Ok),
        (4, Some(stream)) => {
            let (at, offset) = (double(&mut content)?, double(&mut content)?);
            if at.is_finite() && offset.is_finite() {
                stream.offsets.push((at, offset));
            }
        }
        _ => return None,
    }
    Some(Ok(()))
}

fn header(id: u32, text: &[u8]) -> Result<LslStream, TableError> {
    let mut xml = Xml::new(text);
    let mut stream = LslStream { id, ..LslStream::default() };
    let (mut path, mut count, mut format) = (Vec::new(), 0, String::new());
    let damaged = |what: String| KIND.damaged(format!("the header of stream {id}: {what}"));
    while let Some(tag) = xml.next().map_err(damaged)? {
        if tag.is_start {
            path.push(tag.name.clone());
            if path.ends_with(&["channels".to_owned(), "channel".to_owned()]) {
                stream.channels.push(TableColumn::default());
            }
        }
        if !tag.is_end {
            continue;
        }
        let text = tag.text.trim().to_owned();
        let names: Vec<&str> = path.iter().map(String::as_str).collect();
        match names[..] {
            ["info", "name"] => stream.name = text,
            ["info", "channel_count"] => count = text.parse().unwrap_or(0),
            ["info", "nominal_srate"] => stream.rate_hz = text.parse().unwrap_or(0.0),
            ["info", "channel_format"] => format = text,
            ["info", "desc", .., "channel", "label"] => {
                if let Some(channel) = stream.channels.last_mut() {
                    channel.name = text;
                }
            }
            ["info", "desc", .., "channel", "unit"] => {
                if let Some(channel) = stream.channels.last_mut() {
                    channel.unit = Some(text).filter(|unit| !unit.is_empty());
                }
            }
            _ => {}
        }
        path.pop();
    }
    budget::check_columns(KIND, count)?;
    if count == 0 {
        return Err(damaged("no number of channels".to_owned()));
    }
    stream.element = match format.as_str() {
        "float32" => Some(Element::Single),
        "double64" => Some(Element::Double),
        "int8" => Some(Element::Signed(1)),
        "int16" => Some(Element::Signed(2)),
        "int32" => Some(Element::Signed(4)),
        "int64" => Some(Element::Signed(8)),
        "string" => None,
        other => return Err(damaged(format!("values of format `{other}`"))),
    };
    stream.channels.resize_with(count, TableColumn::default);
    for (at, channel) in stream.channels.iter_mut().enumerate() {
        if channel.name.is_empty() {
            channel.name = format!("channel{}", at + 1);
        }
    }
    stream.values = vec![Vec::new(); if stream.element.is_some() { count } else { 0 }];
    Ok(stream)
}

fn samples(stream: &mut LslStream, content: &mut ByteReader<'_>) -> Option<()> {
    let period_s = if stream.rate_hz > 0.0 { 1.0 / stream.rate_hz } else { 0.0 };
    for _ in 0..length(content)? {
        let time_s = match content.u8()? {
            0 => stream.times_s.last()? + period_s,
            8 => double(content)?,
            _ => return None,
        };
        let Some(element) = stream.element else {
            for _ in 0..stream.channels.len() {
                let length = length(content)?;
                content.take(usize::try_from(length).ok()?)?;
            }
            stream.times_s.push(time_s);
            continue;
        };
        let values = content.take(stream.values.len() * element.size())?;
        for (column, bytes) in stream.values.iter_mut().zip(values.chunks_exact(element.size())) {
            column.push(element.cell(bytes, true).number().unwrap_or(f64::NAN));
        }
        stream.times_s.push(time_s);
    }
    Some(())
}

/// Fits the line `a + b·t` through clock offsets by least squares; for a single offset, b is 0.
fn line(offsets: &[(f64, f64)]) -> Option<(f64, f64)> {
    let count = offsets.len() as f64;
    let mean = |of: fn(&(f64, f64)) -> f64| offsets.iter().map(of).sum::<f64>() / count;
    if offsets.is_empty() {
        return None;
    }
    let (at, offset) = (mean(|it| it.0), mean(|it| it.1));
    let spread: f64 = offsets.iter().map(|it| (it.0 - at).powi(2)).sum();
    let common: f64 = offsets.iter().map(|it| (it.0 - at) * (it.1 - offset)).sum();
    let slope = if spread > 0.0 { common / spread } else { 0.0 };
    Some((offset - slope * at, slope))
}

/// Returns a label in lower case, letters and digits only.
fn plain(label: &str) -> String {
    label.chars().filter(|c| c.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

fn is_reading(label: &str) -> bool {
    let label = plain(label);
    let digits = label.strip_prefix("sensor").or_else(|| label.strip_prefix('s'));
    digits.is_some_and(|digits| !digits.is_empty() && digits.bytes().all(|it| it.is_ascii_digit()))
}

fn is_load(label: &str) -> bool {
    let label = plain(label);
    let kinds = ["force", "torque", "moment", "f", "m", "t"];
    let rest = kinds.iter().find_map(|kind| label.strip_prefix(kind));
    rest.is_some_and(|rest| rest.starts_with(['x', 'y', 'z']))
}

impl LslStream {
    fn holds_numbers(&self) -> bool {
        self.element.is_some() && !self.times_s.is_empty()
    }

    fn has(&self, is: fn(&str) -> bool) -> bool {
        self.holds_numbers() && self.channels.iter().any(|channel| is(&channel.name))
    }
}

fn choose(streams: &[LslStream], part: Option<&str>) -> Result<usize, TableError> {
    let those = |is: &dyn Fn(&LslStream) -> bool| -> Vec<usize> {
        (0..streams.len()).filter(|at| is(&streams[*at])).collect()
    };
    let found = match part {
        Some(name) => those(&|stream| stream.name == name && stream.holds_numbers()),
        None => match those(&|stream| stream.has(is_reading)) {
            readings if readings.is_empty() => those(&LslStream::holds_numbers),
            readings => readings,
        },
    };
    match found[..] {
        [one] => Ok(one),
        _ => {
            let names = streams.iter().filter(|stream| stream.holds_numbers());
            let names = names.map(|stream| stream.name.clone()).collect();
            Err(KIND.choice("stream", part, names))
        }
    }
}

fn table(
    streams: &[LslStream],
    base: usize,
    is_joined: bool,
    notes: &mut Vec<String>,
) -> (Vec<TableColumn>, Vec<Vec<f64>>) {
    let own = &streams[base];
    let time = TableColumn { name: "time".to_owned(), unit: Some("s".to_owned()) };
    let mut columns: Vec<TableColumn> = [time].into_iter().chain(own.channels.clone()).collect();
    let mut rows: Vec<Vec<f64>> = vec![own.times_s.clone()];
    rows.extend(own.values.iter().cloned());
    let takes_loads = is_joined && own.has(is_reading) && !own.has(is_load);
    for (at, other) in streams.iter().enumerate().filter(|(at, _)| *at != base) {
        let name = &other.name;
        if !other.holds_numbers() {
            notes.push(format!("stream `{name}` is left out: it holds no numbers"));
        } else if !(takes_loads && other.has(is_load)) {
            notes.push(format!("stream `{name}` is left out: name it to read it"));
        } else {
            let joined = join(&own.times_s, other);
            for (channel, values) in other.channels.iter().zip(joined) {
                let is_taken = columns.iter().any(|column| column.name == channel.name);
                let prefix = if is_taken { format!("{name}.{at}.") } else { String::new() };
                let label = format!("{prefix}{}", channel.name);
                columns.push(TableColumn { name: label, unit: channel.unit.clone() });
                rows.push(values);
            }
            notes.push(format!("stream `{name}` is interpolated to the times of `{}`", own.name));
        }
    }
    let first = 1 + own.channels.len();
    let is_whole = |row: usize| rows[first..].iter().all(|column| !column[row].is_nan());
    let whole: Vec<bool> = (0..own.times_s.len()).map(is_whole).collect();
    let left_out = whole.iter().filter(|is| !**is).count();
    if left_out > 0 {
        notes.push(format!("{left_out} rows are left out: no sample of another stream is near"));
        for column in &mut rows {
            let mut is_kept = whole.iter();
            column.retain(|_| is_kept.next().is_none_or(|is| *is));
        }
    }
    (columns, rows)
}

/// Interpolates the channels of `other` to `times_s`; NaN for times without samples around them.
fn join(times_s: &[f64], other: &LslStream) -> Vec<Vec<f64>> {
    // Stamps may go back if a clock was set.
    let mut order: Vec<usize> = (0..other.times_s.len()).collect();
    order.sort_by(|a, b| other.times_s[*a].total_cmp(&other.times_s[*b]));
    let times: Vec<f64> = order.iter().map(|at| other.times_s[*at]).collect();
    let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps.sort_by(f64::total_cmp);
    let longest = PAUSE_PERIODS * steps.get(steps.len() / 2).copied().unwrap_or(0.0);
    let mut joined = vec![Vec::with_capacity(times_s.len()); other.values.len()];
    for &time_s in times_s {
        let after = times.partition_point(|it| *it < time_s);
        let right = times.get(after);
        let left = after.checked_sub(1).and_then(|left| Some((left, *times.get(left)?)));
        let around = match (left, right) {
            (_, Some(right)) if *right == time_s => Some((after, after, 0.0)),
            (Some((at, left)), Some(right)) if right - left <= longest => {
                Some((at, after, (time_s - left) / (right - left)))
            }
            _ => None,
        };
        for (column, values) in joined.iter_mut().zip(&other.values) {
            column.push(around.map_or(f64::NAN, |(left, right, share)| {
                let (left, right) = (values[order[left]], values[order[right]]);
                left + share * (right - left)
            }));
        }
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bytes::ByteWriter;

    fn chunk(tag: u16, content: ByteWriter) -> ByteWriter {
        let length = (content.0.len() + 2) as u32;
        ByteWriter::default().bytes(&[4]).u32(length).u16(tag).bytes(&content.0)
    }

    fn stream(id: u32, name: &str, format: &str, labels: &[&str]) -> ByteWriter {
        let channels: String = labels
            .iter()
            .map(|label| format!("<channel><label>{label}</label><unit>N</unit></channel>"))
            .collect();
        let text = format!(
            "<?xml version=\"1.0\"?><info><name>{name}</name><channel_count>{}</channel_count>\
             <nominal_srate>100</nominal_srate><channel_format>{format}</channel_format>\
             <desc><channels>{channels}</channels></desc></info>",
            labels.len()
        );
        chunk(2, ByteWriter::default().u32(id).bytes(text.as_bytes()))
    }

    fn sample(id: u32, time_s: Option<f64>, value: &[u8]) -> ByteWriter {
        let content = ByteWriter::default().u32(id).bytes(&[1, 1]);
        let content = match time_s {
            Some(time_s) => content.bytes(&[8]).u64(time_s.to_bits()),
            None => content.bytes(&[0]),
        };
        chunk(3, content.bytes(value))
    }

    fn open_bytes(pieces: &[ByteWriter], part: Option<&str>) -> Result<FoundTable, TableError> {
        let bytes =
            [b"XDF:".to_vec(), pieces.iter().flat_map(|it| it.0.clone()).collect()].concat();
        open(&FileSource::Memory(bytes.into()), part)
    }

    fn rows(found: &FoundTable) -> Vec<Vec<Cell>> {
        let wanted: Vec<_> =
            (0..found.rows.columns()).map(|at| WantedColumn { at, is_text: true }).collect();
        let mut part = crate::format::TablePart::default();
        part.clear(&wanted);
        Arc::clone(&found.rows).rows(wanted).unwrap()(100, &mut part).unwrap();
        let cells = part.columns.iter_mut().map(|column| column.cells().clone());
        cells.collect()
    }

    #[test]
    fn readings_get_the_forces_of_another_computer_at_their_times() {
        let mut pieces = vec![
            stream(1, "shell", "int16", &["s1", "s2"]),
            stream(2, "reference", "double64", &["Fx"]),
            stream(3, "marks", "string", &["what"]),
        ];
        // The other clock is 5 s behind.
        for at in [0.0_f64, 100.0] {
            let offset = ByteWriter::default().u32(2).u64(at.to_bits()).u64(5_f64.to_bits());
            pieces.push(chunk(4, offset));
        }
        for n in 0..4_u16 {
            let time_s = (n != 2).then_some(10.0 + f64::from(n) / 100.0);
            pieces.push(sample(1, time_s, &[n.to_le_bytes(), [7, 0]].concat()));
            let value = f64::from(n);
            pieces.push(sample(2, Some(5.005 + value / 100.0), &value.to_le_bytes()));
        }
        pieces.push(sample(3, Some(10.0), b"\x01\x05start"));
        let found = open_bytes(&pieces, None).unwrap();
        let names: Vec<_> = found.columns.iter().flatten().map(|it| it.name.as_str()).collect();
        assert_eq!(names, ["time", "s1", "s2", "Fx"]);
        let columns = rows(&found);
        let numbers =
            |at: usize| -> Vec<f64> { columns[at].iter().filter_map(Cell::number).collect() };
        // The first row is before the first force.
        assert_eq!(numbers(1), [1.0, 2.0, 3.0]);
        for (found, wanted) in numbers(3).iter().zip([0.5, 1.5, 2.5]) {
            assert!((found - wanted).abs() < 1e-9, "{found}");
        }
        assert!((numbers(0)[1] - 10.02).abs() < 1e-12);
        assert_eq!(found.notes.len(), 3, "{:?}", found.notes);
        let named = open_bytes(&pieces, Some("reference")).unwrap();
        assert_eq!(rows(&named).len(), 2);
    }

    #[test]
    fn a_choice_is_asked_for_and_damage_is_named() {
        let two = [
            stream(1, "a", "float32", &["x"]),
            stream(2, "b", "float32", &["x"]),
            sample(1, Some(1.0), &[0; 4]),
            sample(2, Some(1.0), &[0; 4]),
        ];
        assert!(matches!(open_bytes(&two, None), Err(TableError::Choice { .. })));
        assert!(open_bytes(&two, Some("b")).is_ok());
        let short = [stream(1, "a", "float32", &["x"]), sample(1, Some(1.0), &[0; 3])];
        assert!(matches!(open_bytes(&short, None), Err(TableError::Damaged { .. })));
        // The recorder was killed.
        let mut cut = two.to_vec();
        cut.truncate(3);
        cut.push(ByteWriter(vec![4, 200, 0, 0, 0, 3, 0]));
        let found = open_bytes(&cut, None).unwrap();
        assert!(found.is_cut_off);
        // A damaged byte is never a reason to read beyond the data.
        for at in 0..two[0].0.len() {
            let mut damaged = two.to_vec();
            damaged[0].0[at] ^= 0xff;
            _ = open_bytes(&damaged, None);
        }
    }
}
