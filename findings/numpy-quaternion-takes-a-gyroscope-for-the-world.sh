#!/usr/bin/env bash
# Question: the orientation of a wrist from the angular velocity that its gyroscope reads, by numpy-quaternion's
# integrate_angular_velocity: which axes does it take the velocity in?
# Good guess: the body's, where a gyroscope reads it, as pyquaternion's integrate does.
# True: the world's. A sensor that lies on its side and turns about its own z axis by 90 degrees ends 90 degrees away
# from where it is, and gravity with it. The velocity has to be turned into the world's axes first: R * omega * R^-1.
# Packages: numpy-quaternion 2024.0.13, pyquaternion 0.9.9.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check numpy-quaternion==2024.0.13 pyquaternion==0.9.9 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import numpy as np
import pyquaternion
import quaternion

half = np.sqrt(0.5)
on_its_side = quaternion.quaternion(half, half, 0, 0)  # turned about x by 90 degrees
about_z = quaternion.quaternion(half, 0, 0, half)
rate = np.array([0, 0, np.pi / 2])  # rad/s, for one second

_, way = quaternion.integrate_angular_velocity(lambda t, r: rate, 0, 1, on_its_side)
other = pyquaternion.Quaternion(*quaternion.as_float_array(on_its_side))
other.integrate(rate, 1.0)
print("about the body's z: ", on_its_side * about_z)
print("about the world's z:", about_z * on_its_side)
print("numpy-quaternion:   ", way[-1])
print("pyquaternion:       ", other)
assert np.isclose(way[-1], about_z * on_its_side, atol=1e-6)
assert np.allclose(other.elements, quaternion.as_float_array(on_its_side * about_z))
angle = np.degrees(2 * np.arccos(abs((way[-1] * (on_its_side * about_z).conjugate()).w)))
print(f"apart by {angle:.0f} degrees")
assert angle > 89
PYTHON
