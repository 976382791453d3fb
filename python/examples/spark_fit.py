"""One calibration from a table of readings, on Spark: `spark-submit spark_fit.py calibration.json TABLE.parquet…`.

The table has the columns `s1` … in counts, `fx_n` … in N, `mx_nm` … in N·m, and `group`, the label of rows that are held
out together. Each partition becomes the exact sums over its rows, which are merged in a tree: the coefficients are the
same to the last bit for any partitions in any order. A task that fails and runs again is counted once; duplicate rows
are rejected.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pyarrow

import shellcal

WRENCH = ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")


def sums(batches: Iterator[pyarrow.RecordBatch], model: str) -> Iterator[pyarrow.RecordBatch]:
    """Returns the partial fit of a partition, as a table with one value; empty for a partition without rows."""
    partial = shellcal.Partial(model, groups=True)
    for batch in batches:
        if batch.num_rows:
            sensors = (name for name in batch.schema.names if name[:1] == "s" and name[1:].isdigit())
            names = sorted(sensors, key=lambda name: int(name[1:]))
            X, Y = (
                np.column_stack([batch.column(name).to_numpy(zero_copy_only=False) for name in of])
                for of in (names, WRENCH)
            )
            partial.add(X, Y, groups=batch.column("group").to_pylist(), name="<table>")
    if partial.rows:
        yield pyarrow.RecordBatch.from_arrays([pyarrow.array([partial.to_bytes()])], ["partial"])


def merged(one: bytes, other: bytes) -> bytes:
    """Merges two partial fits."""
    partials = map(shellcal.Partial.from_bytes, (one, other))
    return shellcal.merge(partials).to_bytes()


def fit(table: Any, model: str = "cubic") -> shellcal.Calibration:
    """Returns the calibration from a Spark data frame."""
    partials = table.mapInArrow(lambda batches: sums(batches, model), "partial binary")
    whole = partials.rdd.map(lambda row: bytes(row.partial)).treeReduce(merged)
    return shellcal.Partial.from_bytes(whole).solve("auto" if model == "auto" else None, cv=True)


def main() -> None:
    from pyspark.sql import SparkSession

    output, *tables = sys.argv[1:]
    session = SparkSession.builder.appName("shellcal").getOrCreate()
    fit(session.read.parquet(*tables)).save(output)
    session.stop()


if __name__ == "__main__":
    main()
