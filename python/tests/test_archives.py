"""An archive of logs on two worker processes, one of which is killed: the result equals a single machine's file."""

from __future__ import annotations

import functools
import json
import os
import random
import runpy
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import EPOCH, program

import shellcal

LOGS = 200


class Archive:
    """Delivered logs, and the result of a single machine."""

    def __init__(self, folder: Path) -> None:
        whole = folder / "whole.csv"
        program("synth train", "--rows", 60 * LOGS, "--rate", 10, "-o", whole)
        header, *rows = whole.read_text().splitlines()
        self.paths = [folder / f"part-{number:03}.csv" for number in range(LOGS)]
        for number, path in enumerate(self.paths):
            path.write_text("\n".join([header, *rows[60 * number : 60 * (number + 1)]]) + "\n")
        # The result of `fit`, and the one from its sums, for results that need no rows.
        sums, merged, fitted = (folder / name for name in ("sums.json", "all.json", "fit.json"))
        program("fit", *self.paths, "--groups", "--partial", sums)
        program("merge", sums, "--cv", "-o", merged)
        program("fit", *self.paths, "--model", "cubic", "--cv", "-o", fitted)
        self.merged = merged.read_text()
        self.fitted: dict[str, Any] = json.loads(fitted.read_text())
        # The same rows under another name, as if a queue or an operator delivered them twice.
        self.twice = folder / "part-000-again.csv"
        shutil.copy(self.paths[0], self.twice)
        self.delivered = [*self.paths, self.twice]
        random.Random(1).shuffle(self.delivered)

    def check(self, calibration: shellcal.Calibration, skipped: list[str]) -> None:
        assert len(skipped) == 1 and skipped[0] in (str(self.paths[0]), str(self.twice))
        text = calibration.to_json()
        if skipped[0] == str(self.paths[0]):
            # The order of two equal files is random; only its name, and a checksum that includes it, differ.
            text = text.replace(str(self.twice), str(self.paths[0]))
        without_checksum = [it.rsplit(',\n  "checksum"', 1)[0] for it in (text, self.merged)]
        assert without_checksum[0] == without_checksum[1]
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
        # In the middle of the work: some logs are done, others are not.
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


def test_partitions_of_a_table_are_the_fit_of_the_whole_on_spark(logs: list[Path]) -> None:
    """Tests the functions passed to `mapInArrow` and `treeReduce`, on batches as Spark passes them."""
    arrow = pytest.importorskip("pyarrow")
    spark_fit = example("spark_fit.py")
    tables = [arrow.table(shellcal.read_log(log)) for log in logs]
    batches = [batch for table in tables for batch in table.to_batches(max_chunksize=170)]
    random.Random(4).shuffle(batches)
    partitions = [batches[place::4] for place in range(4)] + [[]]
    documents = [
        batch.column("partial")[0].as_py()
        for partition in partitions
        for batch in spark_fit["sums"](iter(partition), "cubic")
    ]
    assert len(documents) == 4
    whole = functools.reduce(spark_fit["merged"], documents)
    rows = [np.concatenate([table[name].to_numpy() for table in tables]) for name in tables[0].column_names]
    columns = dict(zip(tables[0].column_names, rows))
    everything = shellcal.Table(columns, {})
    expected = shellcal.Calibration("cubic", cv=True).fit(everything.X, everything.Y, groups=everything.groups)
    found = shellcal.Partial.from_bytes(whole).solve(cv=True)
    assert (found.coefficients_ == expected.coefficients_).all()
    held_out = (of.diagnostics_["cross_validation"]["grouped"] for of in (found, expected))
    for ours, theirs in zip(next(held_out), next(held_out)):
        # Sums of squares over groups, in the order of their batches.
        assert ours["rms"] == pytest.approx(theirs["rms"], rel=1e-12)
    with pytest.raises(shellcal.CountedTwiceError):
        spark_fit["merged"](whole, documents[0])


@pytest.mark.filterwarnings("ignore")
def test_spark_makes_the_same_calibration(
    logs: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    sql = pytest.importorskip("pyspark.sql")
    monkeypatch.setenv("PYSPARK_PYTHON", sys.executable)
    frames = [pytest.importorskip("pandas").DataFrame(dict(shellcal.read_log(log))) for log in logs]
    session = sql.SparkSession.builder.master("local[2]").config("spark.ui.enabled", "false").getOrCreate()
    try:
        table = session.createDataFrame(frames[0])
        for frame in frames[1:]:
            table = table.union(session.createDataFrame(frame))
        found = example("spark_fit.py")["fit"](table.repartition(5))
    finally:
        session.stop()
    expected = shellcal.partial_fit(logs, groups="column").solve(cv=True)
    assert (found.coefficients_ == expected.coefficients_).all()


def test_shares_of_a_manifest_are_one_data_set(tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    shellcal.synth("train", tmp_path / "train.csv", rows=2000, rate=10)
    calibration = tmp_path / "calibration.json"
    shellcal.fit_logs(tmp_path / "train.csv", model="cubic").save(calibration)
    shellcal.synth("trials", tmp_path / "trials")
    manifest = tmp_path / "trials/manifest.csv"
    whole = shellcal.batch(manifest, calibration, parquet=tmp_path / "whole")
    # More shares than a cluster would use for 25 trials: some are empty.
    parts = [
        shellcal.batch(manifest, calibration, shard=f"{share}/30", parquet=tmp_path / "parts")
        for share in range(30, 0, -1)
    ]
    assert [trial for part in reversed(parts) for trial in part["trials"]] == whole["trials"]
    for table in ("trials", "strides"):
        found = parquet.read_table(tmp_path / "parts" / table)
        assert found == parquet.read_table(tmp_path / "whole" / f"{table}.parquet"), table
    assert not (tmp_path / "parts/conditions").exists()


def test_the_program_alone_does_the_same_in_a_pipe(tmp_path: Path, logs: list[Path]) -> None:
    """Tests the commands of `docs/archives.md` for SLURM and GNU parallel, with xargs instead."""
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
