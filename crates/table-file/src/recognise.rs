//! Recognising the format of a file from its first bytes.

use crate::kind::FileKind;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recognised {
    Table(FileKind),
    /// A known format that is not supported: its name with an article, and advice on converting the file.
    Foreign {
        what: &'static str,
        remedy: &'static str,
    },
    /// Text, possibly compressed, or an unknown format.
    Unknown,
}

/// Number of bytes at the start of a file that [`recognise`] examines.
pub const RECOGNISED_BYTES: usize = 2048;

const EXPORT: &str = "export the table as CSV or Parquet";
const AS_XLSX: &str = "save it as .xlsx or CSV";
const UNPACK: &str = "unpack it, or compress with gzip or zstd";
const ARROW: &str = "an Arrow or Feather file";
const AS_PARQUET: &str = "write Parquet instead, in Python with `df.to_parquet(…)`";
const NETCDF: &str = "a netCDF-3 file";
const AS_NETCDF_4: &str = "write netCDF-4, which is HDF5: `nccopy -k nc4 OLD NEW`";
const R_DATA: &str = "an R data file";
const AS_CSV_IN_R: &str = "write it as CSV: in R `write.csv(TABLE, 'log.csv', row.names = FALSE)`";
const DECODE: &str =
    "write its signals as CSV: in Python `asammdf` or `cantools`, with the DBC of the sensor";
const NO_TABLE: &str = "give the table that it was made of";

/// Signature of HDF5 at 0 or a power of two from 512 ("HDF5 File Format Specification Version 3.0", section II.A).
const HDF5: &[u8] = b"\x89HDF\r\n\x1a\n";

/// Unsupported formats: their first bytes, names, and advice on converting them.
const FOREIGN: [(&[u8], &str, &str); 30] = [
    (b"ARROW1", ARROW, AS_PARQUET),
    (b"FEA1", ARROW, AS_PARQUET),
    (b"\xd0\xcf\x11\xe0\xa1\xb1\x1a\xe1", "an old Excel or Office file", AS_XLSX),
    (b"CDF\x01", NETCDF, AS_NETCDF_4),
    (b"CDF\x02", NETCDF, AS_NETCDF_4),
    (b"CDF\x05", NETCDF, AS_NETCDF_4),
    (b"X\n\0\0\0", R_DATA, AS_CSV_IN_R),
    (b"RDX", R_DATA, AS_CSV_IN_R),
    (b"ULog\x01\x12\x35", "a PX4 ULog file", EXPORT),
    (
        b"MDF ",
        "an MDF measurement file",
        "write it as CSV: in Python `asammdf.MDF(FILE).export('csv', single_time_base=True)`",
    ),
    (b"LOGG\x90\0\0\0", "a recording of a CAN bus (BLF)", DECODE),
    (b"<?xml", "an XML document", EXPORT),
    (b"<!DOCTYPE", "an HTML page", EXPORT),
    (b"<html", "an HTML page", EXPORT),
    (b"TDSh", "the index of a TDMS file", "give the file beside it that ends in `.tdms`"),
    (b"\x80\x02", "a Python pickle", EXPORT),
    (b"\x80\x03", "a Python pickle", EXPORT),
    (b"\x80\x04\x95", "a Python pickle", EXPORT),
    (b"\x80\x05\x95", "a Python pickle", EXPORT),
    (b"Obj\x01", "an Avro file", EXPORT),
    (b"ORC", "an ORC file", EXPORT),
    (b"\xfd7zXZ\0", "compressed with xz", UNPACK),
    (b"BZh", "compressed with bzip2", UNPACK),
    (b"\x04\x22\x4d\x18", "compressed with lz4", UNPACK),
    (b"7z\xbc\xaf\x27\x1c", "a 7z archive", UNPACK),
    (b"Rar!\x1a\x07", "a RAR archive", UNPACK),
    (b"%PDF-", "a PDF document", NO_TABLE),
    (b"\x89PNG\r\n\x1a\n", "a PNG picture", NO_TABLE),
    (b"\xff\xd8\xff", "a JPEG picture", NO_TABLE),
    (b"\x7fELF", "a program", NO_TABLE),
];

