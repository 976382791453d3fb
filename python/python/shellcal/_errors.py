"""Exceptions: the fault, its place, and a hint."""

from __future__ import annotations


class ShellcalError(ValueError):
    """Base class of the exceptions of this package.

    Attributes
    ----------
    message : str
        The fault, without the hint.
    file, line, column : str, int, int or None
        The place of the fault, as far as known; lines and columns count from 1.
    hint : str or None
        How to resolve the fault.
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
    """An array with an unsuitable shape, type or content."""


class OptionError(ShellcalError):
    """An unknown option, or an invalid value."""


class LogError(ShellcalError):
    """A log that cannot be read."""


class DocumentError(ShellcalError):
    """A calibration or a partial fit that cannot be read."""


class FitError(ShellcalError):
    """Rows that do not determine the requested model."""


class MergeError(ShellcalError):
    """Partial fits that do not belong to one fit."""


class CountedTwiceError(MergeError):
    """A partial fit whose rows were counted before."""


class ProgramError(ShellcalError):
    """A failure of the program `shellcal`."""


class NotFittedError(ShellcalError, AttributeError):
    """A calibration that was not fitted or loaded yet."""


class ShellcalWarning(UserWarning):
    """A result that needs caution."""
