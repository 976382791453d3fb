"""What an archive costs: `python benches/archives.py`.

Bytes of a partial fit by model, with and without groups; time to merge; rows per second and core. Medians of five, in
seconds of the processor, which other programs on the machine do not change.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import shellcal


def timed(work: Callable[[], object], clock: Callable[[], float] = time.process_time) -> float:
    times = []
    for _ in range(5):
        start = clock()
        work()
        times.append(clock() - start)
    return median(times)


def main() -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        logs = [folder / "a.csv", folder / "b.csv"]
        for seed, log in enumerate(logs):
            shellcal.synth("train", log, seed=seed)
        rows = shellcal.read_log(logs[0]).rows
        size = logs[0].stat().st_size
        print(f"{rows} rows, {size / rows:.0f} bytes a row")
        print(f"{'model':10}{'bytes':>9}{'a group':>9}{'merge':>10}{'with 388 groups':>17}{'rows/s and core':>17}")
        for model in ("linear", "cubic", "quadratic", "poly3"):
            plain = [shellcal.partial_fit(log, model) for log in logs]
            grouped = [shellcal.partial_fit(log, model, groups=True) for log in logs]
            bytes_, groups = len(plain[0].to_bytes()), grouped[0].groups or []
            per_group = (len(grouped[0].to_bytes()) - 3 * bytes_) / len(groups)

            def merge(parts: list[shellcal.Partial]) -> float:
                first, second = (part.to_bytes() for part in parts)

                def work() -> None:
                    shellcal.Partial.from_bytes(first).merge(shellcal.Partial.from_bytes(second))

                # Of each, one document is read and merged.
                return timed(work) / 2

            summing = timed(lambda: shellcal.partial_fit(logs[0], model, threads=1))
            print(
                f"{model:10}{bytes_:9}{per_group:9.0f}{merge(plain) * 1e3:7.2f} ms"
                f"{merge(grouped) * 1e3:14.1f} ms{rows / summing:17,.0f}"
            )
        # Two processes beside each other, as two workers have them.
        for workers in (1, 2):
            command = [shellcal.program(), "fit", "--threads=1", "-q", "--partial"]

            def work() -> None:
                running = [
                    subprocess.Popen([*command, os.devnull, logs[worker]]) for worker in range(workers)
                ]
                assert all(process.wait() == 0 for process in running)

            print(f"{workers} processes, cubic: {workers * rows / timed(work, time.perf_counter):,.0f} rows/s")


if __name__ == "__main__":
    main()
