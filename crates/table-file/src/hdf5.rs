//! Numbers in HDF5 files, including MATLAB 7.3. The crate `hdf5-pure` reads the format; this module selects the data
//! sets of a log and limits the memory that a file may use.

use std::collections::HashMap;
use std::io::Read;
use std::sync::Arc;

use hdf5_pure::{
    AttrValue, Dataset, Datatype, DatatypeByteOrder, Error, FloatingPointLayout, FormatError,
    Group, ReadSeekSource, Source, VlenStringReadOptions,
};

use crate::arrays::{
    Array, ArrayNumbers, ArrayRows, ArrayValues, Labels, NAMES, UNITS, attributes_in,
    columns_of_log,
};
use crate::budget;
use crate::element::Element;
use crate::format::{FileSource, FoundTable, OpenFile, RowSource, RowStream, WantedColumn};
use crate::kind::{FileKind, TableError};
use shell_data::unit::{Quantity, Unit};

const KIND: FileKind = FileKind::Hdf5;

/// Limits on the nesting of groups and the number of objects.
const DEPTH: usize = 8;
const OBJECTS: usize = 4096;

/// Bytes that all data sets may use, in addition to [`RATIO`] times the file's length. The limit is low, because a file
/// can claim any number of rows that were never written.
const ANY: u64 = 16 << 20;
const RATIO: u64 = 32;

/// Bytes that the reader uses per chunk of a data set, and at least per text.
const PER_CHUNK: u64 = 352;
const PER_TEXT: u64 = 32;

/// The first bytes of a MATLAB file, in which data sets are matrices stored column by column.
const MATLAB: &[u8] = b"MATLAB 7.3";

const CLASSES: [&str; 11] = [
    "double", "single", "logical", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32",
    "uint64",
];

#[derive(Debug)]
struct Hdf5Table {
    file: FileSource,
    sets: ArrayRows,
}

pub(crate) fn open(source: &FileSource, part: Option<&str>) -> Result<FoundTable, TableError> {
    let mut head = Vec::new();
    source.open()?.take(MATLAB.len() as u64).read_to_end(&mut head)?;
    let is_matlab = head == MATLAB;
    let file = read(source)?;
    if file.file_size() < file.superblock().eof_address {
        return Err(KIND.damaged("it is cut off"));
    }
    let mut found = DataSets { is_matlab, ..DataSets::default() };
    found.add(&file.root(), "", &GroupLabels::default(), DEPTH)?;
    let (columns, sets, notes) = columns_of_log(KIND, found.sets, part)?;
    let rows = Arc::new(Hdf5Table { file: source.clone(), sets });
    let attributes = [found.attributes, found.scalars].concat();
    Ok(FoundTable { columns, rows, notes, is_cut_off: false, attributes })
}

#[derive(Default)]
struct DataSets {
    sets: Vec<Array>,
    objects: usize,
    is_matlab: bool,
    attributes: Vec<(String, String)>,
    /// Names and values of data sets with a single value.
    scalars: Vec<(String, String)>,
}

/// The longest text of a data set with a single value, in bytes.
const SCALAR: u64 = 1 << 12;

type Attributes = HashMap<String, AttrValue>;

/// Names and units in the attributes of a group or a data set.
#[derive(Clone, Debug, Default)]
struct GroupLabels {
    unit: Option<String>,
    labels: Labels,
}

impl GroupLabels {
    /// Reads attributes. Labels that they lack are taken from the group `above`.
    fn new(attributes: &Attributes, above: &Self) -> Self {
        let units = texts_of(attributes, &UNITS).unwrap_or_default();
        let list = |texts: &[String], above: &[String]| {
            if texts.len() > 1 { texts.to_vec() } else { above.to_vec() }
        };
        let names = texts_of(attributes, &NAMES).unwrap_or_default();
        let unit = units.first().filter(|_| units.len() == 1).cloned();
        Self {
            unit: unit.or_else(|| above.unit.clone()),
            labels: Labels {
                names: list(&names, &above.labels.names),
                units: list(&units, &above.labels.units),
            },
        }
    }

