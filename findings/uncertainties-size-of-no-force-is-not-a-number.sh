#!/usr/bin/env bash
# Question: the size of the force of an unloaded sensor, hypot(fx, fy) of two components of (0.00 +/- 0.02) N, with the
# package uncertainties. How sure is it?
# Good guess: 0 +/- 0.02 N, as for any direction in which the force could point, or an error because the derivative is not
# defined there.
# True: 0 +/- nan, without an error or a warning from the package. sqrt(fx**2 + fy**2) is the same; 1e-9 N beside it gives
# 0.02. Every sum or mean that holds one such row is "+/- nan", and comparisons with a limit are false.
# Package: uncertainties 3.2.3.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check uncertainties==3.2.3
cd "$folder"
venv/bin/python -W error - <<'PYTHON'
from math import isnan

from uncertainties import ufloat
from uncertainties.umath import hypot, sqrt

at_rest, loaded = ufloat(0.0, 0.02), ufloat(3.0, 0.02)
sizes = [hypot(at_rest, ufloat(0.0, 0.02)), sqrt(at_rest**2 + ufloat(0.0, 0.02) ** 2)]
beside = hypot(ufloat(1e-9, 0.02), ufloat(0.0, 0.02))
mean = (sizes[0] + hypot(loaded, ufloat(4.0, 0.02))) / 2
print(sizes, beside, mean)
assert all(size.nominal_value == 0 and isnan(size.std_dev) for size in sizes)
assert abs(beside.std_dev - 0.02) < 1e-9
assert mean.nominal_value == 2.5 and isnan(mean.std_dev)
assert not mean.std_dev < 0.1
PYTHON
