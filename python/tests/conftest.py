"""Recordings of the simulated sensor, and the program as the reference for fits."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import shellcal

#: Date of every document in the tests.
EPOCH = "1500000000"


@pytest.fixture(autouse=True)
def a_day_in_2017(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SOURCE_DATE_EPOCH", EPOCH)


@pytest.fixture(scope="session")
def logs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Three recordings of different lengths; poses are groups."""
    folder = tmp_path_factory.mktemp("logs")
    paths = [folder / f"{seed}.csv" for seed in (1, 2, 3)]
    for seed, rows, path in zip((1, 2, 3), (900, 1700, 400), paths):
        program("synth train", "--rows", rows, "--rate", 10, "--seed", seed, "-o", path)
    return paths


@pytest.fixture(scope="session")
def table(logs: list[Path]) -> shellcal.Table:
    return shellcal.read_log(logs[1])


def program(command: str, *arguments: Any) -> str:
    """Returns the output of the program."""
    line = [shellcal.program(), *command.split(), *map(str, arguments)]
    done = subprocess.run(
        line, capture_output=True, text=True, env={"SOURCE_DATE_EPOCH": EPOCH}, check=False
    )
    assert done.returncode == 0, f"{line}: {done.stderr}"
    return done.stdout


def record_whole(port: str, calibration: Path, log: Path, stream: Path | None = None) -> None:
    """Records three seconds of a board at 100 Hz, again if a busy machine lost frames."""
    options = ["--calibration", calibration, *(["--stream", stream] if stream else [])]
    for _ in range(20):
        for made in filter(None, (log, stream)):
            made.unlink(missing_ok=True)
        program("record", port, "--start", "--duration", 3, *options, "-o", log)
        if len(log.read_bytes().splitlines()) > 280:
            return
    raise AssertionError(f"{log}: fewer than 280 frames in 20 recordings")


def fitted(tmp_path: Path, *arguments: Any) -> dict[str, Any]:
    """Returns the calibration file of `shellcal fit`, for the cubic model unless another is given."""
    path = tmp_path / "fitted.json"
    model = () if "--model" in arguments else ("--model", "cubic")
    program("fit", *arguments, *model, "-o", path, "-q")
    document: dict[str, Any] = json.loads(path.read_text())
    return document


def counts(rows: int, channels: int = 8, seed: int = 0) -> tuple[Any, Any]:
    """Returns 12-bit readings, and a wrench that is linear in them except for noise."""
    random = np.random.default_rng(seed)
    X = random.integers(1200, 2800, (rows, channels)).astype(float)
    truth = random.normal(size=(channels, 6)) / 1000
    return X, (X - 2000) @ truth + 0.01 * random.normal(size=(rows, 6))