    /// Returns the labels, or else those of the group.
    fn or(self, group: &Self) -> Labels {
        let list = |own: Vec<String>, of: &[String]| if own.is_empty() { of.to_vec() } else { own };
        Labels {
            names: list(self.labels.names, &group.labels.names),
            units: list(self.labels.units, &group.labels.units),
        }
    }

    /// Returns the group's unit for a data set, if both the unit and the name are of time, or neither is.
    fn unit_of(&self, name: &str) -> Option<String> {
        let name = name.to_lowercase();
        let is_time = name.contains("time") || name == "t" || name.starts_with("t_");
        let unit = self.unit.clone()?;
        let suits = Unit::parse(&unit, Quantity::Time).is_some() == is_time;
        suits.then_some(unit)
    }
}

/// Returns the texts of the first attribute that exists; the case of `names` does not matter.
fn texts_of(attributes: &Attributes, names: &[&str]) -> Option<Vec<String>> {
    let of_name = |name: &&str| {
        let mut same = attributes.iter().filter(|(key, _)| key.eq_ignore_ascii_case(name));
        same.find_map(|(_, value)| Some(value.as_strings()?.to_vec()))
    };
    names.iter().find_map(of_name)
}

/// Returns texts and numbers that describe the file.
fn attributes_of_file(attributes: &Attributes) -> Vec<(String, String)> {
    let pair = |(key, value): (&String, &AttrValue)| {
        let number = || Some(value.as_f64().or_else(|| Some(value.as_i64()? as f64))?.to_string());
        // Units in the root group are labels of its data sets, not attributes of the file.
        let is_shared = UNITS.iter().any(|it| key.eq_ignore_ascii_case(it));
        let text = value.as_str().map(str::to_owned).or_else(number)?;
        (!is_shared).then(|| (key.clone(), text))
    };
    let mut pairs: Vec<(String, String)> = attributes.iter().filter_map(pair).collect();
    pairs.sort_unstable();
    pairs
}

impl DataSets {
    /// Adds the data sets of a group and of its subgroups.
    fn add(
        &mut self,
        group: &Group,
        path: &str,
        above: &GroupLabels,
        depth: usize,
    ) -> Result<(), TableError> {
        let attributes = group.attrs().map_err(unreadable)?;
        let of_group = GroupLabels::new(&attributes, above);
        if depth == DEPTH {
            self.attributes = attributes_of_file(&attributes);
        }
        // Octave stores a value with its type in a group; the value is stored column by column.
        let is_octave = attributes.contains_key("OCTAVE_NEW_FORMAT");
        for (name, set) in group.iter_datasets().map_err(unreadable)? {
            self.count()?;
            let is_by_row = !self.is_matlab && !is_octave;
            let shape = set.shape().map_err(unreadable)?.into_iter();
            let mut size: Vec<usize> =
                shape.map(|side| usize::try_from(side).unwrap_or(usize::MAX)).collect();
            if !is_by_row {
                size.reverse();
            }
            if name == "block0_values" {
                return Err(KIND.unsupported("a frame of pandas; `df.to_parquet(…)` is read"));
            }
            let name = match (is_octave, name.as_str()) {
                (true, "type") => continue,
                (true, "value") => path.trim_end_matches('/').to_owned(),
                _ => format!("{path}{name}"),
            };
            let (unit, own, mut values) = self.values(&set)?;
            if size.iter().all(|side| *side == 1) && matches!(values, ArrayValues::Unread) {
                let values = self::values(&set, &name, SCALAR)?;
                let size = vec![1];
                let labels = Labels::default();
                let single =
                    Array { name: name.clone(), size, unit: None, labels, is_by_row, values };
                self.scalars.extend(attributes_in(&[single]));
            }
            let labels = own.or(&of_group);
            let unit = unit.or_else(|| of_group.unit_of(&name));
            if is_octave && matches!(set.datatype(), Ok(Datatype::Compound { .. })) {
                values = ArrayValues::Other("a range of Octave: save with `save -v7`");
            }
            self.sets.push(Array { name, size, unit, labels, is_by_row, values });
        }
        if depth == 0 {
            return Ok(());
        }
        for (name, inner) in group.iter_groups().map_err(unreadable)? {
            self.count()?;
            // `#` groups hold the contents of MATLAB cells and objects, `_i_` groups the indexes of PyTables.
            if !name.starts_with('#') && !name.starts_with("_i_") {
                self.add(&inner, &format!("{path}{name}/"), &of_group, depth - 1)?;
            }
        }
        Ok(())
    }

