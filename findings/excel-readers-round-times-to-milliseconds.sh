#!/usr/bin/env bash
# Question: a workbook has a run at 2.5 kHz, its time as elapsed time in Excel's cells ([h]:mm:ss.0000). How far apart are
# the rows that Python's readers return?
# Good guess: 0.4 ms, to a microsecond: a cell holds days as a double, and Python's timedelta has microseconds.
# True: 0 or 1 ms. openpyxl, pandas with either engine and polars round times of cells, dates as well, to whole
# milliseconds, without a warning: of 2500 rows a second 1000 have a time of their own. The cells have all digits.
# Packages: openpyxl 3.1.5, pandas 3.1.1 with python-calamine 0.9.1, polars 2.1.0 with fastexcel 0.21.0.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check openpyxl==3.1.5 pandas==3.1.1 python-calamine==0.9.1 \
    polars==2.1.0 fastexcel==0.21.0
cd "$folder"
venv/bin/python - <<'PYTHON'
import re
import zipfile

import openpyxl
import pandas
import polars

ROWS, PERIOD_S = 2501, 0.0004
workbook = openpyxl.Workbook()
sheet = workbook.active
sheet.append(["t", "date", "fz_n"])
for row in range(ROWS):
    # Days, which is how Excel keeps times.
    days = row * PERIOD_S / 86400
    sheet.append([days, 45000.25 + days, float(row)])
    sheet.cell(row + 2, 1).number_format = "[h]:mm:ss.0000"
    sheet.cell(row + 2, 2).number_format = "yyyy-mm-dd hh:mm:ss.000"
workbook.save("run.xlsx")

cells = zipfile.ZipFile("run.xlsx").read("xl/worksheets/sheet1.xml").decode()
days = [float(of) for of in re.findall(r'<c r="A\d+"[^>]*><v>([^<]*)</v>', cells)][-ROWS:]
assert all(abs(days[row] * 86400 - row * PERIOD_S) < 1e-9 for row in range(ROWS)), "the cells have all digits"

rows = list(openpyxl.load_workbook("run.xlsx").active.iter_rows(min_row=2, values_only=True))
frames = {engine: pandas.read_excel("run.xlsx", engine=engine) for engine in ("openpyxl", "calamine")}
frame = polars.read_excel("run.xlsx")
for column, name in enumerate(("t", "date")):
    found = {"openpyxl": [row[column] for row in rows], "polars": frame[name].to_list()}
    found |= {f"pandas with {engine}": list(of[name]) for engine, of in frames.items()}
    for reader, times in found.items():
        steps = sorted({round((after - before).total_seconds() * 1e3, 6) for before, after in zip(times, times[1:])})
        print(f"{reader}, {name}: {len(set(times))} times in {ROWS} rows, steps of {steps} ms")
        assert len(set(times)) == 1001 and all(step == int(step) for step in steps)
PYTHON
