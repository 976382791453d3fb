"""Runs the pipelines of `examples/pipeline` with Snakemake and with DVC, and kills a task."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import shellcal

from conftest import EPOCH, program

PIPELINE = Path(__file__).parent.parent / "examples" / "pipeline"
FILES = ("calibration.json", "results/trials.csv", "report.html")

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the killed task is a shell script")

#: The program, except that the first attempt at the second session is killed in the middle of its work.
KILLED = """#!/bin/sh
case "$*" in
  *session-2.csv*)
    if [ ! -e killed ]; then
      touch killed
      "{program}" "$@" &
      kill -9 $!
      exit 137
    fi ;;
esac
exec "{program}" "$@"
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pipeline")
    shutil.copytree(PIPELINE, folder, dirs_exist_ok=True)
    for name in ("training", "trials"):
        (folder / name).mkdir()
    for seed in (1, 2, 3):
        log = folder / "training" / f"session-{seed}.csv"
        program("synth train", "--rows", 400, "--rate", 10, "--seed", seed, "-o", log)
    rows = ["file,condition,t_enter_s,t_exit_s"]
    for seed in (1, 2):
        program("synth trial", "--seed", seed, "-o", folder / "trials" / f"run-{seed}.txt")
        rows.append(f"run-{seed}.txt,3 cm,auto,auto")
    (folder / "trials" / "manifest.csv").write_text("\n".join(rows) + "\n")
    return folder


def run(folder: Path, *line: str, ok: bool = True) -> str:
    tools = f"{folder}{os.pathsep}{Path(sys.executable).parent}"
    surroundings = {
        **os.environ,
        "SOURCE_DATE_EPOCH": EPOCH,
        "PATH": f"{tools}{os.pathsep}{os.environ['PATH']}",
        "HOME": str(folder),
        "DVC_NO_ANALYTICS": "1",
    }
    done = subprocess.run(line, cwd=folder, env=surroundings, capture_output=True, text=True, check=False)
    assert (done.returncode == 0) == ok, done.stdout + done.stderr
    return done.stdout + done.stderr


def made(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in FILES}


def start_over(folder: Path, script: str) -> None:
    """Removes all results; the program is then a script in the pipeline's folder."""
    for path in [folder / "killed", *(folder / "partial").glob("*"), *(folder / name for name in FILES)]:
        path.unlink(missing_ok=True)
    tool = folder / "shellcal"
    tool.write_text(script.format(program=shellcal.program()))
    tool.chmod(tool.stat().st_mode | stat.S_IXUSR)


def test_a_killed_task_is_repeated_to_the_same_bytes(folder: Path) -> None:
    pytest.importorskip("snakemake")
    pytest.importorskip("dvc")
    snakemake = [sys.executable, "-m", "snakemake", "--cores", "2", "--quiet", "all"]
    start_over(folder, '#!/bin/sh\nexec "{program}" "$@"\n')
    run(folder, *snakemake)
    whole = made(folder)
    assert b"</html>" in whole["report.html"] and b"run-2.txt" in whole["results/trials.csv"]

    # A replaced log is detected, even if its time is older.
    log, other = folder / "trials" / "run-2.txt", folder / "trials" / "run-1.txt"
    content, times = log.read_bytes(), (log.stat().st_atime, log.stat().st_mtime)
    log.write_bytes(other.read_bytes())
    os.utime(log, (times[0] - 3600, times[1] - 3600))
    run(folder, *snakemake)
    assert made(folder)["results/trials.csv"] != whole["results/trials.csv"]
    log.write_bytes(content)
    run(folder, *snakemake)
    assert made(folder) == whole

    start_over(folder, KILLED)
    run(folder, *snakemake, "--retries", "1")
    assert (folder / "killed").exists()
    assert made(folder) == whole

    start_over(folder, KILLED)
    shutil.rmtree(folder / "partial")
    shutil.rmtree(folder / "results")
    run(folder, sys.executable, "-m", "dvc", "init", "--no-scm", "--quiet")
    said = run(folder, sys.executable, "-m", "dvc", "repro", ok=False)
    assert "session-2" in said
    run(folder, sys.executable, "-m", "dvc", "repro", "--quiet")
    assert made(folder) == whole
    # Unchanged results are not recomputed.
    assert "didn't change" in run(folder, sys.executable, "-m", "dvc", "repro")


def test_the_profile_of_slurm_is_one(folder: Path) -> None:
    yaml = pytest.importorskip("yaml")
    profile = yaml.safe_load((PIPELINE / "profiles" / "slurm" / "config.yaml").read_text())
    assert profile["executor"] == "slurm" and profile["retries"] > 0
