//! LabVIEW measurement files in TDMS ("TDMS File Format Internal Structure", NI): channels as columns.
//!
//! ```text
//! segment: "TDSm" · what it contains · version · length · position of values
//!          objects: path · position and type of their values · properties
//!          values, channel by channel or row by row
//! ```
//!
//! A channel's values are in any number of segments; a segment without a list of objects continues the one
//! before. Linear and polynomial scales are applied to the stored values.

use std::collections::HashMap;
use std::io::{Read, Seek, SeekFrom};
use std::sync::Arc;

use crate::arrays::{Array, ArrayNumbers, ArrayRows, ArrayValues, columns_of_log};
use crate::budget;
use crate::element::Element;
use crate::format::{
    FileSource, FoundTable, OpenFile, RowSource, RowStream, TableColumn, WantedColumn,
};
use crate::kind::{FileKind, TableError};

const KIND: FileKind = FileKind::Tdms;

/// Length of a segment's head.
const HEAD: u64 = 28;

/// Bits for what a segment contains.
const HAS_OBJECTS: u32 = 1 << 1;
const HAS_NEW_LIST: u32 = 1 << 2;
const HAS_VALUES: u32 = 1 << 3;
const IS_BY_ROW: u32 = 1 << 5;
const IS_BIG_ENDIAN: u32 = 1 << 6;

/// The position of the next segment in a segment that was not finished.
const UNFINISHED: u64 = u64::MAX;

/// Indexes of values: none, the same as before, and those of measurement cards.
const NO_VALUES: u32 = 0xffff_ffff;
const SAME_VALUES: u32 = 0;
const OF_CARD: [u32; 2] = [0x6912_0000, 0x6913_0000];

/// Maximum number of pieces of a file's channels.
const PIECES: usize = 1 << 20;

/// The values of a channel in a segment.
#[derive(Clone, Copy, Debug, Default)]
struct Index {
    kind: u32,
    /// Number of values.
    count: u64,
    /// Size of all values in bytes, for texts.
    bytes: u64,
}

/// A part of a channel's values.
#[derive(Clone, Copy, Debug)]
struct Piece {
    at: u64,
    count: u64,
    /// Distance from one value to the next in bytes.
    stride: u64,
}

#[derive(Clone, Debug, Default)]
struct Channel {
    /// `/'group'/'channel'` without slashes and quotes: `group/channel`.
    name: String,
    /// The type of the values, 0 if there are none.
    kind: u32,
    is_little: bool,
    /// True if the values cannot be read: of a card, or of several types.
    is_unread: bool,
    pieces: Vec<Piece>,
    count: u64,
    properties: HashMap<String, Property>,
}

#[derive(Clone, Debug)]
enum Property {
    Number(f64),
    Text(String),
}

#[derive(Debug)]
struct TdmsTable {
    file: FileSource,
    channels: Vec<Channel>,
    arrays: ArrayRows,
    /// Time of the first row and time from row to row, in s, if no channel is a time. The first array then
    /// holds the times.
    clock: Option<(f64, f64)>,
}

pub(crate) fn open(source: &FileSource, part: Option<&str>) -> Result<FoundTable, TableError> {
    let mut reader = Reader::new(source)?;
    while reader.segment()? {}
    // The reader notes only a missing end.
    let Reader { channels, mut notes, .. } = reader;
    let is_cut_off = !notes.is_empty();
    let channels: Vec<Channel> =
        channels.into_iter().filter(|channel| channel.name.contains('/')).collect();
    let arrays = channels.iter().map(Channel::array).collect();
    let (columns, mut arrays, more) = columns_of_log(KIND, arrays, part)?;
    notes.extend(more);
    // A single channel is a vector, which has a name.
    let mut columns = columns.unwrap_or_default();
    let is_used = |channel: &&Channel| arrays.arrays.iter().any(|array| array.name == channel.name);
    let clocks: Vec<(f64, f64)> =
        channels.iter().filter(is_used).filter_map(Channel::clock).collect();
    let clock = clocks.first().copied().filter(|first| clocks.iter().all(|it| it == first));
    let is_time = |column: &TableColumn| column.name.to_lowercase().contains("time");
    let clock = clock.filter(|_| !columns.iter().any(is_time));
    if clock.is_some() {
        let name = "t_s".to_owned();
        columns.insert(0, TableColumn { name: name.clone(), unit: None });
        let (size, values) = (vec![arrays.rows], ArrayValues::Unread);
        arrays.arrays.insert(0, Array { name, size, unit: None, is_by_row: true, values });
    }
    let table = TdmsTable { file: source.clone(), channels, arrays, clock };
    Ok(FoundTable { columns: Some(columns), rows: Arc::new(table), notes, is_cut_off })
}

