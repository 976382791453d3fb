//! Data sets of numbers in HDF5 files, which those of MATLAB 7.3 are too. The crate `hdf5-pure` reads the
//! format; what of it is a log, and how much memory a file may ask for, is decided here.

use std::io::Read;
use std::ops::Range;
use std::sync::Arc;

use hdf5_pure::{
    AttrValue, Dataset, Datatype, DatatypeByteOrder, Error, FloatingPointLayout, FormatError,
    Group, ReadSeekSource,
};

use crate::arrays::{Array, ArrayNumbers, ArrayRows, columns_of_log};
use crate::budget::{self, Unpacked};
use crate::element::Element;
use crate::format::{FileSource, NamedRows, RowSource, RowStream};
use crate::kind::{FileKind, TableError};

const KIND: FileKind = FileKind::Hdf5;

/// How deep groups are looked into, which may contain each other, and how many objects are.
const DEPTH: usize = 8;
const OBJECTS: usize = 4096;

/// The most that all data sets of a log may take beyond [`RATIO`] times the file: less than elsewhere, as
/// the file may claim any number of rows that were never written.
const ANY: u64 = 16 << 20;
const RATIO: u64 = 32;

/// How a file of MATLAB begins: its data sets are matrices column by column.
const MATLAB: &[u8] = b"MATLAB 7.3";

/// The classes of MATLAB that are numbers.
const CLASSES: [&str; 11] = [
    "double", "single", "logical", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32",
    "uint64",
];

/// The data sets of a file that make up a log.
#[derive(Debug)]
struct Hdf5Table {
    file: FileSource,
    sets: Vec<Array>,
    is_by_row: bool,
}

pub(crate) fn open(source: &FileSource, part: Option<&str>) -> Result<NamedRows, TableError> {
    let mut head = Vec::new();
    source.open()?.take(MATLAB.len() as u64).read_to_end(&mut head)?;
    let is_by_row = head != MATLAB;
    let file = read(source)?;
    if file.file_size() < file.superblock().eof_address {
        return Err(KIND.damaged("it is cut off"));
    }
    let mut found = DataSets { is_by_row, ..DataSets::default() };
    found.add(&file.root(), "", DEPTH)?;
    let (names, sets) = columns_of_log(KIND, found.sets, part)?;
    Ok((names, Arc::new(Hdf5Table { file: source.clone(), sets, is_by_row })))
}

/// Vectors and matrices of numbers.
#[derive(Default)]
struct DataSets {
    sets: Vec<Array>,
    objects: usize,
    is_by_row: bool,
}

impl DataSets {
    /// Those of a group, and of the groups in it.
    fn add(&mut self, group: &Group, path: &str, depth: usize) -> Result<(), TableError> {
        for (name, set) in group.iter_datasets().map_err(unreadable)? {
            self.count()?;
            let is_number = element(&set).is_some() && (self.is_by_row || is_matlab_number(&set)?);
            let shape = set.shape().map_err(unreadable)?.into_iter();
            let mut size: Vec<usize> =
                shape.map(|side| usize::try_from(side).unwrap_or(usize::MAX)).collect();
            if !self.is_by_row {
                size.reverse();
            }
            if is_number {
                self.sets.push(Array { name: format!("{path}{name}"), size, numbers: None });
            }
        }
        if depth == 0 {
            return Ok(());
        }
        for (name, inner) in group.iter_groups().map_err(unreadable)? {
            self.count()?;
            // What MATLAB refers to from cells and objects.
            if !name.starts_with('#') {
                self.add(&inner, &format!("{path}{name}/"), depth - 1)?;
            }
        }
        Ok(())
    }

    fn count(&mut self) -> Result<(), TableError> {
        self.objects += 1;
        match self.objects <= OBJECTS {
            true => Ok(()),
            false => Err(KIND.unsupported(format!("more than {OBJECTS} groups and data sets"))),
        }
    }
}

