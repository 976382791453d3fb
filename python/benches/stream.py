"""A board at 1 kHz and four readers, one of which stops: losses, processor time, latency; and the conversion of a frame.

    python benches/stream.py [--seconds 60] [--rate 1000]
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import socket
import subprocess
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

import shellcal


class Udp(threading.Thread):
    """Counts rows, and gaps between them."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 22)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(5)
        self.port = self.socket.getsockname()[1]
        self.rows: list[int] = []

    def run(self) -> None:
        try:
            while True:
                self.rows.append(json.loads(self.socket.recv(4096))["row"])
        except TimeoutError:
            pass


class Stopped(threading.Thread):
    """Reads for a second, then stops until `go` is set, some seconds before the end."""

    def __init__(self, port: int) -> None:
        super().__init__(daemon=True)
        self.port, self.go, self.rows, self.lost = port, threading.Event(), 0, 0

    def run(self) -> None:
        connection = socket.create_connection(("127.0.0.1", self.port))
        until = time.monotonic() + 1
        with connection.makefile("rb") as lines:
            for line in lines:
                row = json.loads(line)
                self.rows, self.lost = self.rows + 1, row["lost"]
                self.first = row["row"] if self.rows == 1 else self.first
                self.last = row["row"]
                if time.monotonic() > until and not self.go.is_set():
                    self.go.wait()


def processor_s(pid: int) -> float:
    """User and system time of a process."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def percentiles(board_s: list[float], host_s: list[float]) -> str:
    """Percentiles of the delays relative to the fastest row of every ten seconds."""
    board, delay = np.array(board_s), np.array(host_s) - np.array(board_s)
    stretch = ((board - board[0]) // 10).astype(int)
    beyond = np.concatenate([delay[stretch == it] - delay[stretch == it].min() for it in set(stretch)])
    median, p99 = np.percentile(beyond, [50, 99]) * 1e3
    return f"median {median:.2f} ms, 99th percentile {p99:.2f} ms"


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def stream(folder: Path, calibration: Path, seconds: float, rate: float) -> None:
    readers, port = [Udp(), Udp()], free_port()
    for reader in readers:
        reader.start()
    output = ["-", f"tcp:{port}", *(f"udp:127.0.0.1:{reader.port}" for reader in readers)]
    with shellcal.simulated_board(rate=rate) as board:
        frames = shellcal.stream(board.port, calibration, output=output, latency=True)
        first, stopped = next(frames), Stopped(port)
        stopped.start()
        pid, own = frames._process.pid, resource.getrusage(resource.RUSAGE_SELF)
        board_s, host_s, rows = [first.t], [time.time()], [first.row]
        for frame in frames:
            host_s.append(time.time())
            board_s.append(frame.t)
            rows.append(frame.row)
            if frame.t - board_s[0] > seconds - 5:
                stopped.go.set()
            if frame.t - board_s[0] > seconds:
                break
        used = processor_s(pid)
        own_now = resource.getrusage(resource.RUSAGE_SELF)
        time.sleep(2)
        frames.close()
        said = list(frames._lines.said)
    for reader in readers:
        reader.join()
    stopped.join()
    print(f"{len(rows)} frames in {board_s[-1] - board_s[0]:.1f} s, {frames.lost} lost to the loop in Python")
    for number, reader in enumerate(readers):
        missing = reader.rows[-1] - reader.rows[0] + 1 - len(reader.rows)
        print(f"UDP reader {number}: {len(reader.rows)} rows, {missing} missing")
    between = stopped.last - stopped.first + 1 - stopped.rows
    print(f"stopped TCP reader: {stopped.rows} rows, {stopped.lost} told lost, {between} missing")
    print(f"processor of `shellcal stream`: {100 * used / seconds:.1f} % of a core")
    python = own_now.ru_utime + own_now.ru_stime - own.ru_utime - own.ru_stime
    print(f"processor of this script, all readers: {100 * python / seconds:.1f} % of a core")
    print(f"latency to Python beyond the fastest row: {percentiles(board_s[200:], host_s[200:])}")
    print("\n".join(said))


def convert(calibration: Path, log: Path) -> None:
    known = shellcal.Calibration.load(calibration)
    readings = shellcal.read_log(log).X[:1000]
    for frame in readings:
        known.convert(frame)
    started = time.process_time()
    for _ in range(20):
        for frame in readings:
            known.convert(frame)
    print(f"convert, {known!r}: {(time.process_time() - started) / 20_000 * 1e6:.1f} µs a frame")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--rate", type=float, default=1000)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        subprocess.run([shellcal.program(), "synth", "train", "--rows", "2500", "--rate", "10", "-o", "train.csv"], cwd=folder, check=True, capture_output=True)
        for model in ("cubic", "physics"):
            calibration = folder / f"{model}.json"
            subprocess.run([shellcal.program(), "fit", "train.csv", "--model", model, "-o", calibration, "-q"], cwd=folder, check=True)
            convert(calibration, folder / "train.csv")
        stream(folder, folder / "cubic.json", given.seconds, given.rate)


if __name__ == "__main__":
    main()