/// The objects and segments of a file.
struct Reader {
    file: OpenFile,
    length: u64,
    /// Position of the next segment.
    at: u64,
    channels: Vec<Channel>,
    /// Positions of objects in `channels`, by path.
    places: HashMap<String, usize>,
    /// Objects with values in the current segment.
    active: Vec<usize>,
    /// The last index of each object.
    indexes: Vec<Index>,
    pieces: usize,
    notes: Vec<String>,
}

impl Reader {
    fn new(source: &FileSource) -> Result<Self, TableError> {
        Ok(Self {
            file: source.open()?,
            length: source.length()?,
            at: 0,
            channels: Vec::new(),
            places: HashMap::new(),
            active: Vec::new(),
            indexes: Vec::new(),
            pieces: 0,
            notes: Vec::new(),
        })
    }

    fn damaged(&self) -> TableError {
        KIND.damaged(format!("the segment at byte {}", self.at))
    }

    fn bytes(&mut self, at: u64, length: u64) -> Result<Vec<u8>, TableError> {
        if length > self.length.saturating_sub(at) {
            return Err(self.damaged());
        }
        let mut bytes =
            vec![0; budget::within(KIND, "a segment's head", length, budget::DESCRIPTION)?];
        self.file.seek(SeekFrom::Start(at))?;
        let read = self.file.read_exact(&mut bytes);
        read.map_err(|error| KIND.unread(error, format!("the segment at byte {}", self.at)))?;
        Ok(bytes)
    }

    /// Reads the next segment; `false` at the end.
    fn segment(&mut self) -> Result<bool, TableError> {
        if self.at >= self.length {
            return Ok(false);
        }
        if self.length - self.at < HEAD {
            self.notes.push("the file is cut off in the head of a segment".to_owned());
            return Ok(false);
        }
        let head = self.bytes(self.at, HEAD)?;
        if !head.starts_with(b"TDSm") {
            return Err(self.damaged());
        }
        let mut fields = Fields { rest: &head[4..], is_little: true };
        let contents = fields.u32().unwrap_or(0);
        fields.is_little = contents & IS_BIG_ENDIAN == 0;
        let (_version, next, values) = (fields.u32(), fields.u64(), fields.u64());
        let (next, values) = next.zip(values).ok_or_else(|| self.damaged())?;
        let start = self.at + HEAD;
        let mut end = start.saturating_add(next);
        if next == UNFINISHED || end > self.length {
            self.notes.push("its last segment was not finished; whole values are read".to_owned());
            end = self.length;
        }
        let values_at = start.saturating_add(values);
        if values_at > end {
            return Err(self.damaged());
        }
        if contents & HAS_OBJECTS != 0 {
            let bytes = self.bytes(start, values)?;
            let fields = Fields { rest: &bytes, is_little: fields.is_little };
            self.objects(fields, contents & HAS_NEW_LIST != 0).ok_or_else(|| self.damaged())?;
            budget::check_columns(KIND, self.channels.len())?;
        }
        if contents & HAS_VALUES != 0 {
            self.add_values(values_at, end, contents, fields.is_little)?;
        }
        self.at = end;
        Ok(true)
    }

    /// Reads a list of objects; `None` if it is damaged.
    fn objects(&mut self, mut fields: Fields<'_>, is_new: bool) -> Option<()> {
        if is_new {
            self.active.clear();
        }
        for _ in 0..fields.u32()? {
            let path = fields.text()?;
            let at = *self.places.entry(path).or_insert_with_key(|path| {
                let name = path.trim_start_matches('/').split("'/'").collect::<Vec<_>>().join("/");
                let name = name.trim_matches('\'').replace("''", "'");
                self.channels.push(Channel { name, ..Channel::default() });
                self.indexes.push(Index::default());
                self.channels.len() - 1
            });
            let channel = &mut self.channels[at];
            let mut has_values = true;
            match fields.u32()? {
                NO_VALUES => has_values = false,
                SAME_VALUES => {}
                form if OF_CARD.contains(&form) => {
                    channel.is_unread = true;
                    self.indexes[at] = card_index(&mut fields)?;
                }
                _ => {
                    let (kind, _dimension, count) = (fields.u32()?, fields.u32()?, fields.u64()?);
                    let bytes = match size(kind) {
                        // A text takes at least the four bytes of its end.
                        None if kind == TEXT => {
                            fields.u64().filter(|bytes| count.checked_mul(4) <= Some(*bytes))?
                        }
                        None => return None,
                        Some(size) => count.checked_mul(size as u64)?,
                    };
                    channel.is_unread |= channel.kind != 0 && channel.kind != kind;
                    channel.kind = kind;
                    self.indexes[at] = Index { kind, count, bytes };
                }
            }
            if !has_values {
                self.active.retain(|active| *active != at);
            } else if !self.active.contains(&at) {
                self.active.push(at);
            }
            for _ in 0..fields.u32()? {
                let name = fields.text()?;
                let property = fields.property()?;
                channel.properties.insert(name, property);
            }
        }
        Some(())
    }

