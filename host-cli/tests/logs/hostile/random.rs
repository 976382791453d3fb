//! Random commands over damaged files.

use std::ffi::OsString;
use std::fs;
use std::os::unix::ffi::OsStringExt;
use std::path::Path;
use std::time::{Duration, Instant};

use shell_data::wrench::{Axes, Axis};
use system_tests::program;
use system_tests::random::Random;

use super::files;
use super::run::{Blow, Trouble, run, unread};

const AMONG_TESTS: u64 = 300;

/// A capital letter stands for a file of that kind, `O.x` for an output, `?` for any number.
const COMMANDS: [&str; 63] = [
    "info T",
    "info R Z",
    "doctor T R C",
    "doctor Z E --calibration C --json",
    "fit --model cubic T -o O.json",
    "fit --model cubic T --test E -o O.json --export-matrix O.csv",
    "fit T E --cv=file --model quadratic",
    "fit --model cubic T --cv=? --json",
    "fit T --model auto -o O.json --covariance groups",
    "fit --model cubic T --solver tsqr --ridge ? -o O.json",
    "fit --model cubic T --solver svd --truncate ? --plot O.svg",
    "fit --model cubic T --solver huber --fresh --skip-bad-rows --json",
    "fit T --sensors 2-? --wrench 10-15 --model linear",
    "fit T --partial O.json",
    "fit T --model linear --partial O.json --fresh",
    "merge P -o O.json",
    "merge P P --partial O.json",
    "merge P --ridge ? --json",
    "eval C E --max-rms ?",
    "eval C E T --json --fresh",
    "eval C T --plot O.svg --skip-bad-rows",
    "convert C Z -o O.csv",
    "convert C R -o O.csv --interval=?",
    "convert C E --lowpass ? --order ? -o O.csv",
    "convert C Z R --output-dir out/tables --no-tare",
    "convert C E --tare ? --full-scale ? --skip-bad-rows -o O.csv",
    "convert C Z --plot O.svg --columns t,fx,flags",
    "info Z --noise --calibration C --json",
    "trial R --calibration C --trace O.csv",
    "trial R --enter ? --exit ? --calibration C --json",
    "batch M --calibration C --csv out/tables",
    "batch M --calibration C --traces out/traces --json",
    "trial R --find-window --calibration C",
    "plot drag R --calibration C -o O.svg",
    "report M --calibration C -o O.html",
    "stats S",
    "stats S --by condition --trial file --json",
    "stats E --seed ?",
    "import X -o O.json",
    "import C -o O.json",
    "align T Z -o O.csv",
    "synth train --rows ? --rate ? --seed ? -o O.csv",
    "synth zero --rows ? --noise-scale ? -o O.csv",
    "record --replay Z -o O.csv --calibration C",
    "record --replay P --raw O.raw --framing cobs",
    "info B --json",
    "doctor B",
    "fit B --model linear -o O.json",
    "fit B --model linear --partial O.json",
    "convert C B --keep all -o O.csv",
    "convert C B --keep all -o O.parquet --skip-bad-rows",
    "convert C B --keep all -o O.npy",
    "eval C B --edited",
    "export C O.py --edited",
    "stream G -o O.csv --speed 1000",
    "stream G -o O.csv -o O.jsonl --speed 1000 --overwrite",
    "stream G --calibration C -o O.jsonl --rate ? --speed 1000 --overwrite",
    "check C L W --group group",
    "eval C E T --against C",
    "fit W --loads L --group group -o O.json",
    "fit W --loads L --from C --group group -o O.json",
    "report C --certificate --unloaded Z --weights L --weights-log W --group group -o O.html",
    "synth pair O.csv O.csv --duration 2 --rate ?",
];

const NUMBERS: [&str; 14] =
    ["0", "1", "2", "5", "-1", "1e-6", "0.5", "1e300", "-1e300", "nan", "inf", "1000", "95", "x"];

fn pick<'a>(of: &[&'a str], random: &mut Random) -> &'a str {
    of[random.below(of.len() as u64) as usize]
}

fn name(random: &mut Random, extension: &str) -> OsString {
    let stem: &[u8] = match random.below(8) {
        0 => b"with space",
        1 => b"\xff\xfe",
        2 => b"\x1b[31m",
        3 => "µ\u{202e}".as_bytes(),
        _ => b"file",
    };
    let mut name = format!("{}-", random.below(1000)).into_bytes();
    name.extend(stem);
    name.extend(extension.as_bytes());
    OsString::from_vec(name)
}

