"""Frames in real time from ``shellcal stream``.

The program runs as a separate process, so its frames have the same bits as its logs, and a slow Python loop delays no
other reader: it loses frames, and the program reports how many.
"""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import threading
import time
import warnings
import weakref
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from ._calibration import Calibration
from ._errors import ProgramError, ShellcalWarning
from ._program import PathLike, _Calibrated, _error, _option, program

_Numbers = npt.NDArray[np.float64]

#: Maximum number of lines that wait for the loop; beyond it the program counts losses.
_WAITING = 4096

#: Time for the program to end, s.
_PATIENCE = 5.0

_AXES = ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")
_ERRORS = tuple(name.replace("_", "_se_") for name in _AXES)
_CHANNELS = tuple(f"s{channel}" for channel in range(1, 9))


class Frame:
    """A frame of a board.

    Attributes
    ----------
    t : float
        Time of the frame, s on the board's clock.
    index : int
        Sequence number; a gap means frames lost on the way from the board.
    host_t : float
        Arrival time at this computer, s since 1970.
    wrench, std : array of 6, or None
        Fx, Fy, Fz in N, Mx, My, Mz in N·m, and their standard errors; ``nan`` for axes that the calibration lacks.
    readings : array of 8, or None
        In steps of the 12-bit converter.
    flags : tuple of str
        Empty for a regular frame: ``"s3:range"``, ``"s3:saturated"``, ``"untared"``, ``"mark1"`` and so on.
    row, lost : int
        Number of the frame in the stream, and number of frames that this loop has lost so far by being too slow.
    """

    __slots__ = ("t", "index", "host_t", "wrench", "std", "readings", "flags", "row", "lost")

    def __init__(self, line: bytes) -> None:
        row = json.loads(line)
        self.t: float = row["t_s"]
        self.index: int = row["index"]
        self.host_t: float = row["host_s"]
        self.wrench = _numbers(row, _AXES)
        self.std = _numbers(row, _ERRORS)
        self.readings = _numbers(row, _CHANNELS)
        self.flags: tuple[str, ...] = tuple(row["flags"].split())
        self.row: int = row["row"]
        self.lost: int = row["lost"]

    def __repr__(self) -> str:
        return f"Frame(t={self.t}, wrench={self.wrench}, flags={self.flags})"


@dataclass(frozen=True, eq=False)
class FrameBlock:
    """Consecutive frames as columns: n, n × 6, n × 8; in the units of `Frame`."""

    t: _Numbers
    index: npt.NDArray[np.int64]
    wrench: _Numbers | None
    std: _Numbers | None
    readings: _Numbers | None
    flags: list[tuple[str, ...]]


def _numbers(row: dict[str, Any], names: tuple[str, ...]) -> _Numbers | None:
    values = [row.get(name) for name in names]
    if values.count(None) == len(names):
        return None
    # None becomes NaN.
    return np.array(values, dtype=np.float64)


def _block(frames: list[Frame]) -> FrameBlock:
    def stacked(name: str) -> _Numbers | None:
        columns = [getattr(frame, name) for frame in frames]
        return None if any(column is None for column in columns) else np.stack(columns)

    return FrameBlock(
        np.array([frame.t for frame in frames]),
        np.array([frame.index for frame in frames], dtype=np.int64),
        stacked("wrench"),
        stacked("std"),
        stacked("readings"),
        [frame.flags for frame in frames],
    )


class _Lines:
    """The program's output, read by threads that do not keep the stream alive."""

    def __init__(self, process: subprocess.Popen[bytes]) -> None:
        self.lines: deque[bytes] = deque()
        self.changed = threading.Condition()
        self.is_over = False
        self.is_closing = False
        self.said: deque[str] = deque(maxlen=1000)
        self.waiters: list[tuple[asyncio.AbstractEventLoop, asyncio.Future[None]]] = []
        self.threads = [
            threading.Thread(target=read, args=(file,), daemon=True)
            for read, file in ((self._read, process.stdout), (self._listen, process.stderr))
        ]
        for thread in self.threads:
            thread.start()

    def _read(self, out: IO[bytes]) -> None:
        with out:
            for line in out:
                if not line.endswith(b"\n"):
                    break  # The program has ended within a line, since its output was not read.
                with self.changed:
                    while len(self.lines) >= _WAITING and not self.is_closing:
                        self.changed.wait()
                    self.lines.append(line)
                    self._tell()
        with self.changed:
            self.is_over = True
            self._tell()

    def _listen(self, err: IO[bytes]) -> None:
        with err:
            for line in err:
                self.said.append(line.decode(errors="replace").rstrip("\n"))

    def _tell(self) -> None:
        self.changed.notify_all()
        for loop, future in self.waiters:
            try:
                loop.call_soon_threadsafe(_wake, future)
            except RuntimeError:
                pass  # The loop has ended.
        self.waiters.clear()

    def take(self, timeout: float | None) -> bytes | None:
        """Returns the next line; ``None`` at a timeout or at the end."""
        with self.changed:
            if not self.lines and not self.is_over:
                self.changed.wait_for(lambda: self.lines or self.is_over, timeout)
            return self._pop()

    def take_newest(self) -> bytes | None:
        with self.changed:
            while len(self.lines) > 1:
                self.lines.popleft()
            return self._pop()

    def _pop(self) -> bytes | None:
        if not self.lines:
            return None
        if len(self.lines) == _WAITING:
            self.changed.notify_all()
        return self.lines.popleft()

    async def wait(self) -> bytes | None:
        while True:
            with self.changed:
                line = self._pop()
                if line is not None or self.is_over:
                    return line
                loop = asyncio.get_running_loop()
                future = loop.create_future()
                self.waiters.append((loop, future))
            await future


