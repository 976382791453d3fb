"""Exceptions: what went wrong, where, and what to do about it."""

from __future__ import annotations


class ShellcalError(ValueError):
    """Anything that this package refuses.

    Attributes
    ----------
    message : str
        What is wrong, without the hint.
    file, line, column : str, int, int or None
        Where, as far as that is known; lines and columns count from 1.
    hint : str or None
        What to do about it.
    """

    def __init__(
        self,
        message: str,
        file: str | None = None,
        line: int | None = None,
        column: int | None = None,
        hint: str | None = None,
    ) -> None:
        super().__init__(message, file, line, column, hint)
        self.message = message
        self.file = file
        self.line = line
        self.column = column
        self.hint = hint

    def __str__(self) -> str:
        return self.message if self.hint is None else f"{self.message}\nhint: {self.hint}"


class ArrayError(ShellcalError):
    """An array of a shape, type or content that cannot be used."""


class OptionError(ShellcalError):
    """An option that is not one of those there are."""


class LogError(ShellcalError):
    """A log that cannot be read."""


class DocumentError(ShellcalError):
    """A calibration or a partial fit that cannot be read."""


class FitError(ShellcalError):
    """Rows that do not determine what is asked of them."""


class MergeError(ShellcalError):
    """Partial fits that are no parts of one fit."""


class CountedTwiceError(MergeError):
    """A partial fit whose rows have been counted already."""


class ProgramError(ShellcalError):
    """The program `shellcal` could not do it."""


class NotFittedError(ShellcalError, AttributeError):
    """A calibration that has not been fitted or loaded yet."""


class ShellcalWarning(UserWarning):
    """A result that is to be read with care."""
