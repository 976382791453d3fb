//! LabVIEW measurement files in TDMS ("TDMS File Format Internal Structure", NI): channels as columns.
//!
//! ```text
//! segment: "TDSm" · what it contains · version · length · position of values
//!          objects: path · position and type of their values · properties
//!          values, channel by channel or row by row
//! ```
//!
//! A channel's values are in any number of segments. A segment without a list of objects has the objects of the
//! previous one. Linear and polynomial scales are applied.

use std::collections::HashMap;
use std::io::{Read, Seek, SeekFrom};
use std::sync::Arc;

use crate::arrays::{Array, ArrayNumbers, ArrayRows, ArrayValues, Labels, columns_of_log};
use crate::budget;
use crate::element::Element;
use crate::format::{
    FileSource, FoundTable, OpenFile, RowSource, RowStream, TableColumn, WantedColumn,
};
use crate::kind::{FileKind, TableError};

const KIND: FileKind = FileKind::Tdms;

/// Length of a segment's head.
const HEAD: u64 = 28;

const HAS_OBJECTS: u32 = 1 << 1;
const HAS_NEW_LIST: u32 = 1 << 2;
const HAS_VALUES: u32 = 1 << 3;
const IS_BY_ROW: u32 = 1 << 5;
const IS_BIG_ENDIAN: u32 = 1 << 6;

/// The position of the next segment as stated by an unfinished segment.
const UNFINISHED: u64 = u64::MAX;

/// Kinds of indexes: no values, the same index as before, or values of measurement cards (DAQmx), whose samples or
/// digital lines share a buffer.
const NO_VALUES: u32 = 0xffff_ffff;
const SAME_VALUES: u32 = 0;
const OF_CARD: u32 = 0x1269;
const OF_LINES: [u32; 2] = [0x126a, 0x1369];

const PIECES: usize = 1 << 20;

#[derive(Clone, Copy, Debug, Default)]
struct Index {
    kind: u32,
    count: u64,
    /// Size of all texts in bytes.
    bytes: u64,
    /// The number of a card's buffer, and the position in a row of this buffer.
    card: Option<(usize, u64)>,
}

impl Index {
    /// Returns a card's buffer and the position in its rows; `None` if a value exceeds the length of a row in `rows`.
    fn place_in(&self, rows: &[u64]) -> Option<(usize, u64)> {
        let (buffer, offset) = self.card?;
        let end = offset.saturating_add(size(self.kind)? as u64);
        rows.get(buffer).is_some_and(|row| end <= *row).then_some((buffer, offset))
    }
}

#[derive(Clone, Copy, Debug)]
struct Piece {
    at: u64,
    count: u64,
    /// Distance from one value to the next, bytes.
    stride: u64,
}

#[derive(Clone, Debug, Default)]
struct Channel {
    /// `/'group'/'channel'` without slashes and quotes: `group/channel`.
    name: String,
    /// The type of the values; 0 if there are none.
    kind: u32,
    is_little: bool,
    unread: Option<&'static str>,
    /// True for values of a card, which need a scale.
    is_of_card: bool,
    pieces: Vec<Piece>,
    count: u64,
    properties: HashMap<String, Property>,
}

#[derive(Clone, Debug)]
enum Property {
    Number(f64),
    Text(String),
    /// A time in s since 1970.
    Time(f64),
}

#[derive(Debug)]
struct TdmsTable {
    file: FileSource,
    channels: Vec<Channel>,
    arrays: ArrayRows,
    /// Time of the first row and time per row, s, if no channel is a time. The first array then holds the times.
    clock: Option<(f64, f64)>,
}

