"""One calibration from an archive of logs, on Ray: `python ray_fit.py calibration.json LOG…`.

Like `dask_fit.py`: partial fits of logs on any worker, merged as they arrive.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence

import ray

import shellcal


@ray.remote(max_retries=3)
def partial_fit(log: str, model: str) -> shellcal.Partial:
    return shellcal.partial_fit(log, model=model, groups=True)


def fit(
    logs: Sequence[str | os.PathLike[str]], model: str = "cubic"
) -> tuple[shellcal.Calibration, list[str]]:
    """Returns the calibration, and the logs that were delivered twice."""

    def arriving() -> Iterator[shellcal.Partial]:
        waiting = [partial_fit.remote(os.fspath(log), model) for log in logs]
        while waiting:
            (done, *_), waiting = ray.wait(waiting)
            yield ray.get(done)

    skipped: list[str] = []
    whole = shellcal.merge(arriving(), duplicates="skip", skipped=skipped)
    return whole.solve("auto" if model == "auto" else None, cv=True), skipped


def main() -> None:
    output, *logs = sys.argv[1:]
    calibration, skipped = fit(logs)
    for name in skipped:
        print(f"{name}: left out, its rows have been counted already", file=sys.stderr)
    calibration.save(output)


if __name__ == "__main__":
    main()
