//! Each format on small files: results are the same for all numbers of threads, chunk sizes, compressions and parsers.

use std::io::Write;
use std::path::Path;

use log_file::{
    ColumnRef, Log, LogError, LogFormat, LogPosition, Mapping, MomentUnit, PlacedProblem,
    ReadOptions, ReadSummary, Wanted,
};
use shell_data::block::Block;

fn file(bytes: &[u8]) -> tempfile::NamedTempFile {
    let mut file = tempfile::NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    file
}

fn open(text: &str) -> (tempfile::NamedTempFile, Log) {
    open_with(text, &Mapping::default())
}

fn open_with(text: &str, mapping: &Mapping) -> (tempfile::NamedTempFile, Log) {
    let file = file(text.as_bytes());
    let log = Log::open(file.path(), mapping).unwrap();
    (file, log)
}

fn all(log: &Log) -> Wanted {
    Wanted {
        time: log.has_time(),
        readings: log.channels() > 0,
        wrench: log.has_wrench(),
        groups: log.has_groups(),
        others: vec![0],
        ..Wanted::default()
    }
}

fn read_with(log: &Log, wanted: &Wanted, options: &ReadOptions<'_>) -> (Block, ReadSummary) {
    let mut whole = Block::default();
    let summary = log
        .read(wanted, options, std::mem::take, |block| append(&mut whole, block))
        .unwrap_or_else(|error| panic!("{error}"));
    (whole, summary)
}

fn read(log: &Log) -> Block {
    read_with(log, &all(log), &ReadOptions::default()).0
}

fn append(whole: &mut Block, block: Block) -> Result<(), LogError> {
    // A block stores the last row of the previous block.
    let last = (whole.rows > 0 && !whole.readings.is_empty())
        .then(|| whole.readings.iter().map(|column| column[whole.rows - 1]).collect::<Vec<_>>());
    assert_eq!(block.readings_before, last);
    whole.rows += block.rows;
    whole.time_s.extend(block.time_s);
    for (columns, more) in [
        (&mut whole.readings, block.readings),
        (&mut whole.wrench, block.wrench),
        (&mut whole.others, block.others),
    ] {
        columns.resize(more.len(), Vec::new());
        columns.iter_mut().zip(more).for_each(|(column, more)| column.extend(more));
    }
    for (label, rows) in block.groups {
        match whole.groups.last_mut() {
            Some((last, count)) if *last == label => *count += rows,
            _ => whole.groups.push((label, rows)),
        }
    }
    Ok(())
}

/// Returns a CSV of many rows with columns of every kind and repeated readings.
fn long_csv(rows: usize) -> String {
    let mut text = String::from("group,t_s,s0,s1,note,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n");
    for row in 0..rows {
        let (a, b) = (1000 + row / 3 % 1000, 2000.0 + (row / 3) as f64 * 0.37);
        let time = row as f64 * 0.01;
        let wrench = (row as f64).sin();
        text += &format!(
            "pose {},{time:.2},{a},{b},x{row},{wrench},{:.12},{:e},-0.5,.25,1.\n",
            row / 70,
            wrench * 0.1,
            wrench * 1e-9
        );
    }
    text
}

#[test]
fn telemetry_has_its_columns_named_by_the_last_header_line() {
    let (_file, log) = open(
        "%  Data file recorded 2015/5/14\n%  A | B\n% Columns: \n\
         % time | Right Leg Pos | GryoY | S1 | S2\n\
         302,51799024,-360,1011,1329\n1303,51799036,-361,1011,1329\n2304,5,-361,1010,1329\n",
    );
    assert_eq!((log.format(), log.channels()), (LogFormat::Telemetry, 2));
    assert!(log.repeats_are_stale());
    let (block, summary) = read_with(&log, &all(&log), &ReadOptions::default());
    assert_eq!((summary.rows, summary.repeated_rows), (3, 1));
    assert_eq!(block.time_s, [302e-6, 1303e-6, 2304e-6]);
    assert_eq!(block.readings, [[1011.0, 1011.0, 1010.0], [1329.0; 3]]);
    assert_eq!(block.others, [[302.0, 1303.0, 2304.0]], "unchanged");
    assert_eq!(log.columns()[2].name, "GryoY");
}