/// Recognises a file from its first [`RECOGNISED_BYTES`], or all bytes of a shorter file.
pub fn recognise(head: &[u8]) -> Recognised {
    if head.starts_with(b"MATLAB 5.0 MAT-file")
        || matches!(head.get(124..128), Some([0, 1, b'I', b'M'] | [1, 0, b'M', b'I']))
    {
        return Recognised::Table(FileKind::Matlab);
    }
    // Another program's header may precede it, as in MATLAB files.
    if [0, 512, 1024].iter().any(|&at| head.get(at..).is_some_and(|it| it.starts_with(HDF5))) {
        return Recognised::Table(FileKind::Hdf5);
    }
    let foreign = |what, remedy| Recognised::Foreign { what, remedy };
    match head {
        [b'X', b'D', b'F', b':', ..] => return Recognised::Table(FileKind::Xdf),
        [b'P', b'A', b'R', b'1', ..] => return Recognised::Table(FileKind::Parquet),
        [b'\x93', b'N', b'U', b'M', b'P', b'Y', ..] => return Recognised::Table(FileKind::NumPy),
        [b'\x89', b'M', b'C', b'A', b'P', b'0', ..] => return Recognised::Table(FileKind::Mcap),
        [b'T', b'D', b'S', b'm', ..] => return Recognised::Table(FileKind::Tdms),
        _ if head.starts_with(b"#ROSBAG V") => return Recognised::Table(FileKind::Rosbag),
        _ if head.starts_with(b"SQLite format 3\0") => return Recognised::Table(FileKind::Sqlite),
        // C3D: number of the parameter block, a key, and the block's byte order ("The C3D File Format User Guide").
        [2..=9, 0x50, ..] => {
            let remedy = "write its force plates as CSV, with `ezc3d` in Python or Mokka";
            return foreign("a C3D motion capture file", remedy);
        }
        // An Arrow stream begins with a continuation marker and the length of the first message.
        [0xff, 0xff, 0xff, 0xff, _, _, ..16, 0, ..] => return foreign(ARROW, AS_PARQUET),
        [b'P', b'K', 3, 4, ..] => return archive(head),
        _ if is_matlab_4(head) => {
            let remedy =
                "save it in MATLAB with `save(…, '-v7')`, or in Python with `scipy.io.savemat`";
            return foreign("a MATLAB 4 file", remedy);
        }
        _ => {}
    }
    if let Some((what, remedy)) = text_document(head) {
        return foreign(what, remedy);
    }
    let found = FOREIGN.iter().find(|(start, ..)| head.starts_with(start));
    found.map_or(Recognised::Unknown, |&(_, what, remedy)| foreign(what, remedy))
}

/// Recognises texts that are not tables; returns the format's name, and advice on converting the file.
fn text_document(head: &[u8]) -> Option<(&'static str, &'static str)> {
    let rest = |text: &'static [u8]| head.trim_ascii_start().strip_prefix(text);
    if rest(b"[").is_some_and(|rest| rest.trim_ascii_start().starts_with(b"{")) {
        return Some((
            "a list in JSON",
            "write one object per line: `jq -c '.[]' FILE > log.jsonl`",
        ));
    }
    if rest(b"<?xml").is_some() && head.windows(9).any(|part| part == b"<FTSensor") {
        return Some(("a calibration of an ATI sensor", "use it with `shellcal import`"));
    }
    let first = head.split(|&byte| byte == b'\n').next().and_then(|line| str::from_utf8(line).ok());
    let frame = first.and_then(|line| line.strip_prefix('(')?.split_once(") "));
    if frame.is_some_and(|(time, rest)| time.parse::<f64>().is_ok() && rest.contains('#')) {
        return Some(("a log of a CAN bus (candump)", DECODE));
    }
    let is_echo = rest(b"header:").is_some_and(|rest| rest.trim_ascii_start().starts_with(b"s"));
    is_echo.then_some((
        "YAML of messages as ROS prints them",
        "print them as CSV: `ros2 topic echo --csv TOPIC`, or in ROS 1 `rostopic echo -p TOPIC`",
    ))
}

