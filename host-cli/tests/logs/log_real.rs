//! The readers on the real recordings.

use log_file::{Log, LogError, LogFormat, Mapping, ReadOptions, ReadSummary, Wanted};
use shell_data::block::Block;
use system_tests::real_recording;

fn read(log: &Log, wanted: &Wanted) -> (Vec<Block>, ReadSummary) {
    let mut blocks = Vec::new();
    let fold = |block| {
        blocks.push(block);
        Ok::<(), LogError>(())
    };
    let summary = log.read(wanted, &ReadOptions::default(), std::mem::take, fold).unwrap();
    (blocks, summary)
}

const TRIAL: &str =
    "skinproc/velociroach_s=10cm_w=5.5cm_h=27cm_layer=3_ply=6_f=13Hz_beetleshell_run3.txt";

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn the_trial_log_has_its_rows_and_three_quarters_of_them_repeat() {
    let path = real_recording(TRIAL);
    let log = Log::open(&path, &Mapping::default()).unwrap();
    assert_eq!(log.format(), LogFormat::Telemetry);
    assert_eq!((log.columns().len(), log.channels()), (24, 8));
    assert!(log.has_time() && !log.has_wrench() && log.repeats_are_stale());
    let wanted = Wanted { time: true, readings: true, others: vec![1, 15], ..Wanted::default() };
    let (blocks, summary) = read(&log, &wanted);
    assert_eq!(summary.rows, 9689);
    let repeats = summary.repeated_rows as f64 / summary.rows as f64;
    assert!((0.765..0.775).contains(&repeats), "{repeats}");
    let (first, last) = (&blocks[0], blocks.last().unwrap());
    assert_eq!(first.time_s[0], 302.0 / 1e6);
    let readings: Vec<f64> = first.readings.iter().map(|column| column[0]).collect();
    assert_eq!(readings, [1011.0, 1329.0, 1184.0, 1193.0, 1582.0, 1220.0, 1340.0, 1728.0]);
    assert_eq!((first.others[0][0], first.others[1][0]), (51_799_024.0, 882.0));
    assert_eq!(last.time_s[last.rows - 1], 12_211_501.0 / 1e6);
    assert_eq!(last.readings[7][last.rows - 1], 1713.0);
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn the_training_set_has_its_rows_in_si_units() {
    let path = real_recording("skinproc/behavior4_2Hz.csv");
    let log = Log::open(&path, &Mapping::default()).unwrap();
    assert_eq!((log.format(), log.channels()), (LogFormat::Training, 8));
    let wanted = Wanted { time: true, readings: true, wrench: true, ..Wanted::default() };
    let (blocks, summary) = read(&log, &wanted);
    assert_eq!(summary.rows, 959);
    assert!(!log.repeats_are_stale());
    assert_eq!(blocks[0].time_s[0], 1425168310.852012);
    assert_eq!(blocks[0].wrench[5][0], -0.182270744491);
}

#[test]
#[cfg_attr(not(real_data), ignore = "SHELLCAL_REAL_DATA does not name the recordings")]
fn the_console_log_has_the_frames_that_the_base_station_printed() {
    let path = real_recording("skinproc/stream_log_excerpt.txt");
    let log = Log::open(&path, &Mapping::default()).unwrap().with_chunk_bytes(1 << 22);
    assert_eq!((log.format(), log.channels()), (LogFormat::Console, 8));
    let wanted = Wanted { time: true, readings: true, ..Wanted::default() };
    let (blocks, summary) = read(&log, &wanted);
    assert_eq!((summary.rows, blocks.len()), (150, 1));
    // The base station printed the decoded values: `time = …` and `[1961 2123 …]`.
    let text = std::fs::read_to_string(path).unwrap();
    let times = text.lines().filter_map(|line| line.strip_prefix("time = "));
    let readings = text.lines().filter(|line| line.starts_with('[') && line.ends_with(']'));
    let mut printed = 0;
    for (row, (time, readings)) in times.zip(readings).enumerate() {
        let time: f64 = time.split_once(' ').unwrap().0.parse().unwrap();
        assert_eq!(blocks[0].time_s[row], time);
        let expected: Vec<f64> = readings[1..readings.len() - 1]
            .split_ascii_whitespace()
            .map(|reading| reading.parse().unwrap())
            .collect();
        let decoded: Vec<f64> = blocks[0].readings.iter().map(|column| column[row]).collect();
        assert_eq!(decoded, expected);
        printed += 1;
    }
    assert_eq!(printed, 150);
}
