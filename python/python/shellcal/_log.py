"""Logs as tables of columns."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from ._errors import OptionError
from ._files import PathLike
from ._native import read_log as _read_log

_COLUMNS = (
    "format",
    "table",
    "header_line",
    "skip_lines",
    "sensors",
    "wrench",
    "time",
    "group",
    "time_unit",
    "moment_unit",
    "unit",
    "where",
    "exclude_group",
)

# Options that take several conditions.
_SEVERAL = ("where", "exclude_group")


class Table(Mapping[str, npt.NDArray[Any]]):
    """Named columns of equal length, each a numpy array.

    The table is a mapping (``pandas.DataFrame(dict(t))``), and also an Arrow table by the PyCapsule interface
    (``polars.DataFrame(t)``, ``pyarrow.table(t)``, ``duckdb.sql("from t")``).

    Attributes
    ----------
    about : dict
        Properties of the file: format, rows left out, rows that repeat their readings.
    """

    def __init__(self, columns: Mapping[str, npt.NDArray[Any]], about: dict[str, Any]) -> None:
        self._columns = dict(columns)
        self.about = about

    def __getitem__(self, name: str) -> npt.NDArray[Any]:
        try:
            return self._columns[name]
        except KeyError:
            raise KeyError(f"no column `{name}`, there are {', '.join(self._columns)}") from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return max((len(column) for column in self._columns.values()), default=0)

    @property
    def X(self) -> npt.NDArray[np.float64]:
        """The readings, of shape (rows, channels), counts."""
        names = [name for name in self._columns if name[:1] == "s" and name[1:].isdigit()]
        return np.column_stack([self._columns[name] for name in names])

    @property
    def Y(self) -> npt.NDArray[np.float64]:
        """The wrench, of shape (rows, axes): Fx, Fy, Fz in N, Mx, My, Mz in N·m, as far as present."""
        axes = [name for name in _AXES if name in self._columns] or _AXES
        return np.column_stack([self[name] for name in axes])

    @property
    def groups(self) -> npt.NDArray[Any] | None:
        """The label of each row, if the log has a group column."""
        return self._columns.get("group")

    def __arrow_c_stream__(self, requested_schema: Any = None) -> Any:
        # The consumer has to accept the available types: `float64`, and `large_utf8` for text.
        from ._arrow import stream

        return stream(self._columns)

    def __repr__(self) -> str:
        return f"<Table of {self.rows} rows: {', '.join(self._columns)}>"

    def _repr_html_(self) -> str:
        from html import escape

        head = "".join(f"<th>{escape(name)}</th>" for name in self._columns)
        shown = min(self.rows, 5)
        rows = "".join(
            "<tr>"
            + "".join(f"<td>{escape(str(column[row]))}</td>" for column in self._columns.values())
            + "</tr>"
            for row in range(shown)
        )
        return f"<p>{self.rows} rows</p><table><tr>{head}</tr>{rows}</table>"


_AXES = ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")


def read_log(path: PathLike, **options: Any) -> Table:
    """Reads a log completely into memory, in any of the formats of ``shellcal``.

    Parameters
    ----------
    path : path
        The log, also compressed with gzip.
    format, table, sensors, wrench, time, group, time_unit, moment_unit, unit : str, optional
        Meanings of the columns, if their names do not tell, as for the options of ``shellcal fit``: ``wrench`` names
        six columns, or some with their axes (``fx=a,fz=b``), ``unit`` the units (``force=kN,moment=N·mm``).
    header_line, skip_lines : int, optional
        The line that names the columns, from 1, or the number of lines to ignore at the start of a text.
    where : str or list of str, optional
        Reads only rows that meet all conditions: ``name=A``, ``load>2``.
    exclude_group : str or list of str, optional
        Groups whose rows are left out.
    skip_bad_rows : bool or "all"
        Leaves out invalid rows, up to a tenth of a log, or all.
    threads : int
        0 for one per core.

    Returns
    -------
    Table
        The columns of the log: ``t_s`` in s, ``s1`` … in counts, ``fx_n`` … in N, ``mx_nm`` … in N·m, telemetry without
        conversion, ``group`` as text.

    Raises
    ------
    LogError
        With file, line, column and a hint.
    """
    columns, groups, (kind, skipped, repeated) = _read_log(os.fspath(path), reading(options))
    found: dict[str, npt.NDArray[Any]] = dict(columns)
    if groups is not None:
        places, labels = groups
        found["group"] = np.asarray(labels, dtype=str)[places] if labels else np.asarray([], dtype=str)
    about = {"format": kind, "skipped_rows": skipped, "repeated_rows": repeated}
    return Table(found, about)


def reading(options: dict[str, Any]) -> tuple[dict[str, str], str, int]:
    """Converts the options of reading a log to the core's."""
    options = dict(options)
    skip, threads = options.pop("skip_bad_rows", False), options.pop("threads", 0)
    if not isinstance(threads, int) or not 0 <= threads <= 1024:
        raise OptionError(f"threads is {threads!r}, expected an integer from 0 to 1024")
    if skip not in (False, True, "all"):
        raise OptionError(f"skip_bad_rows is {skip!r}, expected True, False or 'all'")
    columns = {}
    for name, value in options.items():
        if name not in _COLUMNS:
            raise OptionError(f"no option `{name}`, expected one of {', '.join(_COLUMNS)}")
        if value is None:
            continue
        if isinstance(value, (list, tuple)):
            separator = "\n" if name in _SEVERAL else ","
            value = separator.join(str(part) for part in value)
        columns[name] = str(value)
    return columns, "all" if skip == "all" else "few" if skip else "", threads
