"""Exported code gives the results of the program."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import program

CHANNELS = [f"s{channel}" for channel in range(1, 9)]
AXES = ["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"]
ERRORS = ["fx_se_n", "fy_se_n", "fz_se_n", "mx_se_nm", "my_se_nm", "mz_se_nm"]


def columns(path: Path, names: list[str]) -> Any:
    with path.open() as file:
        header = file.readline().strip().split(",")
    places = [header.index(name) for name in names]
    return np.loadtxt(path, delimiter=",", skiprows=1, usecols=places)


@pytest.fixture(scope="module", params=["cubic", "poly3", "physics"])
def calibrated(
    request: pytest.FixtureRequest, logs: list[Path], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Path, Any, Any]:
    """A calibration, a log, the program's wrenches for it, and the tolerance."""
    folder = tmp_path_factory.mktemp(request.param)
    calibration, converted = folder / "calibration.json", folder / "converted.csv"
    program("fit", logs[1], "--model", request.param, "-o", calibration, "-q")
    untouched = ["--no-tare", "--no-lowpass", "--all-rows"]
    program("convert", calibration, logs[2], *untouched, "-o", converted, "-q")
    wrench = columns(converted, AXES)
    # Polynomials differ by rounding: sums of up to 165 products, a few of the largest of which cancel. The
    # physics model's iteration ends within a thousandth of a standard error, from slightly different starts.
    near = columns(converted, ERRORS) * 1e-3 if request.param == "physics" else 1e-12
    return calibration, logs[2], wrench, near


def test_python_gives_the_wrenches_of_the_program(
    calibrated: tuple[Path, Path, Any, Any], tmp_path: Path
) -> None:
    calibration, log, expected, near = calibrated
    path = tmp_path / "shell_wrench.py"
    program("export", calibration, path)
    spec = importlib.util.spec_from_file_location("shell_wrench", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    readings = columns(log, CHANNELS)
    wrench = module.wrench(readings)
    assert module.AXES == AXES
    assert (np.abs(wrench - expected) <= near).all()
    # One frame, and a stack of frames.
    assert np.allclose(module.wrench(readings[7]), wrench[7], rtol=0, atol=1e-12)
    assert module.wrench(readings[:6].reshape(2, 3, 8)).shape == (2, 3, 6)
    with pytest.raises(ValueError, match="channels are expected"):
        module.wrench(readings[:, :7])


@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="Octave is not installed")
def test_octave_gives_the_wrenches_of_the_program(
    calibrated: tuple[Path, Path, Any, Any], tmp_path: Path
) -> None:
    calibration, log, expected, near = calibrated
    program("export", calibration, tmp_path / "shell_wrench.m")
    np.savetxt(tmp_path / "readings.txt", columns(log, CHANNELS), fmt="%.17g")
    script = "w = shell_wrench(load('readings.txt')); save('-ascii', '-double', 'wrench.txt', 'w')"
    subprocess.run(["octave-cli", "-q", "--eval", script], cwd=tmp_path, check=True)
    assert (np.abs(np.loadtxt(tmp_path / "wrench.txt") - expected) <= near).all()
