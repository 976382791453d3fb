"""Partial fits: exact sums over some rows, which can be merged in any order."""

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
    """The sums over some rows: all that a fit of `model` needs from them.

    The sums are exact, so any order of merging gives the bits of one fit over all rows.

    Parameters
    ----------
    model : {"linear", "cubic", "quadratic", "poly3", "auto"}
        The largest model to be fitted; ``"auto"`` sums the data for the choice of a model.
    intercept : bool
        Whether the model has a constant.
    groups : bool or {"auto", "file", "column"}
        Whether the sums of each group are kept, for held-out errors, the choice of a model and standard errors by
        group. 12 kB per group for cubic, 100 kB for poly3 with eight channels.
    seed : int
        Seed of the random split for comparison with held-out errors.
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
        """Adds rows: arrays as for `Calibration.fit`, called `name`. Adding the same rows twice is an error.

        Raises
        ------
        FitError
            If the rows have no exact sums: readings must be counts of a converter. Logs with other numbers can be
            added with `add_logs`.
        CountedTwiceError
            If the same rows were added before.
        """
        readings = _arrays.readings(X)
        wrench = _arrays.wrench(y, readings.shape[0])
        labels = _arrays.labels(groups, readings.shape[0])
        if self._what[2] is not None and labels is None:
            raise OptionError("this partial fit keeps groups: give groups=, a label for each row")
        new = _Sums.from_arrays(readings, wrench, labels, os.fspath(name), self._what, made_by())
        return self._add(new)

    def add_logs(self, *paths: PathLike, fresh: bool = False, **columns: Any) -> Partial:
        """Adds the rows of logs. `columns` are those of `read_log`; `fresh` leaves out rows that repeat the previous
        readings. Logs without exact sums, as with readings in volts, are kept as R factors of a QR factorisation, which
        merge only with each other, and are exact to the last digits but one."""
        files = [os.fspath(path) for path in paths]
        return self._add(_Sums.from_logs(files, self._what, fresh, reading(columns), made_by()))

    def merge(self, other: Partial) -> Partial:
        """Adds the rows of another partial fit; after an error this one is unchanged.

        Raises
        ------
        MergeError
            If the two do not belong to one fit.
        CountedTwiceError
            If rows of the other were counted before.
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
        """Whether all sources of `other` are among the sources of this one."""
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
        """Returns the calibration with `model` or a smaller one, as ``shellcal merge`` does.

        It lacks the results that need the rows: largest errors, and distributions of errors and loads.
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

    # Serialisation

    def to_bytes(self) -> bytes:
        """Returns the document, as ``shellcal merge --partial`` writes it."""
        return self._known().document()

    @classmethod
    def from_bytes(cls, document: bytes) -> Partial:
        """Parses a document."""
        return cls._of(_Sums.parse(document))

    @classmethod
    def load(cls, path: PathLike) -> Partial:
        """Loads a file."""
        return cls._of(_Sums.load(os.fspath(path)))

    @classmethod
    def read_all(cls, documents: bytes) -> list[Partial]:
        """Parses concatenated partial fits."""
        return [cls._of(sums) for sums in read_partials(documents)]

    def save(self, path: PathLike) -> None:
        """Writes the document to a file, completely or not at all."""
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

    # Properties

    @property
    def rows(self) -> int:
        """Number of summed rows."""
        return 0 if self._sums is None else self._sums.rows()

    @property
    def groups(self) -> list[str] | None:
        """The labels of the groups, if they are kept."""
        return None if self._sums is None else self._sums.groups()

    @property
    def sources(self) -> list[tuple[str, str | None, int]]:
        """Name, checksum and rows of every source."""
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
    """Returns the partial fit of one or more logs, as ``shellcal fit --partial`` writes it."""
    paths = [logs] if isinstance(logs, (str, os.PathLike)) else list(logs)
    return Partial(model, intercept=intercept, groups=groups, seed=seed).add_logs(*paths, **columns)


def merge(
    partials: Iterable[Partial], *, duplicates: str = "refuse", skipped: list[str] | None = None
) -> Partial:
    """Merges all partial fits, with only one at a time in memory in addition to the sum.

    With ``duplicates="skip"``, partial fits whose sources were all counted before are left out, and their names are
    added to `skipped`: for queues that may deliver twice.
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