    /// Returns the unit of a data set, and its values or the reason why they are not read.
    fn values(
        &self,
        set: &Dataset,
    ) -> Result<(Option<String>, GroupLabels, ArrayValues), TableError> {
        let attributes = set.attrs().map_err(unreadable)?;
        let text = |name: &str| attributes.get(name).and_then(AttrValue::as_str);
        // Cuts the origin off units such as "milliseconds since 2026-03-01 12:00:00".
        let units = texts_of(&attributes, &UNITS).filter(|units| units.len() == 1);
        let unit = units.as_ref().and_then(|units| units[0].split(" since ").next());
        let unit = unit.map(str::trim);
        let unit = unit.filter(|unit| !unit.is_empty()).map(str::to_owned);
        // MATLAB texts are numbers as well, and an empty matrix stores its dimensions as numbers.
        let is_number = !attributes.contains_key("MATLAB_empty")
            && text("MATLAB_class").is_none_or(|it| CLASSES.contains(&it));
        let kind = set.datatype().map_err(unreadable)?;
        let filters = set.filters();
        let refused = filters.iter().copied().find_map(unread_filter);
        let is_big = element(&kind).is_some_and(|(_, is_little)| !is_little);
        // `hdf5-pure` 0.47 returns such numbers in the other byte order, and calls shuffled ones damaged.
        let is_misread = filters.contains(&SCALE_OFFSET) && (is_big || filters.contains(&SHUFFLE));
        let refused = refused.or(is_misread
            .then_some("compressed with scale-offset after a shuffle or in big-endian byte order"));
        // Attributes of netCDF's conventions (CF 1.11, section 8.1).
        let is_packed =
            ["scale_factor", "add_offset"].iter().any(|it| attributes.contains_key(*it));
        let refused = refused.or(is_packed.then_some("packed with `scale_factor` or `add_offset`"));
        let values = match &kind {
            _ if refused.is_some() => ArrayValues::Other(refused.unwrap_or_default()),
            _ if self.is_matlab && !is_number => ArrayValues::Other("no numbers"),
            Datatype::String { .. } | Datatype::VariableLength { is_string: true, .. } => {
                ArrayValues::Unread
            }
            kind if element(kind).is_some() => ArrayValues::Unread,
            Datatype::Compound { .. } => ArrayValues::Other(
                "records of several fields, as in tables of pandas; `df.to_parquet(…)` is read",
            ),
            Datatype::Reference { .. } => ArrayValues::Other("references"),
            _ => ArrayValues::Other("values of an unusual type"),
        };
        Ok((unit, GroupLabels::new(&attributes, &GroupLabels::default()), values))
    }

    fn count(&mut self) -> Result<(), TableError> {
        self.objects += 1;
        match self.objects <= OBJECTS {
            true => Ok(()),
            false => Err(KIND.unsupported(format!("more than {OBJECTS} groups and data sets"))),
        }
    }
}

const SHUFFLE: u16 = 2;
const SCALE_OFFSET: u16 = 6;

/// Returns the reason why a filter is not supported, by its number registered at The HDF Group.
fn unread_filter(filter: u16) -> Option<&'static str> {
    Some(match filter {
        // Deflate, shuffle, Fletcher32, scale-offset, LZF, ZFP.
        1 | SHUFFLE | 3 | SCALE_OFFSET | 32_000 | 32_013 => return None,
        4 => "compressed with szip",
        5 => "compressed with n-bit",
        307 => "compressed with bzip2",
        32_001 => "compressed with Blosc",
        32_004 => "compressed with LZ4",
        32_008 => "compressed with Bitshuffle",
        32_015 => "compressed with Zstandard",
        32_026 => "compressed with Blosc2",
        _ => "compressed with a filter that is not known",
    })
}

