"""Files written by pyarrow are read like pyarrow reads them, or rejected with the reason."""

from __future__ import annotations

import datetime
import decimal
import random
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as parquet

import shellcal

#: Number of files; each has its own seed.
FILES = 500
AXES = ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")
INTEGERS = ["int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64"]
#: Encodings that pyarrow writes for a type, in addition to dictionaries.
OF_INTEGERS = ["PLAIN", "DELTA_BINARY_PACKED", "BYTE_STREAM_SPLIT"]
OF_FLOATS = ["PLAIN", "BYTE_STREAM_SPLIT"]


def column(draw: random.Random, numbers: Any, rows: int, nulls: bool) -> tuple[Any, str | None]:
    """Returns readings of any type, with an encoding or `None` for a dictionary."""
    kind = draw.choice([*INTEGERS, "float", "double"])
    if kind in ("float", "double"):
        values = (numbers.integers(-(2**15), 2**15, rows) / 8.0).astype("f4" if kind == "float" else "f8")
        encoding = draw.choice([None, *OF_FLOATS])
    else:
        top = min(2**15, np.iinfo(kind).max)
        values = numbers.integers(0 if kind[0] == "u" else -top, top, rows).astype(kind)
        split = [] if kind in ("int8", "int16", "uint8", "uint16") else [OF_INTEGERS[2]]
        encoding = draw.choice([None, *OF_INTEGERS[:2], *split])
    mask = numbers.random(rows) < 0.2 if nulls else None
    kinds = {"float": pa.float32(), "double": pa.float64()}
    return pa.array(values, kinds.get(kind) or getattr(pa, kind)(), mask=mask), encoding


def others(draw: random.Random, rows: int) -> dict[str, tuple[Any, str | None]]:
    """Returns columns that are not numbers, with the name of their type in the error; `None` for columns that are read."""
    at = datetime.datetime(2017, 5, 29)
    made = {
        "price": (pa.array([decimal.Decimal(row) / 8 for row in range(rows)], pa.decimal128(12, 3)), "decimal"),
        "tags": (pa.array([[row, row + 1] for row in range(rows)], pa.list_(pa.int32())), "list"),
        "raw": (pa.array([bytes([row % 256]) for row in range(rows)], pa.binary()), "bytes"),
        "note": (pa.array([None if row % 5 == 0 else f"n{row}, \"x\"" for row in range(rows)]), None),
        "flag": (pa.array([row % 2 == 0 for row in range(rows)]), None),
        "when": (pa.array([at + datetime.timedelta(milliseconds=row) for row in range(rows)], pa.timestamp("ms")), None),
        "nested": (pa.array([None if row % 3 == 0 else {"x": row, "y": 0.5} for row in range(rows)]), None),
    }
    return {name: made[name] for name in made if draw.random() < 0.4}


def test_five_hundred_files_are_equal_or_refused_by_name(tmp_path: Path) -> None:
    path, ended = tmp_path / "log.parquet", {"equal": 0, "refused": 0}
    for seed in range(FILES):
        draw, numbers = random.Random(seed), np.random.default_rng(seed)
        rows, nulls = draw.choice([1, 7, 100, 3000]), draw.random() < 0.2
        columns, encodings = {"t_s": pa.array(np.arange(rows) / 100)}, {}
        for name in [*(f"s{i + 1}" for i in range(draw.randrange(1, 5))), *AXES]:
            columns[name], encoding = column(draw, numbers, rows, nulls and name == "s1")
            if encoding is not None:
                encodings[name] = encoding
        extra = others(draw, rows)
        table = pa.table(columns | {name: values for name, (values, _) in extra.items()})
        compression = draw.choice(["none", "snappy", "gzip", "zstd", "lz4", "brotli"])
        dictionary = [name for name in table.column_names if name not in encodings and draw.random() < 0.7]
        parquet.write_table(
            table,
            path,
            compression=compression,
            use_dictionary=dictionary,
            column_encoding=encodings,
            version=draw.choice(["1.0", "2.4", "2.6"]),
            data_page_version=draw.choice(["1.0", "2.0"]),
            data_page_size=draw.choice([None, 256, 4096]),
            row_group_size=draw.choice([None, 1, 50, 1000]) if rows < 500 else draw.choice([None, 700]),
            write_page_checksum=draw.random() < 0.5,
            write_statistics=draw.random() < 0.5,
            store_schema=draw.random() < 0.5,
        )
        expected = parquet.read_table(path)
        has_null = expected.column("s1").null_count > 0
        try:
            found = shellcal.read_log(path)
        except shellcal.LogError as error:
            said = str(error)
            assert compression == "brotli" and "brotli" in said.lower() or has_null and "s1" in said, (seed, said)
            ended["refused"] += 1
            if compression == "brotli":
                continue
            # A missing reading makes an invalid row, not a zero.
            if expected.column("s1").null_count == rows:
                continue
            found = shellcal.read_log(path, skip_bad_rows="all")
            expected = expected.filter(pa.compute.is_valid(expected.column("s1")))
        else:
            assert compression != "brotli" and not has_null, seed
            ended["equal"] += 1
        for name in columns:
            assert np.array_equal(found[name], expected.column(name).to_numpy().astype(float)), (seed, name)
        for name, (_, kind) in extra.items():
            if kind is not None:
                # By the name of the leaf: `tags.list.element`.
                leaf = f"{name}.list.element" if kind == "list" else name
                try:
                    # Bytes without a declared type may be text of an old writer: a value that is not a number
                    # is an invalid row.
                    shellcal.read_log(path, sensors=leaf, skip_bad_rows=kind != "bytes")
                except shellcal.LogError as error:
                    assert name in str(error) and (kind == "bytes" or kind in str(error)), (seed, str(error))
                else:
                    raise AssertionError((seed, name, "was read as readings"))
    assert min(ended.values()) > FILES / 20, ended
