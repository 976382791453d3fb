#!/usr/bin/env bash
# Question: Pinocchio's ten parameters of a payload, Inertia.toDynamicParameters(), the unknowns of its regressors: in which
# order are the moments of inertia, and about which point?
# Good guess: m, the first moments, then Ixx Ixy Ixz Iyy Iyz Izz as URDF and SDF list them, about the centre of mass.
# True: Ixx, Ixy, Iyy, Ixz, Iyz, Izz (column by column of the upper triangle), about the frame's origin. Read in the other
# order, an Iyy of 0.70 kg m2 becomes -0.04, which no body can have.
# Package: pin 4.1.0.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pin==4.1.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import numpy as np
import pinocchio as pin

mass, centre = 2.0, np.array([0.1, 0.2, 0.3])
about_centre = np.array([[0.40, 0.01, 0.02], [0.01, 0.50, 0.03], [0.02, 0.03, 0.60]])
found = pin.Inertia(mass, centre, about_centre).toDynamicParameters()
about_origin = about_centre + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
print("found    ", found.round(4))
print("of centre", about_centre[np.triu_indices(3)])
print("of origin", about_origin[np.triu_indices(3)].round(4))
assert np.allclose(found[:4], [mass, *(mass * centre)])
# Ixx, Ixy, Iyy, Ixz, Iyz, Izz.
assert np.allclose(found[4:], about_origin.T[np.tril_indices(3)])
assert not np.allclose(found[4:], about_origin[np.triu_indices(3)])
PYTHON