def _start(arguments: list[str]) -> subprocess.Popen[bytes]:
    # This process handles Ctrl-C and ends the program; the same applies to notebooks.
    return subprocess.Popen(
        arguments,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=os.name != "nt",
    )


def _wake(future: asyncio.Future[None]) -> None:
    if not future.done():
        future.set_result(None)


class FrameStream:
    """Frames of a board or a log, see `stream`. Supports ``for`` and ``async for``."""

    def __init__(self, arguments: list[str], calibrated: _Calibrated | None) -> None:
        self._calibrated = calibrated
        self._process = _start(arguments)
        self._lines = _Lines(self._process)
        self._latest: Frame | None = None
        self._is_closed = False
        self._end = weakref.finalize(self, _end, self._process, self._lines)

    def __enter__(self) -> FrameStream:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    async def __aenter__(self) -> FrameStream:
        return self

    async def __aexit__(self, *_: object) -> None:
        await asyncio.get_running_loop().run_in_executor(None, self.close)

    def __iter__(self) -> Iterator[Frame]:
        return self

    def __next__(self) -> Frame:
        frame = self.read()
        if frame is None:
            raise StopIteration
        return frame

    def __aiter__(self) -> FrameStream:
        return self

    async def __anext__(self) -> Frame:
        line = None if self._is_closed else await self._lines.wait()
        if line is None:
            self._check()
            raise StopAsyncIteration
        return self._frame(line)

    def read(self, timeout: float | None = None) -> Frame | None:
        """Returns the next frame; ``None`` at the end, or if none arrives within `timeout` s.

        Raises
        ------
        ProgramError
            If the stream has failed: a lost port, an unsuitable calibration.
        """
        if self._is_closed:
            return None
        line = self._lines.take(timeout)
        if line is None:
            self._check()
            return None
        return self._frame(line)

    def latest(self) -> Frame | None:
        """Returns the newest frame without waiting, and skips older ones. ``None`` before the first."""
        line = None if self._is_closed else self._lines.take_newest()
        if line is not None:
            return self._frame(line)
        self._check()
        return self._latest

    def chunks(self, seconds: float) -> Iterator[FrameBlock]:
        """Yields blocks of frames as arrays, each of this many seconds of the board's clock; the last may be shorter."""
        frames: list[Frame] = []
        for frame in self:
            if frames and not 0 <= frame.t - frames[0].t < seconds:
                yield _block(frames)
                frames = []
            frames.append(frame)
        if frames:
            yield _block(frames)

    def tare(self) -> None:
        """Takes the mean wrench of the next 50 frames as zero; the first frame with it has the flag ``"tared"``."""
        self._order("tare")

    def untare(self) -> None:
        """Removes that zero."""
        self._order("untare")

    def mark(self) -> None:
        """Flags the next frame: ``"mark1"``, ``"mark2"`` and so on."""
        self._order("mark")

    def rate(self, hz: float | None) -> None:
        """Sets the number of frames per second, without aliasing; ``None`` for all."""
        self._order("rate all" if hz is None else f"rate {hz!r}")

    @property
    def lost(self) -> int:
        """Number of frames lost because this loop is too slow, as of the newest frame."""
        return 0 if self._latest is None else self._latest.lost

    def close(self) -> None:
        """Ends the stream, and tells the board to stop. Can be called repeatedly."""
        self._is_closed = True
        self._end()
        if self._calibrated is not None:
            self._calibrated.__exit__()
            self._calibrated = None

    def _order(self, line: str) -> None:
        try:
            assert self._process.stdin is not None
            self._process.stdin.write(line.encode() + b"\n")
            self._process.stdin.flush()
        except (OSError, ValueError):
            self._check()
            raise ProgramError("the stream has ended") from None

    def _frame(self, line: bytes) -> Frame:
        self._warn()
        self._latest = Frame(line)
        return self._latest

    def _warn(self) -> None:
        said = self._lines.said
        while said and said[0].startswith(("warning: ", "note: ")):
            line = said.popleft()
            if line.startswith("warning: "):
                warnings.warn(line.removeprefix("warning: "), ShellcalWarning, stacklevel=4)

    def _check(self) -> None:
        """Raises the reason if the stream has failed."""
        if self._is_closed or not self._lines.is_over:
            return
        code = self._process.wait(_PATIENCE)
        self._lines.threads[1].join(_PATIENCE)
        self._warn()
        if code != 0:
            self.close()
            raise _error("\n".join(self._lines.said), code)


