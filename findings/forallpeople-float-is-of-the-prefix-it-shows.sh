#!/usr/bin/env bash
# Question: forces with units by forallpeople, handed to numpy or a plot: what is float() of 0.5 N and of 2500 N?
# Good guess: the value in the base unit (0.5 and 2500), or an error because a unit is lost.
# True: the number in front of the prefix that would be shown: 500.0 (mN) and 2.5 (kN). An array of both has 500 and
# 2.5 in it: small forces are the large ones. `.value` is in newtons.
# Package: forallpeople 3.0.0.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check forallpeople==3.0.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import forallpeople as si
import numpy as np

si.environment("default")
forces = [0.5 * si.N, 50 * si.N, 2500 * si.N]
numbers = np.array(forces, dtype=float)
print("forces:      ", *forces, sep="  ")
print("as floats:   ", numbers)
print("their values:", [force.value for force in forces])
assert numbers.tolist() == [500.0, 50.0, 2.5]
assert [force.value for force in forces] == [0.5, 50, 2500]
PYTHON
