//! Files written by h5py 3.16, with damage that the HDF5 library refuses ("HDF5 File Format Specification
//! Version 3.0", section III.A.1: nodes of a version 1 B-tree).

#![allow(
    clippy::disallowed_methods,
    clippy::disallowed_types,
    clippy::unwrap_used,
    reason = "tests read files, run themselves, and may panic"
)]

use std::path::Path;

use shell_data::random::{Purpose, RandomStream};
use table_file::{FileKind, FileSource, Table, TableError, TablePart, WantedColumn};

fn read(bytes: Vec<u8>) -> Result<TablePart, TableError> {
    let table = Table::open(&FileSource::Memory(bytes.into()), FileKind::Hdf5, None)?;
    let wanted = (0..table.width()).map(|at| WantedColumn { at, is_text: false });
    let mut part = TablePart::default();
    table.rows(wanted.collect(), 1)?.next(1000, &mut part)?;
    Ok(part)
}

fn seeds() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../log-file/fuzz/seeds/hdf5"))
}

#[test]
fn a_piece_that_is_not_on_the_grid_of_its_data_set_is_refused() {
    for name in ["chunked.h5", "gzip.h5"] {
        let bytes = std::fs::read(seeds().join(name)).unwrap();
        assert_eq!(read(bytes.clone()).unwrap().rows, 24, "{name}");
        // Nodes of chunks: 24 bytes of header, size and filter mask of the first chunk, then its offset.
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

/// The checksum of HDF5's headers: Bob Jenkins's hash of 2006 (lookup3, `hashlittle` from 0).
fn lookup3(bytes: &[u8]) -> u32 {
    let [mut a, mut b, mut c] = [0xdead_beef_u32.wrapping_add(bytes.len() as u32); 3];
    let mut blocks = bytes.chunks(12).peekable();
    while let Some(block) = blocks.next() {
        let mut full = [0; 12];
        full[..block.len()].copy_from_slice(block);
        let word = |at: usize| u32::from_le_bytes(full[at..at + 4].try_into().expect("four bytes"));
        a = a.wrapping_add(word(0));
        b = b.wrapping_add(word(4));
        c = c.wrapping_add(word(8));
        // The three words take turns.
        if blocks.peek().is_some() {
            for bits in [4, 6, 8, 16, 19, 4] {
                a = a.wrapping_sub(c) ^ c.rotate_left(bits);
                c = c.wrapping_add(b);
                (a, b, c) = (b, c, a);
            }
        } else {
            for bits in [14, 11, 25, 16, 4, 14, 24] {
                c = (c ^ b).wrapping_sub(b.rotate_left(bits));
                (a, b, c) = (b, c, a);
            }
            return b;
        }
    }
    c
}

/// Object headers of version 2 that end with a checksum: their extents, with it.
fn sealed(bytes: &[u8]) -> Vec<std::ops::Range<usize>> {
    let starts = (0..bytes.len()).filter(|&at| bytes[at..].starts_with(b"OHDR\x02"));
    let end = |start: usize| {
        let flags = *bytes.get(start + 5)?;
        let times = if flags & 0x20 != 0 { 16 } else { 0 };
        let phases = if flags & 0x10 != 0 { 4 } else { 0 };
        let (head, width) = (start + 6 + times + phases, 1 << (flags & 3));
        let size = bytes.get(head..head + width)?.iter().rev();
        let size = size.fold(0, |size: usize, byte| size << 8 | usize::from(*byte));
        let end = head + width + size + 4;
        (size < bytes.len() && end <= bytes.len()).then_some(start..end)
    };
    starts.filter_map(end).collect()
}

/// A file with one to three numbers of its headers changed, and right checksums.
fn misstated(seed: &[u8], random: &mut RandomStream) -> Vec<u8> {
    let mut bytes = seed.to_vec();
    let headers = sealed(&bytes);
    let mut below = |bound: usize| (random.uniform() * bound as f64) as usize;
    for _ in 0..=below(3) {
        let within = match headers.len() {
            count @ 1.. if below(5) > 0 => headers[below(count)].clone(),
            _ => 0..bytes.len(),
        };
        let at = within.start + below(within.len() - 8);
        let width = [1, 2, 4, 8][below(4)];
        let number = match below(4) {
            0 => u64::MAX,
            1 => 1,
            _ => 1 << below(8 * width),
        };
        bytes[at..at + width].copy_from_slice(&number.to_le_bytes()[..width]);
    }
    for header in headers {
        let (content, checksum) = bytes[header].split_last_chunk_mut::<4>().expect("a checksum");
        *checksum = lookup3(content).to_le_bytes();
    }
    bytes
}

/// A file whose vectors claim 2²⁴ one-byte rows in chunks of one row. A list of the chunks would take 5.7 GB.
fn in_tiny_chunks(seed: &[u8]) -> Vec<u8> {
    const FLOATS: [u8; 8] = [0x11, 0x20, 0x3f, 0, 8, 0, 0, 0];
    const BYTES: [u8; 12] = [0x10, 0, 0, 0, 1, 0, 0, 0, 0, 0, 8, 0];
    // A layout of version 4 in chunks: flags, two sides of one byte each, an array of fixed length as index.
    const LAYOUT: [u8; 5] = [4, 2, 0, 2, 1];
    let mut bytes = seed.to_vec();
    for header in sealed(seed) {
        let (content, checksum) = bytes[header].split_last_chunk_mut::<4>().expect("a checksum");
        let at = |wanted: &[u8]| content.windows(wanted.len()).position(|part| part == wanted);
        let places = (at(&24_u64.to_le_bytes()), at(&FLOATS), at(&LAYOUT));
        if let (Some(rows), Some(kind), Some(layout)) = places {
            content[rows..rows + 8].copy_from_slice(&(1_u64 << 24).to_le_bytes());
            content[kind..kind + 12].copy_from_slice(&BYTES);
            let sides = layout + LAYOUT.len();
            content[sides..sides + 3].copy_from_slice(&[1, 1, 2]);
            content[sides + 3..sides + 11].copy_from_slice(&512_u64.to_le_bytes());
            *checksum = lookup3(content).to_le_bytes();
        }
    }
    bytes
}

/// The environment variable that is set in the process that reads under a limit.
const IS_LIMITED: &str = "SHELLCAL_TEST_IS_LIMITED";

/// Half of the memory that the documentation allows, KiB. Taking more ends the process.
const LIMIT_KIB: u32 = 128 << 10;

fn setting(name: &str) -> Option<u64> {
    std::env::var(name).ok().and_then(|text| text.parse().ok())
}

#[cfg(target_os = "linux")]
#[test]
fn sizes_that_a_header_claims_take_no_memory_that_the_file_does_not_fill() {
    if std::env::var_os(IS_LIMITED).is_none() {
        let limited = format!("ulimit -d {LIMIT_KIB}; exec \"$0\" \"$@\"");
        let test = "sizes_that_a_header_claims_take_no_memory_that_the_file_does_not_fill";
        let run = std::process::Command::new("sh")
            .args(["-c", &limited])
            .arg(std::env::current_exe().unwrap())
            .args(["--exact", test, "--nocapture"])
            .env(IS_LIMITED, "1")
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&run.stdout);
        assert!(run.status.success(), "{}: {:?}", run.status, said.lines().last());
        return;
    }
    let files = std::fs::read_dir(seeds()).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<_> = files.map(|path| std::fs::read(path).unwrap()).collect();
    files.sort();
    let headers = files.iter().flat_map(|file| sealed(file).into_iter().map(|at| &file[at]));
    for (content, checksum) in headers.map(|header| header.split_last_chunk::<4>().unwrap()) {
        assert_eq!(lookup3(content).to_le_bytes(), *checksum);
    }
    let error = read(in_tiny_chunks(&std::fs::read(seeds().join("fixed_array.h5")).unwrap()));
    let error = error.unwrap_err().to_string();
    assert!(error.contains("takes 5905580032 bytes, more than"), "{error}");
    let first = setting("SHELLCAL_HOSTILE_SEED").unwrap_or(1);
    let cases = setting("SHELLCAL_HOSTILE_CASES").unwrap_or(10_000);
    let mut refused = 0;
    for seed in first..first + cases {
        println!("seed {seed}");
        let mut random = RandomStream::new(seed, Purpose::Losses, 0);
        let file = &files[(random.uniform() * files.len() as f64) as usize];
        refused += u64::from(read(misstated(file, &mut random)).is_err());
    }
    assert!((cases / 10..cases).contains(&refused), "{refused} of {cases}");
}
