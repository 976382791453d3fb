//! `cargo xtask bench-trials`: batches of trials, process start to exit, against a notebook's
//! pipeline in pandas and a vectorised one in polars and SciPy; and how they grow with the windows and
//! with the number of trials.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::measure::{Measurement, argument, installed, measure, summary};
use crate::steps;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Directory of the peer's script, peer_trial.py
    #[arg(long, env = "SHELLCAL_PEERS", value_name = "DIR")]
    peers: PathBuf,

    /// The calibration matrix that both use, as MATLAB has it [default: that of the real recordings
    /// in `SHELLCAL_REAL_DATA`, or beside the peers]
    #[arg(long, value_name = "FILE")]
    matrix: Option<PathBuf>,

    /// The program that is measured [default: the release, built first]
    #[arg(long, value_name = "FILE")]
    program: Option<PathBuf>,

    /// Runs of every batch; the notebook runs once, as it takes its time
    #[arg(long, default_value_t = 9)]
    runs: usize,
}

/// Trials in a condition, of five.
const PER_CONDITION: usize = 5;
/// Trials to measure the memory with.
const MANY: usize = 1000;
/// Shares of the windows to evaluate.
const SHARES: [f64; 4] = [0.02, 0.25, 0.5, 1.0];

/// A log and the window of its trial, s.
struct Log {
    path: PathBuf,
    window_s: [f64; 2],
}

pub(crate) fn run(args: &Args) -> Result<()> {
    let matrix = match (&args.matrix, std::env::var_os("SHELLCAL_REAL_DATA")) {
        (Some(matrix), _) => matrix.clone(),
        (None, Some(data)) => PathBuf::from(data).join("skinproc/N_matrix_trial9.mat"),
        (None, None) => args.peers.join("../data/skinproc/N_matrix_trial9.mat"),
    };
    ensure!(matrix.exists(), "`{}` does not exist, name one with `--matrix`", matrix.display());
    let shellcal = args.program.clone().map_or_else(steps::build_shellcal, Ok)?;
    let dir = steps::scratch("bench-trials")?;
    let logs = logs(&shellcal, &dir)?;
    let calibration = dir.join("calibration.json");
    let mut import = Command::new(&shellcal);
    steps::run(
        "import the matrix",
        import.arg("import").args([&matrix]).arg("-o").arg(&calibration),
    )?;
    let batch = |manifest: &Path, more: &[String]| {
        let mut command = vec![argument(&shellcal), "batch".into(), argument(manifest)];
        command.extend(["--calibration".into(), argument(&calibration), "--quiet".into()]);
        command.extend(["--csv".into(), argument(&dir.join("results"))]);
        command.extend_from_slice(more);
        command
    };
    let repeat = |command: &[String]| -> Result<Measurement> {
        measure(command)?;
        let runs: Result<Vec<_>> = (0..args.runs).map(|_| measure(command)).collect();
        Ok(summary(&runs?))
    };

    let rows: usize = logs.iter().map(|log| count_rows(&log.path)).sum::<Result<usize>>()?;
    println!("\n{} trials, {rows} rows\n", logs.len());
    let manifest = write_manifest(&dir, "windows", &logs, |[from, to]| vec![[from, to]])?;
    let traces = ["--traces".into(), argument(&dir.join("traces")), "--whole-logs".into()];
    let ours = [repeat(&batch(&manifest, &[]))?, repeat(&batch(&manifest, &traces))?];
    let own = steps::workspace().join("xtask/peers/polars_trials.py");
    let notebook = args.peers.join("peer_trial.py");
    let mut theirs = Vec::new();
    for (name, script, needs, runs) in [
        ("notebook", &notebook, "import pandas, scipy", 1),
        ("polars", &own, "import polars, scipy", args.runs),
    ] {
        match installed("python3", &["-c", needs]) {
            true => theirs.push((name, peer(script, &matrix, &logs, &dir, runs)?)),
            false => println!("{name}: `{needs}` fails in python3 here, left out"),
        }
    }
    println!("{:<16} {:<10} {:>10} {:>8} {:>9}", "", "", "ms", "ratio", "peak MB");
    for (i, name) in ["results", "and traces"].into_iter().enumerate() {
        let all = [("shellcal", &ours)].into_iter().chain(theirs.iter().map(|(n, of)| (*n, of)));
        for (tool, both) in all {
            let (ms, megabytes) = (both[i].wall_s * 1e3, both[i].peak_bytes as f64 / 1e6);
            let ratio = both[i].wall_s / ours[i].wall_s;
            println!("{name:<16} {tool:<10} {ms:>10.1} {ratio:>8.1} {megabytes:>9.1}");
        }
    }

    println!("\nthe same logs, less of their windows");
    for share in SHARES {
        let part = |[from, to]: [f64; 2]| vec![[from, from + share * (to - from)]];
        let manifest = write_manifest(&dir, "part", &logs, part)?;
        let found = repeat(&batch(&manifest, &[]))?;
        println!("{:>4.0} % {:>10.1} ms", 100.0 * share, found.wall_s * 1e3);
    }

    let each = MANY / logs.len();
    let cut = |[from, to]: [f64; 2]| {
        let step = (to - from) / each as f64;
        let at = |i: usize| ((from + i as f64 * step) * 1e6).round() / 1e6;
        (0..each).map(|i| [at(i), at(i + 1)]).collect()
    };
    let manifest = write_manifest(&dir, "many", &logs, cut)?;
    let found = measure(&batch(&manifest, &[]))?;
    println!(
        "\n{} trials: {:.0} ms, {:.1} MB",
        each * logs.len(),
        found.wall_s * 1e3,
        found.peak_bytes as f64 / 1e6
    );
    Ok(())
}