#[test]
fn telemetry_without_sensors_has_time_and_other_columns() {
    let (_file, log) = open("% time | DCR | VBatt\n1000,-3000,882\n");
    assert_eq!(log.channels(), 0);
    let wanted = Wanted { time: true, others: vec![2], ..Wanted::default() };
    let (block, _) = read_with(&log, &wanted, &ReadOptions::default());
    assert_eq!((block.time_s, block.others), (vec![0.001], vec![vec![882.0]]));
    let error = log.require(&Wanted { readings: true, ..Wanted::default() }).unwrap_err();
    assert!(
        matches!(
            error,
            LogError::At {
                position: LogPosition::Line(1),
                problem: PlacedProblem::MissingColumns { .. },
                ..
            }
        ),
        "{error}"
    );
}

#[test]
fn csv_units_are_brought_to_si() {
    let (_file, log) = open(
        "# synthetic: made by a test\n\
         time_ms,S1,Fx (mN),fy_n,fz_n,mx_mnm,my_nm,Mz [N·mm]\n\
         1500,7,2000,3,4,5000,6,7000\n",
    );
    let block = read(&log);
    assert_eq!(block.time_s, [1.5]);
    assert_eq!(block.readings, [[7.0]]);
    assert_eq!(block.wrench, [[2.0], [3.0], [4.0], [5.0], [6.0], [7.0]]);
}

#[test]
fn separators_line_ends_and_byte_order_marks_make_no_difference() {
    let comma = "Timestamp,s1,s2\n1.5,10,20\n2.5,11,21\n";
    let expected = read(&open(comma).1);
    for text in [
        comma.replace(',', ";"),
        comma.replace(',', "\t"),
        comma.replace('\n', "\r\n"),
        comma.replace(',', " , "),
        comma.replace("10", "\"10\"").replace("s1", "\"s1\""),
        format!("\u{feff}{comma}"),
        format!("\n\n{comma}\n  \n\r\n"),
        comma.replace("\n2.5", "\n\n2.5"),
        comma.trim_end().to_owned(),
        format!("\u{feff}{}", comma.replace('\n', "\r\n").trim_end()),
        comma.replace("10", "+1.0e1"),
    ] {
        assert_eq!(read(&open(&text).1), expected, "{text:?}");
    }
}

#[test]
fn the_training_file_has_fifteen_columns_in_a_known_order() {
    let row = "1.25,1,2,3,4,5,6,7,8,0.1,0.2,0.3,400,500,600\n";
    let (_file, log) = open(row);
    assert_eq!(log.format(), LogFormat::Training);
    let block = read(&log);
    assert_eq!(block.time_s, [1.25]);
    assert_eq!(block.readings.concat(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]);
    assert_eq!(block.wrench.concat(), [0.1, 0.2, 0.3, 400.0, 500.0, 600.0]);
    let mapping = Mapping { moment_unit: Some(MomentUnit::MillinewtonMetre), ..Mapping::default() };
    let block = read(&open_with(row, &mapping).1);
    assert_eq!(block.wrench.concat(), [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]);
}

