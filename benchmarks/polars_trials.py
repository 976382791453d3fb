"""Trials with polars, numpy and SciPy: a single start for all logs, and no loop over samples. This is the computation
of a notebook's pipeline, as fast as these tools allow. For `bench.py trials`; prints the number of rows and the last
log's energy and root mean square of Fz as JSON.

usage: python3 polars_trials.py [--csv FOLDER] MATRIX.mat LOG…
"""

import io
import json
import sys
from pathlib import Path

import numpy as np
import polars as pl
from scipy.io import loadmat
from scipy.signal import butter, lfilter

# The robot's constants: leg encoder, converter, gyroscope and accelerometer of the board.
LEG_RAD = 95.8738e-6
VOLTS, BATTERY, BACK_EMF = 3.3, 3.7 / 2.7, 15.0 / 47.0
MOTOR_OHM, TORQUE = 3.3, 1.41
ACCELERATION, ROTATION = 9.81 / 4096.0, np.pi / 180.0 / 16.384
LOW_PASS = butter(4, 10.0 / 500.0)
TARE_ROWS = 50
AXES = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]


def smooth(columns):
    return lfilter(*LOW_PASS, columns, axis=0)


def running(rates, steps):
    """Integrates rates from the first row on, each over the step that ends at it."""
    return np.concatenate([[0.0], np.cumsum(rates[1:] * steps)])


def read(path):
    """Reads the columns of a log by name; the line before the first row names them."""
    text = Path(path).read_bytes()
    header = [line for line in text[:4096].split(b"\n") if line.startswith(b"%")]
    names = [name.strip() for name in header[-1].decode().lstrip("% ").split("|")]
    rows = text[sum(len(line) + 1 for line in header) :]
    return pl.read_csv(io.BytesIO(rows), has_header=False, new_columns=names)


def evaluate(path, matrix):
    log = {name: column.to_numpy().astype(float) for name, column in read(path).to_dict().items()}
    out = {"time": log["time"] / 1e6}
    for leg in ("Right Leg Pos", "Left Leg Pos"):
        out[leg] = log[leg] * LEG_RAD % (2 * np.pi)
        out["Commanded " + leg] = log["Commanded " + leg] * LEG_RAD
    turning = np.column_stack([log[f"Gyro{axis}"] for axis in "XYZ"]) * ROTATION
    moving = smooth(np.column_stack([log[f"A{axis}"] for axis in "XYZ"]) * ACCELERATION)
    volts = log["VBatt"] * BATTERY * VOLTS / 1023.0
    power = 0.0
    for side in "RL":
        duty = log["DC" + side] / 4096.0
        amperes = (volts - log[side + "BEMF"] * VOLTS / 1024.0 / BACK_EMF) / MOTOR_OHM
        out["Power" + side] = np.abs(duty * volts * amperes)
        out["Torque" + side] = duty * TORQUE * amperes
        out["VMotor" + side] = volts * log["DC" + side]
        power = power + out["Power" + side]
    out["Energy"] = running(power, np.diff(out["time"]))
    out["AngleZ"] = running(turning[:, 2], 1e-3)
    out["A_mag"], out["Gyro_mag"] = (np.linalg.norm(of, axis=1) for of in (moving, turning))
    readings = np.column_stack([log[f"S{channel}"] for channel in range(1, 9)])
    powers = np.stack([readings, readings**2, readings**3], axis=2)
    wrench = powers.reshape(len(readings), -1) @ matrix
    wrench = smooth(wrench - wrench[:TARE_ROWS].mean(axis=0))
    out.update(zip(AXES, wrench.T))
    out["F_mag"], out["M_mag"] = (np.linalg.norm(wrench[:, of], axis=1) for of in (slice(3), slice(3, 6)))
    return pl.DataFrame(out)


def main(arguments):
    folder = None
    if arguments[0] == "--csv":
        folder, arguments = Path(arguments[1]), arguments[2:]
        folder.mkdir(parents=True, exist_ok=True)
    stored = loadmat(arguments[0])
    matrix = stored["N"] if "N" in stored else stored["C"]
    rows = 0
    for path in arguments[1:]:
        trial = evaluate(path, matrix)
        rows += len(trial)
        if folder:
            trial.write_csv(folder / (Path(path).name + ".csv"))
    rms = float(np.sqrt((trial["Fz"] ** 2).mean()))
    print(json.dumps({"rows": rows, "energy": trial["Energy"][-1], "Fz_rms": rms}))


main(sys.argv[1:])