pub(crate) fn open(source: &FileSource, part: Option<&str>) -> Result<FoundTable, TableError> {
    let mut reader = Reader::new(source)?;
    while reader.segment()? {}
    // The reader has a note only if the end is missing.
    let Reader { channels, mut notes, .. } = reader;
    let is_cut_off = !notes.is_empty();
    let (mut channels, parents): (Vec<Channel>, Vec<Channel>) =
        channels.into_iter().partition(|channel| channel.name.contains('/'));
    for channel in channels.iter_mut().filter(|channel| !channel.has_scales()) {
        let group = channel.name.split('/').next().unwrap_or_default();
        // A channel may have the scales of its group, or else of the file, whose name is empty.
        let of = |name: &str| parents.iter().find(|it| it.name == name && it.has_scales());
        if let Some(parent) = of(group).or_else(|| of("")) {
            let all = parent.properties.iter().filter(|(key, _)| key.starts_with("NI_"));
            channel.properties.extend(all.map(|(key, value)| (key.clone(), value.clone())));
        }
    }
    let arrays = channels.iter().map(Channel::array).collect();
    let (columns, mut arrays, more) = columns_of_log(KIND, arrays, part)?;
    notes.extend(more);
    // A single channel is a vector, whose column has a name.
    let mut columns = columns.unwrap_or_default();
    let is_used = |channel: &&Channel| arrays.arrays.iter().any(|array| array.name == channel.name);
    let clocks: Vec<(&Channel, Clock)> =
        channels.iter().filter(is_used).filter_map(|it| Some((it, it.clock()?))).collect();
    let first = clocks.first().map(|(_, clock)| *clock);
    if let Some(first) = first
        && clocks.iter().any(|(_, clock)| !clock.agrees_with(first))
    {
        // Channels with different clocks have their rows at different times.
        let group = |name: &str| name.split('/').next().unwrap_or_default().to_owned();
        let mut groups: Vec<String> = clocks.iter().map(|(it, _)| group(&it.name)).collect();
        groups.dedup();
        let found = match groups.len() {
            1 => clocks.iter().map(|(it, _)| it.name.clone()).collect(),
            _ => groups,
        };
        return Err(KIND.choice("clock", part, found));
    }
    let clock = first.map(|clock| (clock.offset, clock.increment));
    let is_time = |column: &TableColumn| column.name.to_lowercase().contains("time");
    let clock = clock.filter(|_| !columns.iter().any(is_time));
    if clock.is_some() {
        let name = "t_s".to_owned();
        columns.insert(0, TableColumn { name: name.clone(), unit: None });
        let (size, values) = (vec![arrays.rows], ArrayValues::Unread);
        arrays.arrays.insert(
            0,
            Array { name, size, unit: None, labels: Labels::default(), is_by_row: true, values },
        );
    }
    let table = TdmsTable { file: source.clone(), channels, arrays, clock };
    Ok(FoundTable {
        columns: Some(columns),
        rows: Arc::new(table),
        notes,
        is_cut_off,
        attributes: Vec::new(),
    })
}

struct Reader {
    file: OpenFile,
    length: u64,
    /// Position of the next segment.
    at: u64,
    channels: Vec<Channel>,
    places: HashMap<String, usize>,
    /// Objects with values in the current segment.
    active: Vec<usize>,
    indexes: Vec<Index>,
    /// Length of a row in each buffer of the cards.
    card_rows: Vec<u64>,
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
            card_rows: Vec::new(),
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
                form if form == OF_CARD || OF_LINES.contains(&form) => {
                    let is_line = form != OF_CARD;
                    let (index, rows) = card_index(&mut fields, is_line)?;
                    let why = is_line.then_some("digital lines of a card");
                    channel.unread = channel.unread.or(why).or(channel.other_kind(index.kind));
                    channel.is_of_card = true;
                    channel.kind = index.kind;
                    (self.indexes[at], self.card_rows) = (index, rows);
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
                    channel.unread = channel.unread.or(channel.other_kind(kind));
                    channel.kind = kind;
                    self.indexes[at] = Index { kind, count, bytes, card: None };
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
        if indexes.iter().any(|index| index.card.is_some()) {
            return self.add_card_values(start, end, is_little);
        }
        let total = indexes.iter().fold(0, |all: u64, index| all.saturating_add(index.bytes));
        if total == 0 {
            return Ok(());
        }
        let is_by_row = contents & IS_BY_ROW != 0;
        let row: u64 = indexes.iter().map(|index| size(index.kind).unwrap_or(0) as u64).sum();
        let active = self.active.clone();
        let mut at = start;
        while at < end {
            let mut offset = at;
            for (&place, index) in active.iter().zip(&indexes) {
                let size = size(index.kind).unwrap_or(0) as u64;
                let (stride, step) = if is_by_row { (row, size) } else { (size, index.bytes) };
                let count = whole_values(end.saturating_sub(offset), size, stride, index);
                self.add_piece(place, is_little, Piece { at: offset, count, stride })?;
                offset = offset.saturating_add(step);
            }
            at = at.saturating_add(total);
        }
        Ok(())
    }

