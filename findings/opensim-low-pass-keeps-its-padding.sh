#!/usr/bin/env bash
# Question: OpenSim's low-pass of a table of forces, TableUtilities.filterLowpass(table, 6, padData=True): which rows has
# the table afterwards?
# Good guess: the same; padding keeps the filter quiet at the ends and is taken off again, as SciPy and MATLAB do.
# True: the padding stays. 1000 rows from 0 s become 2000 from -0.5 s: mirrored forces before the trial began and after it
# ended that nobody measured, and row i is no longer row i of the motion beside it. trim() takes them off.
# Package: opensim 4.6.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check opensim==4.6 numpy==2.4.6
cd "$folder"
venv/bin/python - <<'PYTHON'
import opensim

table = opensim.TimeSeriesTable()
table.setColumnLabels(["fz"])
for row in range(1000):
    table.appendRow(row * 0.001, opensim.RowVector([10.0 if row < 500 else 20.0]))
found = {}
for pad in (False, True):
    copy = opensim.TimeSeriesTable(table)
    opensim.TableUtilities.filterLowpass(copy, 6.0, pad)
    times = copy.getIndependentColumn()
    found[pad] = copy.getNumRows(), times[0], times[-1]
    print(f"padData={pad}: {copy.getNumRows()} rows, {times[0]:g} to {times[-1]:g} s")
copy.trim(0.0, 0.999)
print("trimmed:", copy.getNumRows(), "rows")
assert found[False] == (1000, 0.0, 0.999)
assert found[True][0] == 2000 and abs(found[True][1] + 0.5) < 1e-9
assert copy.getNumRows() == 1000
PYTHON