    /// Adds the values between two positions to the active channels.
    fn add_values(
        &mut self,
        start: u64,
        end: u64,
        contents: u32,
        is_little: bool,
    ) -> Result<(), TableError> {
        let indexes: Vec<Index> = self.active.iter().map(|&at| self.indexes[at]).collect();
        let total = indexes.iter().fold(0, |all: u64, index| all.saturating_add(index.bytes));
        if total == 0 {
            return Ok(());
        }
        let is_by_row = contents & IS_BY_ROW != 0;
        let row: u64 = indexes.iter().map(|index| size(index.kind).unwrap_or(0) as u64).sum();
        let mut at = start;
        while at < end {
            let mut offset = at;
            for (&place, index) in self.active.iter().zip(&indexes) {
                let size = size(index.kind).unwrap_or(0) as u64;
                let (stride, step) = if is_by_row { (row, size) } else { (size, index.bytes) };
                let room = end.saturating_sub(offset);
                // The last value of a row ends before the row does.
                let whole = match size {
                    0 if room >= index.bytes => index.count,
                    0 => 0,
                    _ if room < size => 0,
                    _ => (room - size) / stride + 1,
                };
                let count = index.count.min(whole);
                let here = offset;
                offset = offset.saturating_add(step);
                if count == 0 {
                    continue;
                }
                let channel = &mut self.channels[place];
                channel.is_unread |= channel.count > 0 && channel.is_little != is_little;
                channel.is_little = is_little;
                channel.count += count;
                match channel.pieces.last_mut() {
                    // Pieces that follow each other without a gap are one.
                    Some(last)
                        if size > 0
                            && last.stride == stride
                            && last.at + last.count * stride == here =>
                    {
                        last.count += count;
                    }
                    _ => {
                        self.pieces += 1;
                        channel.pieces.push(Piece { at: here, count, stride });
                    }
                }
            }
            if self.pieces > PIECES {
                return Err(KIND.unsupported(format!("more than {PIECES} pieces of channels")));
            }
            at = at.saturating_add(total);
        }
        Ok(())
    }
}

/// Reads the index of a measurement card's channel, which is skipped. A buffer holds the bytes of all
/// channels.
fn card_index(fields: &mut Fields<'_>) -> Option<Index> {
    let (_kind, _dimension, count) = (fields.u32()?, fields.u32()?, fields.u64()?);
    for _ in 0..fields.u32()? {
        fields.take(20)?;
    }
    for _ in 0..fields.u32()? {
        fields.u32()?;
    }
    Some(Index { kind: 0, count, bytes: 0 })
}

/// Types of values.
const TEXT: u32 = 0x20;
const TIME: u32 = 0x44;

/// Returns the size of a value in bytes; `None` for texts and unknown types.
fn size(kind: u32) -> Option<usize> {
    Some(match kind {
        1 | 5 | 0x21 => 1,
        2 | 6 => 2,
        3 | 7 | 9 | 0x19 => 4,
        4 | 8 | 10 | 0x1a | 0x0008_000c => 8,
        TIME | 0x0010_000d => 16,
        _ => return None,
    })
}

/// Returns the type of numbers; `None` for others.
fn element(kind: u32) -> Option<Element> {
    Some(match kind {
        1..=4 => Element::Signed(1 << (kind - 1)),
        5..=8 => Element::Unsigned(1 << (kind - 5)),
        9 | 0x19 => Element::Single,
        10 | 0x1a => Element::Double,
        0x21 => Element::Truth,
        _ => return None,
    })
}

/// Seconds from 1904, where times begin, to 1970.
const TO_1970: i64 = 2_082_844_800;

/// Fields of a segment's head in its byte order.
struct Fields<'a> {
    rest: &'a [u8],
    is_little: bool,
}

