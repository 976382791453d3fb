"""Calibrations with memory terms give the program's results: fitted here, applied here, and exported as code."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import program

import shellcal

TIMES = [0.3, 4.0]
CHANNELS = [f"s{channel}" for channel in range(1, 9)]
AXES = ["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"]
# Rounding of sums of about forty products.
NEAR = 1e-12


def columns(path: Path, names: list[str]) -> Any:
    with path.open() as file:
        header = file.readline().strip().split(",")
    return np.loadtxt(path, delimiter=",", skiprows=1, usecols=[header.index(name) for name in names])


@pytest.fixture(scope="module")
def remembering(
    logs: list[Path], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Path, Any]:
    """A calibration with memory terms, a log, and the program's wrenches of it."""
    folder = tmp_path_factory.mktemp("memory")
    calibration, converted = folder / "calibration.json", folder / "converted.csv"
    given = ["--model", "cubic", "--memory-terms", "0.3,4", "--covariance", "rows"]
    program("fit", logs[1], *given, "-o", calibration, "-q")
    untouched = ["--no-tare", "--no-lowpass", "--all-rows"]
    program("convert", calibration, logs[2], *untouched, "-o", converted, "-q")
    return calibration, logs[2], columns(converted, AXES)


def test_a_file_is_applied_along_the_rows_of_a_recording(remembering: tuple[Path, Path, Any]) -> None:
    path, log, expected = remembering
    calibration = shellcal.Calibration.load(path)
    assert calibration.memory_terms == (0.3, 4.0)
    readings, times = columns(log, CHANNELS), columns(log, ["t_s"])
    assert (calibration.predict(readings, time=times) == expected).all()
    with pytest.raises(shellcal.OptionError, match="there is no time"):
        calibration.predict(readings)
    with pytest.raises(shellcal.ArrayError, match="time has the shape"):
        calibration.predict(readings, time=times[1:])
    # Frame by frame as well, and from a restart when the clock goes back to its start.
    for _ in range(2):
        for frame, at, wrench in zip(readings, times, expected):
            assert (calibration.convert(frame, at) == wrench).all()
    with pytest.raises(shellcal.OptionError, match="there is no time"):
        calibration.convert(readings[0])


def test_a_fit_here_is_the_fit_of_the_program(
    logs: list[Path], remembering: tuple[Path, Path, Any]
) -> None:
    _, log, expected = remembering
    train = shellcal.read_log(logs[1])
    fitted = shellcal.Calibration("cubic", memory_terms=TIMES, covariance="rows")
    fitted.fit(train.X, train.Y, time=columns(logs[1], ["t_s"]))
    found = fitted.predict(columns(log, CHANNELS), time=columns(log, ["t_s"]))
    assert np.allclose(found, expected, rtol=0, atol=1e-9)
    with pytest.raises(shellcal.OptionError, match="memory_terms"):
        shellcal.Calibration(memory_terms="some").fit(train.X, train.Y)


def test_exported_python_gives_the_wrenches_of_the_program(
    remembering: tuple[Path, Path, Any], tmp_path: Path
) -> None:
    calibration, log, expected = remembering
    path = tmp_path / "shell_wrench.py"
    program("export", calibration, path)
    spec = importlib.util.spec_from_file_location("shell_wrench", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    readings, times = columns(log, CHANNELS), columns(log, ["t_s"])
    assert (np.abs(module.wrench(readings, times) - expected) <= NEAR).all()
    state = module.State()
    pieces = [module.wrench(readings[rows], times[rows], state) for rows in np.array_split(np.arange(len(times)), 7)]
    assert (np.abs(np.concatenate(pieces) - expected) <= NEAR).all()
    with pytest.raises(ValueError, match="a time is expected"):
        module.wrench(readings)


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="Octave is not installed")
def test_exported_matlab_gives_the_wrenches_of_the_program(
    remembering: tuple[Path, Path, Any], tmp_path: Path
) -> None:
    calibration, log, expected = remembering
    program("export", calibration, tmp_path / "shell_wrench.m")
    np.savetxt(tmp_path / "readings.txt", columns(log, CHANNELS), fmt="%.17g")
    np.savetxt(tmp_path / "times.txt", columns(log, ["t_s"]), fmt="%.17g")
    script = (
        "r = load('readings.txt'); t = load('times.txt'); [a, state] = shell_wrench(r(1:100, :), t(1:100), []); "
        "w = [a; shell_wrench(r(101:end, :), t(101:end), state)]; save('-ascii', '-double', 'wrench.txt', 'w')"
    )
    subprocess.run(["octave-cli", "-q", "--eval", script], cwd=tmp_path, check=True)
    assert (np.abs(np.loadtxt(tmp_path / "wrench.txt") - expected) <= NEAR).all()
