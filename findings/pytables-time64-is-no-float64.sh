#!/usr/bin/env bash
# Question: a PyTables table for a log, with the column type that is made for times, Time64Col: what becomes of stamps?
# Good guess: Time64 is a float64 of seconds with another name, "a 64-bit time value": the same bits come back, and every
# reader of HDF5 sees a float64.
# True: stamps are cut to whole microseconds on the way (a stamp of 250 ns becomes 0), as seconds and microseconds of
# 32 bits each; and the column has HDF5's time type, which h5py cannot read: the whole table, forces and all, is refused
# with "No NumPy equivalent for TypeTimeID". A Float64Col keeps bits and readers.
# Packages: PyTables 3.11.1, h5py 3.16.0.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check tables==3.11.1 h5py==3.16.0 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import h5py
import tables


class Row(tables.IsDescription):
    t = tables.Time64Col()
    t_float = tables.Float64Col()
    fz = tables.Float64Col()


stamps = [2.5e-7, 0.1234567891]
with tables.open_file("log.h5", "w") as file:
    table = file.create_table("/", "log", Row)
    for stamp in stamps:
        table.row["t"] = table.row["t_float"] = stamp
        table.row["fz"] = 9.81
        table.row.append()
with tables.open_file("log.h5") as file:
    rows = file.root.log[:]
print("given:     ", stamps)
print("Time64Col: ", rows["t"].tolist())
print("Float64Col:", rows["t_float"].tolist())
try:
    h5py.File("log.h5")["log"][:]
    refused = ""
except TypeError as error:
    refused = str(error)
print("h5py:", refused)
assert rows["t_float"].tolist() == stamps
assert rows["t"].tolist() != stamps and max(abs(rows["t"] - stamps)) < 1e-6 and rows["t"][0] == 0
assert "TypeTimeID" in refused
PYTHON