impl<'a> Fields<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (bytes, rest) = self.rest.split_at_checked(count)?;
        self.rest = rest;
        Some(bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        let bytes = *self.take(4)?.first_chunk()?;
        Some(if self.is_little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    }

    fn u64(&mut self) -> Option<u64> {
        let bytes = *self.take(8)?.first_chunk()?;
        Some(if self.is_little { u64::from_le_bytes(bytes) } else { u64::from_be_bytes(bytes) })
    }

    fn text(&mut self) -> Option<String> {
        let length = usize::try_from(self.u32()?).ok()?;
        Some(String::from_utf8_lossy(self.take(length)?).into_owned())
    }

    fn property(&mut self) -> Option<Property> {
        let kind = self.u32()?;
        if kind == TEXT {
            return self.text().map(Property::Text);
        }
        let bytes = self.take(size(kind)?)?;
        Some(match element(kind) {
            Some(element) => {
                Property::Number(element.cell(bytes, self.is_little).number().unwrap_or(f64::NAN))
            }
            None => Property::Text(String::new()),
        })
    }
}

/// A polynomial of the stored values, lowest power first.
type Polynomial = Vec<f64>;

impl Channel {
    fn number(&self, property: &str) -> Option<f64> {
        match self.properties.get(property)? {
            Property::Number(number) => Some(*number),
            Property::Text(_) => None,
        }
    }

    fn text(&self, property: &str) -> Option<&str> {
        match self.properties.get(property)? {
            Property::Text(text) => Some(text),
            Property::Number(_) => None,
        }
    }

    /// The channel as an array whose values have not been read.
    fn array(&self) -> Array {
        let values = match self.kind {
            _ if self.is_unread => {
                ArrayValues::Other("raw values of a measurement card, which LabVIEW exports as CSV")
            }
            _ if self.count == 0 => ArrayValues::Other("no values"),
            TEXT | TIME => ArrayValues::Unread,
            kind if element(kind).is_some() && self.scales().is_some() => ArrayValues::Unread,
            kind if element(kind).is_some() => {
                ArrayValues::Other("a scale that is not a polynomial")
            }
            _ => ArrayValues::Other("no real numbers"),
        };
        let unit = self.text("unit_string").or_else(|| self.text("NI_UnitDescription"));
        let unit = unit.map(str::trim).filter(|unit| !unit.is_empty()).map(str::to_owned);
        let size = vec![usize::try_from(self.count).unwrap_or(usize::MAX)];
        Array { name: self.name.clone(), size, unit, is_by_row: true, values }
    }

    /// Returns the time of the first value and the time from value to value of a waveform, in s.
    fn clock(&self) -> Option<(f64, f64)> {
        let increment = self.number("wf_increment").filter(|step| *step > 0.0)?;
        Some((self.number("wf_start_offset").unwrap_or(0.0), increment))
    }

    /// Returns the scales of the stored values in their order; `None` if one is not a polynomial.
    fn scales(&self) -> Option<Vec<Polynomial>> {
        let count = self.number("NI_Number_Of_Scales").unwrap_or(0.0);
        if count <= 0.0 || self.text("NI_Scaling_Status") != Some("unscaled") {
            return Some(Vec::new());
        }
        (0..count.min(16.0) as usize)
            .map(|at| {
                let key = |of: &str| format!("NI_Scale[{at}]_{of}");
                let number = |of: &str| self.number(&key(of));
                match self.text(&key("Scale_Type"))? {
                    "Linear" => Some(vec![number("Linear_Y_Intercept")?, number("Linear_Slope")?]),
                    "Polynomial" => {
                        let size =
                            number("Polynomial_Coefficients_Size")?.clamp(0.0, 32.0) as usize;
                        (0..size)
                            .map(|of| number(&format!("Polynomial_Coefficients[{of}]")))
                            .collect()
                    }
                    _ => None,
                }
            })
            .collect()
    }

