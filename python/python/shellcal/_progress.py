"""A tqdm progress bar for long operations, if tqdm is installed and the output is interactive."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

#: Duration in seconds below which there is no bar, and tqdm is not imported.
_DELAY = 1.0


class Progress:
    """Receives the progress; creates a bar for long operations."""

    def __init__(self, what: str, unit: str) -> None:
        self._what, self._unit = what, unit
        self._start = time.monotonic()
        self._bar: Any = None
        self._is_off = False

    def __call__(self, done: int, total: int | None = None) -> None:
        if self._bar is None and not self._is_off and time.monotonic() - self._start >= _DELAY:
            self._bar = _bar(self._what, self._unit)
            self._is_off = self._bar is None
        if self._bar is not None:
            if total is not None:
                self._bar.total = total
            self._bar.update(done - self._bar.n)

    def close(self) -> None:
        """Closes the bar in its current state."""
        if self._bar is not None:
            self._bar.close()


def _bar(what: str, unit: str) -> Any:
    try:
        with warnings.catch_warnings():
            # A notebook without widgets gets a text bar.
            warnings.simplefilter("ignore")
            from tqdm.auto import tqdm

            return tqdm(desc=what, unit=unit, unit_scale=True)
    except ImportError:
        return None


def _is_watched() -> bool:
    """Whether this is a notebook or a terminal."""
    return "ipykernel" in sys.modules or (sys.stderr is not None and sys.stderr.isatty())


@contextmanager
def shown(what: str, unit: str) -> Iterator[Progress | None]:
    """Yields the receiver of the progress; `None` if the output is not interactive."""
    progress = Progress(what, unit) if _is_watched() else None
    try:
        yield progress
    finally:
        if progress is not None:
            progress.close()
