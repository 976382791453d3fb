#!/usr/bin/env bash
# Question: a log of 1 kHz becomes one of 100 Hz by scipy.signal.decimate. What does a load of 10 N read then?
# Good guess: 10 N. A low-pass against aliasing lets a constant through; with zero_phase=True it is only not delayed.
# True: 9.886 N. The default filter is Chebyshev's of order 8, whose gain at zero frequency is -0.05 dB as at every
# trough of its ripple, and zero phase applies it twice. Every force, at every factor, is 1.14 % too small, as if the
# sensor had lost gain; with zero_phase=False 0.57 %. ftype="fir" keeps 10 N.
# Package: SciPy 1.17.1.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check scipy==1.17.1 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import numpy as np
from scipy.signal import decimate

load = np.full(4000, 10.0)
middle = slice(150, 160)  # away from the ends
found = {
    "default": decimate(load, 10)[middle].mean(),
    "zero_phase=False": decimate(load, 10, zero_phase=False)[middle].mean(),
    'ftype="fir"': decimate(load, 10, ftype="fir")[middle].mean(),
}
for call, newton in found.items():
    print(f"10 N decimated by 10, {call}: {newton:.4f} N")
assert abs(found["default"] - 10 * 10 ** (-0.1 / 20)) < 1e-6
assert abs(found["zero_phase=False"] - 10 * 10 ** (-0.05 / 20)) < 1e-3
assert abs(found['ftype="fir"'] - 10) < 1e-9
PYTHON
