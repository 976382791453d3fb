#!/usr/bin/env bash
# Question: counts of a 16-bit converter in a netCDF file, as int16 without any _FillValue: do all of them come back?
# Good guess: all 65536; only a value that an attribute (_FillValue, missing_value, valid_range) names is masked.
# True: -32767 is masked, netCDF's default fill value of int16, although no attribute says so: a reading near full scale
# is left out of every mean, while -32768, at full scale, stays. xarray, on the same file, keeps both.
# Packages: netCDF4 1.7.5.1.post1, xarray 2026.9.0.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check netCDF4==1.7.5.1.post1 xarray==2026.9.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import netCDF4
import numpy as np
import xarray

counts = np.array([-32768, -32767, -32766, 5], "i2")
with netCDF4.Dataset("log.nc", "w") as file:
    file.createDimension("row", len(counts))
    file.createVariable("fz", "i2", ("row",))[:] = counts
with netCDF4.Dataset("log.nc") as file:
    read = file["fz"][:]
    print("attributes:", file["fz"].ncattrs())
    assert file["fz"].ncattrs() == []
other = xarray.open_dataset("log.nc")["fz"].values
print("written:", counts, "mean", counts.mean())
print("netCDF4:", read, "mean", read.mean())
print("xarray: ", other, "mean", other.mean())
assert np.ma.getmaskarray(read).tolist() == [False, True, False, False]
assert other.tolist() == counts.tolist()
PYTHON
