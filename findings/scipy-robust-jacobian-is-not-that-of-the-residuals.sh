#!/usr/bin/env bash
# Question: a robust calibration by scipy.optimize.least_squares(loss="soft_l1"): result.jac gives leverages or standard
# errors of the rows. Is it the Jacobian of the residuals?
# Good guess: yes, d residual / d parameter at the solution, as result.fun is the residuals there; the loss comes on top.
# True: fun is, jac is not: its rows are scaled by the loss (so that J'J is the Gauss-Newton matrix of the cost). The row
# of a reading that is 20 N off has nearly vanished from it, and ordinary rows are scaled, too: leverages and standard
# errors mix weighted rows with unweighted residuals.
# Package: SciPy 1.17.1.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check scipy==1.17.1 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import numpy as np
from scipy.optimize import least_squares

count = np.linspace(0, 10, 40)
force = 2 * count + 1 + np.random.default_rng(1).normal(0, 0.3, 40)
force[20] += 20
jacobian = np.stack([count, np.ones(40)], axis=1) / 0.3


def residuals(parameters):
    return (parameters[0] * count + parameters[1] - force) / 0.3


for loss in ("linear", "soft_l1"):
    result = least_squares(residuals, [1, 0], loss=loss, jac=lambda _: jacobian)
    share = result.jac[:, 1] / jacobian[:, 1]
    errors = np.sqrt(np.diag(np.linalg.inv(result.jac.T @ result.jac)))
    print(f"{loss}: fun is the residuals: {np.allclose(result.fun, residuals(result.x))}; result.jac is the Jacobian times",
          f"{share.min():.3f} to {share.max():.3f}, {share[20]:.3f} at the bad row; standard errors {errors.round(4)}")
    assert np.allclose(result.fun, residuals(result.x))
    assert (loss == "linear") == np.allclose(share, 1)
assert share[20] < 0.01 and np.median(share) < 0.95
PYTHON
