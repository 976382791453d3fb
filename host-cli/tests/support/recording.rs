//! Shared parts of the tests of `record` and `board`.

use std::fs;
use std::path::{Path, PathBuf};

use log_file::{Log, LogError, Mapping, ReadOptions, Wanted};
use shared_proto::{Framing, Packet, Sample, Values};
use shell_data::block::Block;
use system_tests::on_the_wire;
use system_tests::program::succeed;
use system_tests::random::Random;

/// Frame `index` of a board at 100 Hz, identified by its readings.
pub fn sample(index: u64) -> Sample {
    Sample {
        sequence: index as u16,
        clock_us: (1_000_000 + index * 10_000) as u32,
        values: Values::Readings(counts(index)),
        saturated: 0,
        dropped: 0,
    }
}

pub fn counts(index: u64) -> [u16; 8] {
    std::array::from_fn(|c| ((index * 7919 + c as u64 * 12_553) % 65_521) as u16)
}

/// In converter steps.
pub fn readings(index: u64) -> [f64; 8] {
    counts(index).map(|counts| f64::from(counts) / 16.0)
}

pub fn frame(index: u64) -> Vec<u8> {
    on_the_wire(&Packet::Sample(sample(index)), Framing::Cobs)
}

pub fn stream(indices: impl IntoIterator<Item = u64>) -> Vec<u8> {
    indices.into_iter().flat_map(frame).collect()
}

/// Reads a log by the program's own reader: readings, time and wrench.
pub fn read_log(path: &Path) -> Result<Block, LogError> {
    let log = Log::open(path, &Mapping::default())?;
    let wanted = Wanted {
        time: log.has_time(),
        readings: log.channels() > 0,
        wrench: log.has_wrench(),
        ..Wanted::default()
    };
    let mut whole = Block::default();
    let options = ReadOptions { threads: 1, ..ReadOptions::default() };
    log.read(&wanted, &options, std::mem::take, |block| {
        append(&mut whole, block);
        Ok::<_, LogError>(())
    })?;
    Ok(whole)
}

fn append(whole: &mut Block, mut next: Block) {
    whole.rows += next.rows;
    whole.time_s.append(&mut next.time_s);
    for (whole, next) in [(&mut whole.readings, next.readings), (&mut whole.wrench, next.wrench)] {
        whole.resize(next.len(), Vec::new());
        whole.iter_mut().zip(next).for_each(|(whole, mut next)| whole.append(&mut next));
    }
}

pub fn assert_rows_are(log: &Block, indices: impl IntoIterator<Item = u64>) {
    let indices: Vec<u64> = indices.into_iter().collect();
    assert_eq!(log.rows, indices.len());
    for (row, index) in indices.into_iter().enumerate() {
        assert_eq!(log.time_s[row], (1_000_000 + index * 10_000) as f64 / 1e6);
        let row: Vec<f64> = log.readings.iter().map(|column| column[row]).collect();
        assert_eq!(row, readings(index), "frame {index}");
    }
}

pub fn column(path: &Path, name: &str) -> Vec<String> {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let at = lines.next().unwrap().split(',').position(|column| column == name).unwrap();
    lines.map(|line| line.split(',').nth(at).unwrap().to_owned()).collect()
}

/// A cubic calibration fitted to a cubic function of readings.
pub fn calibration(dir: &Path) -> PathBuf {
    let mut text = "s1,s2,s3,s4,s5,s6,s7,s8,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n".to_owned();
    let mut random = Random(1);
    for _ in 0..200 {
        let s: [u64; 8] = std::array::from_fn(|_| random.bits(12));
        let z = |i: usize| s[i % 8] as f64 / 4096.0;
        let wrench: [f64; 6] =
            std::array::from_fn(|axis| z(axis) + z(axis + 1).powi(2) - z(axis + 2).powi(3) + 0.5);
        let fields = s.iter().map(u64::to_string).chain(wrench.iter().map(f64::to_string));
        text += &(fields.collect::<Vec<_>>().join(",") + "\n");
    }
    fs::write(dir.join("training.csv"), text).unwrap();
    succeed(dir, "fit training.csv --model cubic --output cal.json");
    dir.join("cal.json")
}
