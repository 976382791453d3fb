//! Files written by h5py 3.16, with damage that the HDF5 library refuses ("HDF5 File Format Specification
//! Version 3.0", section III.A.1: nodes of a version 1 B-tree).

#![allow(clippy::disallowed_methods, reason = "tests read files")]

use std::path::Path;

use table_file::{FileKind, FileSource, Table, TableError, TablePart, WantedColumn};

fn read(bytes: Vec<u8>) -> Result<TablePart, TableError> {
    let table = Table::open(&FileSource::Memory(bytes.into()), FileKind::Hdf5, None)?;
    let wanted = (0..table.width()).map(|at| WantedColumn { at, is_text: false });
    let mut part = TablePart::default();
    table.rows(wanted.collect())?.next(1000, &mut part)?;
    Ok(part)
}

#[test]
fn a_piece_that_is_not_on_the_grid_of_its_data_set_is_refused() {
    let seeds = Path::new(env!("CARGO_MANIFEST_DIR")).join("../log-file/fuzz/seeds/hdf5");
    for name in ["chunked.h5", "gzip.h5"] {
        let bytes = std::fs::read(seeds.join(name)).unwrap();
        assert_eq!(read(bytes.clone()).unwrap().rows, 24, "{name}");
        // Nodes of chunks: a header of 24 bytes, then size and filter mask of the first chunk, then its
        // offset.
        let nodes = (0..bytes.len()).filter(|&at| bytes[at..].starts_with(b"TREE\x01\x00"));
        let places: Vec<usize> = nodes.map(|node| node + 24 + 8).collect();
        assert!(places.len() >= 8, "{name} has {} data sets in pieces", places.len());
        for place in places {
            for bit in 0..64 {
                let mut damaged = bytes.clone();
                damaged[place + bit / 8] ^= 1 << (bit % 8);
                let is_refused = read(damaged).is_err();
                assert!(is_refused, "{name}, bit {bit} of byte {place}");
            }
        }
    }
}
