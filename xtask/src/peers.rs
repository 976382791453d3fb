//! `cargo xtask bench-peers`: whole fits, process start to exit, against what people run today.
//!
//! Every tool reads the same training and test file and prints the errors on both. The runs are
//! interleaved, so that a busy moment of the machine hits all tools alike; the table gives medians
//! and their ratios to shellcal.

use std::fs;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use anyhow::{Context, Result, ensure};

use shell_data::instructions::available;

use crate::measure::{Measurement, argument, installed, measure, summary};
use crate::steps;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Directory of the peers' scripts (peer_fit.py, peer_polars.py, peer_fit.R, …)
    #[arg(long, env = "SHELLCAL_PEERS", value_name = "DIR")]
    peers: PathBuf,

    /// Rows of the training file (the paper's number)
    #[arg(long, default_value_t = 77_522)]
    train_rows: usize,

    /// The same again with so many training rows, which do not fit a cache
    #[arg(long, value_name = "ROWS", num_args = 0..=1, default_missing_value = "5000000")]
    large: Option<usize>,

    /// Rows of the test file (the paper's number)
    #[arg(long, default_value_t = 19_932)]
    test_rows: usize,

    /// Runs of every tool
    #[arg(long, default_value_t = 9)]
    runs: usize,

    /// The program that is measured [default: the release, built first]
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,

    /// An earlier program, measured beside it
    #[arg(long, value_name = "FILE")]
    before: Option<PathBuf>,

    /// How the wrench is written [default: both, one after the other]
    #[arg(long, value_enum)]
    numbers: Option<Numbers>,
}

/// How the numbers of a file are written.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Numbers {
    /// In the steps of a digital sensor, `0.00625`
    Short,
    /// With all digits of a double, `0.30432148234712341`
    Full,
}

/// The models by our names and by the peers'.
const MODELS: [(&str, &str); 3] =
    [("cubic", "cubic24+1"), ("quadratic", "quad44+1"), ("poly3", "cubic164+1")];

/// What an earlier program is called.
const BEFORE: &str = "shellcal before";

struct Tool {
    name: &'static str,
    command: Vec<String>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    ensure!(args.peers.is_dir(), "`{}` is not a directory", args.peers.display());
    let shellcal = args.program.clone().map_or_else(steps::build_shellcal, Ok)?;
    let dir = steps::scratch("bench-peers")?;
    let (name, vectors) = (processor(), available()[0].0);
    println!("{name}, vectors: {vectors}\n");
    let both = [Numbers::Short, Numbers::Full];
    for numbers in args.numbers.as_ref().map_or(&both[..], std::slice::from_ref) {
        let make = |kind, rows| match numbers {
            Numbers::Short => synthetic(&shellcal, &dir, kind, rows),
            Numbers::Full => with_all_digits(&args.peers, &dir, rows),
        };
        let test = make("test", args.test_rows)?;
        for rows in [Some(args.train_rows), args.large].into_iter().flatten() {
            println!("{numbers:?} numbers, {rows} + {} rows", args.test_rows);
            compare(args, &shellcal, &dir, [&make("train", rows)?, &test])?;
        }
    }
    Ok(())
}

/// What the processor calls itself.
fn processor() -> String {
    let described = fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = described.lines().find_map(|line| line.strip_prefix("model name")?.split_once(": "));
    name.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.to_owned())
}

/// All tools on one pair of files.
fn compare(args: &Args, shellcal: &Path, dir: &Path, files: [&Path; 2]) -> Result<()> {
    let [train, test] = files;
    let bytes = fs::metadata(train)?.len() + fs::metadata(test)?.len();
    println!("{:.1} MB\n", bytes as f64 / 1e6);

    let threads = std::thread::available_parallelism()?.get();
    let floor_s = floor(&files, threads, args.runs)?;
    println!(
        "floor (read both files, find the newlines, {threads} threads): {:.1} ms\n",
        floor_s * 1e3
    );

    for (ours, theirs) in MODELS {
        let fit = |name, program: &Path| Tool {
            name,
            command: vec![
                argument(program),
                "fit".into(),
                argument(train),
                "--test".into(),
                argument(test),
                "--model".into(),
                ours.into(),
                "--output".into(),
                argument(&dir.join("calibration.json")),
                "--json".into(),
            ],
        };
        let mut tools = vec![fit("shellcal", shellcal)];
        tools.extend(args.before.as_ref().map(|before| fit(BEFORE, before)));
        tools.extend(peers(&args.peers, train, test, theirs));
        let tools = working(tools)?;
        let medians = medians(&tools, args.runs)?;
        print_table(ours, &tools, &medians, bytes, floor_s);
    }
    Ok(())
}

/// The same with all digits, by the peers' own script.
fn with_all_digits(peers: &Path, dir: &Path, rows: usize) -> Result<PathBuf> {
    let path = dir.join(format!("full-{rows}.csv"));
    if !path.exists() {
        let mut command = Command::new("python3");
        command.arg(peers.join("make_wide.py")).arg(&path).arg(rows.to_string());
        steps::run(&format!("make {}", path.display()), &mut command)?;
    }
    Ok(path)
}