    /// Adds the values of cards between two positions. The buffers follow one another.
    fn add_card_values(&mut self, start: u64, end: u64, is_little: bool) -> Result<(), TableError> {
        let active: Vec<(usize, Index)> =
            self.active.iter().map(|&at| (at, self.indexes[at])).collect();
        let rows = self.card_rows.clone();
        // Each buffer has as many rows as its channel with the most values.
        let mut counts = vec![0; rows.len()];
        for (_, index) in &active {
            let Some((buffer, _)) = index.place_in(&rows) else {
                for (place, _) in &active {
                    self.channels[*place].unread.get_or_insert(SEVERAL_SCALERS);
                }
                return Ok(());
            };
            counts[buffer] = index.count.max(counts[buffer]);
        }
        let lengths = rows.iter().zip(&counts).map(|(row, count)| row.saturating_mul(*count));
        let lengths: Vec<u64> = lengths.collect();
        let total = lengths.iter().fold(0, |all: u64, length| all.saturating_add(*length));
        let mut at = start;
        while at < end && total > 0 {
            for (place, index) in &active {
                let Some((buffer, offset)) = index.place_in(&rows) else { continue };
                let before = lengths[..buffer].iter().fold(0, |a: u64, b| a.saturating_add(*b));
                let here = at.saturating_add(before).saturating_add(offset);
                let (size, stride) = (size(index.kind).unwrap_or(0) as u64, rows[buffer]);
                let count = whole_values(end.saturating_sub(here), size, stride, index);
                self.add_piece(*place, is_little, Piece { at: here, count, stride })?;
            }
            at = at.saturating_add(total);
        }
        Ok(())
    }

    /// Adds a piece to a channel, or extends the last piece if the new one follows it directly.
    fn add_piece(&mut self, place: usize, is_little: bool, piece: Piece) -> Result<(), TableError> {
        if piece.count == 0 {
            return Ok(());
        }
        let channel = &mut self.channels[place];
        if channel.count > 0 && channel.is_little != is_little {
            channel.unread.get_or_insert("values in two byte orders");
        }
        channel.is_little = is_little;
        channel.count += piece.count;
        let is_number = size(channel.kind).is_some();
        match channel.pieces.last_mut() {
            Some(last)
                if is_number
                    && last.stride == piece.stride
                    && last.at + last.count * last.stride == piece.at =>
            {
                last.count += piece.count;
            }
            _ => {
                self.pieces += 1;
                channel.pieces.push(piece);
            }
        }
        match self.pieces > PIECES {
            true => Err(KIND.unsupported(format!("more than {PIECES} pieces of channels"))),
            false => Ok(()),
        }
    }
}

/// Returns the number of whole values in the `room` bytes left. Texts are either complete or not read.
fn whole_values(room: u64, size: u64, stride: u64, index: &Index) -> u64 {
    let whole = match size {
        0 if room >= index.bytes => index.count,
        0 => 0,
        _ if room < size => 0,
        // No full `stride` follows the last value.
        _ => (room - size) / stride + 1,
    };
    index.count.min(whole)
}

const SEVERAL_SCALERS: &str = "values of a card that several scalers make";