/// Returns the type and byte order of a data type's numbers; `None` if it is not a usual numeric type.
fn element(kind: &Datatype) -> Option<(Element, bool)> {
    const HALF: FloatingPointLayout = FloatingPointLayout {
        bit_offset: 0,
        bit_precision: 16,
        exponent_location: 10,
        exponent_size: 5,
        mantissa_location: 0,
        mantissa_size: 10,
        exponent_bias: 15,
    };
    let (element, byte_order) = match kind {
        Datatype::FixedPoint { size: size @ (1 | 2 | 4 | 8), byte_order, layout } => {
            let (bits, all) = (u32::from(layout.bit_precision), 8 * size);
            let size = *size as u8;
            let element = match (bits == all, layout.signed) {
                _ if layout.bit_offset != 0 || bits == 0 || bits > all => return None,
                // The upper bits are zeros.
                (_, false) => Element::Unsigned(size),
                (true, true) => Element::Signed(size),
                (false, true) => Element::SignedBits { size, bits: bits as u8 },
            };
            (element, byte_order)
        }
        // h5py booleans, and integers with names.
        Datatype::Enumeration { base_type, .. } => return self::element(base_type),
        Datatype::FloatingPoint { size, byte_order, layout } => {
            let element = match (size, *layout) {
                (2, HALF) => Element::Half,
                (4, FloatingPointLayout::IEEE754_BINARY32) => Element::Single,
                (8, FloatingPointLayout::IEEE754_BINARY64) => Element::Double,
                _ => return None,
            };
            (element, byte_order)
        }
        _ => return None,
    };
    match byte_order {
        DatatypeByteOrder::LittleEndian => Some((element, true)),
        DatatypeByteOrder::BigEndian => Some((element, false)),
        DatatypeByteOrder::Vax => None,
    }
}

impl RowSource for Hdf5Table {
    fn reason_of_absence(&self, name: &str) -> Option<&str> {
        self.sets.reason_of_absence(name)
    }

    fn columns(&self) -> usize {
        self.sets.columns()
    }

    fn rows(self: Arc<Self>, wanted: Vec<WantedColumn>) -> Result<RowStream, TableError> {
        let file = read(&self.file)?;
        let limit = ANY.saturating_add(file.file_size().saturating_mul(RATIO));
        let mut left = limit.min(budget::IN_MEMORY);
        let mut sets = self.sets.clone();
        let wanted_sets: Vec<usize> =
            wanted.iter().filter_map(|wanted| Some(sets.place(wanted.at)?.0)).collect();
        for (at, array) in sets.arrays.iter_mut().enumerate() {
            // Checked even if not requested: it may claim more rows than memory can hold.
            let (set, bytes) = data_set(&file, &array.name, left)?;
            if wanted_sets.contains(&at) {
                array.values = values(&set, &array.name, left)?;
                left = left.saturating_sub(bytes.max(array.values.text_bytes()));
                if !array.is_filled() {
                    let what = format!("`{}` has fewer values than its sides say", array.name);
                    return Err(KIND.damaged(what));
                }
            }
        }
        Arc::new(sets).rows(wanted)
    }
}

/// Opens a data set; returns it with the size of its values. Values, chunk and list of chunks may take `most` bytes.
fn data_set(file: &hdf5_pure::File, path: &str, most: u64) -> Result<(Dataset, u64), TableError> {
    // Octave stores the value in a group with the variable's name.
    let set = file.dataset(path).or_else(|_| file.dataset(&format!("{path}/value")));
    let set = set.map_err(unreadable)?;
    let size = set.element_size().map_err(unreadable)?;
    let is_text = matches!(set.datatype().map_err(unreadable)?, Datatype::String { .. });
    let least = if is_text { PER_TEXT } else { 0 };
    let shape = set.shape().map_err(unreadable)?;
    let chunk = set.chunk_shape().map_err(unreadable)?.unwrap_or_default();
    let counts = shape.iter().zip(&chunk).map(|(length, side)| length.div_ceil((*side).max(1)));
    let bytes_of_list = product(PER_CHUNK, counts);
    let bytes_of_chunk = product(size, chunk.iter().copied());
    let bytes = product(size.max(least), shape.iter().copied());
    let largest = bytes.max(bytes_of_chunk).max(bytes_of_list);
    budget::within(KIND, format_args!("`{path}`"), largest, most)?;
    Ok((set, bytes))
}