    /// Reads all values.
    fn values(&self, file: &mut OpenFile) -> Result<ArrayValues, TableError> {
        let cut_off = |error| KIND.unread(error, format!("`{}` is cut off", self.name));
        if self.kind == TEXT {
            return self.texts(file);
        }
        let size = size(self.kind).unwrap_or(1);
        let mut bytes = Vec::with_capacity(self.count as usize * size);
        for piece in &self.pieces {
            file.seek(SeekFrom::Start(piece.at))?;
            let mut left = piece.count;
            let mut rows = vec![0; (piece.stride as usize).saturating_mul(left.min(4096) as usize)];
            while left > 0 {
                let count = left.min(4096);
                // The last value may be the last of the file.
                let length = (count - 1) as usize * piece.stride as usize + size;
                let at = piece.at + (piece.count - left) * piece.stride;
                file.seek(SeekFrom::Start(at))?;
                file.read_exact(&mut rows[..length]).map_err(cut_off)?;
                for row in rows[..length].chunks(piece.stride as usize) {
                    bytes.extend_from_slice(&row[..size]);
                }
                left -= count;
            }
        }
        let scales = self.scales().unwrap_or_default();
        let (mut element, mut is_little) = (element(self.kind), self.is_little);
        if self.kind == TIME {
            let seconds = bytes.as_chunks::<16>().0.iter().map(|time| seconds(*time, is_little));
            bytes = seconds.flat_map(f64::to_le_bytes).collect();
            (element, is_little) = (Some(Element::Double), true);
        } else if let (false, Some(stored)) = (scales.is_empty(), element) {
            let scaled = bytes.chunks_exact(size).map(|value| {
                let value = stored.cell(value, is_little).number().unwrap_or(f64::NAN);
                scales.iter().fold(value, |value, scale| {
                    scale.iter().rev().fold(0.0, |sum, of| sum * value + of)
                })
            });
            bytes = scaled.flat_map(f64::to_le_bytes).collect();
            (element, is_little) = (Some(Element::Double), true);
        }
        let (range, element) = (0..bytes.len(), element.unwrap_or(Element::Double));
        Ok(ArrayValues::Numbers(ArrayNumbers { bytes: Arc::new(bytes), range, element, is_little }))
    }

    /// Reads texts: in each piece the positions of their ends, followed by the texts.
    fn texts(&self, file: &mut OpenFile) -> Result<ArrayValues, TableError> {
        let cut_off = |error| KIND.unread(error, format!("`{}` is cut off", self.name));
        let wrong = || KIND.damaged(format!("the texts of `{}`", self.name));
        let mut texts = Vec::new();
        for piece in &self.pieces {
            file.seek(SeekFrom::Start(piece.at))?;
            let mut ends = vec![0; piece.count as usize * 4];
            file.read_exact(&mut ends).map_err(cut_off)?;
            let mut fields = Fields { rest: &ends, is_little: self.is_little };
            let mut start = 0;
            for _ in 0..piece.count {
                let end = fields.u32().filter(|end| *end >= start).ok_or_else(wrong)?;
                let what = format_args!("a text of `{}`", self.name);
                let length = u64::from(end - start);
                let mut text = vec![0; budget::within(KIND, what, length, budget::DESCRIPTION)?];
                file.read_exact(&mut text).map_err(cut_off)?;
                texts.push(String::from_utf8_lossy(&text).into_owned());
                start = end;
            }
        }
        Ok(ArrayValues::Texts(Arc::new(texts)))
    }
}

/// Converts a time to seconds since 1970: fractions of 2⁻⁶⁴ s and seconds since 1904.
fn seconds(time: [u8; 16], is_little: bool) -> f64 {
    let time = if is_little { i128::from_le_bytes(time) } else { i128::from_be_bytes(time) };
    let since_1970 = time.saturating_sub(i128::from(TO_1970) << 64);
    since_1970 as f64 * 2_f64.powi(-64)
}

/// The times of rows at equal distances, in s.
fn times((start, step): (f64, f64), rows: usize) -> ArrayValues {
    let times = (0..rows).flat_map(|row| (start + row as f64 * step).to_le_bytes());
    let bytes = Arc::new(times.collect::<Vec<u8>>());
    let (range, element) = (0..bytes.len(), Element::Double);
    ArrayValues::Numbers(ArrayNumbers { bytes, range, element, is_little: true })
}

impl RowSource for TdmsTable {
    fn columns(&self) -> usize {
        self.arrays.columns()
    }

    fn rows(self: Arc<Self>, wanted: Vec<WantedColumn>) -> Result<RowStream, TableError> {
        let (mut file, mut arrays) = (self.file.open()?, self.arrays.clone());
        let used: Vec<usize> =
            wanted.iter().filter_map(|wanted| Some(arrays.place(wanted.at)?.0)).collect();
        let (rows, mut total) = (arrays.rows, 0_u64);
        for (at, array) in arrays.arrays.iter_mut().enumerate().filter(|(at, _)| used.contains(at))
        {
            let clock = self.clock.filter(|_| at == 0);
            let channel = self.channels.iter().find(|channel| channel.name == array.name);
            // No value takes more than sixteen bytes, scaled or not.
            let count = channel.map_or(rows as u64, |channel| channel.count);
            total = total.saturating_add(count.saturating_mul(16));
            budget::within(KIND, "its channels", total, budget::IN_MEMORY)?;
            array.values = match (clock, channel) {
                (Some(clock), _) => times(clock, rows),
                (None, Some(channel)) => channel.values(&mut file)?,
                (None, None) => continue,
            };
        }
        Arc::new(arrays).rows(wanted)
    }
}
