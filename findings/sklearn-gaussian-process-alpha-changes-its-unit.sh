#!/usr/bin/env bash
# Question: a Gaussian process for what a calibration leaves over; readings have a noise of 0.5 N, so alpha = 0.25 N2.
# Does that hold with normalize_y=True?
# Good guess: alpha is "the variance of Gaussian measurement noise on the training observations", so in the unit of the
# observations, whatever is normalised within.
# True: with normalize_y=True it is added after the targets have been divided by their standard deviation. Here, with
# loads of +-20 N, 0.5 stands for 7 N of noise: the same alpha smooths the curve until it is wrong by 2 N, and the
# standard deviations that it states are twelve times as large.
# Package: scikit-learn 1.9.1.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check scikit-learn==1.9.1 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import numpy as np
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

noise = 0.5
x = np.linspace(0, 1, 60)[:, None]
truth = 20 * np.sin(6 * x[:, 0])
force = truth + np.random.default_rng(1).normal(0, noise, len(x))


def fit(alpha, normalize_y):
    scale = force.std() if normalize_y else 1.0
    kernel = ConstantKernel((20 / scale) ** 2, "fixed") * RBF(0.3, "fixed")
    model = GaussianProcessRegressor(kernel, alpha=alpha, normalize_y=normalize_y, optimizer=None).fit(x, force)
    mean, deviation = model.predict(x, return_std=True)
    return abs(mean - truth).max(), deviation[30]


plain = fit(noise**2, False)
normalised = fit(noise**2, True)
by_variance = fit(noise**2 / force.var(), True)
for what, (error, deviation) in (("normalize_y=False, alpha=0.25", plain), ("normalize_y=True, alpha=0.25", normalised),
                                 ("normalize_y=True, alpha=0.25/var(y)", by_variance)):
    print(f"{what}: wrong by up to {error:.2f} N, stated standard deviation {deviation:.2f} N")
assert normalised[1] > 10 * plain[1] and normalised[0] > 3 * plain[0]
assert abs(by_variance[1] - plain[1]) < 0.01 * plain[1]
PYTHON