/// Reads a card channel's index and the row lengths of the buffers. `card` is `None` unless values come from one place.
fn card_index(fields: &mut Fields<'_>, is_line: bool) -> Option<(Index, Vec<u64>)> {
    let (_kind, _dimension, count) = (fields.u32()?, fields.u32()?, fields.u64()?);
    let (scalers, mut index) = (fields.u32()?, Index { count, ..Index::default() });
    for _ in 0..scalers {
        let (kind, buffer, offset) = (fields.u32()?, fields.u32()?, fields.u32()?);
        // Skips a bitmap of the sample format, and the number of the scaler.
        fields.take(if is_line { 5 } else { 8 })?;
        // Cards have other type numbers: alternately unsigned and signed integers, then floating-point numbers.
        let kind = match kind {
            0..8 if kind % 2 == 0 => 5 + kind / 2,
            0..8 => 1 + kind / 2,
            8 | 9 => kind + 1,
            _ => 0,
        };
        if scalers == 1 && kind != 0 {
            index.kind = kind;
            // The position of a line is in bits.
            let offset = if is_line { offset / 8 } else { offset };
            index.card = Some((buffer as usize, u64::from(offset)));
        }
    }
    let mut rows = Vec::new();
    for _ in 0..fields.u32()? {
        rows.push(u64::from(fields.u32()?));
    }
    Some((index, rows))
}

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

/// Seconds from 1904, the epoch of times, to 1970.
const TO_1970: i64 = 2_082_844_800;

/// Converts a time to seconds since 1970. One word has 2⁻⁶⁴ s, the other (first if big-endian) s since 1904.
fn time_of(bytes: &[u8], is_little: bool) -> f64 {
    let mut words = [0_u64; 2];
    for (word, bytes) in words.iter_mut().zip(bytes.chunks_exact(8)) {
        let bytes = bytes.try_into().unwrap_or_default();
        *word = if is_little { u64::from_le_bytes(bytes) } else { u64::from_be_bytes(bytes) };
    }
    let [fraction, seconds] = if is_little { words } else { [words[1], words[0]] };
    (seconds as i64).saturating_sub(TO_1970) as f64 + fraction as f64 / 2_f64.powi(64)
}

/// A segment's head in its byte order.
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
            None if kind == TIME => Property::Time(time_of(bytes, self.is_little)),
            None => Property::Text(String::new()),
        })
    }
}

/// The times of a channel's values, s: the first since 1970, the first in the waveform, and the step.
#[derive(Clone, Copy, Debug)]
struct Clock {
    start: f64,
    offset: f64,
    increment: f64,
}

impl Clock {
    /// Returns true if the values of both are at the same times.
    fn agrees_with(self, other: Self) -> bool {
        let is_same_step = (self.increment - other.increment).abs() <= 1e-9 * self.increment;
        is_same_step && (self.start - other.start).abs() < self.increment / 2.0
    }
}

/// A polynomial of the stored values, lowest power first.
type Polynomial = Vec<f64>;

