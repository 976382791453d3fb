from collections.abc import Callable, Sequence
from os import PathLike
from typing import Any

import numpy as np
import numpy.typing as npt

_Matrix = npt.NDArray[np.float64]
_Groups = tuple[npt.NDArray[np.uint32], list[str]]
_Rows = tuple[
    _Matrix,
    _Matrix,
    _Groups | None,
    npt.NDArray[np.uint32] | None,
    _Matrix | None,
    _Matrix | None,
]
_Made = tuple[str, str]
_What = tuple[str, bool, str | None, int]
_Reading = tuple[dict[str, str], str, int]

__version__: str

class Fitted:
    @staticmethod
    def load(path: str | PathLike[str], edited: bool) -> Fitted: ...
    @staticmethod
    def parse(document: bytes, name: str | PathLike[str], edited: bool) -> Fitted: ...
    def to_json(self) -> str: ...
    def name(self) -> str: ...
    def channels(self) -> int: ...
    def has_standard_errors(self) -> bool: ...
    def interval_factors(self, level: float) -> list[float]: ...
    def has_memory(self) -> bool: ...
    def predict(
        self, x: _Matrix, errors: bool, time: _Matrix | None
    ) -> tuple[_Matrix, _Matrix | None]: ...
    def convert(self, readings: Sequence[float] | _Matrix, time_s: float | None = None) -> _Matrix: ...
    def figure(self, x: _Matrix, y: _Matrix, title: str) -> str: ...
    def out_of_range(self, x: _Matrix) -> list[bool]: ...

def fit(
    rows: _Rows,
    *,
    model: str,
    intercept: bool,
    ridge: float,
    solver: str,
    truncate: float | None,
    lag: float | None,
    memory_terms: list[float] | None,
    cross_validation: tuple[int | None] | None,
    seed: int,
    covariance: str,
    threads: int,
    made_by: _Made,
    serial: str | None,
    progress: Callable[[int], None] | None,
) -> tuple[Fitted, list[str], list[str]]: ...

class Partial:
    @staticmethod
    def from_arrays(
        x: _Matrix,
        y: _Matrix,
        groups: _Groups | None,
        name: str | PathLike[str],
        what: _What,
        made: _Made,
    ) -> Partial: ...
    @staticmethod
    def from_logs(
        paths: list[str], what: _What, fresh: bool, reading: _Reading, made: _Made
    ) -> Partial: ...
    @staticmethod
    def parse(document: bytes) -> Partial: ...
    @staticmethod
    def load(path: str | PathLike[str]) -> Partial: ...
    def document(self) -> bytes: ...
    def copy(self) -> Partial: ...
    def merge(self, other: Partial) -> None: ...
    def has_counted(self, other: Partial) -> bool: ...
    def rows(self) -> int: ...
    def model(self) -> str: ...
    def channels(self) -> int: ...
    def groups(self) -> list[str] | None: ...
    def sources(self) -> list[tuple[PathLike[str], str | None, int]]: ...
    def solve(
        self,
        model: str | None,
        ridge: float,
        cross_validation: tuple[int | None] | None,
        covariance: str,
        made: _Made,
        serial: str | None,
    ) -> Fitted: ...

def read_partials(documents: bytes) -> list[Partial]: ...
def read_log(
    path: str | PathLike[str], reading: _Reading
) -> tuple[list[tuple[str, _Matrix]], _Groups | None, tuple[str, int, int]]: ...
