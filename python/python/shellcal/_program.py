"""Functions on whole files, computed by the program: the same options, the same bits.

The program is part of the wheel. It runs as a separate process, so it does not block the interpreter, and Ctrl-C ends
it.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import threading
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from . import _progress
from ._calibration import Calibration
from ._errors import ProgramError, ShellcalWarning
from ._log import Table

PathLike = str | os.PathLike[str]
_Paths = PathLike | Iterable[PathLike]


def program() -> str:
    """Returns the path of the program: from `SHELLCAL_PROGRAM`, from the wheel, or from the `PATH`."""
    named = os.environ.get("SHELLCAL_PROGRAM")
    if named:
        return named
    name = "shellcal.exe" if os.name == "nt" else "shellcal"
    folders = [sysconfig.get_path("scripts"), os.path.dirname(sys.executable)]
    if hasattr(sysconfig, "get_preferred_scheme"):
        folders.append(sysconfig.get_path("scripts", scheme=sysconfig.get_preferred_scheme("user")))
    for folder in folders:
        path = os.path.join(folder, name)
        if os.path.isfile(path):
            return path
    found = shutil.which(name)
    if found is None:
        raise ProgramError(
            "the program `shellcal` is not installed",
            hint="install the wheel, or `cargo install --path host-cli`, or name it in SHELLCAL_PROGRAM",
        )
    return found


def run(command: str, *inputs: PathLike, ok: tuple[int, ...] = (0,), **options: Any) -> Any:
    """Runs a command of the program and returns what it prints with ``--json``.

    Options have the names of the program's, with ``_`` for ``-``: ``True`` is a flag, a list several values, ``None``
    no option. Warnings of the program become `ShellcalWarning`. Long runs show a progress bar in notebooks and
    terminals if tqdm is installed.

    Raises
    ------
    ProgramError
        With the program's message, file, line and column, and hint.
    """
    arguments = [program(), *command.split(), "--json"]
    for name, value in options.items():
        arguments += _option(name, value)
    if inputs:
        arguments += ["--", *(os.fspath(path) for path in inputs)]
    with _progress.shown(command, "trial" if command == "batch" else "B") as progress:
        try:
            code, document, said = _execute(arguments, progress)
        except OSError as error:
            raise ProgramError(f"cannot run `{arguments[0]}`: {error}") from None
    for line in said.splitlines():
        if line.startswith("warning: "):
            warnings.warn(line.removeprefix("warning: "), ShellcalWarning, stacklevel=3)
    if code not in ok:
        raise _error(said, code)
    try:
        return json.loads(document) if document.strip() else None
    except ValueError as error:
        raise ProgramError(f"`{command}` printed no JSON: {error}") from None


_PROGRESS = re.compile(rb"progress: (\d+)/(\d+)\s*$")


def _execute(arguments: list[str], progress: _progress.Progress | None) -> tuple[int, bytes, str]:
    """Returns exit code, standard output, and standard error without the progress."""
    if progress is None:
        done = subprocess.run(arguments, capture_output=True, stdin=subprocess.DEVNULL, check=False)
        return done.returncode, done.stdout, done.stderr.decode(errors="replace")
    after = arguments.index("--json") + 1
    arguments = [*arguments[:after], "--progress-lines", *arguments[after:]]
    printed: list[bytes] = []
    said = []
    with subprocess.Popen(
        arguments, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        # Both pipes must be read, otherwise the program would block on one of them.
        output = process.stdout
        reader = threading.Thread(target=lambda: printed.append(output.read()))
        reader.start()
        try:
            for line in process.stderr:
                place = _PROGRESS.match(line)
                if place is None:
                    said.append(line)
                else:
                    progress(int(place[1]), int(place[2]))
        except BaseException:
            process.kill()
            raise
        finally:
            reader.join()
    return process.returncode, b"".join(printed), b"".join(said).decode(errors="replace")


def _option(name: str, value: Any) -> list[str]:
    flag = "--" + name.rstrip("_").replace("_", "-")
    if value is None or value is False:
        return []
    if value is True:
        return [flag]
    if isinstance(value, (list, tuple)):
        return [flag, *(_word(part) for part in value)]
    return [f"{flag}={_word(value)}"]


def _word(value: Any) -> str:
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    return os.fspath(value) if isinstance(value, os.PathLike) else str(value)


_PLACE = re.compile(r"`(?P<file>[^`]+)`(?:, |: )line (?P<line>\d+)(?:[,:] column (?P<column>\d+))?")


def _error(said: str, code: int) -> ProgramError:
    lines = said.splitlines()
    at = next((i for i, line in enumerate(lines) if line.startswith("error: ")), None)
    if at is None:
        return ProgramError(said.strip() or f"the program ended with the code {code}")
    hints = [line.removeprefix("hint: ") for line in lines[at:] if line.startswith("hint: ")]
    rest = (line for line in lines[at:] if not line.startswith("hint: "))
    message = "\n".join(rest).removeprefix("error: ").strip()
    place = _PLACE.search(message)
    return ProgramError(
        message,
        place["file"] if place else None,
        int(place["line"]) if place else None,
        int(place["column"]) if place and place["column"] else None,
        "; ".join(hints) or None,
    )


def _paths(paths: _Paths) -> list[PathLike]:
    return [paths] if isinstance(paths, (str, os.PathLike)) else list(paths)


class _Calibrated:
    """The file of a calibration, which exists while the program reads it."""

    def __init__(self, calibration: Calibration | PathLike) -> None:
        self._calibration = calibration
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def __enter__(self) -> PathLike:
        if not isinstance(self._calibration, Calibration):
            return self._calibration
        self._folder = tempfile.TemporaryDirectory(prefix="shellcal-")
        path = Path(self._folder.name) / "calibration.json"
        self._calibration.save(path)
        return path

    def __exit__(self, *_: object) -> None:
        if self._folder is not None:
            self._folder.cleanup()


def fit_logs(train: _Paths, test: _Paths = (), **options: Any) -> Calibration:
    """``shellcal fit``: fits a calibration from logs, byte for byte as the program does.

    `options` are the program's: ``model="physics"``, ``cv=True``, ``plot="fit.svg"`` and so on.
    """
    with tempfile.TemporaryDirectory(prefix="shellcal-") as folder:
        output = Path(folder) / "calibration.json"
        figure = Path(folder) / "fit.svg"
        options["test"] = [os.fspath(path) for path in _paths(test)] or None
        if "plot" not in options and not options.get("partial"):
            options["plot"] = figure
        run("fit", *_paths(train), output=output, **options)
        calibration = Calibration.load(output)
        if figure.exists():
            calibration._shown = figure.read_text(encoding="utf-8")
        return calibration


def convert(
    calibration: Calibration | PathLike, log: PathLike, output: PathLike | None = None, **options: Any
) -> Any:
    """``shellcal convert``: forces and moments of a log, tared and filtered as by the program.

    Returns
    -------
    Table
        The columns of the program's output: ``t_s`` in s, ``fx_n`` … in N, ``mx_nm`` … in N·m, standard errors and
        flags; with `output` the program's summary, as a dict.
    """
    with _Calibrated(calibration) as file, tempfile.TemporaryDirectory(prefix="shellcal-") as folder:
        path = Path(folder) / "wrench.csv" if output is None else Path(output)
        about = run("convert", file, log, output=path, **options)
        return about if output is not None else _read_csv(path, about)


def trial(log: PathLike, calibration: Calibration | PathLike | None = None, **options: Any) -> Any:
    """``shellcal trial``: drag (N), lift (N), energies (J) and specific resistance of a trial, as a dict."""
    if calibration is None:
        return run("trial", log, **options)
    with _Calibrated(calibration) as file:
        return run("trial", log, calibration=file, **options)


def batch(
    manifest: PathLike, calibration: Calibration | PathLike | None = None, **options: Any
) -> Any:
    """``shellcal batch``: all trials of a manifest, with statistics by condition, as a dict.

    Trials that could not be evaluated are listed in ``failures``; they raise no exception.
    """
    if calibration is None:
        return run("batch", manifest, ok=(0, 1), **options)
    with _Calibrated(calibration) as file:
        return run("batch", manifest, ok=(0, 1), calibration=file, **options)


def simulate(**options: Any) -> Any:
    """``shellcal simulate``: the drag (N) of a body in a channel of springy beams, as a dict."""
    return run("simulate", **options)


def align(reference: PathLike, log: PathLike, output: PathLike, **options: Any) -> Any:
    """``shellcal align``: joins a reference's and a board's recording to a training log; returns a dict with the
    offset (s) and its standard error."""
    return run("align", reference, log, output=output, **options)


def synth(kind: str, output: PathLike, **options: Any) -> Any:
    """``shellcal synth``: a recording from a model of the sensor: ``train``, ``test``, ``zero`` or ``trial`` into a
    file, ``pair`` or ``trials`` into a folder."""
    if kind in ("pair", "trials"):
        return run(f"synth {kind}", output, **options)
    return run(f"synth {kind}", output=output, **options)


def info(*logs: PathLike) -> Any:
    """``shellcal info``: describes logs."""
    return run("info", *logs)


def _read_csv(path: Path, about: Any) -> Table:
    """Reads the columns of a table that the program wrote: numbers, otherwise text."""
    with open(path, encoding="utf-8") as file:
        names = file.readline().rstrip("\n").split(",")
        cells = [line.rstrip("\n").split(",") for line in file]
    columns: dict[str, Any] = {}
    for place, name in enumerate(names):
        column = np.asarray([row[place] for row in cells], dtype=str)
        try:
            columns[name] = column.astype(np.float64)
        except ValueError:
            columns[name] = column
    return Table(columns, about)
