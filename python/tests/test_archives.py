"""An archive of logs on two worker processes, one of which is killed: the file of one machine, byte for byte."""

from __future__ import annotations

import json
import os
import random
import runpy
import shutil
import signal
import subprocess
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from conftest import EPOCH, program

import shellcal

LOGS = 200


class Archive:
    """Logs as they are delivered, and what one machine makes of them."""

    def __init__(self, folder: Path) -> None:
        whole = folder / "whole.csv"
        program("synth train", "--rows", 60 * LOGS, "--rate", 10, "-o", whole)
        header, *rows = whole.read_text().splitlines()
        self.paths = [folder / f"part-{number:03}.csv" for number in range(LOGS)]
        for number, path in enumerate(self.paths):
            path.write_text("\n".join([header, *rows[60 * number : 60 * (number + 1)]]) + "\n")
        # One `fit`, and the same from its sums, for what takes no rows.
        sums, merged, fitted = (folder / name for name in ("sums.json", "all.json", "fit.json"))
        program("fit", *self.paths, "--groups", "--partial", sums)
        program("merge", sums, "--cv", "-o", merged)
        program("fit", *self.paths, "--cv", "-o", fitted)
        self.merged = merged.read_text()
        self.fitted: dict[str, Any] = json.loads(fitted.read_text())
        # The same rows under another name, as a queue or an operator delivers them twice.
        self.twice = folder / "part-000-again.csv"
        shutil.copy(self.paths[0], self.twice)
        self.delivered = [*self.paths, self.twice]
        random.Random(1).shuffle(self.delivered)

    def check(self, calibration: shellcal.Calibration, skipped: list[str]) -> None:
        assert len(skipped) == 1 and skipped[0] in (str(self.paths[0]), str(self.twice))
        text = calibration.to_json()
        if skipped[0] == str(self.paths[0]):
            # Which of two equal files came first is chance; its name is all that tells.
            text = text.replace(str(self.twice), str(self.paths[0]))
        assert text == self.merged
        found = json.loads(text)
        assert found["coefficients"] == self.fitted["coefficients"]
        held_out = (of["diagnostics"]["cross_validation"] for of in (found, self.fitted))
        assert next(held_out) == next(held_out)
        for field in ("residual", "coefficients", "degrees_of_freedom"):
            assert found["covariance"][field] == self.fitted["covariance"][field]


@pytest.fixture(scope="module")
def archive(tmp_path_factory: pytest.TempPathFactory) -> Archive:
    return Archive(tmp_path_factory.mktemp("archive"))


def example(name: str) -> dict[str, Any]:
    return runpy.run_path(str(Path(__file__).parent.parent / "examples" / name))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.skipif(os.name == "nt", reason="a process is killed as POSIX does it")
def test_dask_makes_the_same_file_though_a_worker_is_killed(archive: Archive) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None
    ) as cluster, distributed.Client(cluster) as client:
        pids = list(client.run(os.getpid).values())
        assert len(set(pids)) == 2
        # In the middle: some logs are done, and more are not.
        killer = threading.Timer(0.05, lambda: os.kill(pids[0], signal.SIGKILL))
        killer.start()
        calibration, skipped = example("dask_fit.py")["fit"](client, archive.delivered)
        killer.join()
        deadline = time.monotonic() + 60
        while pids[0] in client.run(os.getpid).values():
            assert time.monotonic() < deadline, "the worker was not killed"
            time.sleep(0.1)
    archive.check(calibration, skipped)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.skipif(os.name == "nt", reason="a process is killed as POSIX does it")
def test_ray_makes_the_same_file_though_a_worker_is_killed(archive: Archive) -> None:
    ray = pytest.importorskip("ray")
    ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    try:
        pid = ray.get(ray.remote(lambda: os.getpid()).remote())
        killer = threading.Timer(0.3, lambda: os.kill(pid, signal.SIGKILL))
        killer.start()
        calibration, skipped = example("ray_fit.py")["fit"](archive.delivered)
        killer.join()
    finally:
        ray.shutdown()
    archive.check(calibration, skipped)


def test_the_program_alone_does_the_same_in_a_pipe(tmp_path: Path, logs: list[Path]) -> None:
    """What `docs/archives.md` has for SLURM and GNU parallel, with xargs in its place."""
    binary = shellcal.program()
    line = (
        f"printf '%s\\n' {' '.join(map(str, logs))} | xargs -P 2 -I LOG sh -c "
        f"'{binary} fit LOG --groups --partial LOG.json -q' && "
        f"cat {' '.join(f'{log}.json' for log in reversed(logs))} | {binary} merge - --cv -o {tmp_path}/cal.json"
    )
    environment = {**os.environ, "SOURCE_DATE_EPOCH": EPOCH}
    subprocess.run(line, shell=True, check=True, env=environment, capture_output=True)
    whole = shellcal.partial_fit(logs, groups=True)
    assert (tmp_path / "cal.json").read_text() == whole.solve(cv=True).to_json()
