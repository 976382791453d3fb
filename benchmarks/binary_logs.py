"""Writes logs of 500,000 rows in binary files, and fits a linear model to one with an intercept, as a notebook would.

usage: binary_logs.py make FILE [OTHER_COLUMNS]
       binary_logs.py fit FILE
"""

import sys

import numpy

ROWS = 500_000
READINGS = [f"s{channel + 1}" for channel in range(8)]
WRENCH = ["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"]


def make(path: str, others: int) -> None:
    random = numpy.random.default_rng(1)
    readings = 2000 + 300 * random.standard_normal((ROWS, 8))
    wrench = (readings - 2000) @ random.standard_normal((8, 6)) / 1000 + 0.01 * random.standard_normal((ROWS, 6))
    table = numpy.hstack([readings, wrench])
    if path.endswith(".npy"):
        numpy.save(path, table)
        return
    import polars

    columns = {name: table[:, at] for at, name in enumerate(READINGS + WRENCH)}
    columns |= {f"other{at + 1}": random.standard_normal(ROWS) for at in range(others)}
    packed = "snappy" if path.endswith(".snappy.parquet") else "zstd"
    polars.DataFrame(columns).write_parquet(path, compression=packed)


def fit(path: str) -> None:
    if path.endswith(".npy"):
        table = numpy.load(path)
    else:
        import polars

        table = polars.read_parquet(path, columns=READINGS + WRENCH).to_numpy()
    features = numpy.column_stack([numpy.ones(len(table)), table[:, :8]])
    print(numpy.linalg.lstsq(features, table[:, 8:], rcond=None)[0])


if sys.argv[1] == "make":
    make(sys.argv[2], int(sys.argv[3]) if len(sys.argv) > 3 else 0)
else:
    fit(sys.argv[2])
