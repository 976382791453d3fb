#!/usr/bin/env bash
# Question: RANSAC against bad rows of a calibration of +-50 N with a noise of 0.05 N: is a row that is 10 N off left out?
# Good guess: yes; the default threshold is the median absolute deviation, MAD, of the residuals, some 0.03 N.
# True: it is the MAD of the *targets*: with loads of +-50 N a row counts as good up to 25 N off. All 300 rows are
# inliers, the five bad ones too, and the fit is plain least squares. The wider the calibration, the less is left out.
# A residual_threshold in newtons has to be given.
# Package: scikit-learn 1.9.1.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check scikit-learn==1.9.1 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import numpy as np
from sklearn.linear_model import RANSACRegressor

rng = np.random.default_rng(1)
reading = rng.uniform(-50, 50, (300, 1))
load = reading[:, 0] + rng.normal(0, 0.05, 300)
load[:5] += 10
kept = {}
for threshold in (None, 0.3):
    model = RANSACRegressor(residual_threshold=threshold, random_state=0).fit(reading, load)
    kept[threshold] = model.inlier_mask_.sum(), model.inlier_mask_[:5].sum()
    print(f"residual_threshold={threshold}: {kept[threshold][0]} of 300 rows are inliers, {kept[threshold][1]} of 5 that",
          f"are 10 N off; offset {model.estimator_.intercept_:.4f} N")
print(f"MAD of the loads: {np.median(abs(load - np.median(load))):.1f} N")
assert kept[None] == (300, 5)
assert kept[0.3] == (295, 0)
PYTHON
