//! A file that pyarrow 26 wrote, with `write_page_checksum=True`: 24 rows of a number, a decimal, a list, and a
//! number in two structs, of which the outer one is null in every third row.

#![allow(clippy::disallowed_methods, reason = "tests read files")]

use std::io::Read;
use std::path::Path;

use table_file::{FileKind, FileSource, Table};

fn text(path: &Path) -> Result<String, String> {
    let file = FileSource::Disk(path.to_owned());
    let table = Table::open(&file, FileKind::Parquet, None).map_err(|error| error.to_string())?;
    let mut text = String::new();
    let mut stream = table.text(1).map_err(|error| error.to_string())?;
    stream.read_to_string(&mut text).map_err(|error| error.to_string())?;
    Ok(text)
}

fn nested() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/nested.parquet")
}

#[test]
fn decimals_and_lists_are_refused_by_name_and_null_structs_are_missing() {
    let table = Table::open(&FileSource::Disk(nested()), FileKind::Parquet, None).unwrap();
    let names = ["t_s", "price", "tags.list.element", "wrench.force.x"];
    assert_eq!(table.names.clone().unwrap(), names);
    for (column, what) in [(1, "decimal"), (2, "list")] {
        let said = table.check_is_read(column).unwrap_err().to_string();
        assert!(said.contains(names[column]) && said.contains(what), "{said}");
    }
    assert!(table.check_is_read(0).is_ok() && table.check_is_read(3).is_ok());
    let row = |row: u32| {
        let force = if row % 3 == 2 { String::new() } else { row.to_string() };
        format!("{},,,{force}\n", f64::from(row) / 100.0)
    };
    let expected: String = (0..24).map(row).collect();
    assert_eq!(text(&nested()).unwrap(), format!("{}\n{expected}", names.join(",")));
}

#[test]
fn no_bit_of_a_page_can_change_unnoticed() {
    let expected = text(&nested()).unwrap();
    let bytes = std::fs::read(nested()).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("flipped.parquet");
    // The footer, which has no checksum, begins where its length at the end of the file says.
    let (_, end) = bytes.split_at(bytes.len() - 8);
    let footer = u32::from_le_bytes([end[0], end[1], end[2], end[3]]) as usize + 8;
    let mut refused = 0;
    for bit in 8 * 4..8 * (bytes.len() - footer) {
        let mut flipped = bytes.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        std::fs::write(&path, flipped).unwrap();
        match text(&path) {
            Ok(found) => assert_eq!(found, expected, "bit {bit}"),
            Err(_) => refused += 1,
        }
    }
    assert!(refused > 1000, "{refused}");
}
