#!/usr/bin/env python3
"""Measures shellcal against the tools in common use: whole processes, from start to exit. The tools take turns, so that
other load on the machine affects all of them. Missing tools are named and left out.

usage: bench.py fits    [--peers DIR] [--rows N] [--full] [--before FILE]   fits against pandas, polars, DuckDB, R, Octave
       bench.py choice  [--rows N] [--before FILE]                           the default fit against a grid search of scikit-learn
       bench.py channels                                                     455 features of twelve channels against scikit-learn
       bench.py binary                                                       Parquet and NumPy files against polars and numpy
       bench.py lengths                                                      time and memory against the length of a log
       bench.py trials  [--peers DIR] --matrix FILE                          batches of trials against a notebook's pipeline
       bench.py beams                                                        the beam channel against companion matrices
       bench.py instructions                                                 what a fit costs with what it can be asked for

`--runs N` sets the number of runs, `--program FILE` another program than the release, which is built first.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
WORK = ROOT / "target" / "bench"


def cargo(*arguments: str) -> None:
    subprocess.run(["cargo", *arguments], cwd=ROOT, check=True)


def measure(command: list) -> tuple[float, float]:
    """Seconds from start to exit, and peak memory in MB."""
    start = time.perf_counter()
    process = subprocess.Popen([str(part) for part in command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    said = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - start
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(said.decode(errors="replace").strip().splitlines()[-1:] or process.returncode)
    return seconds, usage.ru_maxrss / (1e3 if sys.platform == "linux" else 1e6)


def compare(title: str, tools: dict[str, list], runs: int) -> None:
    """Prints a table of medians; the first tool is shellcal, which must work."""
    working = {}
    for name, command in tools.items():
        try:
            measure(command)  # also warms the caches
            working[name] = command
        except (OSError, RuntimeError) as error:
            if not working:
                raise
            print(f"{name}: left out: {error}")
    found = {name: [] for name in working}
    for _ in range(runs):
        for name, command in working.items():
            found[name].append(measure(command))
    print(f"\n{title}\n{'':<20} {'median ms':>10} {'ratio':>8} {'peak MB':>9}")
    ours = None
    for name, runs_of_it in found.items():
        seconds = statistics.median(run[0] for run in runs_of_it)
        ours = ours or seconds
        print(f"{name:<20} {1e3 * seconds:>10.1f} {seconds / ours:>8.1f} {max(run[1] for run in runs_of_it):>9.1f}")


def made(path: Path, command: list) -> Path:
    """Returns a file, created by a command unless it exists."""
    if not path.exists():
        subprocess.run([str(part) for part in command], check=True, stdout=subprocess.DEVNULL)
    return path


def fits(options: argparse.Namespace) -> None:
    def log(kind: str, rows: int) -> Path:
        if options.full:
            path = WORK / f"full-{rows}.csv"
            return made(path, ["python3", options.peers / "make_wide.py", path, rows])
        path = WORK / f"{kind}-{rows}.csv"
        return made(path, [options.program, "synth", kind, "--layout", "peer", "--rows", rows, "-o", path])

    train, test = log("train", options.rows), log("test", 19_932)
    print(f"{options.rows} + 19932 rows, {(train.stat().st_size + test.stat().st_size) / 1e6:.1f} MB")
    for model, theirs in {"cubic": "cubic24+1", "quadratic": "quad44+1", "poly3": "cubic164+1"}.items():
        def fit(program: Path) -> list:
            calibration = WORK / "calibration.json"
            return [program, "fit", train, "--test", test, "--model", model, "-o", calibration, "--json"]

        tools = {"shellcal": fit(options.program)}
        if options.before:
            tools["shellcal before"] = fit(options.before)
        peers = {"DuckDB + numpy": ["python3", HERE / "duckdb_fit.py"]}
        if options.peers:
            scripts = {"pandas + numpy": "peer_fit.py", "polars + numpy": "peer_polars.py", "scikit-learn": "peer_sklearn.py"}
            peers |= {name: ["python3", options.peers / script] for name, script in scripts.items()}
            peers |= {"R data.table": ["Rscript", options.peers / "peer_fit.R"]}
            peers |= {"Octave": ["octave-cli", options.peers / "peer_fit.m"]}
        tools |= {name: [*command, train, test, theirs] for name, command in peers.items()}
        compare(f"{model}, with intercept", tools, options.runs)


def choice(options: argparse.Namespace) -> None:
    def log(kind: str, rows: int) -> Path:
        path = WORK / f"plain-{kind}-{rows}.csv"
        return made(path, [options.program, "synth", kind, "--layout", "peer", "--rows", rows, "-o", path])

    train, test = log("train", options.rows), log("test", 19_932)
    # scikit-learn compares the same polynomials, without lag and memory.
    polynomials = ["--lag", "0", "--memory-terms", "none"]
    fit = [options.program, "fit", train, "--test", test, "-o", WORK / "calibration.json", "--json"]
    tools = {"shellcal": fit, "without memory": [*fit, *polynomials]}
    if options.before:
        tools["shellcal before"] = [options.before, *fit[1:]]
    tools["scikit-learn"] = [sys.executable, HERE / "choice_sklearn.py", train, test]
    compare(f"choice of a model, {options.rows} rows", tools, options.runs)


def channels(options: argparse.Namespace) -> None:
    script = HERE / "twelve_channels.py"
    log = made(WORK / "twelve.csv", ["python3", script, "make", WORK / "twelve.csv"])
    tools = {"shellcal": [options.program, "fit", log, "--model", "poly3", "-o", WORK / "calibration.json", "--json"]}
    if options.before:
        tools["shellcal before"] = [options.before, *tools["shellcal"][1:]]
    tools["scikit-learn"] = ["python3", script, "fit", log]
    compare(f"poly3 of twelve channels, {log.stat().st_size / 1e6:.1f} MB", tools, options.runs)


def binary(options: argparse.Namespace) -> None:
    script = HERE / "binary_logs.py"
    by_position = ["--sensors", "1-8", "--wrench", "9-14"]
    # polars packs with Zstandard unless told otherwise, pandas with Snappy.
    files = {name: (0, []) for name in ("14.parquet", "14.snappy.parquet")}
    files |= {"14+60.parquet": (60, []), "14.npy": (0, by_position)}
    for name, (others, columns) in files.items():
        log = made(WORK / name, [sys.executable, script, "make", WORK / name, others])
        fit = ["fit", log, *columns, "--model", "linear", "-o", WORK / "calibration.json", "--json"]
        tools = {"shellcal": [options.program, *fit]}
        if options.before:
            tools["shellcal before"] = [options.before, *fit]
        tools["numpy" if name.endswith(".npy") else "polars + numpy"] = [sys.executable, script, "fit", log]
        compare(f"{name}, linear, 500000 rows, {log.stat().st_size / 1e6:.1f} MB", tools, options.runs)


def lengths(options: argparse.Namespace) -> None:
    rows = 10_000
    seed = WORK / "seed.csv"
    made(seed, [options.program, "synth", "train", "--layout", "peer", "--rows", rows, "-o", seed])
    header, _, body = seed.read_bytes().partition(b"\n")
    for factor in (1, 10, 100, 1000):
        path = WORK / f"times-{factor}.csv"
        with path.open("wb") as file:
            file.write(header + b"\n")
            for _ in range(factor):
                file.write(body)
        fit = [options.program, "fit", path, "-o", "/dev/null", "--covariance", "rows", "--quiet"]
        compare(f"{rows * factor} rows, {path.stat().st_size / 1e6:.1f} MB", {"shellcal": fit}, options.runs)
        path.unlink()


def trials(options: argparse.Namespace) -> None:
    folder = WORK / "trials"
    manifest = made(folder / "manifest.csv", [options.program, "synth", "trials", "--per-condition", "5", folder])
    calibration = WORK / "matrix.json"
    subprocess.run([options.program, "import", options.matrix, "-o", calibration], check=True)
    rows = [line.split(",") for line in manifest.read_text().splitlines()[1:]]
    logs = []
    for name, *_ in rows:
        # The notebook skips eight lines, which precede the column names in the lab's logs.
        text = (folder / name).read_text()
        comments = sum(line.startswith("%") for line in text.splitlines()[:9])
        logs.append(folder / name.replace(".txt", ".lab.txt"))
        logs[-1].write_text("%\n" * (9 - comments) + text)

    def batch(parts: int, share: float, *more: object) -> list:
        """Returns a command on windows of a share of each trial's, cut into parts."""
        lines = ["file,condition,t_enter_s,t_exit_s"]
        for i, (log, (_, _, start, end)) in enumerate(zip(logs, rows)):
            begin, step = float(start), share * (float(end) - float(start)) / parts
            lines += [f"{log},{i // 5},{begin + k * step:.6f},{begin + (k + 1) * step:.6f}" for k in range(parts)]
        path = WORK / f"manifest-{parts}-{share}.csv"
        path.write_text("\n".join(lines) + "\n")
        return [options.program, "batch", path, "--calibration", calibration, "-q", "--csv", WORK / "results", *more]

    peers = {"polars": HERE / "polars_trials.py"}
    if options.peers:
        peers["notebook"] = options.peers / "peer_trial.py"
    results = {name: ["python3", script, options.matrix, *logs] for name, script in peers.items()}
    compare("25 trials", {"shellcal": batch(1, 1.0)} | results, options.runs)
    tables = {name: ["python3", script, "--csv", WORK / "peer", options.matrix, *logs] for name, script in peers.items()}
    traces = batch(1, 1.0, "--traces", WORK / "traces")
    compare("25 trials and a table of every row", {"shellcal": traces} | tables, options.runs)
    for share in (0.02, 0.25, 0.5):
        compare(f"{100 * share:.0f} % of their windows", {"shellcal": batch(1, share)}, options.runs)
    compare("1000 trials", {"shellcal": batch(40, 1.0)}, 1)


