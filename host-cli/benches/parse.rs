//! Parses a training file of the paper's size on one thread. Baselines: the csv crate with `str::parse`,
//! csv-core with fast-float2, and the lower bound of reading the file and finding its line ends. The wrench
//! has the digits of the lab's files, or all digits of a double.
//!
//! `cargo bench -p shellcal --bench parse` prints the results of divan, then a table of ratios for each kind of
//! file, measured in alternating rounds, so that other load on the machine affects all methods equally; the best
//! times are compared, because other load disturbed them least. The environment variable `SHELLCAL_INSTRUCTIONS`
//! (`avx512`, `avx2`, `neon`, `none`) selects the vector instructions of shellcal.

#![expect(clippy::print_stdout, reason = "a benchmark prints its figures")]

use std::fmt::Write as _;
use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::LazyLock;
use std::time::Instant;

use divan::counter::BytesCount;
use divan::{Bencher, black_box};
use log_file::{Log, LogError, Mapping, ReadOptions, Wanted};
use system_tests::random::Random;

/// Rows of the paper's training set.
const ROWS: usize = 77_522;

/// Time, eight sensors and six wrench columns.
const COLUMNS: usize = 15;

const ROUNDS: usize = 31;

static TWELVE_DIGITS: LazyLock<tempfile::NamedTempFile> =
    LazyLock::new(|| training_file(twelve_digits));
static ALL_DIGITS: LazyLock<tempfile::NamedTempFile> = LazyLock::new(|| training_file(all_digits));

