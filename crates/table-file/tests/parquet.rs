//! A file written by pyarrow 26 with `write_page_checksum=True`: 24 rows of a number, a decimal, a list of
//! two, and a number in two nested structs, of which the outer one is null in every third row. A file of several row
//! groups.

#![allow(clippy::disallowed_methods, reason = "tests read files")]

use std::path::Path;

use table_file::write::{Cells, NamedTable};
use table_file::{ColumnPart, FileKind, FileSource, Table, TablePart, WantedColumn};

fn columns(path: &Path) -> Result<TablePart, String> {
    let file = FileSource::Disk(path.to_owned());
    let table = Table::open(&file, FileKind::Parquet, None).map_err(|error| error.to_string())?;
    let wanted = [(0, false), (4, false), (4, true), (3, false), (2, false)];
    let wanted = wanted.map(|(at, is_text)| WantedColumn { at, is_text }).to_vec();
    let mut rows = table.rows(wanted, 1).map_err(|error| error.to_string())?;
    let mut part = TablePart::default();
    rows.next(100, &mut part).map_err(|error| error.to_string())?;
    Ok(part)
}

fn nested() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/nested.parquet")
}

#[test]
fn decimals_are_refused_by_name_lists_are_columns_and_null_structs_are_missing() {
    let table = Table::open(&FileSource::Disk(nested()), FileKind::Parquet, None).unwrap();
    let names = ["t_s", "price", "tags1", "tags2", "wrench.force.x"];
    assert_eq!(table.names().unwrap(), names);
    let said = table.check_is_read(1).unwrap_err().to_string();
    assert!(said.contains("`price`") && said.contains("decimal"), "{said}");
    assert!([0, 2, 3, 4].iter().all(|&column| table.check_is_read(column).is_ok()));
    let part = columns(&nested()).unwrap();
    assert_eq!(part.rows, 24);
    let times = (0..24).map(|row| f64::from(row) / 100.0).collect();
    assert_eq!(part.columns[0], ColumnPart::Numbers { values: times, missing: Vec::new() });
    // The lists are [0, 1], [1, 2], ….
    for (column, first) in [(4, 0), (3, 1)] {
        let values = (first..first + 24).map(f64::from).collect();
        assert_eq!(part.columns[column], ColumnPart::Numbers { values, missing: Vec::new() });
    }
    let ColumnPart::Numbers { values, missing } = &part.columns[1] else { panic!("no numbers") };
    let ColumnPart::Cells(cells) = &part.columns[2] else { panic!("no texts") };
    for row in 0..24_u32 {
        let (at, is_missing) = (row as usize, row % 3 == 2);
        assert_eq!(missing.contains(&at), is_missing);
        assert!(if is_missing { values[at].is_nan() } else { values[at] == f64::from(row) });
        assert_eq!(cells[at].text(), if is_missing { String::new() } else { row.to_string() });
    }
}

#[test]
fn columns_are_the_same_on_any_number_of_threads() {
    let rows = 150_000;
    let column = |at: usize| (0..rows).map(|row| (row * (at + 1)) as f64).collect::<Vec<f64>>();
    let names = ["a", "b", "c", "d", "e"];
    let columns =
        names.iter().enumerate().map(|(at, name)| (*name, Cells::Full(column(at).into())));
    let bytes = NamedTable::new(columns).to_parquet().unwrap();
    let table = Table::open(&FileSource::Memory(bytes.into()), FileKind::Parquet, None).unwrap();
    for threads in [1, 2, 3, 9] {
        let wanted = (0..names.len()).map(|at| WantedColumn { at, is_text: false }).collect();
        let mut stream = table.rows(wanted, threads).unwrap();
        let (mut found, mut part) = (vec![Vec::new(); names.len()], TablePart::default());
        // 7001 is not a multiple of the rows in a group.
        while stream.next(7_001, &mut part).unwrap() {
            for (found, column) in found.iter_mut().zip(&part.columns) {
                let ColumnPart::Numbers { values, .. } = column else { panic!("no numbers") };
                found.extend_from_slice(values);
            }
        }
        assert!(found.iter().enumerate().all(|(at, found)| *found == column(at)), "{threads}");
    }
}

#[test]
fn no_bit_of_a_page_can_change_unnoticed() {
    let shown = |part: TablePart| format!("{part:?}");
    let expected = columns(&nested()).map(shown).unwrap();
    let bytes = std::fs::read(nested()).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("flipped.parquet");
    // The footer has no checksum. Its length is stored at the end of the file.
    let (_, end) = bytes.split_at(bytes.len() - 8);
    let footer = u32::from_le_bytes([end[0], end[1], end[2], end[3]]) as usize + 8;
    let mut refused = 0;
    for bit in 8 * 4..8 * (bytes.len() - footer) {
        let mut flipped = bytes.clone();
        flipped[bit / 8] ^= 1 << (bit % 8);
        std::fs::write(&path, flipped).unwrap();
        match columns(&path).map(shown) {
            Ok(found) => assert_eq!(found, expected, "bit {bit}"),
            Err(_) => refused += 1,
        }
    }
    assert!(refused > 1000, "{refused}");
}
