"""A fit of arrays beside scikit-learn's on the same features: `python benches/fit.py [ROWS]`.

Prints the median time of five fits, the peak of memory beyond the arrays, each in a process of its own, and the
RMS error of Fz. The second set is the first with a channel that repeats another but for some counts: features
that a solver of normal equations or of a truncated SVD in raw units takes for dependent.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from statistics import median

import numpy as np


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


def measure(which: str, rows: int, near: bool) -> None:
    X, Y = data(rows, near)
    if which == "shellcal":
        import shellcal

        model = shellcal.Calibration("cubic", covariance="none")
        features = X
    else:
        from sklearn.linear_model import LinearRegression

        model = LinearRegression()
        features = X
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    times = []
    for _ in range(5):
        start = time.perf_counter()
        if which != "shellcal":
            # The features are part of a fit: scikit-learn's own PolynomialFeatures takes longer.
            features = np.concatenate([X, X**2, X**3], axis=1)
        model.fit(features, Y)
        times.append(time.perf_counter() - start)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    error = np.sqrt(((model.predict(features) - Y)[:, 2] ** 2).mean())
    print(f"{which:10} {rows:9} {'near' if near else 'plain':6} {median(times) * 1e3:9.0f} ms "
          f"{peak / 1024:7.0f} MB   RMS Fz {error:.5f}")


if __name__ == "__main__":
    if len(sys.argv) == 4:
        measure(sys.argv[1], int(sys.argv[2]), sys.argv[3] == "near")
    else:
        rows = sys.argv[1] if len(sys.argv) > 1 else "1000000"
        for near in ("plain", "near"):
            for which in ("shellcal", "sklearn"):
                subprocess.run([sys.executable, __file__, which, rows, near], check=True)
