"""Costs of an archive: `python benches/archives.py`, a few minutes.

Bytes of a partial fit by model, with and without groups; rows per second and core; time to merge a document.
Medians of five, in seconds of processor time, which does not depend on other programs on the machine.
"""

from __future__ import annotations

import os
import resource
import subprocess
import tempfile
from pathlib import Path
from statistics import median

import numpy as np

import shellcal

#: Number of partial fits in a stream.
PARTS = 2000


def processor_seconds(*arguments: object, stdin: Path | None = None) -> float:
    """Median of five runs of a command of the program."""
    times = []
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        with open(stdin or os.devnull, "rb") as source:
            command = [shellcal.program(), *map(str, arguments), "--quiet"]
            subprocess.run(command, check=True, stdin=source, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(
            after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        )
    return median(times)


def main() -> None:
    random = np.random.default_rng(1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log, sums, grouped, stream = (folder / file for file in ("a.csv", "a.json", "g.json", "s.json"))
        shellcal.synth("train", log)
        table = shellcal.read_log(log)
        rows, groups = table.rows, len(set(table.groups))
        print(f"{rows} rows in {groups} groups, {log.stat().st_size / rows:.0f} bytes a row")
        print(f"{'model':10}{'bytes':>9}{'a group':>9}{'rows/s':>12}{'by group':>12}{'merge':>10}")
        for model in ("linear", "cubic", "quadratic", "poly3"):
            fit = ("fit", log, "--model", model, "--threads", 1, "--partial")
            summing = processor_seconds(*fit, sums)
            by_group = processor_seconds(*fit, grouped, "--groups")
            size = sums.stat().st_size
            # The file has additional sums of all rows and of two random folds.
            a_group = (grouped.stat().st_size - 3 * size) / groups
            with open(stream, "wb") as file:
                for _ in range(PARTS):
                    part = random.integers(0, rows, 50)
                    file.write(shellcal.Partial(model).add(table.X[part], table.Y[part]).to_bytes())
            merging = processor_seconds("merge", "-", "--partial", folder / "all.json", stdin=stream)
            print(
                f"{model:10}{size:9}{a_group:9.0f}{rows / summing:12,.0f}{rows / by_group:12,.0f}"
                f"{merging / PARTS * 1e3:7.2f} ms"
            )


if __name__ == "__main__":
    main()