def beams(options: argparse.Namespace) -> None:
    """Times only the solving, not the start of a process."""
    cargo("build", "--release", "--package", "beam-channel", "--example", "sweep")
    sweep = ROOT / "target/release/examples/sweep"
    companion = ROOT / "beam-channel/benches/peer_companion.py"
    pitch = 0.28 / 11

    def run(command: list, beams: int, positions: int, repeats: int) -> dict:
        length = pitch * (beams - 1)
        ways = (-0.1, length + 0.1) if beams == 11 else (length / 2, length / 2 + 10 * pitch)
        values = [0.06, beams, pitch, *ways, positions, repeats]
        one_thread = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        command = [str(part) for part in [*command, *values]]
        return json.loads(subprocess.run(command, check=True, capture_output=True, env=one_thread).stdout)

    print(f"{'beams':>6} {'µs/position':>12} {'ns/contact':>11}")
    for count in (11, 110, 11_000):
        ours = run([sweep], count, 2000, options.runs)
        seconds = statistics.median(ours["seconds"])
        print(f"{count:>6} {seconds * 1e6 / 2000:>12.3f} {seconds * 1e9 / ours['contacts']:>11.1f}")
    found: dict[str, list[float]] = {}
    for _ in range(options.runs):
        ours, peers = run([sweep], 11, 200, 1), run(["python3", companion], 11, 200, 1)
        for name, result in {"beam-channel": ours, **peers}.items():
            found.setdefault(name, []).extend(result["seconds"])
            apart = max(abs(a - b) for a, b in zip(ours["totals"], result["totals"]))
            assert apart < 1e-6, f"{name}: {apart} N apart"
    for name, seconds in found.items():
        ratio = statistics.median(seconds) / statistics.median(found["beam-channel"])
        print(f"{name:<20} {statistics.median(seconds) * 1e6 / 200:>10.3f} µs/position {ratio:>8.1f}")