def _end(process: subprocess.Popen[bytes], lines: _Lines) -> None:
    """Ends the program: by closing its input, or by force if that does not help."""
    with lines.changed:
        lines.is_closing = True
        lines.lines.clear()
        lines.changed.notify_all()
    try:
        if process.stdin is not None:
            process.stdin.close()
    except OSError:
        pass  # It has already ended.
    try:
        process.wait(_PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    for thread in lines.threads:
        thread.join(_PATIENCE)


def stream(
    source: PathLike, calibration: Calibration | PathLike | None = None, **options: Any
) -> FrameStream:
    """``shellcal stream``: frames as they arrive.

    ``with shellcal.stream("/dev/ttyUSB0", calibration="cal.json", lowpass=10) as frames: for f in frames: …``

    Parameters
    ----------
    source
        A serial port, ``tcp://HOST:PORT``, the port of a `simulated_board`, or a log, which is played in real time.
    calibration
        Calibration for forces.
    options
        Options of the program: ``lowpass=10``, ``no_lowpass=True``, ``no_tare=True``, ``rate=100``,
        ``reconnect=True``, ``speed=4``. The board is told to start unless ``start=False``.
    """
    options.setdefault("start", True)
    calibrated = None
    if calibration is not None:
        calibrated = _Calibrated(calibration)
        options["calibration"] = calibrated.__enter__()
    arguments = [program(), "stream", "--until-eof"]
    for name, value in options.items():
        for part in value if isinstance(value, (list, tuple)) else [value]:
            arguments += _option(name, part)
    try:
        return FrameStream([*arguments, "--", os.fspath(source)], calibrated)
    except OSError as error:
        raise ProgramError(f"cannot run `{arguments[0]}`: {error}") from None


class SimulatedBoard:
    """A board without hardware, see `simulated_board`."""

    def __init__(self, arguments: list[str]) -> None:
        self._process = _start(arguments)
        self._end = weakref.finalize(self, _end_board, self._process)
        assert self._process.stdout is not None
        try:
            self.port: str = json.loads(_document(self._process.stdout))["port"]
        except ValueError:
            _, said = self._process.communicate()
            raise _error(said.decode(errors="replace"), self._process.returncode) from None

    def __enter__(self) -> SimulatedBoard:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def load(self, *wrench: float) -> None:
        """Sets the load on the shell: Fx, Fy, Fz in N, Mx, My, Mz in N·m; missing values are 0.

        Only for a board with ``load="-"``.
        """
        line = ",".join(repr(float(value)) for value in (*wrench, *[0.0] * (6 - len(wrench))))
        assert self._process.stdin is not None
        self._process.stdin.write(line.encode() + b"\n")
        self._process.stdin.flush()

    def close(self) -> None:
        """Switches the board off."""
        self._end()


def _document(out: IO[bytes]) -> bytes:
    """Reads the document of ``--json``, which ends with a brace alone on its line."""
    text = b""
    for line in out:
        text += line
        if line.rstrip() in (b"}", b"{}"):
            break
    return text


def _end_board(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.communicate(timeout=_PATIENCE)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()


def simulated_board(rate: float | None = None, **options: Any) -> SimulatedBoard:
    """``shellcal board --simulate``: a simulated board, which runs until it is closed. Its port is ``board.port``.

    Parameters
    ----------
    rate
        Frames per second instead of the usual 100, Hz.
    options
        Options of the program: ``seed=1``, ``radio="loss=0.1"``, ``load="load.csv"``, or ``load="-"`` for `SimulatedBoard.load`.
    """
    arguments = [program(), "--json", "board", "--simulate", "--until-eof"]
    for name, value in options.items():
        arguments += _option(name, value)
    board = SimulatedBoard(arguments)
    if rate is not None:
        _set_rate(board, rate)
    return board


def _set_rate(board: SimulatedBoard, rate: float) -> None:
    # Less averaging if eight channels would not fit into a period.
    quick = [["sampling", "--settling", "25", "--conversions", "4"]] if rate > 200 else []
    for order in [*quick, ["rate", repr(float(rate))]]:
        deadline = time.monotonic() + _PATIENCE
        while True:
            done = subprocess.run(
                [program(), "board", board.port, *order],
                capture_output=True,
                stdin=subprocess.DEVNULL,
                check=False,
            )
            if done.returncode == 0:
                break
            if time.monotonic() > deadline or b"no answer" not in done.stderr:
                board.close()
                raise _error(done.stderr.decode(errors="replace"), done.returncode)