/// Returns true for a MATLAB level 4 matrix, which has no signature: five integers (type, rows, columns, imaginary
/// flag, length of the name) and a name that ends with a zero ("MAT-File Format", MathWorks, chapter 2).
fn is_matlab_4(head: &[u8]) -> bool {
    let Some((header, name)) = head.split_first_chunk::<20>() else { return false };
    let word = |at: usize| [header[at], header[at + 1], header[at + 2], header[at + 3]];
    // The thousands digit of the type is the byte order.
    type Order = fn([u8; 4]) -> u32;
    let orders = [(u32::from_le_bytes as Order, 0), (u32::from_be_bytes as Order, 1)];
    orders.into_iter().any(|(read, machine)| {
        let [kind, rows, columns, imaginary, length] = [0, 4, 8, 12, 16].map(|at| read(word(at)));
        let name =
            (length as usize).checked_sub(1).and_then(|last| name.get(..=last)?.split_last());
        let is_name = |(end, name): (&u8, &[u8])| {
            *end == 0 && !name.is_empty() && name.iter().all(u8::is_ascii_graphic)
        };
        kind / 100 == 10 * machine
            && (kind / 10 % 10 <= 5 && kind % 10 <= 2)
            && (rows > 0 && columns > 0 && imaginary <= 1)
            && name.is_some_and(is_name)
    })
}

/// Recognises a zip archive by the name of its first file and the bytes after it.
fn archive(head: &[u8]) -> Recognised {
    let has = |name: &[u8]| head.windows(name.len()).any(|window| window == name);
    let foreign = |what, remedy| Recognised::Foreign { what, remedy };
    if has(b"opendocument.spreadsheet") {
        Recognised::Table(FileKind::Ods)
    } else if has(b"xl/workbook.bin") {
        foreign("a binary Excel workbook (.xlsb)", AS_XLSX)
    } else if has(b"[Content_Types].xml") || has(b"xl/") || has(b"_rels/.rels") || has(b"docProps/")
    {
        Recognised::Table(FileKind::Xlsx)
    } else if has(b".npy") {
        foreign("an archive of NumPy arrays (.npz)", "save the table with `numpy.save` as .npy")
    } else {
        foreign("a zip archive", UNPACK)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_known_by_how_they_begin() {
        use Recognised::{Table, Unknown};
        let mut untitled = vec![b' '; 124];
        untitled.extend([0, 1, b'I', b'M']);
        for (head, expected) in [
            (&b"PAR1\x15"[..], Table(FileKind::Parquet)),
            (b"\x93NUMPY\x01\0", Table(FileKind::NumPy)),
            (b"\x89MCAP0\r\n", Table(FileKind::Mcap)),
            (b"\x89HDF\r\n\x1a\n\0", Table(FileKind::Hdf5)),
            (&[&[b' '; 512][..], HDF5].concat(), Table(FileKind::Hdf5)),
            (b"MATLAB 5.0 MAT-file, ", Table(FileKind::Matlab)),
            (b"SQLite format 3\0", Table(FileKind::Sqlite)),
            (b"#ROSBAG V2.0\n", Table(FileKind::Rosbag)),
            (b"TDSm\x0e\0\0\0", Table(FileKind::Tdms)),
            (&untitled, Table(FileKind::Matlab)),
            (b"PK\x03\x04....[Content_Types].xml", Table(FileKind::Xlsx)),
            (b"t_s,s1,s2\n", Unknown),
            (b"\x1f\x8b\x08", Unknown),
            (&[0; 64], Unknown),
            (b"", Unknown),
        ] {
            assert_eq!(recognise(head), expected, "{head:?}");
        }
        for (head, expected) in [
            (&b"ARROW1\0\0"[..], "an Arrow or Feather file"),
            (b"FEA1", "an Arrow or Feather file"),
            (b"\xff\xff\xff\xff\x10\x02\0\0", "an Arrow or Feather file"),
            (b"PK\x03\x04....arr_0.npy", "an archive of NumPy arrays (.npz)"),
            (b"PK\x03\x04....notes.txt", "a zip archive"),
            (b"CDF\x02\0\0", "a netCDF-3 file"),
            (b"\x02\x50\x06\0", "a C3D motion capture file"),
            // `scipy.io.savemat(…, {"xy": …}, format="4")` with 3 by 2 numbers, and its big-endian equivalent.
            (b"\0\0\0\0\x03\0\0\0\x02\0\0\0\0\0\0\0\x03\0\0\0xy\0\0", "a MATLAB 4 file"),
            (b"\0\0\x03\xe8\0\0\0\x03\0\0\0\x02\0\0\0\0\0\0\0\x03xy\0@", "a MATLAB 4 file"),
        ] {
            let Recognised::Foreign { what, .. } = recognise(head) else { panic!("{expected}") };
            assert_eq!(what, expected);
        }
    }
}
