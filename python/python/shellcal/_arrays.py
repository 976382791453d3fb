"""Conversion of the user's arrays to matrices for the core, or an exception with a hint."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ._errors import ArrayError

Matrix = npt.NDArray[np.float64]
#: Number of repetitions of each row; weight of each row; mask of the rows that are used.
Weights = tuple[npt.NDArray[np.uint32] | None, Matrix | None, npt.NDArray[np.bool_] | None]
Labels = tuple[npt.NDArray[np.uint32], list[str]]

#: Channels are counted in a byte.
MOST_CHANNELS = 255
#: Capacity of the exact sums.
MOST_ROWS = 2**30
AXES = ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")


def readings(value: Any, channels: int | None = None) -> Matrix:
    """`X`: one row per sample, one column per channel, counts."""
    array = _matrix(value, "X")
    if array.shape[1] == 0:
        raise ArrayError(
            f"X has 0 feature(s) (shape={array.shape}) while a minimum of 1 is required: "
            "a column per channel"
        )
    if array.shape[0] == 0:
        raise ArrayError(f"X has 0 sample(s) (shape={array.shape}) while a minimum of 1 is required")
    if channels is not None and array.shape[1] != channels:
        raise ArrayError(
            f"X has {array.shape[1]} features, but Calibration is expecting {channels} features as input",
            hint="give the sensor's channels as columns, in the order of the fit",
        )
    if array.shape[1] > MOST_CHANNELS:
        raise ArrayError(
            f"X has {array.shape[1]} columns, at most {MOST_CHANNELS} channels are fitted",
            hint="rows are samples and columns are channels: is it X.T that is meant?",
        )
    return _finite(array, "X", [f"s{channel + 1}" for channel in range(array.shape[1])])


def wrench(value: Any, rows: int) -> Matrix:
    """`Y`: one row per sample, the columns Fx, Fy, Fz (N), Mx, My, Mz (N·m), or the first of them."""
    if value is None:
        raise ArrayError(
            "requires y to be passed, but the target y is None: the wrench that the reference measured"
        )
    array = _matrix(value, "Y", columns_of_vectors=True)
    if array.shape[0] != rows:
        raise ArrayError(
            f"Y has {array.shape[0]} rows, X has {rows}", hint="one row of both for each sample"
        )
    if not 1 <= array.shape[1] <= len(AXES):
        raise ArrayError(
            f"Y has {array.shape[1]} columns, expected 6: Fx, Fy, Fz in N, Mx, My, Mz in N·m",
            hint="fewer are taken as the first of these",
        )
    return _finite(array, "Y", list(AXES))


def labels(value: Any, rows: int) -> Labels | None:
    """`groups`: for each row the label of its group; a group is held out as a whole."""
    if value is None:
        return None
    array = np.asarray(value)
    if array.ndim != 1 or array.shape[0] != rows:
        raise ArrayError(
            f"groups has the shape {array.shape}, X has {rows} rows", hint="one label for each row"
        )
    if array.dtype.kind == "f":
        if not np.isfinite(array).all():
            raise ArrayError("groups has NaN or infinity", hint="give every row a label")
        if (array == np.floor(array)).all() and (np.abs(array) < 2**53).all():
            array = array.astype(np.int64)
    if array.dtype.kind == "O":
        array = np.asarray([str(label) for label in array], dtype=str)
    names, places = np.unique(array, return_inverse=True)
    if len(names) > 2000:
        raise ArrayError(
            f"groups has {len(names)} labels, at most 2000 are held out",
            hint="a group is a pose, a session or a file, not a row",
        )
    return places.astype(np.uint32).reshape(-1), [str(name) for name in names]


def times(value: Any, rows: int) -> Matrix | None:
    """The time of each row, s."""
    if value is None:
        return None
    array = np.asarray(value)
    if array.dtype.kind not in "iuf" or array.shape != (rows,):
        raise ArrayError(
            f"time has the shape {array.shape} and the type {array.dtype}, X has {rows} rows",
            hint="one number for each row, in s",
        )
    return np.ascontiguousarray(array, dtype=np.float64)


def weights(value: Any, rows: int) -> Weights:
    """`sample_weight`: integers are repetitions of rows, other numbers weights of squares."""
    if value is None:
        return None, None, None
    array = np.asarray(value)
    if array.dtype.kind not in "biuf":
        raise ArrayError(f"sample_weight has the type {array.dtype}, expected numbers")
    if array.shape != (rows,):
        raise ArrayError(
            f"sample_weight has the shape {array.shape}, X has {rows} rows", hint="one weight for each row"
        )
    array = array.astype(np.float64)
    wrong = ~(np.isfinite(array) & (array >= 0.0))
    if wrong.any():
        row = int(np.argmax(wrong))
        raise ArrayError(
            f"sample_weight is {array[row]} in row {row}, expected a number that is not negative",
            hint="a weight of 0 leaves a row out",
        )
    kept = array > 0.0
    if not kept.any():
        raise ArrayError("sample_weight is zero in every row", hint="give some rows a weight")
    if (array == np.floor(array)).all():
        if array.sum() > MOST_ROWS:
            raise ArrayError(
                f"sample_weight adds up to {array.sum():.0f} rows, at most {MOST_ROWS} are summed exactly",
                hint="whole numbers are numbers of rows: divide by a common divisor",
            )
        return array.astype(np.uint32), None, None
    return None, array, None if kept.all() else kept


def _matrix(value: Any, name: str, columns_of_vectors: bool = False) -> Matrix:
    if hasattr(value, "toarray") and hasattr(value, "nnz"):
        # Users of sparse matrices expect a TypeError.
        raise TypeError(f"{name} is a sparse matrix, which is not taken: give {name}.toarray()")
    array = np.asarray(value)
    kind = array.dtype.kind
    if kind == "c":
        raise ArrayError(f"Complex data not supported: {name} has the type {array.dtype}")
    if kind == "O":
        array = _numbers(array, name)
    elif kind not in "biuf":
        raise ArrayError(
            f"{name} has the type {array.dtype}, expected numbers",
            hint=f"give a numeric array, such as {name}.astype(float)",
        )
    if array.ndim == 1 and columns_of_vectors:
        array = array.reshape(-1, 1)
    if array.ndim != 2:
        raise ArrayError(
            f"Expected 2D array, got {array.ndim}D array instead: {name} has the shape {array.shape}",
            hint="Reshape your data: one row for each sample, array.reshape(1, -1) for a single one",
        )
    # Other widths or byte orders, and unaligned fields, are copied; arbitrary strides are not.
    return np.require(array, np.float64, ["A"])


def _numbers(array: npt.NDArray[Any], name: str) -> Matrix:
    try:
        return array.astype(np.float64)
    except (TypeError, ValueError) as error:
        for place, item in np.ndenumerate(array):
            try:
                float(item)
            except (TypeError, ValueError):
                break
        message = f"{name}[{', '.join(map(str, place))}] is {item!r}: argument must be a string or a number"
        hint = f"{name} is an array of objects: give columns of one numeric type"
        if isinstance(error, TypeError):
            raise TypeError(f"{message}\nhint: {hint}") from None
        raise ArrayError(message, hint=hint) from None


def _finite(array: Matrix, name: str, columns: list[str]) -> Matrix:
    # A finite sum implies finite terms; otherwise the terms are checked one by one.
    with np.errstate(over="ignore", invalid="ignore"):
        if np.isfinite(array.sum()):
            return array
    rows, places = np.nonzero(~np.isfinite(array))
    if len(rows) == 0:
        return array
    row, column = int(rows[0]), int(places[0])
    what = "NaN" if np.isnan(array[row, column]) else "infinity (inf)"
    raise ArrayError(
        f"{name} contains {what} in row {row}, column {column} (`{columns[column]}`), "
        f"and {len(rows) - 1} more such values",
        hint=f"leave such rows out: keep = np.isfinite({name}).all(axis=1)",
    )
