"""One calibration from an archive of logs, on Dask: `python dask_fit.py calibration.json LOG…`.

Every log becomes a partial fit on some worker, and results are merged as they arrive. The logs of a worker that dies go
to another; a log that is delivered twice is counted once, and reported. The result is the same to the last bit for any
number of workers and any order.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Sequence

from distributed import Client, as_completed

import shellcal


def fit(
    client: Client, logs: Sequence[str | os.PathLike[str]], model: str = "cubic"
) -> tuple[shellcal.Calibration, list[str]]:
    """Returns the calibration, and the logs that were delivered twice."""
    futures = client.map(
        shellcal.partial_fit, [os.fspath(log) for log in logs], model=model, groups=True
    )
    skipped: list[str] = []
    arriving: Iterable[shellcal.Partial] = (
        partial for _, partial in as_completed(futures, with_results=True)
    )
    whole = shellcal.merge(arriving, duplicates="skip", skipped=skipped)
    chosen = "auto" if model == "auto" else None
    return whole.solve(chosen, cv=True), skipped


def main() -> None:
    output, *logs = sys.argv[1:]
    # For a SLURM cluster: `dask_jobqueue.SLURMCluster(cores=8, memory="8GB").get_client()`.
    with Client() as client:
        calibration, skipped = fit(client, logs)
    for name in skipped:
        print(f"{name}: left out, its rows have been counted already", file=sys.stderr)
    calibration.save(output)


if __name__ == "__main__":
    main()
