//! Files of every kind that the program reads, and what chance does to them.

use std::fs;
use std::path::Path;

use system_tests::program;
use system_tests::random::Random;

/// Good files: logs, telemetry, a calibration, a partial fit, a matrix, a manifest, a table.
pub(super) const SEEDS: [&str; 9] = [
    "train.csv",
    "test.csv",
    "zero.csv",
    "trials/3cm-1.txt",
    "trials/manifest.csv",
    "cal.json",
    "partial.json",
    "matrix.csv",
    "results/strides.csv",
];

/// Makes them in a folder.
pub(super) fn make(dir: &Path) {
    for arguments in [
        "synth train --rows 400 -o train.csv",
        "synth test --rows 200 -o test.csv",
        "synth zero --rows 200 -o zero.csv",
        "synth trials trials --per-condition 1",
        "fit train.csv --model cubic --covariance rows -o cal.json --export-matrix matrix.csv",
        "fit train.csv --model linear --partial partial.json",
        "batch trials/manifest.csv --calibration cal.json --csv results",
    ] {
        program::succeed(dir, arguments);
    }
}

/// Bytes of a good file, or what is left of them.
pub(super) fn damaged(seeds: &Path, name: &str, random: &mut Random) -> Vec<u8> {
    let mut bytes = fs::read(seeds.join(name)).unwrap();
    // Long files take long, and say no more.
    bytes.truncate(200_000);
    if random.percent(40) {
        return bytes;
    }
    for _ in 0..=random.below(4) {
        damage(&mut bytes, random);
    }
    bytes
}

fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    const TEXTS: [&[u8]; 14] = [
        b"1e300",
        b"-1e300",
        b"NaN",
        b"inf",
        b"",
        b"\"",
        b"1e63",
        b"0",
        b"-",
        b"999999999999",
        b"\x1b[2J",
        b"\0",
        b"\n\n\n",
        b"\xff\xfe",
    ];
    if bytes.is_empty() {
        return bytes.extend(TEXTS[random.below(14) as usize]);
    }
    let at = random.below(bytes.len() as u64) as usize;
    match random.below(8) {
        0 => bytes.truncate(at),
        1 => bytes[at] ^= 1 << random.below(8),
        2 => drop(bytes.drain(at..(at + 1 + random.below(200) as usize).min(bytes.len()))),
        3 => {
            let piece = bytes[at..(at + 300).min(bytes.len())].to_vec();
            let to = random.below(bytes.len() as u64) as usize;
            drop(bytes.splice(to..to, piece));
        }
        // A whole field, so that what is around it stays right.
        4 | 5 => {
            let is_end = |byte: &u8| matches!(byte, b',' | b'\n' | b'|' | b':' | b'[');
            let start = bytes[..at].iter().rposition(is_end).map_or(0, |end| end + 1);
            let end = bytes[at..].iter().position(is_end).map_or(bytes.len(), |end| at + end);
            let text = TEXTS[random.below(14) as usize];
            drop(bytes.splice(start..end.max(start), text.iter().copied()));
        }
        6 => bytes.extend_from_within(..at),
        _ => bytes.iter_mut().filter(|byte| **byte == b'\n').for_each(|byte| *byte = b'\r'),
    }
}