fn draw(seeds: &Path, dir: &Path, random: &mut Random) -> Vec<OsString> {
    let mut arguments: Vec<OsString> = Vec::new();
    let mut inputs: Vec<OsString> = Vec::new();
    fs::create_dir(dir.join("out")).unwrap();
    let command = pick(&COMMANDS, random);
    if command.split(' ').any(|word| word == "M") {
        // Manifests refer to logs in their own folder.
        for log in ["0cm-1.txt", "1cm-1.txt", "2cm-1.txt", "3cm-1.txt", "free-1.txt"] {
            fs::hard_link(seeds.join("trials").join(log), dir.join(log)).unwrap();
        }
    }
    for word in command.split(' ') {
        let kind = |word: &str| match word {
            "T" => Some(("train.csv", ".csv")),
            "E" => Some(("test.csv", ".csv")),
            "Z" => Some(("zero.csv", ".csv")),
            "R" => Some(("trials/3cm-1.txt", ".txt")),
            "M" => Some(("trials/manifest.csv", ".csv")),
            "C" => Some(("cal.json", ".json")),
            "P" => Some(("partial.json", ".json")),
            "X" => Some(("matrix.csv", ".csv")),
            "S" => Some(("results/strides.csv", ".csv")),
            "L" => Some(("loads.csv", ".csv")),
            "W" => Some(("weights.csv", ".csv")),
            _ => None,
        };
        if word == "G" {
            // This file is not damaged, because a log with a wrong duration would be played for that duration.
            let name = name(random, ".csv");
            fs::copy(seeds.join("train.csv"), dir.join(&name)).unwrap();
            inputs.push(name.clone());
            arguments.push(name);
        } else if word == "B" {
            let extension = pick(&["", ".parquet", ".csv"], random);
            let name = name(random, extension);
            fs::write(dir.join(&name), files::binary(random)).unwrap();
            inputs.push(name.clone());
            arguments.push(name);
        } else if let Some((seed, extension)) = kind(word) {
            let seed = if random.percent(5) { pick(&files::SEEDS, random) } else { seed };
            let name = name(random, extension);
            fs::write(dir.join(&name), files::damaged(seeds, seed, random)).unwrap();
            inputs.push(name.clone());
            arguments.push(name);
        } else if let Some(extension) = word.strip_prefix('O').filter(|_| word.contains('.')) {
            let input = inputs.last().filter(|_| random.percent(10));
            let new = || Path::new("out").join(name(&mut random.clone(), extension)).into();
            let path = input.cloned().unwrap_or_else(new);
            random.next();
            arguments.push(path);
        } else if word.contains('?') {
            arguments.push(word.replace('?', pick(&NUMBERS, random)).into());
        } else {
            arguments.push(word.into());
        }
    }
    arguments
}

fn trouble(random: &mut Random) -> Trouble {
    let blow = blow(random);
    let disk = [1, 8, 40][random.below(3) as usize];
    let disk = random.percent(10).then_some(disk);
    Trouble { blow, disk, reader_leaves: random.percent(5) }
}

fn blow(random: &mut Random) -> Option<Blow> {
    let (name, number) = [("-INT", 2), ("-TERM", 15), ("-HUP", 1)][random.below(3) as usize];
    let after = Duration::from_micros(random.below(40_000));
    random.percent(10).then_some(Blow { name, number, after })
}

/// Draws an `eval` with limits, of logs and a calibration with some axes: it passes only if all have the required axes.
fn gate(seeds: &Path, dir: &Path, random: &mut Random) -> Result<(), String> {
    let (train, calibrated) = files::of_some_axes(seeds, "train.csv", random);
    let mut measured = Vec::new();
    let mut arguments: Vec<OsString> = ["eval", "cal.json"].map(Into::into).to_vec();
    fs::write(dir.join("train.csv"), train).unwrap();
    for log in 0..=random.below(2) {
        let (text, axes) = files::of_some_axes(seeds, "test.csv", random);
        let name = format!("{log}.csv");
        fs::write(dir.join(&name), text).unwrap();
        arguments.push(name.into());
        measured.push(axes);
    }
    if calibrated.is_empty() {
        return Ok(());
    }
    program::succeed(dir, "fit train.csv --model linear --covariance none -o cal.json");
    let (forces, moments) = (random.percent(60), random.percent(60));
    let limits = [(forces, "--max-rms"), (moments, "--max-rms-moment")];
    // The first limit is above all errors of these logs, the second below.
    let limit = pick(&["1e9", "1e-12"], random);
    for (_, option) in limits.into_iter().filter(|(is_set, _)| *is_set) {
        arguments.extend([option.into(), limit.into()]);
    }
    let is_limited = |axis: Axis| if axis.is_moment() { moments } else { forces };
    let mut asked: Axes = Axis::ALL.into_iter().filter(|&axis| is_limited(axis)).collect();
    if random.percent(40) {
        let named: Axes = Axis::ALL.into_iter().filter(|_| random.percent(50)).collect();
        let names: Vec<String> = named.iter().map(|axis| axis.name().to_lowercase()).collect();
        if !named.is_empty() {
            arguments.extend(["--axes".into(), names.join(",").into()]);
            asked = named;
        }
    }
    let line: Vec<_> = arguments.iter().map(|word| word.to_string_lossy()).collect();
    let line = line.join(" ");
    let is_left = random.percent(30);
    let passed = passes(dir, &line, is_left);
    let are_compared = calibrated.contain(asked) && measured.iter().all(|axes| axes.contain(asked));
    let is_within = limit == "1e9" || !asked.iter().any(is_limited);
    // Without a common axis, the run ends before limits are tested.
    let says_nothing = measured.iter().fold(calibrated, |all, axes| all.and(*axes)).is_empty();
    let limits_nothing = (forces || moments) && !asked.iter().any(is_limited)
        || [false, true].into_iter().any(|moment| {
            let is_set = if moment { moments } else { forces };
            is_set && !asked.iter().any(|axis| axis.is_moment() == moment)
        });
    match passed == (are_compared && is_within && !says_nothing && !limits_nothing) {
        true => Ok(()),
        false => Err(format!("{line}: passed: {passed}; {calibrated}; {measured:?}")),
    }
}