/// Whether a data set of MATLAB is a matrix of numbers: texts are data sets of numbers, too, and of an empty
/// matrix the sides are the numbers.
fn is_matlab_number(set: &Dataset) -> Result<bool, TableError> {
    let attributes = set.attrs().map_err(unreadable)?;
    let class = attributes.get("MATLAB_class").and_then(AttrValue::as_str);
    Ok(!attributes.contains_key("MATLAB_empty") && class.is_none_or(|it| CLASSES.contains(&it)))
}

/// Its numbers and the order of their bytes; `None` for what is none, or none of the usual ones.
fn element(set: &Dataset) -> Option<(Element, bool)> {
    const HALF: FloatingPointLayout = FloatingPointLayout {
        bit_offset: 0,
        bit_precision: 16,
        exponent_location: 10,
        exponent_size: 5,
        mantissa_location: 0,
        mantissa_size: 10,
        exponent_bias: 15,
    };
    let (element, byte_order) = match set.datatype().ok()? {
        Datatype::FixedPoint { size: size @ (1 | 2 | 4 | 8), byte_order, layout } => {
            let is_whole = layout.bit_offset == 0 && u32::from(layout.bit_precision) == 8 * size;
            let kind = if layout.signed { Element::Signed } else { Element::Unsigned };
            (is_whole.then_some(kind(size as u8))?, byte_order)
        }
        Datatype::FloatingPoint { size, byte_order, layout } => {
            let element = match (size, layout) {
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
    fn rows(
        self: Arc<Self>,
        parts: Range<usize>,
        unpacked: Unpacked,
    ) -> Result<RowStream, TableError> {
        let file = read(&self.file)?;
        let limit = ANY.saturating_add(file.file_size().saturating_mul(RATIO));
        let mut left = limit.min(budget::IN_MEMORY);
        let read = |array: &Array| {
            let path = &array.name;
            let set = file.dataset(path).map_err(unreadable)?;
            let changed = || KIND.damaged(format!("`{path}` is not what it was"));
            let (element, is_little) = element(&set).ok_or_else(changed)?;
            let bytes_of = |sides: &[u64]| {
                let size = element.size() as u64;
                sides.iter().fold(size, |all, &side| all.saturating_mul(side))
            };
            let bytes = bytes_of(&set.shape().map_err(unreadable)?);
            let piece = bytes_of(&set.chunk_shape().map_err(unreadable)?.unwrap_or_default());
            budget::within(KIND, format_args!("`{path}`"), bytes.max(piece), left)?;
            left -= bytes;
            let bytes = Arc::new(set.read_raw().map_err(unreadable)?);
            let range = 0..bytes.len();
            let is_by_row = self.is_by_row;
            let numbers = Some(ArrayNumbers { bytes, range, element, is_little, is_by_row });
            Ok(Array { numbers, ..array.clone() })
        };
        let mut arrays = self.sets.iter().map(read).collect::<Result<Vec<_>, TableError>>()?;
        arrays.retain(Array::is_filled);
        Arc::new(ArrayRows(arrays)).rows(parts, unpacked)
    }
}

/// The error of what the reader refuses.
fn read(file: &FileSource) -> Result<hdf5_pure::File, TableError> {
    let source = ReadSeekSource::new(file.open()?).map_err(Error::Format).map_err(unreadable)?;
    hdf5_pure::File::from_source(source).map_err(unreadable)
}

fn unreadable(error: Error) -> TableError {
    use FormatError::{
        InvalidLayoutVersion, UnsupportedExternalStorage, UnsupportedFilter, UnsupportedVersion,
        UnsupportedVirtualLayout,
    };
    match error {
        Error::Io(error) => KIND.unread(error, "it is cut off"),
        // Of a version that is newer than the reader.
        Error::Format(
            error @ (InvalidLayoutVersion(_)
            | UnsupportedExternalStorage
            | UnsupportedFilter(_)
            | UnsupportedVersion(_)
            | UnsupportedVirtualLayout),
        ) => KIND.unsupported(error.to_string()),
        error => KIND.damaged(error.to_string()),
    }
}
