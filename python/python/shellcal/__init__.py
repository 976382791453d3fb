"""Calibration and trial processing for an optical 6-axis force/torque shell.

Imports are lazy: `import shellcal` takes a few milliseconds, and numpy is loaded with the first array.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_WHERE = {
    "_calibration": ("Calibration",),
    "_choice": ("choose_model", "cross_validate"),
    "_errors": (
        "ArrayError",
        "CountedTwiceError",
        "DocumentError",
        "FitError",
        "LogError",
        "MergeError",
        "NotFittedError",
        "OptionError",
        "ProgramError",
        "ShellcalError",
        "ShellcalWarning",
    ),
    "_log": ("Table", "read_log"),
    "_native": ("__version__",),
    "_partial": ("Partial", "merge", "partial_fit"),
    "_program": (
        "align",
        "batch",
        "convert",
        "fit_logs",
        "info",
        "program",
        "run",
        "simulate",
        "synth",
        "trial",
    ),
    "_stream": ("Frame", "FrameBlock", "FrameStream", "SimulatedBoard", "simulated_board", "stream"),
}
_MODULES = {name: module for module, names in _WHERE.items() for name in names}

__all__ = sorted(name for name in _MODULES if not name.startswith("_"))


def __getattr__(name: str) -> Any:
    module = _MODULES.get(name)
    if module is None:
        raise AttributeError(f"module `shellcal` has no attribute `{name}`")
    value = getattr(import_module(f".{module}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