/// A file of the sensor model, made once and kept.
fn synthetic(shellcal: &Path, dir: &Path, kind: &str, rows: usize) -> Result<PathBuf> {
    let path = dir.join(format!("{kind}-{rows}.csv"));
    if !path.exists() {
        let mut command = Command::new(shellcal);
        command.args(["synth", kind, "--layout", "peer", "--rows", &rows.to_string(), "--output"]);
        steps::run(&format!("make {}", path.display()), command.arg(&path))?;
    }
    Ok(path)
}

/// The peers that are installed here, each on the same files.
fn peers(dir: &Path, train: &Path, test: &Path, model: &str) -> Vec<Tool> {
    let own = steps::workspace().join("xtask/peers");
    let own = own.as_path();
    let known: [(&'static str, &str, &Path, &str, &[&str]); 6] = [
        ("pandas + numpy", "python3", dir, "peer_fit.py", &["-c", "import numpy, pandas"]),
        ("polars + numpy", "python3", dir, "peer_polars.py", &["-c", "import numpy, polars"]),
        ("scikit-learn", "python3", dir, "peer_sklearn.py", &["-c", "import pandas, sklearn"]),
        ("DuckDB + numpy", "python3", own, "duckdb_fit.py", &["-c", "import duckdb, numpy"]),
        ("R data.table", "Rscript", dir, "peer_fit.R", &["-e", "library(data.table)"]),
        ("Octave", "octave-cli", dir, "peer_fit.m", &["--version"]),
    ];
    known
        .into_iter()
        .filter(|(name, program, _, _, check)| {
            let found = installed(program, check);
            if !found {
                println!("{name}: not installed here, left out");
            }
            found
        })
        .map(|(name, program, folder, script, _)| {
            let files = [&folder.join(script), train, test].map(argument);
            let command = [&[program.to_owned()], &files[..], &[model.to_owned()]].concat();
            Tool { name, command }
        })
        .collect()
}

/// The tools that get through a first run, which also warms the caches; ours has to.
fn working(tools: Vec<Tool>) -> Result<Vec<Tool>> {
    let mut works = Vec::new();
    for tool in tools {
        match measure(&tool.command) {
            Ok(_) => works.push(tool),
            Err(error) if works.is_empty() => return Err(error),
            Err(error) => println!("{}: left out: {error:#}", tool.name),
        }
    }
    Ok(works)
}

/// Interleaved runs, one summary per tool.
fn medians(tools: &[Tool], runs: usize) -> Result<Vec<Measurement>> {
    let mut measured = vec![Vec::new(); tools.len()];
    for _ in 0..runs {
        for (tool, measured) in tools.iter().zip(&mut measured) {
            let run = measure(&tool.command).with_context(|| format!("running {}", tool.name))?;
            measured.push(run);
        }
    }
    Ok(measured.iter().map(|runs| summary(runs)).collect())
}

fn print_table(model: &str, tools: &[Tool], medians: &[Measurement], bytes: u64, floor_s: f64) {
    let ours = medians[0];
    println!("{model}, with intercept");
    println!("{:<16} {:>10} {:>10} {:>12} {:>10}", "", "median ms", "ratio", "peak MB", "× file");
    for (tool, median) in tools.iter().zip(medians) {
        println!(
            "{:<16} {:>10.1} {:>10.1} {:>12.1} {:>10.2}",
            tool.name,
            median.wall_s * 1e3,
            median.wall_s / ours.wall_s,
            median.peak_bytes as f64 / 1e6,
            median.peak_bytes as f64 / bytes as f64,
        );
    }
    let of_peers = tools.iter().zip(medians).skip(1).filter(|(tool, _)| tool.name != BEFORE);
    let fastest = of_peers.map(|(_, median)| median.wall_s).fold(f64::INFINITY, f64::min);
    println!(
        "shellcal takes {:.1} × the floor; the fastest peer takes {:.1} × shellcal's time\n",
        ours.wall_s / floor_s,
        fastest / ours.wall_s,
    );
}

/// Median time to read the files and find their newlines, each thread a stretch of each file, in s.
fn floor(files: &[&Path], threads: usize, runs: usize) -> Result<f64> {
    let mut times = Vec::new();
    for _ in 0..runs {
        let start = Instant::now();
        let mut newlines = 0;
        for path in files {
            let stretch = fs::metadata(path)?.len().div_ceil(threads as u64);
            newlines += std::thread::scope(|scope| -> Result<usize> {
                let count =
                    |thread| scope.spawn(move || newlines_of(path, thread * stretch, stretch));
                let counting: Vec<_> = (0..threads as u64).map(count).collect();
                let count = |counting: std::thread::ScopedJoinHandle<'_, Result<usize>>| {
                    counting.join().expect("a thread that counts does not panic")
                };
                counting.into_iter().map(count).sum()
            })?;
        }
        ensure!(newlines > 0, "no rows");
        times.push(start.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    Ok(times[times.len() / 2])
}

/// The newlines in a stretch of a file.
fn newlines_of(path: &Path, start: u64, bytes: u64) -> Result<usize> {
    let mut file = fs::File::open(path)?;
    file.seek(SeekFrom::Start(start))?;
    let (mut file, mut buffer, mut newlines) = (file.take(bytes), vec![0; 1 << 20], 0);
    loop {
        let count = file.read(&mut buffer)?;
        if count == 0 {
            return Ok(newlines);
        }
        newlines += memchr::memchr_iter(b'\n', &buffer[..count]).count();
    }
}
