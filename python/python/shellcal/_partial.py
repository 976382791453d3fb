"""Partial fits: the exact sums over some rows, merged with those over others in any order."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

from . import _arrays, _options
from ._calibration import Calibration
from ._errors import CountedTwiceError, OptionError
from ._files import PathLike, write_whole
from ._log import reading
from ._native import Partial as _Sums
from ._native import read_partials
from ._origin import made_by


class Partial:
    """The sums over some rows: all that a fit of `model` needs to know of them.

    Exact, so that whatever is merged with whatever in any order gives the bits of one fit over all rows.

    Parameters
    ----------
    model : {"linear", "cubic", "quadratic", "poly3", "auto"}
        The largest model that is to be fitted; ``"auto"`` sums what the choice of a model needs.
    intercept : bool
        Whether there is to be a constant.
    groups : bool or {"auto", "file", "column"}
        Whether the sums of each group are kept, for held-out errors, the choice of a model and standard
        errors by group. 12 kB a group for cubic, 100 kB for poly3 of eight channels.
    seed : int
        How rows are assigned to the random split that held-out errors are compared with.
    """

    def __init__(
        self,
        model: str = "cubic",
        *,
        intercept: bool = True,
        groups: bool | str = False,
        seed: int = 1,
    ) -> None:
        if not isinstance(groups, bool) and groups not in ("auto", "file", "column"):
            raise OptionError(f"groups is {groups!r}, expected True, False, `auto`, `file` or `column`")
        kept: str | None = groups if isinstance(groups, str) else "auto" if groups else None
        self._what = (_options.text("model", model), bool(intercept), kept, _options.count("seed", seed))
        self._sums: _Sums | None = None

    def add(self, X: Any, y: Any, *, groups: Any = None, name: PathLike = "<array>") -> Partial:
        """Adds rows: arrays as for `Calibration.fit`, called `name`. The same rows are refused twice.

        Raises
        ------
        FitError
            If the rows cannot be summed exactly: readings have to be counts of a converter. Logs of other
            numbers can be added (`add_logs`).
        CountedTwiceError
            If the same rows have been added already.
        """
        readings = _arrays.readings(X)
        wrench = _arrays.wrench(y, readings.shape[0])
        labels = _arrays.labels(groups, readings.shape[0])
        if self._what[2] is not None and labels is None:
            raise OptionError("this partial fit keeps groups: give groups=, a label for each row")
        new = _Sums.from_arrays(readings, wrench, labels, os.fspath(name), self._what, made_by())
        return self._add(new)

    def add_logs(self, *paths: PathLike, fresh: bool = False, **columns: Any) -> Partial:
        """Adds the rows of logs. `columns` are those of `read_log`; `fresh` leaves out rows that repeat
        the readings of the row before. Where no exact sums can be had of them, as of readings in volts, R factors of a
        QR factorisation are kept, which merge with their like alone, and to the last digits but one."""
        files = [os.fspath(path) for path in paths]
        return self._add(_Sums.from_logs(files, self._what, fresh, reading(columns), made_by()))

    def merge(self, other: Partial) -> Partial:
        """Adds the rows of another; this one stays as it was where that cannot be.

        Raises
        ------
        MergeError
            If both are not parts of one fit.
        CountedTwiceError
            If rows of the other have been counted already.
        """
        if other._sums is not None:
            self._add(other._sums)
        return self

    def _add(self, sums: _Sums) -> Partial:
        if self._sums is None:
            self._sums = sums.copy()
        elif self._sums is sums:
            self._sums.merge(sums.copy())
        else:
            self._sums.merge(sums)
        return self

    def has_counted(self, other: Partial) -> bool:
        """Whether all sources of `other` are among those of this one."""
        if self._sums is None or other._sums is None:
            return False
        return self._sums.has_counted(other._sums.copy() if other is self else other._sums)

    def solve(
        self,
        model: str | None = None,
        *,
        ridge: float = 0.0,
        cv: bool | int = False,
        covariance: str = "auto",
        serial: str | None = None,
    ) -> Calibration:
        """The calibration, of `model` or a smaller one, as ``shellcal merge`` gives it.

        It lacks what takes the rows: largest errors, how errors and loads are distributed.
        """
        fitted = self._known().solve(
            None if model is None else _options.text("model", model),
            _options.number("ridge", ridge),
            _options.folds(cv),
            _options.text("covariance", covariance),
            made_by(),
            serial,
        )
        return Calibration._of(fitted)

    def _known(self) -> _Sums:
        if self._sums is None:
            raise OptionError("this partial fit has no rows: `add` some")
        return self._sums

    # As bytes.

    def to_bytes(self) -> bytes:
        """The document, as ``shellcal merge --partial`` writes it."""
        return self._known().document()

    @classmethod
    def from_bytes(cls, document: bytes) -> Partial:
        """The partial fit in a document."""
        return cls._of(_Sums.parse(document))

    @classmethod
    def load(cls, path: PathLike) -> Partial:
        """The partial fit in a file."""
        return cls._of(_Sums.load(os.fspath(path)))

    @classmethod
    def read_all(cls, documents: bytes) -> list[Partial]:
        """Partial fits that stand one after the other."""
        return [cls._of(sums) for sums in read_partials(documents)]

    def save(self, path: PathLike) -> None:
        """Writes the document to a file, whole or not at all."""
        write_whole(path, self.to_bytes())

    @classmethod
    def _of(cls, sums: _Sums) -> Partial:
        basis, plus, _ = sums.model().partition("+")
        new = cls(basis, intercept=bool(plus), groups=sums.groups() is not None)
        new._sums = sums
        return new

    def __reduce__(self) -> Any:
        if self._sums is None:
            model, intercept, kept, seed = self._what
            return _empty, (model, intercept, kept, seed)
        return Partial.from_bytes, (self.to_bytes(),)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Partial) or self._sums is None or other._sums is None:
            return self is other
        return self.to_bytes() == other.to_bytes()

    __hash__ = None  # type: ignore[assignment]

    # What it is.

    @property
    def rows(self) -> int:
        """Rows summed."""
        return 0 if self._sums is None else self._sums.rows()

    @property
    def groups(self) -> list[str] | None:
        """The labels of the groups, where they are kept."""
        return None if self._sums is None else self._sums.groups()

    @property
    def sources(self) -> list[tuple[str, str | None, int]]:
        """Name, checksum and rows of everything that was added."""
        if self._sums is None:
            return []
        return [(os.fspath(path), checksum, rows) for path, checksum, rows in self._sums.sources()]

    def __repr__(self) -> str:
        if self._sums is None:
            return f"<Partial of {self._what[0]}: no rows>"
        return f"<Partial of {self._sums.model()}: {self.rows} rows of {len(self.sources)} sources>"


def _empty(model: str, intercept: bool, kept: str | None, seed: int) -> Partial:
    return Partial(model, intercept=intercept, groups=kept or False, seed=seed)


def partial_fit(
    logs: PathLike | Iterable[PathLike],
    model: str = "cubic",
    *,
    intercept: bool = True,
    groups: bool | str = False,
    seed: int = 1,
    **columns: Any,
) -> Partial:
    """The partial fit of a log, or of several: what ``shellcal fit --partial`` writes."""
    paths = [logs] if isinstance(logs, (str, os.PathLike)) else list(logs)
    return Partial(model, intercept=intercept, groups=groups, seed=seed).add_logs(*paths, **columns)


def merge(
    partials: Iterable[Partial], *, duplicates: str = "refuse", skipped: list[str] | None = None
) -> Partial:
    """All partial fits as one, one at a time in memory beside the sum.

    With ``duplicates="skip"`` those whose sources have all been counted already are left out, and their
    names put into `skipped`: for queues that deliver twice.
    """
    if duplicates not in ("refuse", "skip"):
        raise OptionError(f"duplicates is {duplicates!r}, expected `refuse` or `skip`")
    whole: Partial | None = None
    for partial in partials:
        if whole is None:
            whole = _empty(*partial._what)
        try:
            whole.merge(partial)
        except CountedTwiceError:
            if duplicates == "refuse" or not whole.has_counted(partial):
                raise
            if skipped is not None:
                skipped.extend(name for name, _, _ in partial.sources)
    if whole is None:
        raise OptionError("no partial fits were given")
    return whole