impl Channel {
    /// Returns a reason if the channel already has values of another type.
    fn other_kind(&self, kind: u32) -> Option<&'static str> {
        (self.kind != 0 && self.kind != kind).then_some("values of several types")
    }

    fn has_scales(&self) -> bool {
        self.properties.keys().any(|key| key.starts_with("NI_") && key.contains("Scale"))
    }

    fn number(&self, property: &str) -> Option<f64> {
        match self.properties.get(property)? {
            Property::Number(number) => Some(*number),
            Property::Text(_) | Property::Time(_) => None,
        }
    }

    fn text(&self, property: &str) -> Option<&str> {
        match self.properties.get(property)? {
            Property::Text(text) => Some(text),
            Property::Number(_) | Property::Time(_) => None,
        }
    }

    /// Returns the channel as an array whose values have not been read.
    fn array(&self) -> Array {
        let values = match self.kind {
            _ if let Some(why) = self.unread => ArrayValues::Other(why),
            _ if self.count == 0 => ArrayValues::Other("no values"),
            TEXT | TIME => ArrayValues::Unread,
            kind if element(kind).is_some() => match self.scales() {
                Some(scales) if scales.is_empty() && self.is_of_card => {
                    ArrayValues::Other("counts of a card without a scale")
                }
                Some(_) => ArrayValues::Unread,
                None => ArrayValues::Other("a scale that is neither linear nor a polynomial"),
            },
            _ => ArrayValues::Other("no real numbers"),
        };
        let unit = self.text("unit_string").or_else(|| self.text("NI_UnitDescription"));
        let unit = unit.map(str::trim).filter(|unit| !unit.is_empty()).map(str::to_owned);
        let size = vec![usize::try_from(self.count).unwrap_or(usize::MAX)];
        Array {
            name: self.name.clone(),
            size,
            unit,
            labels: Labels::default(),
            is_by_row: true,
            values,
        }
    }

    /// Returns the times of a waveform, if the channel states its step.
    fn clock(&self) -> Option<Clock> {
        let increment = self.number("wf_increment").filter(|step| *step > 0.0)?;
        let offset = self.number("wf_start_offset").unwrap_or(0.0);
        let start = match self.properties.get("wf_start_time") {
            Some(Property::Time(start)) => *start,
            _ => 0.0,
        };
        Some(Clock { start: start + offset, offset, increment })
    }

    /// Returns the scales in the order of application; `None` if one is not a polynomial. The last scale yields the
    /// result. The input of each scale is the stored values or the result of another scale.
    fn scales(&self) -> Option<Vec<Polynomial>> {
        // A key is `NI_Scale[1]_Scale_Type`.
        let numbered = self.properties.keys().filter_map(|key| {
            let number = key.strip_prefix("NI_Scale[")?.split_once("]_Scale_Type")?.0;
            number.parse::<u32>().ok()?.checked_add(1).map(f64::from)
        });
        let count =
            self.number("NI_Number_Of_Scales").unwrap_or_else(|| numbered.fold(0.0, f64::max));
        let mut scales = Vec::new();
        if count < 1.0 || self.text("NI_Scaling_Status") == Some("scaled") {
            return Some(scales);
        }
        let mut at = count - 1.0;
        // A longer chain of scales is a loop.
        for _ in 0..16 {
            let key = |of: &str| format!("NI_Scale[{at}]_{of}");
            let number = |of: &str| self.number(&key(of));
            let kind = match self.text(&key("Scale_Type")) {
                Some(kind) => kind,
                // The scale belongs to the card itself, and has no properties.
                None if self.is_of_card => break,
                None => return None,
            };
            scales.push(match kind {
                "Linear" => vec![number("Linear_Y_Intercept")?, number("Linear_Slope")?],
                "Polynomial" => {
                    let size = number("Polynomial_Coefficients_Size").unwrap_or(4.0);
                    (0..size.clamp(0.0, 32.0) as usize)
                        .map(|of| number(&format!("Polynomial_Coefficients[{of}]")))
                        .collect::<Option<_>>()?
                }
                "AdvancedAPI" => vec![0.0, 1.0],
                _ => return None,
            });
            match number(&format!("{kind}_Input_Source")) {
                Some(source) if source < count => at = source,
                // The input of the scale is the stored values.
                _ => {
                    scales.reverse();
                    return Some(scales);
                }
            }
        }
        scales.reverse();
        Some(scales).filter(|scales| scales.len() < 16)
    }

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
                scaled(stored.cell(value, is_little).number().unwrap_or(f64::NAN), &scales)
            });
            bytes = scaled.flat_map(f64::to_le_bytes).collect();
            (element, is_little) = (Some(Element::Double), true);
        }
        let (range, element) = (0..bytes.len(), element.unwrap_or(Element::Double));
        Ok(ArrayValues::Numbers(ArrayNumbers { bytes: Arc::new(bytes), range, element, is_little }))
    }

    /// Reads texts. Each piece has the positions of their ends, followed by the texts.
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

