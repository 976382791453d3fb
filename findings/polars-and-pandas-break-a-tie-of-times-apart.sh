#!/usr/bin/env bash
# Question: readings at 200 Hz get the nearest sample of a reference at 100 Hz, every other one lying half-way: does it
# matter whether pandas or polars joins them?
# Good guess: no; an as-of join by the nearest time is the same table, and a tie goes to the earlier sample, as in both
# the default direction is backward.
# True: pandas takes the earlier sample, polars the later. Half of all rows have another reference, 10 ms apart; the lag
# between the two sensors, found from the joined table, differs by half a sample of the reference.
# Packages: pandas 3.1.1, polars 2.1.0.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pandas==3.1.1 polars==2.1.0
cd "$folder"
venv/bin/python - <<'PYTHON'
import pandas
import polars

reading_ms = list(range(0, 50, 5))
reference_ms = list(range(0, 60, 10))
by_pandas = pandas.merge_asof(
    pandas.DataFrame({"t": reading_ms}), pandas.DataFrame({"t": reference_ms, "of": reference_ms}),
    on="t", direction="nearest")["of"].tolist()
by_polars = polars.DataFrame({"t": reading_ms}).join_asof(
    polars.DataFrame({"t": reference_ms, "of": reference_ms}), on="t", strategy="nearest")["of"].to_list()
print("readings at (ms):  ", reading_ms)
print("reference, pandas: ", by_pandas)
print("reference, polars: ", by_polars)
assert by_pandas == [t // 10 * 10 for t in reading_ms]
assert by_polars == [(t + 5) // 10 * 10 for t in reading_ms]
PYTHON