type ParseMethod = (&'static str, fn(&Path) -> f64);

const WAYS: [ParseMethod; 6] = [
    ("shellcal", shellcal_reader),
    ("csv-core + fast-float2", csv_core_fast_float),
    ("csv ByteRecord + str::parse", csv_byte_record),
    ("csv StringRecord + str::parse", csv_string_record),
    ("shellcal with checksum", shellcal_with_checksum),
    ("floor: read, find newlines", floor),
];

fn main() {
    divan::main();
    // `cargo test --benches` runs this too, without measurements.
    if std::env::args().any(|arg| arg == "--bench") {
        print_ratios("twelve digits", TWELVE_DIGITS.path());
        print_ratios("all digits", ALL_DIGITS.path());
    }
}

#[divan::bench(args = WAYS.map(|(name, _)| name), sample_count = 20, sample_size = 1)]
fn parse_twelve_digits(bencher: Bencher<'_, '_>, name: &str) {
    measure(bencher, name, TWELVE_DIGITS.path());
}

#[divan::bench(args = WAYS.map(|(name, _)| name), sample_count = 20, sample_size = 1)]
fn parse_all_digits(bencher: Bencher<'_, '_>, name: &str) {
    measure(bencher, name, ALL_DIGITS.path());
}

fn measure(bencher: Bencher<'_, '_>, name: &str, path: &Path) {
    let (_, way) =
        WAYS[WAYS.iter().position(|(n, _)| *n == name).expect("an argument given above")];
    let bytes = std::fs::metadata(path).expect("the file was just written").len();
    bencher.counter(BytesCount::new(bytes)).bench_local(|| black_box(way(path)));
}

fn print_ratios(digits: &str, path: &Path) {
    let bytes = std::fs::metadata(path).expect("the file was just written").len();
    let mut times = vec![Vec::with_capacity(ROUNDS); WAYS.len()];
    for _ in 0..ROUNDS {
        for ((_, way), times) in WAYS.iter().zip(&mut times) {
            let start = Instant::now();
            black_box(way(path));
            times.push(start.elapsed());
        }
    }
    times.iter_mut().for_each(|times| times.sort_unstable());
    let best: Vec<f64> = times.iter().map(|times| times[0].as_secs_f64()).collect();
    println!(
        "\n{ROWS} rows × {COLUMNS} columns, {digits}, {bytes} bytes, one thread, {ROUNDS} rounds"
    );
    println!(
        "{:<32}{:>10}{:>10}{:>10}{:>20}",
        "", "best ms", "median ms", "MB/s", "best / shellcal's"
    );
    for ((name, _), times) in WAYS.iter().zip(&times) {
        let (best_s, median_s) = (times[0].as_secs_f64(), times[ROUNDS / 2].as_secs_f64());
        let megabytes = bytes as f64 / 1e6 / best_s;
        let (best_ms, median_ms, ratio) = (best_s * 1e3, median_s * 1e3, best_s / best[0]);
        println!("{name:<32}{best_ms:>10.2}{median_ms:>10.2}{megabytes:>10.0}{ratio:>20.2}");
    }
}

/// Reads all columns with the library. The sum prevents the optimiser from removing the work, and shows
/// that all methods read the same numbers.
fn shellcal_reader(path: &Path) -> f64 {
    read_with(path, ReadOptions { threads: 1, ..ReadOptions::default() })
}

fn shellcal_with_checksum(path: &Path) -> f64 {
    read_with(path, ReadOptions { threads: 1, checksum: true, ..ReadOptions::default() })
}

fn read_with(path: &Path, options: ReadOptions<'_>) -> f64 {
    let log = Log::open(path, &Mapping::default()).expect("a training file");
    let wanted = Wanted { time: true, readings: true, wrench: true, ..Wanted::default() };
    let mut last = 0.0;
    let summary = log.read(
        &wanted,
        &options,
        |block| black_box(block).wrench[5].last().copied().unwrap_or_default(),
        |z| {
            last = z;
            Ok::<(), LogError>(())
        },
    );
    assert_eq!(summary.expect("rows that are right").rows, ROWS as u64);
    last
}

/// The fastest known combination of crates.
fn csv_core_fast_float(path: &Path) -> f64 {
    use csv_core::ReadRecordResult::{End, InputEmpty, OutputEndsFull, OutputFull, Record};

    let mut file = File::open(path).expect("a file");
    let mut columns = vec![Vec::<f64>::new(); COLUMNS];
    let mut reader = csv_core::Reader::new();
    let (mut text, mut fields, mut ends) = (vec![0; 1 << 16], vec![0; 1 << 10], [0; COLUMNS + 1]);
    let (mut written, mut count) = (0, 0);
    loop {
        let read = file.read(&mut text).expect("a file");
        let mut rest = &text[..read];
        loop {
            let (found, taken, bytes, new) =
                reader.read_record(rest, &mut fields[written..], &mut ends[count..]);
            (rest, written, count) = (&rest[taken..], written + bytes, count + new);
            match found {
                InputEmpty => break,
                End => return black_box(&columns)[COLUMNS - 1].last().copied().unwrap_or_default(),
                OutputFull | OutputEndsFull => panic!("a long row"),
                Record => {
                    let mut start = 0;
                    for (column, &end) in columns.iter_mut().zip(&ends[..count]) {
                        column.push(fast_float2::parse(&fields[start..end]).expect("a number"));
                        start = end;
                    }
                    (written, count) = (0, 0);
                }
            }
        }
    }
}

fn csv_byte_record(path: &Path) -> f64 {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_path(path).expect("a file");
    let mut columns = vec![Vec::<f64>::new(); COLUMNS];
    let mut record = csv::ByteRecord::new();
    while reader.read_byte_record(&mut record).expect("rows that are right") {
        for (column, field) in columns.iter_mut().zip(&record) {
            let text = std::str::from_utf8(field).expect("ASCII");
            column.push(text.parse().expect("a number"));
        }
    }
    black_box(&columns)[COLUMNS - 1].last().copied().unwrap_or_default()
}

fn csv_string_record(path: &Path) -> f64 {
    let mut reader = csv::ReaderBuilder::new().has_headers(false).from_path(path).expect("a file");
    let mut columns = vec![Vec::<f64>::new(); COLUMNS];
    let mut record = csv::StringRecord::new();
    while reader.read_record(&mut record).expect("rows that are right") {
        for (column, field) in columns.iter_mut().zip(&record) {
            column.push(field.parse().expect("a number"));
        }
    }
    black_box(&columns)[COLUMNS - 1].last().copied().unwrap_or_default()
}

fn floor(path: &Path) -> f64 {
    let mut file = File::open(path).expect("a file");
    let mut buffer = vec![0; 1 << 18];
    let mut lines = 0;
    loop {
        let read = file.read(&mut buffer).expect("a file");
        if read == 0 {
            return lines as f64;
        }
        lines += memchr::memchr_iter(b'\n', &buffer[..read]).count();
    }
}

/// Twelve significant digits, as in the lab's files.
fn twelve_digits(text: &mut String, value: f64) {
    let decimals = 11 - value.abs().log10().floor() as i32;
    write!(text, "{value:.*}", decimals as usize).expect("a string");
}

/// Shortest text that reads back as this number, as most programs write doubles: 15 to 17 digits.
fn all_digits(text: &mut String, value: f64) {
    write!(text, "{value}").expect("a string");
}

/// Writes rows in the style of the lab's training files: `1425168310.852012,1482,…,-0.0630686291217`.
fn training_file(write_number: fn(&mut String, f64)) -> tempfile::NamedTempFile {
    let mut random = Random(1);
    let mut text = String::new();
    for row in 0..ROWS {
        write!(text, "{:.6}", 1_425_168_310.852 + row as f64 * 0.002).expect("a string");
        for _ in 0..8 {
            write!(text, ",{}", 900 + (random.unit() * 1200.0) as u32).expect("a string");
        }
        for scale in [0.5, 0.5, 4.0, 0.3, 0.3, 0.3] {
            text.push(',');
            write_number(&mut text, (random.unit() - 0.5) * scale);
        }
        text.push('\n');
    }
    let file = tempfile::Builder::new().suffix(".csv").tempfile().expect("a writable directory");
    std::fs::write(file.path(), text).expect("room for the file");
    file
}
