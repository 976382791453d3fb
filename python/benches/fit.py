"""A cubic fit of arrays, compared with scikit-learn's on the same features: `python benches/fit.py [ROWS]`.

Each fit is a separate process, after a fit of a few rows that loads the libraries; the kinds take turns, five times.
Prints the median time, the peak of additional memory, and the RMS error of Fz. scikit-learn's features come from
`PolynomialFeatures` for each channel, s, s², s³, computed before the timing ("fit") or within it ("pipeline"), as in
shellcal. In the second set, one channel repeats another except for a few counts: solvers by normal equations or by a
truncated SVD in raw units consider such features dependent.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from statistics import median
from typing import Any

import numpy as np

KINDS = ("shellcal", "scikit-learn fit", "scikit-learn pipeline")
ROUNDS = 5


def data(rows: int, near: bool) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(1)
    X = random.integers(1200, 2800, (rows, 8)).astype(float)
    if near:
        X[:, 1] = X[:, 0] + random.integers(0, 2, rows)
    z = (X - 2000) / 800
    truth = random.normal(size=(16, 6))
    Y = np.hstack([z, z**3]) @ truth
    if near:
        Y += (X[:, :1] - X[:, 1:2]) * 3
    return X, Y + 0.1 * random.normal(size=Y.shape)


def powers() -> Any:
    from sklearn.compose import ColumnTransformer
    from sklearn.preprocessing import PolynomialFeatures

    cubes = PolynomialFeatures(3, include_bias=False)
    return ColumnTransformer([(f"s{channel + 1}", cubes, [channel]) for channel in range(8)])


def measure(kind: str, rows: int, near: bool) -> None:
    X, Y = data(rows, near)
    features = X
    if kind == "shellcal":
        import shellcal

        model: Any = shellcal.Calibration("cubic", covariance="none")
    else:
        from sklearn.linear_model import LinearRegression
        from sklearn.pipeline import make_pipeline

        model = LinearRegression()
        if kind == "scikit-learn fit":
            features = powers().fit_transform(X)
        else:
            model = make_pipeline(powers(), model)
    model.fit(features[:1000], Y[:1000])
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.perf_counter()
    model.fit(features, Y)
    seconds = time.perf_counter() - start
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    error = float(np.sqrt(((model.predict(features) - Y)[:, 2] ** 2).mean()))
    print(json.dumps([seconds, peak / 1024, error]))


def main() -> None:
    rows = sys.argv[1] if len(sys.argv) > 1 else "1000000"
    for near in ("plain", "near"):
        found: dict[str, list[list[float]]] = {kind: [] for kind in KINDS}
        for _ in range(ROUNDS):
            for kind in KINDS:
                command = [sys.executable, __file__, kind, rows, near]
                found[kind].append(json.loads(subprocess.check_output(command)))
        of_ours = median(seconds for seconds, _, _ in found["shellcal"])
        for kind, runs in found.items():
            seconds, peak, error = (median(column) for column in zip(*runs))
            print(f"{kind:22} {rows:>9} {near:6} {seconds * 1e3:7.0f} ms {peak:6.0f} MB   RMS Fz {error:.5f}"
                  f"   {seconds / of_ours:5.1f} times")
    print("load of the machine:", *(f"{load:.1f}" for load in os.getloadavg()))


if __name__ == "__main__":
    if len(sys.argv) == 4:
        measure(sys.argv[1], int(sys.argv[2]), sys.argv[3] == "near")
    else:
        main()
