#!/usr/bin/env python3
"""A calibration in one sitting without hands: a simulated board, a rig that hangs what the page of `shellcal calibrate` asks for,
and a reference beside it, whose clock is 0.3 s off and 80 ppm fast.

    python3 sitting.py FOLDER [OPTION OF calibrate ...]

With a robot as the rig, `hang` moves it, and the page's events say to which load.
"""

import json
import os
import random
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from urllib.request import urlopen

PROGRAM = os.environ.get("SHELLCAL_PROGRAM", "shellcal")
AXES = "fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm"
#: Weights on a post with four hooks, in seven directions.
RIG = ["--masses", "0.1kg,0.3kg", "--directions", "+x,-x,+y,-y,down,up,45:-30"]
for hook in ("0,0,40", "30,0,40", "-20,30,30", "-10,-30,50"):
    RIG += ["--point", hook]
#: Noise of the reference, N and N·m, and time without a load between two loads, s.
NOISE = [0.01] * 3 + [0.0005] * 3
REST_S = 1.5


class Bench:
    """The load on the shell, as board and reference feel it."""

    def __init__(self, folder):
        self.load = [0.0] * 6
        board = [PROGRAM, "board", "--simulate", "--load", "-", "--symlink", str(folder / "board"), "--seed", "1"]
        self.board = subprocess.Popen(board, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.board.stdout.readline()

    def hang(self, load):
        self.load = load
        self.board.stdin.write(",".join(map(str, load)) + "\n")
        self.board.stdin.flush()

    def serve_reference(self, listener):
        """Sends the load at 200 Hz."""
        stream, _ = listener.accept()
        noise, start = random.Random(1), time.monotonic()
        try:
            stream.sendall(f"time_s,{AXES}\n".encode())
            for sample in range(1, sys.maxsize):
                time.sleep(max(0.0, start + sample / 200 - time.monotonic()))
                time_s = 0.3 + (time.monotonic() - start) * (1 + 80e-6)
                values = [time_s] + [noise.gauss(value, sd) for value, sd in zip(self.load, NOISE)]
                stream.sendall((",".join(f"{value:.6f}" for value in values) + "\n").encode())
        except OSError:
            pass  # The sitting is over.


def hang_what_is_asked(bench, address):
    """Follows the events of the page until it ends."""
    page, token = address.split("/?")
    held, shown, since = 0, None, time.monotonic()
    for line in urlopen(f"{page}/events?{token}"):
        # The last event has no data.
        if not line.startswith(b"data: "):
            continue
        guide = json.loads(line[5:])["guide"]
        if guide["finding"] not in ("", shown):
            shown = guide["finding"]
            print(shown, flush=True)
        if guide["recorded"] > held and guide["errors"]:
            newest = guide["errors"][-1]
            error, upper = newest["error"][0], newest["upper"][0]
            print(f"{newest['loads']} loads: error {error:.3f} N, 95 % {upper:.3f} N", flush=True)
        held = max(held, guide["recorded"])
        if guide["phase"] in ("release", "done"):
            if any(bench.load):
                bench.hang([0.0] * 6)
                since = time.monotonic()
        elif guide["phase"] == "hang" and not any(bench.load) and time.monotonic() - since > REST_S:
            bench.hang(guide["wrench"])


def main():
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    bench = Bench(folder)
    listener = socket.create_server(("127.0.0.1", 0))
    threading.Thread(target=bench.serve_reference, args=(listener,), daemon=True).start()
    reference = f"lines:tcp:127.0.0.1:{listener.getsockname()[1]}"
    calibrate = [PROGRAM, "calibrate", str(folder / "board"), "--start", *RIG, "--reference", reference]
    calibrate += ["--output", str(folder / "shell-1"), "--serve", *sys.argv[2:]]
    try:
        sitting = subprocess.Popen(calibrate, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True)
        line = sitting.stdout.readline()
        print(line, end="", flush=True)
        if line.startswith("live at "):
            hang_what_is_asked(bench, line.removeprefix("live at ").strip())
        print(sitting.stdout.read(), end="")
        return sitting.wait()
    finally:
        bench.board.terminate()


if __name__ == "__main__":
    sys.exit(main())
