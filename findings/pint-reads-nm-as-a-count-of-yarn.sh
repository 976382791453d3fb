#!/usr/bin/env bash
# Question: the torque columns of a log have the unit "Nm"; what does pint make of 5 Nm?
# Good guess: 5 N m, or an UndefinedUnitError, since a product needs a space, a dot or a star.
# True: "Nm" is pint's number_metric, the count of a yarn (1 Nm = 1000 m/kg), and mNm is a thousandth of it. Readings
# keep their unit through every scaling and averaging, and 2 Nm + 3 Nm are 5 Nm; only a conversion to another unit of
# torque fails, with m/kg in its message.
# Package: pint 0.25.3.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pint==0.25.3
cd "$folder"
venv/bin/python - <<'PYTHON'
import pint

units = pint.UnitRegistry()
torque = units.Quantity("2 Nm") + units.Quantity("3 Nm")
print(f'"2 Nm" + "3 Nm" = {torque} = {torque.to_base_units()}')
print(f'"5 mNm" = {units.Quantity("5 mNm").to_base_units()}')
print(f'"5 N m" = {units.Quantity("5 N m").to_base_units()}')
try:
    torque.to("N m")
    raised = None
except pint.DimensionalityError as error:
    raised = error
print(f"converted to N m: {raised}")
assert torque.to_base_units().magnitude == 5000 and torque.check("[length]/[mass]")
assert raised is not None
assert units.Quantity("5 N m").check("[energy]")
PYTHON
