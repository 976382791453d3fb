#!/usr/bin/env python3
"""Tests a board through its serial port: `python3 firmware/hil/run.py PORT clock noise`. See docs/hil.md.

Every test records with `shellcal` (the variable SHELLCAL gives its path) and examines the log. The exit code is 1
if a test fails. The port may be that of a real board, of `cargo xtask emulate`, or of `shellcal board --simulate`.
"""

import argparse
import csv
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time

SHELLCAL = os.environ.get("SHELLCAL", "shellcal")
READINGS = [f"s{channel}" for channel in range(1, 9)]


class Board:
    def __init__(self, port, framing):
        self.port, self.framing = port, framing
        self.folder = tempfile.TemporaryDirectory()

    def ask(self, *words):
        command = [SHELLCAL, "--json", "board", self.port, "--framing", self.framing, *words]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode == 2:
            raise SystemExit(done.stderr)
        return json.loads(done.stdout or "{}")

    def record(self, seconds, *words):
        """The summary and the rows of a recording."""
        log = os.path.join(self.folder.name, "log.csv")
        command = [SHELLCAL, "--json", "record", self.port, "--framing", self.framing, "--start", "--overwrite",
                   "--duration", str(seconds), "--output", log, *words]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(done.stderr)
        with open(log, newline="") as file:
            return json.loads(done.stdout), list(csv.DictReader(file))


def columns(rows):
    return [[float(row[name]) for row in rows] for name in READINGS]


def emitters(board, _args):
    faults = board.ask("self-test").get("faults", [])
    return not faults, "; ".join(faults) or "each raises its own channel and no other"


def clock(board, args):
    """Compares the board's clock with this computer's, over a long recording."""
    summary, rows = board.record(args.seconds)
    rate = summary["board_time_s"] / (len(rows) - 1)
    off = summary["board_time_s"] / summary["elapsed_s"] - 1
    temperatures = [float(row["temperature_c"]) for row in rows if row["temperature_c"]]
    warmth = f"{min(temperatures):.1f} to {max(temperatures):.1f} °C" if temperatures else "no temperature"
    # HSI16 is off by up to 1 %; starting and ending a recording takes some tenths of a second.
    return abs(off) < 0.01 + 0.5 / args.seconds, f"{off * 100:+.2f} %, {warmth}, a frame in {rate * 1e3:.4f} ms"


def noise(board, args):
    """Noise of the readings of an untouched shell, without slow changes."""
    _, rows = board.record(args.seconds)
    differences = [[b - a for a, b in zip(column, column[1:])] for column in columns(rows)]
    noises = [statistics.pstdev(steps) / math.sqrt(2) for steps in differences]
    return max(noises) < 4.0, "steps: " + " ".join(f"{value:.2f}" for value in noises)


def flicker(board, args):
    """Range of the readings of an untouched shell under the room's lamps."""
    _, rows = board.record(args.seconds)
    ranges = [max(column) - min(column) for column in columns(rows)]
    dark = [float(row["dark1"]) for row in rows if row["dark1"]]
    return max(ranges) < 12.0, f"range {max(ranges):.1f} steps; dark {min(dark):.0f} to {max(dark):.0f}"


def losses(board, args):
    """Losses in a long recording over the radio."""
    summary, _ = board.record(args.seconds)
    kinds = ["missing", "bad_crc", "damaged", "dropped_on_board", "restarts", "uncertain"]
    counts = {kind: summary.get(kind, 0) for kind in kinds}
    share = counts["missing"] / max(summary["frames"], 1)
    return share < 1e-3 and not counts["restarts"], str(counts)


def settling(board, _args):
    """Readings by settling time: the shortest time from which on they stay constant is enough."""
    words, means = [], []
    for us in (400, 200, 150, 100, 70, 50, 30):
        board.ask("sampling", "--settling", str(us))
        _, rows = board.record(3)
        means.append(statistics.fmean(sum(columns(rows), [])))
        words.append(f"{us} µs {means[-1] / means[0] * 100:.2f} %")
    board.ask("sampling", "--settling", "100")
    return means[3] > 0.9 * means[0], ", ".join(words)


def cuts(board, args):
    """Power cuts at random moments of uploads, by a command that switches the supply off and on."""
    calibrations = [board.ask("status").get("calibration")]
    for number in range(args.cuts):
        upload = subprocess.Popen([SHELLCAL, "board", board.port, "upload", args.calibration],
                                  stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(number * 0.618034 % 1 * args.upload_seconds)
        subprocess.run(args.power_cycle, shell=True, check=True)
        upload.kill()
        upload.wait()
        time.sleep(0.5)
        calibrations.append(board.ask("status").get("calibration"))
    lost = sum(calibration in (None, "") for calibration in calibrations)
    return lost == 0, f"{lost} of {args.cuts} cuts left no calibration"


TESTS = {test.__name__: test for test in (emitters, clock, noise, flicker, losses, settling, cuts)}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("port")
    parser.add_argument("tests", nargs="+", choices=TESTS)
    parser.add_argument("--framing", default="cobs")
    parser.add_argument("--seconds", type=float, default=20.0, help="length of a recording")
    parser.add_argument("--cuts", type=int, default=1000)
    parser.add_argument("--calibration", help="for `cuts`; upload it once before")
    parser.add_argument("--power-cycle", help="for `cuts`: command that switches the supply off and on")
    parser.add_argument("--upload-seconds", type=float, default=2.0)
    args = parser.parse_args()
    if "cuts" in args.tests and not (args.calibration and args.power_cycle):
        parser.error("`cuts` needs --calibration and --power-cycle")
    board = Board(args.port, args.framing)
    failed = False
    for name in args.tests:
        passed, words = TESTS[name](board, args)
        failed |= not passed
        print(f"{'ok    ' if passed else 'FAILED'} {name}: {words}", flush=True)
    sys.exit(int(failed))


if __name__ == "__main__":
    main()