def instructions(options: argparse.Namespace) -> None:
    """Counts instructions with Valgrind, the same number in every run. A plain fit must not run code of optional features."""
    # Not the release profile, which inlines functions across files.
    cargo("build", "--profile", "checked", "--package", "shellcal")
    program, log, profile = ROOT / "target/checked/shellcal", WORK / "train-20000.csv", WORK / "callgrind.out"
    made(log, [program, "synth", "train", "--quiet", "--rows", "20000", "-o", log])
    null = ["--output", "/dev/null", "--covariance"]
    asked = {
        "nothing": [],
        "calibration file": [*null, "none"],
        "covariance by rows": [*null, "rows"],
        "covariance by groups": [*null, "groups"],
        "figure": ["--plot", WORK / "fit.svg"],
        "cross-validation": ["--cv"],
        "choice of the model": ["--model", "auto"],
    }
    unasked = ("validation::grouped", "validation::cross_validation", "validation::selection", "uncertainty", "magnitudes")
    plain = 0
    print("| asked for | instructions | times a plain fit |\n| --- | ---: | ---: |")
    for name, arguments in asked.items():
        valgrind = ["valgrind", "--tool=callgrind", f"--callgrind-out-file={profile}", "--quiet"]
        model = [] if "--model" in arguments else ["--model", "cubic"]
        fit = [program, "fit", log, "--quiet", "--threads", "1", *model, *arguments]
        subprocess.run([str(part) for part in valgrind + fit], check=True, stdout=subprocess.DEVNULL)
        text = profile.read_text()
        count = int(next(line for line in text.splitlines() if line.startswith("totals: ")).split()[1])
        plain = plain or count
        print(f"| {name} | {count / 1e6:.1f} M | {count / plain:.3f} |")
        entered = [part for part in unasked if f") least_squares::{part}" in text or f") <least_squares::{part}" in text]
        assert name not in ("nothing", "calibration file") or not entered, f"{name}: entered {entered}"


def main() -> None:
    parser = argparse.ArgumentParser(usage=__doc__)
    suites = [fits, choice, channels, binary, lengths, trials, beams, instructions]
    parser.add_argument("suite", choices=[suite.__name__ for suite in suites])
    parser.add_argument("--peers", type=Path)
    parser.add_argument("--program", type=Path)
    parser.add_argument("--before", type=Path)
    parser.add_argument("--matrix", type=Path)
    parser.add_argument("--rows", type=int, default=77_522)
    parser.add_argument("--full", action="store_true", help="all digits of a double")
    parser.add_argument("--runs", type=int, default=7)
    options = parser.parse_args()
    WORK.mkdir(parents=True, exist_ok=True)
    if options.program is None and options.suite not in ("beams", "instructions"):
        cargo("build", "--release", "--package", "shellcal")
        options.program = ROOT / "target/release/shellcal"
    next(suite for suite in suites if suite.__name__ == options.suite)(options)


main()
