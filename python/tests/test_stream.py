"""Frames in real time: results are the program's, even if the loop is slow or stops."""

from __future__ import annotations

import asyncio
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import shellcal

from conftest import program

pytestmark = pytest.mark.skipif(os.name == "nt", reason="ports that a program makes are not there")


@pytest.fixture(scope="session")
def calibration(logs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stream") / "cal.json"
    program("fit", logs[1], "--model", "cubic", "-o", path, "-q")
    return path


def processes() -> set[int]:
    """The child processes of this one."""
    found = subprocess.run(
        ["ps", "-o", "pid=,args=", "--ppid", str(os.getpid())], capture_output=True, text=True, check=False
    )
    lines = (line.split(None, 1) for line in found.stdout.splitlines())
    return {int(pid) for pid, arguments in lines if "shellcal" in arguments}


def test_a_board_is_read_tared_and_marked(calibration: Path) -> None:
    with shellcal.simulated_board(seed=4, load="-") as board:
        with shellcal.stream(board.port, calibration, lowpass=10) as frames:
            first = [frame for frame, _ in zip(frames, range(100))]
            assert [frame.row for frame in first] == list(range(100))
            assert all(b.index == a.index + 1 for a, b in zip(first, first[1:]))
            last = first[-1]
            assert last.wrench.shape == (6,) and last.std.shape == (6,) and last.readings.shape == (8,)
            assert "untared" in first[0].flags and last.flags == ()
            assert abs(last.host_t - time.time()) < 60
            frames.mark()
            frames.tare()
            seen: list[str] = []
            for frame in frames:
                seen += frame.flags
                if "tared" in seen:
                    break
            assert seen == ["mark1", "tared"]
            # A load on the shell appears in the stream in newtons.
            board.load(0.0, 0.0, -1.5)
            for frame in frames:
                if abs(frame.wrench[2] + 1.5) < 0.3:
                    break
            newest = frames.latest()
            assert newest is not None and newest.index >= frame.index
            assert frames.lost == 0
    assert not processes()


def test_a_loop_that_stops_loses_frames_and_is_told_how_many(calibration: Path, tmp_path: Path) -> None:
    log = tmp_path / "zero.csv"
    program("synth zero", "--rows", 60_000, "-o", log)
    with shellcal.stream(log, speed=1000) as frames:
        first = next(frames)
        # The stream is not read until the whole log was played.
        while processes() and not frames._lines.is_over and len(frames._lines.lines) < 4096:
            time.sleep(0.05)
        time.sleep(1.0)
        rest = list(frames)
    got = [first, *rest]
    assert all(frame.row - frame.lost == place for place, frame in enumerate(got))
    assert got[-1].row <= 59_999


def test_frames_have_the_bits_of_convert(calibration: Path, tmp_path: Path) -> None:
    log = tmp_path / "zero.csv"
    program("synth zero", "--rows", 300, "-o", log)
    converted = shellcal.convert(calibration, log, causal=True, all_rows=True)
    with shellcal.stream(log, calibration, speed=1000) as frames:
        blocks = list(frames.chunks(0.1))
    wrench = np.concatenate([block.wrench for block in blocks])
    # Until tare and clock are known, frames have the forces of the calibration alone.
    for axis, name in enumerate(("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")):
        assert np.array_equal(wrench[50:, axis], converted[name][50:])
    t = np.concatenate([block.t for block in blocks])
    assert np.array_equal(t, converted["t_s"])
    assert all(block.t[-1] - block.t[0] < 0.1 for block in blocks)


def test_frames_come_to_an_event_loop(calibration: Path) -> None:
    async def some(port: str) -> list[int]:
        async with shellcal.stream(port, calibration) as frames:
            found = []
            async for frame in frames:
                found.append(frame.index)
                if len(found) == 120:
                    return found
        raise AssertionError("the stream has ended")

    with shellcal.simulated_board() as board:
        found = asyncio.run(some(board.port))
    assert found == list(range(found[0], found[0] + 120))
    assert not processes()


def test_closing_in_any_order_leaves_nothing(calibration: Path) -> None:
    board = shellcal.simulated_board()
    frames = shellcal.stream(board.port, calibration)
    next(frames)
    board.close()
    with pytest.raises(shellcal.ProgramError, match="is gone"):
        for _ in frames:
            pass
    frames.close()
    frames.close()
    assert list(frames) == []

    board = shellcal.simulated_board()
    unread = shellcal.stream(board.port)
    unread.close()
    forgotten = shellcal.stream(board.port)
    next(forgotten)
    del forgotten
    board.close()
    assert not processes()


# If the tests run in the background of a shell, Ctrl-C is ignored from the start.
_LOOP = """
import signal, shellcal
signal.signal(signal.SIGINT, signal.default_int_handler)
with shellcal.simulated_board() as board, shellcal.stream(board.port) as frames:
    for number, frame in enumerate(frames):
        if number == 10:
            print(board._process.pid, frames._process.pid, flush=True)
"""


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_who_is_interrupted_leaves_nothing(how: Any) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", _LOOP], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as loop:
        assert loop.stdout is not None
        pids = [int(word) for word in loop.stdout.readline().split()]
        assert len(pids) == 2
        loop.send_signal(how)
        loop.wait()
    # A killed parent cannot wait for them, but they must end.
    deadline = time.monotonic() + 60
    while any(_is_running(pid) for pid in pids):
        assert time.monotonic() < deadline, "a process is left"
        time.sleep(0.05)


def _is_running(pid: int) -> bool:
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"


def test_what_cannot_be_streamed_is_an_exception(calibration: Path, tmp_path: Path) -> None:
    with pytest.raises(shellcal.ProgramError, match="there is no port"):
        next(shellcal.stream("/dev/nothing"))
    log = tmp_path / "zero.csv"
    program("synth zero", "--rows", 100, "-o", log)
    two = tmp_path / "two.json"
    X = np.random.default_rng(1).integers(0, 4000, (200, 2)).astype(float)
    shellcal.Calibration(model="linear").fit(X, np.hstack([X, X, X])).save(two)
    # The program also warns of a reference that is computed from the readings.
    refused = pytest.raises(shellcal.ProgramError, match="2 channels")
    with pytest.warns(shellcal.ShellcalWarning, match="NOT OK"), refused:
        next(shellcal.stream(log, two))
    with pytest.raises(shellcal.ProgramError):
        list(shellcal.stream(log, calibration, lowpass=400, speed=1000))
    assert not processes()


def test_the_layout_of_plotjuggler_names_fields(calibration: Path, tmp_path: Path) -> None:
    log = tmp_path / "zero.csv"
    program("synth zero", "--rows", 60, "-o", log)
    printed = program("stream", log, "--calibration", calibration, "--speed", 1000)
    fields = json.loads(printed.splitlines()[0])
    layout = Path(__file__).parents[2] / "docs" / "plotjuggler" / "wrench.xml"
    curves = [curve.attrib["name"] for curve in ElementTree.parse(layout).iter("curve")]
    assert len(curves) == 14 and all(curve.removeprefix("/") in fields for curve in curves)


def test_one_frame_has_the_bits_of_many(table: shellcal.Table) -> None:
    for model in ("cubic", "physics"):
        calibration = shellcal.Calibration(model).fit(table.X, table.Y, groups=table.groups)
        together = calibration.predict(table.X[:100])
        for frame, wrench in zip(table.X, together):
            assert np.array_equal(calibration.convert(frame), wrench)
            assert np.array_equal(calibration.convert(list(frame)), wrench)
        with pytest.raises(shellcal.ArrayError, match="7 readings"):
            calibration.convert(table.X[0, :7])