fn product(first: u64, factors: impl Iterator<Item = u64>) -> u64 {
    factors.fold(first, u64::saturating_mul)
}

/// Reads the values of a data set; texts of variable length may have at most `most` bytes.
fn values(set: &Dataset, path: &str, most: u64) -> Result<ArrayValues, TableError> {
    if let Some(sides) = set.chunk_shape().map_err(unreadable)? {
        check_pieces(set, path, &set.shape().map_err(unreadable)?, &sides)?;
    }
    let kind = set.datatype().map_err(unreadable)?;
    let Some((element, is_little)) = element(&kind) else {
        let texts = match kind {
            Datatype::VariableLength { .. } => {
                let most = usize::try_from(most).unwrap_or(usize::MAX);
                let limit = VlenStringReadOptions::new().with_max_payload_bytes(most);
                set.read_vlen_strings(limit)
            }
            _ => set.read_string(),
        };
        return Ok(ArrayValues::Texts(Arc::new(texts.map_err(unreadable)?)));
    };
    let bytes = Arc::new(set.read_raw().map_err(unreadable)?);
    let range = 0..bytes.len();
    Ok(ArrayValues::Numbers(ArrayNumbers { bytes, range, element, is_little }))
}

/// Checks that chunks lie on the grid, without duplicates: a misplaced chunk would leave zeros in its place.
fn check_pieces(set: &Dataset, path: &str, shape: &[u64], sides: &[u64]) -> Result<(), TableError> {
    let mut offsets: Vec<Vec<u64>> =
        set.chunks().map_err(unreadable)?.into_iter().map(|chunk| chunk.offset).collect();
    let is_placed = |offset: &Vec<u64>| {
        let mut places = offset.iter().zip(sides.iter().zip(shape));
        offset.len() == shape.len()
            && places.all(|(at, (side, end))| *side > 0 && at % side == 0 && at < end)
    };
    let count = offsets.len();
    let are_placed = offsets.iter().all(is_placed);
    offsets.sort_unstable();
    offsets.dedup();
    match are_placed && offsets.len() == count {
        true => Ok(()),
        false => Err(KIND.damaged(format!("a piece of `{path}` is not on the grid of its pieces"))),
    }
}

/// A file with its soft links hidden: the reader refuses groups that contain any.
struct WithoutSoftLinks(ReadSeekSource<OpenFile>);

/// Length of the header and of an entry in a symbol table node, with addresses of eight bytes ("HDF5 File Format
/// Specification Version 3.0", section III.B).
const NODE_HEAD: usize = 8;
const NODE_ENTRY: usize = 40;

impl Source for WithoutSoftLinks {
    fn len(&self) -> u64 {
        self.0.len()
    }

    fn read_at(&self, offset: u64, buffer: &mut [u8]) -> Result<(), FormatError> {
        self.0.read_at(offset, buffer)?;
        let is_node = buffer.starts_with(b"SNOD\x01") && buffer.len() > NODE_HEAD;
        if !is_node || !(buffer.len() - NODE_HEAD).is_multiple_of(NODE_ENTRY) {
            return Ok(());
        }
        let (head, entries) = buffer.split_at_mut(NODE_HEAD);
        let count = usize::from(u16::from_le_bytes([head[6], head[7]]));
        if count * NODE_ENTRY != entries.len() {
            return Ok(());
        }
        // A soft link has an undefined address and cache type 2.
        let is_link = |entry: &[u8]| entry[8..16] == [0xff; 8] && entry[16..20] == [2, 0, 0, 0];
        let mut kept = 0;
        for at in 0..count {
            let entry = at * NODE_ENTRY..(at + 1) * NODE_ENTRY;
            if !is_link(&entries[entry.clone()]) {
                entries.copy_within(entry, kept * NODE_ENTRY);
                kept += 1;
            }
        }
        head[6..8].copy_from_slice(&(kept as u16).to_le_bytes());
        Ok(())
    }
}