/// The example set, made once and kept.
fn logs(shellcal: &Path, dir: &Path) -> Result<Vec<Log>> {
    let set = dir.join("set");
    let manifest = set.join("manifest.csv");
    if !manifest.exists() {
        let mut command = Command::new(shellcal);
        command.args(["synth", "trials", "--per-condition", &PER_CONDITION.to_string()]);
        steps::run("make trials", command.arg(&set))?;
    }
    let text = fs::read_to_string(&manifest)?;
    let row = |line: &str| -> Result<Log> {
        let fields: Vec<&str> = line.split(',').collect();
        let [file, _, from, to] = fields[..] else { anyhow::bail!("`{line}` is no trial") };
        let path = set.join(file.replace(".txt", ".lab.txt"));
        write_with_lab_header(&set.join(file), &path)?;
        Ok(Log { path, window_s: [from.parse()?, to.parse()?] })
    };
    text.lines().skip(1).map(row).collect()
}

/// The peer leaves out eight lines, as the lab's logs have them before the names of columns.
fn write_with_lab_header(from: &Path, to: &Path) -> Result<()> {
    let text = fs::read_to_string(from)?;
    let header = text.lines().take_while(|line| line.starts_with('%')).count();
    let missing = 9_usize.checked_sub(header).context("more than nine lines of header")?;
    Ok(fs::write(to, format!("{}{text}", "%\n".repeat(missing)))?)
}

fn count_rows(path: &Path) -> Result<usize> {
    let bytes = fs::read(path)?;
    let is_row = |line: &&[u8]| !line.starts_with(b"%") && !line.is_empty();
    Ok(bytes.split(|byte| *byte == b'\n').filter(is_row).count())
}

/// A manifest of the windows that `windows` makes of that of each log.
fn write_manifest(
    dir: &Path,
    name: &str,
    logs: &[Log],
    windows: impl Fn([f64; 2]) -> Vec<[f64; 2]>,
) -> Result<PathBuf> {
    let mut text = "file,condition,t_enter_s,t_exit_s\n".to_owned();
    for (i, log) in logs.iter().enumerate() {
        for [from, to] in windows(log.window_s) {
            text += &format!("{},{},{from},{to}\n", log.path.display(), i / PER_CONDITION);
        }
    }
    let path = dir.join(format!("{name}.csv"));
    fs::write(&path, text)?;
    Ok(path)
}

/// A peer on all logs in one process, without and with its table of every row.
fn peer(
    script: &Path,
    matrix: &Path,
    logs: &[Log],
    dir: &Path,
    runs: usize,
) -> Result<[Measurement; 2]> {
    let run = |more: &[String]| {
        let mut command = vec!["python3".into(), argument(script)];
        command.extend_from_slice(more);
        command.push(argument(matrix));
        command.extend(logs.iter().map(|log| argument(&log.path)));
        let runs: Result<Vec<_>> = (0..runs).map(|_| measure(&command)).collect();
        Ok::<_, anyhow::Error>(summary(&runs?))
    };
    Ok([run(&[])?, run(&["--csv".into(), argument(&dir.join("peer"))])?])
}
