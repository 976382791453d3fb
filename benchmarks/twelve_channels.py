#!/usr/bin/env python3
"""A fit with scikit-learn of all products up to the third degree of twelve channels in double precision, 455 features.

usage: twelve_channels.py make FILE [ROWS]   a log of a smooth motion
       twelve_channels.py fit FILE           RMS errors of the fit, as JSON
"""

import json
import sys

import numpy as np

WRENCH = ["fx", "fy", "fz", "mx", "my", "mz"]
SENSORS = [f"s{channel}" for channel in range(12)]


def make(path: str, rows: int) -> None:
    random = np.random.default_rng(1)
    time = np.arange(rows)[:, None]
    speed, phase = random.uniform(0.003, 0.03, (3, 6)), random.uniform(0, 6, (3, 6))
    wrench = sum(np.sin(time * w + p) for w, p in zip(speed, phase)) * [4, 4, 6, 0.1, 0.1, 0.06]
    travel = (wrench / [4, 4, 6, 0.1, 0.1, 0.06]) @ random.normal(size=(6, 12))
    readings = 300 * travel + 20 * travel**2 - travel**3 + random.normal(size=travel.shape)
    # Subtracts the means of the recording, as is common.
    columns = np.hstack([wrench, readings - readings.mean(axis=0)])
    np.savetxt(path, columns, delimiter=",", header=",".join(WRENCH + SENSORS), comments="", fmt="%.17g")


def fit(path: str) -> None:
    import pandas
    from sklearn.linear_model import LinearRegression
    from sklearn.preprocessing import PolynomialFeatures, StandardScaler

    table = pandas.read_csv(path)
    wrench = table[WRENCH].to_numpy()
    # Without the scaler, the powers of raw readings reduce LinearRegression's rank to a fraction.
    features = PolynomialFeatures(3, include_bias=False).fit_transform(StandardScaler().fit_transform(table[SENSORS].to_numpy()))
    model = LinearRegression().fit(features, wrench)
    print(json.dumps({"rms": np.sqrt(((model.predict(features) - wrench) ** 2).mean(axis=0)).tolist(), "rank": int(model.rank_)}))


match sys.argv[1:]:
    case ["make", path, *rows]:
        make(path, int(*rows or [19_069]))
    case ["fit", path]:
        fit(path)
    case _:
        sys.exit(__doc__)
