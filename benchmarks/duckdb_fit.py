"""A complete fit with DuckDB and numpy: SQL reads the files on all cores, numpy computes the features and
solves. For `bench.py fits`; prints the errors on the second file as JSON.

usage: python3 duckdb_fit.py TRAIN.csv TEST.csv cubic24+1|quad44+1|cubic164+1
"""

import itertools
import json
import sys

import duckdb
import numpy as np

AXES = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]
SENSORS = [f"s{channel}" for channel in range(8)]
DEGREES = {"quad44": 2, "cubic164": 3}


def read(path):
    """Reads readings and wrench of a file, one row each."""
    columns = duckdb.execute(
        f"select {', '.join(SENSORS + AXES)} from read_csv(?, header = true)", [path]
    ).fetchnumpy()
    readings = np.column_stack([columns[name].astype(float) for name in SENSORS])
    return readings, np.column_stack([columns[name] for name in AXES])


def features(readings, model):
    """Returns powers of each channel, or all products up to a degree, and a constant if the model has one."""
    name, constant = model.partition("+")[0], model.endswith("+1")
    if name == "cubic24":
        columns = [readings**power for power in (1, 2, 3)]
    else:
        products = (
            channels
            for degree in range(1, DEGREES[name] + 1)
            for channels in itertools.combinations_with_replacement(range(readings.shape[1]), degree)
        )
        columns = [readings[:, list(channels)].prod(axis=1) for channels in products]
    if constant:
        columns.append(np.ones(len(readings)))
    return np.column_stack(columns)


def main(train, test, model):
    readings, wrench = read(train)
    coefficients, _, rank, _ = np.linalg.lstsq(features(readings, model), wrench, rcond=None)
    readings, wrench = read(test)
    errors = features(readings, model) @ coefficients - wrench
    rms = np.sqrt(np.mean(errors**2, axis=0))
    print(json.dumps({"rank": int(rank), "rms": dict(zip(AXES, rms.tolist()))}))


main(*sys.argv[1:])
