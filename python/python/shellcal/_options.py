"""Options, checked before they reach the library."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._errors import OptionError


def folds(cv: bool | int) -> tuple[int | None] | None:
    """Converts `cv` to the core's form: not requested, each group, or a number of folds."""
    if cv is False or cv is None:
        return None
    if cv is True:
        return (None,)
    if isinstance(cv, (int, np.integer)) and cv >= 2:
        return (int(cv),)
    raise OptionError(f"cv is `{cv}`, expected True, False or a number of folds from 2 up")


def text(name: str, value: Any) -> str:
    if not isinstance(value, str):
        raise OptionError(f"{name} is {value!r}, expected a name")
    return value


def physics(given: dict[str, bool]) -> None:
    """Checks that all given options apply to the physics model."""
    for name, is_given in given.items():
        if is_given:
            raise OptionError(
                f"{name} is for polynomials in the readings", hint='leave it out with model="physics"'
            )


def number(name: str, value: Any) -> float:
    if isinstance(value, (bool, str, bytes)):
        raise OptionError(f"{name} is {value!r}, expected a number")
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise OptionError(f"{name} is {value!r}, expected a number") from None


def count(name: str, value: Any, most: int = 2**64 - 1) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or not 0 <= value <= most:
        raise OptionError(f"{name} is {value!r}, expected an integer from 0 to {most}")
    return int(value)


def time_constants(value: Any) -> list[float] | None:
    """Times of memory terms; `None` to search for them."""
    if isinstance(value, str):
        if value == "auto":
            return None
        raise OptionError(f"memory_terms is {value!r}, expected times or \"auto\"")
    return [number("memory_terms", time) for time in value]
