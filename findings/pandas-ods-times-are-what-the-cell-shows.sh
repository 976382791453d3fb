#!/usr/bin/env bash
# Question: the time of a run stands in an OpenDocument spreadsheet as elapsed time (0.01 s a row). Are the values of
# pandas.read_excel(..., engine="odf") those of the cells?
# Good guess: yes, as from .xlsx: the display of a cell is for people, its value (office:time-value) for programs.
# True: of a time the displayed text is parsed as a time of day. Cells that show hh:mm:ss lose the hundredths (three rows at
# one time), cells that show mm:ss.s become hours: 90.5 s shown as 01:30.5 are 5430 s, without a warning. engine="calamine"
# reads the values.
# Package: pandas 3.1.1 with odfpy 1.4.1; python-calamine 0.6.1 beside them.
set -euo pipefail

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --disable-pip-version-check pandas==3.1.1 odfpy==1.4.1 python-calamine==0.6.1
cd "$folder"
venv/bin/python - <<'PYTHON'
import pandas as pd
from odf.opendocument import OpenDocumentSpreadsheet
from odf.table import Table, TableCell, TableRow
from odf.text import P


def read(cells, engine):
    """Reads a column of elapsed times, given as values and as a program for spreadsheets shows them; in seconds."""
    document, table = OpenDocumentSpreadsheet(), Table(name="run")
    names = TableRow()
    names.addElement(TableCell(valuetype="string"))
    names.childNodes[0].addElement(P(text="t"))
    table.addElement(names)
    for value, shown in cells:
        row, cell = TableRow(), TableCell(valuetype="time", timevalue=value)
        cell.addElement(P(text=shown))
        row.addElement(cell)
        table.addElement(row)
    document.spreadsheet.addElement(table)
    document.save("run.ods")
    times = pd.read_excel("run.ods", engine=engine).t
    return [3600 * t.hour + 60 * t.minute + t.second + t.microsecond / 1e6 for t in times]


seconds = [("PT00H00M00.01S", "00:00:00"), ("PT00H00M00.02S", "00:00:00"), ("PT00H01M30.50S", "00:01:31")]
minutes = [("PT00H01M30.50S", "01:30.5")]
for cells, values, wrong in [(seconds, [0.01, 0.02, 90.5], [0, 0, 91]), (minutes, [90.5], [5430])]:
    odf, calamine = read(cells, "odf"), read(cells, "calamine")
    print("shown as", [shown for _, shown in cells], "odf:", odf, "calamine:", calamine)
    assert calamine == values
    assert odf == wrong
PYTHON