fn read(file: &FileSource) -> Result<hdf5_pure::File, TableError> {
    let source = ReadSeekSource::new(file.open()?).map_err(Error::Format).map_err(unreadable)?;
    hdf5_pure::File::from_source(WithoutSoftLinks(source)).map_err(unreadable)
}

fn unreadable(error: Error) -> TableError {
    use FormatError::{
        ChunkedReadError, InvalidLayoutVersion, UnsupportedExternalStorage, UnsupportedFilter,
        UnsupportedVersion, UnsupportedVirtualLayout,
    };
    match error {
        Error::Io(error) => KIND.unread(error, "it is cut off"),
        // HDF5 2.0.
        Error::Format(InvalidLayoutVersion(_)) => {
            KIND.unsupported("a layout of HDF5 2.0: write with `libver=\"v114\"`, not \"latest\"")
        }
        // Features newer than the reader.
        Error::Format(
            error @ (UnsupportedExternalStorage
            | UnsupportedFilter(_)
            | UnsupportedVersion(_)
            | UnsupportedVirtualLayout),
        ) => KIND.unsupported(error.to_string()),
        Error::Format(ChunkedReadError(what)) if what.contains("B-tree") => KIND
            .unsupported("a data set that can grow along two sides, written with a newer `libver`"),
        error => KIND.damaged(error.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use hdf5_pure::FileBuilder;

    type Pairs = Vec<(String, String)>;

    fn columns(builder: FileBuilder) -> (Pairs, Pairs) {
        let bytes = builder.finish().unwrap();
        let found = open(&FileSource::Memory(bytes.into()), None).unwrap();
        let columns = found.columns.unwrap().into_iter();
        let pairs = columns.map(|column| (column.name, column.unit.unwrap_or_default()));
        (pairs.collect(), found.attributes)
    }

    fn list(texts: &[&str]) -> AttrValue {
        AttrValue::VarLenStringArray(texts.iter().map(|&text| text.to_owned()).collect())
    }

    fn pairs(texts: &[(&str, &str)]) -> Pairs {
        texts.iter().map(|&(name, unit)| (name.to_owned(), unit.to_owned())).collect()
    }

    #[test]
    fn units_are_attributes_of_data_sets_groups_and_the_file() {
        let mut of_columns = FileBuilder::new();
        of_columns.create_dataset("t_s").with_f64_data(&[0.0, 1.0, 2.0]);
        let wrench = of_columns.create_dataset("ft").with_f64_data(&[1.0; 6]).with_shape(&[3, 2]);
        wrench.set_attr("Units", list(&["mN", "mNm"]));
        let expected = pairs(&[("t_s", ""), ("ft1", "mN"), ("ft2", "mNm")]);
        assert_eq!(columns(of_columns).0, expected);

        let mut of_groups = FileBuilder::new();
        of_groups.set_attr("sample_rate", AttrValue::F64(100.0));
        of_groups.set_attr("force_units", AttrValue::VarLenString("kN".to_owned()));
        for (name, unit) in [("force", "mN"), ("torque", "mNm")] {
            let mut group = of_groups.create_group(name);
            group.set_attr("unit", AttrValue::VarLenString(unit.to_owned()));
            group.create_dataset(&format!("{name}_x")).with_f64_data(&[1.0, 2.0]);
            group.create_dataset("time").with_f64_data(&[1.0, 2.0]);
            of_groups.add_group(group.finish());
        }
        let (found, attributes) = columns(of_groups);
        let expected = [
            ("force/force_x", "mN"),
            ("force/time", ""),
            ("torque/time", ""),
            ("torque/torque_x", "mNm"),
        ];
        let mut found = found;
        found.sort_unstable();
        assert_eq!(found, pairs(&expected));
        assert_eq!(attributes, pairs(&[("force_units", "kN"), ("sample_rate", "100")]));

        let mut of_file = FileBuilder::new();
        of_file.set_attr("columns", list(&["t", "fz"]));
        of_file.set_attr("units", list(&["ms", "kN"]));
        of_file.create_dataset("data").with_f64_data(&[1.0; 6]).with_shape(&[3, 2]);
        assert_eq!(columns(of_file).0, pairs(&[("t", "ms"), ("fz", "kN")]));
    }
}