#[test]
fn the_reference_file_drops_two_columns_which_need_not_be_numbers() {
    for (header, lead) in [("", "a,b"), ("", "1,2"), ("x,y,t,a,b,c,d,e,f,g,h,i\n", "a,b")] {
        let text = format!("{header}{lead},0.5,1,2,3,4,5,6,9,9,9\n");
        let format = (!header.is_empty()).then_some(LogFormat::Reference);
        let (_file, log) = open_with(&text, &Mapping { format, ..Mapping::default() });
        assert_eq!((log.format(), log.channels()), (LogFormat::Reference, 0));
        let wanted = Wanted { time: true, wrench: true, ..Wanted::default() };
        let (block, _) = read_with(&log, &wanted, &ReadOptions::default());
        assert_eq!(block.time_s, [0.5]);
        assert_eq!(block.wrench.concat(), [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
    }
}

#[test]
fn the_console_log_gives_the_scans_among_the_talk() {
    let scan =
        "SRC: 0x2052 |  [69, 20, 1, 0, 2, 0, 3, 0, 4, 0, 5, 0, 6, 0, 7, 0, 0, 1, 64, 66, 15, 0]";
    let text = format!(
        "Setting up serial ...\r\n{scan}\r\nx = 1\r\nSRC: 0x2052 |  [71, 2, 8, 2]\r\n{scan}"
    );
    let (_file, log) = open(&text);
    assert_eq!((log.format(), log.channels()), (LogFormat::Console, 8));
    let wanted = Wanted { time: true, readings: true, ..Wanted::default() };
    let (block, _) = read_with(&log, &wanted, &ReadOptions::default());
    assert_eq!(block.time_s, [1.0, 1.0]);
    assert_eq!(
        block.readings.iter().map(|column| column[0]).collect::<Vec<_>>(),
        [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 256.0]
    );
}

#[test]
fn columns_without_names_are_mapped_by_place() {
    let position = ColumnRef::Position;
    let mapping = Mapping {
        sensors: Some(vec![position(3), position(2)]),
        time: Some(position(1)),
        ..Mapping::default()
    };
    let block = read(&open_with("0.5,10,20\n1.5,11,21\n", &mapping).1);
    assert_eq!(block.time_s, [0.5, 1.5]);
    assert_eq!(block.readings, [[20.0, 21.0], [10.0, 11.0]]);
}

#[test]
fn group_labels_are_kept_in_runs_quoted_or_not() {
    let (_file, log) = open("pose,s1\na,1\na,2\n\"b, left\",3\na,4\n");
    assert_eq!(
        read_with(
            &log,
            &Wanted { groups: true, readings: true, ..Wanted::default() },
            &ReadOptions::default()
        )
        .0
        .groups,
        [("a".to_owned(), 2), ("b, left".to_owned(), 1), ("a".to_owned(), 1)]
    );
}

#[test]
fn threads_cuts_and_compression_make_no_difference() {
    let text = long_csv(3000);
    let plain = file(text.as_bytes());
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gzip.write_all(text.as_bytes()).unwrap();
    let gzip = file(&gzip.finish().unwrap());
    let wanted = Wanted {
        time: true,
        readings: true,
        wrench: true,
        groups: true,
        others: vec![1],
        ..Wanted::default()
    };
    let read_at = |path: &Path, chunk_bytes: usize, threads: usize| {
        let log = Log::open(path, &Mapping::default()).unwrap().with_chunk_bytes(chunk_bytes);
        read_with(&log, &wanted, &ReadOptions { threads, ..ReadOptions::default() })
    };
    let (expected, summary) = read_at(plain.path(), 1 << 20, 1);
    assert_eq!((summary.rows, summary.repeated_rows), (3000, 2000));
    for path in [plain.path(), gzip.path()] {
        for chunk_bytes in [1, 100, 997, 4096, 1 << 16] {
            for threads in [1, 2, 7] {
                let (block, this) = read_at(path, chunk_bytes, threads);
                assert!(block == expected, "{chunk_bytes} {threads}");
                assert_eq!(this, summary);
            }
        }
    }
}

#[test]
fn plain_rows_and_quoted_rows_give_the_same_bits() {
    let text = long_csv(2000);
    let quoted: String = text
        .lines()
        .enumerate()
        .map(|(line, text)| match line {
            0 => format!("{text}\n"),
            _ => format!("\"{}\"\n", text.replace(',', "\",\"")),
        })
        .collect();
    let wanted = Wanted {
        time: true,
        readings: true,
        wrench: true,
        groups: true,
        others: vec![3],
        ..Wanted::default()
    };
    let read = |text: &str| read_with(&open(text).1, &wanted, &ReadOptions::default());
    let (plain, quoted) = (read(&text), read(&quoted));
    assert!(plain == quoted);
    let bits = |block: &Block| -> Vec<u64> {
        block.wrench.iter().flatten().map(|value| value.to_bits()).collect()
    };
    assert_eq!(bits(&plain.0), bits(&quoted.0));
}

/// Returns numbers of every length, mostly plain, as in logs.
fn number(i: usize) -> String {
    let value = (i as f64 * 0.7).sin();
    match i % 97 {
        0 => format!("{:e}", value * 1e-7),
        1 => format!("{value:.17}"),
        2 => format!("+{}", i % 4096),
        3 => format!("{}.", i % 4096),
        4 => ".5".to_owned(),
        5 => "-0".to_owned(),
        6 => format!(" {} ", i % 4096),
        n if n % 2 == 0 => format!("{}", (value * 10_f64.powi(n as i32 % 12)) as i64),
        n => format!("{:.*}", n % 16, value * 10_f64.powi(i as i32 % 7)),
    }
}

#[test]
fn every_number_of_a_long_file_has_the_bits_of_the_standard_library() {
    let columns = 15;
    let fields: Vec<String> = (0..columns * 5000).map(number).collect();
    for line_end in ["\n", "\r\n"] {
        let rows: Vec<String> = fields.chunks(columns).map(|row| row.join(",")).collect();
        let (_file, log) = open(&(rows.join(line_end) + line_end));
        let wanted = Wanted { others: (0..columns).collect(), ..Wanted::default() };
        let (block, _) = read_with(&log, &wanted, &ReadOptions::default());
        for (i, field) in fields.iter().enumerate() {
            let value = block.others[i % columns][i / columns];
            let expected: f64 = field.trim().parse().unwrap();
            assert_eq!(value.to_bits(), expected.to_bits(), "row {}: {field}", i / columns);
        }
        let some = Wanted { others: vec![3, 11], ..Wanted::default() };
        let (some, _) = read_with(&log, &some, &ReadOptions::default());
        assert!(some.others == [block.others[3].clone(), block.others[11].clone()]);
    }
}

#[test]
fn only_wanted_columns_are_parsed() {
    let (_file, log) = open("s1,time,Fx\n1,oops,nan\n2,,\n");
    let wanted = Wanted { readings: true, ..Wanted::default() };
    let (block, _) = read_with(&log, &wanted, &ReadOptions::default());
    assert_eq!(block.readings, [[1.0, 2.0]]);
    assert!(block.time_s.is_empty() && block.wrench.is_empty());
}

#[test]
fn bad_rows_are_counted_and_left_out_when_asked() {
    let text = "group,time,s1\na,1,10\nb,x,10\nb,2,nan\nb,3\na,4,11,12\na,5,11\nc,6,12\n";
    let (_file, log) = open(text);
    let options = ReadOptions { skip_bad_rows: true, ..ReadOptions::default() };
    for text in [text.to_owned(), text.replace("a,1,", "\"a\",1,")] {
        let (_file, log) = open(&text);
        let wanted = Wanted { time: true, readings: true, groups: true, ..Wanted::default() };
        let (block, summary) = read_with(&log, &wanted, &options);
        assert_eq!((summary.rows, summary.skipped_rows), (3, 4));
        assert_eq!(block.time_s, [1.0, 5.0, 6.0]);
        assert_eq!(block.groups, [("a".to_owned(), 2), ("c".to_owned(), 1)]);
    }
    let error = log.read(&all(&log), &ReadOptions::default(), |_| (), |()| Ok::<_, LogError>(()));
    assert!(matches!(error, Err(LogError::At { problem: PlacedProblem::Row(_), .. })));
}

#[test]
fn a_sample_has_rows_from_all_over_the_file() {
    let (_file, log) = open(&long_csv(20_000));
    let wanted = Wanted { time: true, readings: true, ..Wanted::default() };
    let sample = log.sample(&wanted).unwrap();
    assert!((500..20_000).contains(&sample.rows));
    assert_eq!(sample.time_s[0], 0.0);
    assert!(sample.time_s[sample.rows - 1] > 199.0);
    assert!(sample.time_s.is_sorted());
    let (_file, log) = open(&long_csv(50));
    assert_eq!(log.sample(&wanted).unwrap().rows, 50);
}

#[test]
fn the_checksum_equals_that_of_the_file_on_disk() {
    let (_file, log) = open("time,s1\n1,2\n");
    let options = ReadOptions { checksum: true, ..ReadOptions::default() };
    let (_, summary) = read_with(&log, &all(&log), &options);
    // printf 'time,s1\n1,2\n' | xxh128sum
    let expected = "xxh128:3bc00d86db8130a43a2e22b8bcb4290f";
    assert_eq!(summary.checksum.as_deref(), Some(expected));
}

#[test]
fn a_break_from_fold_ends_the_reading() {
    #[derive(Debug, PartialEq)]
    enum Stop {
        Enough(usize),
        Log,
    }
    impl From<LogError> for Stop {
        fn from(_: LogError) -> Self {
            Stop::Log
        }
    }
    let (_file, log) = open(&long_csv(2000));
    let log = log.with_chunk_bytes(1000);
    for threads in [1, 2, 7] {
        let options = ReadOptions { threads, ..ReadOptions::default() };
        let mut blocks = 0;
        let result = log.read(
            &all_but_first(&log),
            &options,
            |block| block.rows,
            |_| {
                blocks += 1;
                if blocks == 5 { Err(Stop::Enough(blocks)) } else { Ok(()) }
            },
        );
        assert_eq!(result.unwrap_err(), Stop::Enough(5));
    }
}

fn all_but_first(log: &Log) -> Wanted {
    Wanted { others: Vec::new(), ..all(log) }
}

#[test]
fn progress_ends_at_the_size_of_the_file() {
    let (_file, log) = open(&long_csv(2000));
    let last = std::sync::atomic::AtomicU64::new(0);
    let progress = |bytes| last.store(bytes, std::sync::atomic::Ordering::Relaxed);
    let options = ReadOptions { progress: Some(&progress), ..ReadOptions::default() };
    read_with(&log, &all_but_first(&log), &options);
    assert_eq!(last.into_inner(), log.bytes());
}

#[test]
fn logs_of_any_width_are_read() {
    for width in 15..=140 {
        let names =
            (0..width - 14).map(|i| format!("x{i}")).chain((1..=8).map(|i| format!("s{i}")));
        let wrench = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"].map(str::to_owned);
        let mut text = names.chain(wrench).collect::<Vec<_>>().join(",") + "\n";
        let value = |row: usize, column: usize| (row * 7919 + column * 104_729) % 4000;
        for row in 0..300 {
            let fields = (0..width).map(|column| value(row, column).to_string());
            text += &(fields.collect::<Vec<_>>().join(",") + "\n");
        }
        let (_file, log) = open(&text);
        let wanted = Wanted { readings: true, wrench: true, ..Wanted::default() };
        let (block, summary) = read_with(&log, &wanted, &ReadOptions::default());
        assert_eq!(summary.rows, 300, "{width} columns");
        for (channel, readings) in block.readings.iter().enumerate() {
            let expected = (0..300).map(|row| value(row, width - 14 + channel) as f64);
            assert!(readings.iter().copied().eq(expected), "{width} columns");
        }
    }
}