fn scaled(value: f64, scales: &[Polynomial]) -> f64 {
    scales
        .iter()
        .fold(value, |value, scale| scale.iter().rev().fold(0.0, |sum, of| sum * value + of))
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
    fn reason_of_absence(&self, name: &str) -> Option<&str> {
        self.arrays.reason_of_absence(name)
    }

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

#[cfg(test)]
mod tests {
    use super::*;

    /// A file of one segment, with a channel of four doubles in each group. A group is its name, its start in s since
    /// 1904, and the step of its clock in s.
    fn file(groups: &[(&str, i64, f64)]) -> FileSource {
        let text = |text: &str| [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
        let mut objects = (groups.len() as u32).to_le_bytes().to_vec();
        for (group, start, step) in groups {
            objects.extend(text(&format!("/'{group}'/'value'")));
            for number in [20_u32, 10, 1] {
                objects.extend(number.to_le_bytes());
            }
            objects.extend(4_u64.to_le_bytes());
            objects.extend(2_u32.to_le_bytes());
            objects.extend([text("wf_start_time"), TIME.to_le_bytes().to_vec()].concat());
            objects.extend([0_u64.to_le_bytes(), start.to_le_bytes()].concat());
            objects.extend([text("wf_increment"), 10_u32.to_le_bytes().to_vec()].concat());
            objects.extend(step.to_le_bytes());
        }
        let values: Vec<u8> =
            (0..4 * groups.len()).flat_map(|at| (at as f64).to_le_bytes()).collect();
        let contents = HAS_OBJECTS | HAS_NEW_LIST | HAS_VALUES;
        let mut bytes = b"TDSm".to_vec();
        bytes.extend([contents.to_le_bytes(), 4713_u32.to_le_bytes()].concat());
        bytes.extend(((objects.len() + values.len()) as u64).to_le_bytes());
        bytes.extend((objects.len() as u64).to_le_bytes());
        FileSource::Memory([bytes, objects, values].concat().into())
    }

    #[test]
    fn groups_with_other_clocks_are_not_joined_row_by_row() {
        let names = |groups: &[(&str, i64, f64)], part: Option<&str>| {
            let columns = open(&file(groups), part).map(|found| found.columns.unwrap());
            columns.map(|all| all.into_iter().map(|column| column.name).collect::<Vec<_>>())
        };
        let same = [("a", 3_000_000_000, 0.01), ("b", 3_000_000_000, 0.01)];
        assert_eq!(names(&same, None).unwrap(), ["t_s", "a/value", "b/value"]);
        for other in [("b", 3_000_000_003, 0.01), ("b", 3_000_000_000, 0.02)] {
            let both = [same[0], other];
            let said = names(&both, None).unwrap_err().to_string();
            assert_eq!(said, "a TDMS file with more than one clock; it has `a`, `b`");
            assert_eq!(names(&both, Some("b")).unwrap(), ["t_s", "value"]);
        }
    }

    /// The fourth of the values 0, 1, 2, … as npTDMS 1.13 scales it; `None` for scales that are not supported.
    #[test]
    fn scales_are_applied_as_nptdms_applies_them() {
        let linear = |at: usize, slope: f64, intercept: f64, source: Option<f64>| {
            let number =
                |of: &str, value| (format!("NI_Scale[{at}]_Linear_{of}"), Property::Number(value));
            let kind = Property::Text("Linear".to_owned());
            let mut all = vec![(format!("NI_Scale[{at}]_Scale_Type"), kind)];
            all.extend([number("Slope", slope), number("Y_Intercept", intercept)]);
            all.extend(source.map(|source| number("Input_Source", source)));
            all
        };
        let count = |count| ("NI_Number_Of_Scales".to_owned(), Property::Number(count));
        let status = |text: &str| ("NI_Scaling_Status".to_owned(), Property::Text(text.to_owned()));
        let raw = f64::from(u32::MAX);
        let one = linear(0, 2.0, 1.0, None);
        let mut table = vec![count(1.0)];
        table.push(("NI_Scale[0]_Scale_Type".to_owned(), Property::Text("Table".to_owned())));
        for (name, properties, expected) in [
            ("no scale", vec![], Some(3.0)),
            ("no status", [one.clone(), vec![count(1.0)]].concat(), Some(7.0)),
            ("no count", one.clone(), Some(7.0)),
            ("scaled", [one.clone(), vec![count(1.0), status("scaled")]].concat(), Some(3.0)),
            (
                "the first feeds the second",
                [one.clone(), linear(1, 10.0, 0.5, Some(0.0)), vec![count(2.0)]].concat(),
                Some(70.5),
            ),
            (
                "the second takes the stored values",
                [one.clone(), linear(1, 10.0, 0.5, Some(raw)), vec![count(2.0)]].concat(),
                Some(30.5),
            ),
            ("a table", table, None),
            ("in a circle", [linear(0, 1.0, 0.0, Some(0.0)), vec![count(1.0)]].concat(), None),
        ] {
            let channel =
                Channel { properties: properties.into_iter().collect(), ..Channel::default() };
            let found = channel.scales().map(|scales| scaled(3.0, &scales));
            assert_eq!(found, expected, "{name}");
        }
    }
}