/// Returns true for exit code 0. If `reader_leaves`, the reader of the output has closed the pipe.
fn passes(dir: &Path, line: &str, reader_leaves: bool) -> bool {
    let mut run = program::command(dir);
    run.args(line.split_whitespace());
    if reader_leaves {
        run.stdout(unread());
    }
    run.output().unwrap().status.code() == Some(0)
}

/// Draws a table of loads; the check must not pass if some loads were not recorded.
fn weighing(seeds: &Path, dir: &Path, random: &mut Random) -> Result<(), String> {
    fs::copy(seeds.join("cal.json"), dir.join("cal.json")).unwrap();
    let text = fs::read_to_string(seeds.join("weights.csv")).unwrap();
    // Some loads have no rows, others have wrong rows.
    let [gone, bad] = [10, 10].map(|percent| files::LABELS.map(|_| random.percent(percent)));
    let mut log = String::new();
    for (at, line) in text.lines().enumerate() {
        let label = line.rsplit(',').next().unwrap_or_default();
        match files::LABELS.iter().position(|known| *known == label).filter(|_| at > 0) {
            Some(load) if gone[load] => {}
            Some(load) if bad[load] => log += &format!("x{line}\n"),
            _ => log += &format!("{line}\n"),
        }
    }
    fs::write(dir.join("log.csv"), log).unwrap();
    let mut asked = files::LABELS.to_vec();
    let has_more = random.percent(20);
    if has_more {
        asked.push(pick(&["d", "zero-2"], random));
    }
    fs::write(dir.join("loads.csv"), files::loads(&asked)).unwrap();
    let command = pick(
        &[
            "check cal.json loads.csv log.csv",
            "fit log.csv --loads loads.csv --from cal.json",
            "report cal.json --certificate --weights loads.csv --weights-log log.csv -o cal.html",
        ],
        random,
    );
    let line = format!("{command} --group group --skip-bad-rows");
    let is_left = random.percent(30);
    let are_weighed = !has_more && !gone.contains(&true) && !bad.contains(&true);
    match passes(dir, &line, is_left) && !are_weighed {
        true => Err(format!("{line}: passed; gone {gone:?}, bad {bad:?}, asked {asked:?}")),
        false => Ok(()),
    }
}

fn violation(seeds: &Path, seed: u64) -> Option<String> {
    let mut random = Random(seed);
    let dir = tempfile::tempdir().unwrap();
    let gates = [gate, weighing];
    if random.percent(6) {
        let gate = gates[random.below(2) as usize];
        let problem = gate(seeds, dir.path(), &mut random).err()?;
        return Some(format!("seed {seed}: a gate: {problem}"));
    }
    let arguments = draw(seeds, dir.path(), &mut random);
    let problem = run(dir.path(), &arguments, trouble(&mut random)).err()?;
    Some(format!("seed {seed}: {arguments:?}: {problem}"))
}

fn setting(name: &str) -> Option<u64> {
    std::env::var(name).ok().and_then(|text| text.parse().ok())
}

#[test]
fn nothing_fails_open() {
    let seeds = tempfile::tempdir().unwrap();
    files::make(seeds.path());
    let cases = setting("SHELLCAL_HOSTILE_CASES");
    let limit = setting("SHELLCAL_HOSTILE_SECONDS").map(Duration::from_secs);
    let first = setting("SHELLCAL_HOSTILE_SEED").unwrap_or(1);
    let cases = cases.unwrap_or(if limit.is_some() { u64::MAX } else { AMONG_TESTS });
    let started = Instant::now();
    let mut violations = Vec::new();
    let mut done = 0;
    while done < cases && limit.is_none_or(|limit| started.elapsed() < limit) {
        if let Some(violation) = violation(seeds.path(), first.wrapping_add(done)) {
            println!("{violation}");
            violations.push(violation);
        }
        done += 1;
        if done % 1000 == 0 {
            println!("{done} cases, {} violations", violations.len());
        }
    }
    println!("seeds {first} to {}: {} violations", first.wrapping_add(done - 1), violations.len());
    assert!(violations.is_empty(), "{}", violations.join("\n"));
}
