"""Whatever a text is, it stays text: in Python, HTML, SVG, CSV, JSON and the terminal, by the parser of each."""

from __future__ import annotations

import ast
import csv
import io
import json
import random
import subprocess
import sys
import unicodedata
import xml.etree.ElementTree as xml
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import program

import shellcal

#: Seeds of the drawn texts.
CASES = 60

PIECES = [
    *["\n", "\r", "\t", "\0", "\x1b[31m", "\x7f", "\x9b1m", "\u2028", "\u2029", "\u202e", "\u200b", "\ufeff"],
    *['"', "'", '"""', "'''", "\\", "\\u", "\\N{BELL}", "\\x", "%{", "%}", "...", "{}", "$(id)", "`id`", "#", ";"],
    *["</script>", "<!--", "]]>", "&amp;", "<blink>", "&", "a,b", "a|b", "=1+1", "x" * 300, "µ", "\U000e0041", "😀"],
    *['\nprint("OWNED")\n', '"""\nimport os\nos._exit(7)\n"""', "\nsystem('false')\n%", "\uffff", " ", "a"],
]


def texts() -> list[str]:
    drawn = []
    for seed in range(CASES):
        draw = random.Random(seed)
        drawn.append("".join(draw.choice(PIECES) for _ in range(draw.randrange(1, 8))))
    return drawn


def invisible(text: str) -> bool:
    return any(unicodedata.category(c) in {"Cc", "Cf", "Zl", "Zp"} for c in text if c != "\n")


@pytest.fixture(scope="module")
def calibration(logs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    path = tmp_path_factory.mktemp("escapes") / "calibration.json"
    program("fit", logs[0], "--model", "linear", "--test", logs[2], "-o", path, "-q")
    document: dict[str, Any] = json.loads(path.read_text())
    return document


@pytest.mark.parametrize("text", texts())
def test_a_calibration_of_any_text_exports_code_that_does_nothing_else(
    text: str, calibration: dict[str, Any], logs: list[Path], tmp_path: Path
) -> None:
    path, code, matlab = (tmp_path / name for name in ("calibration.json", "wrench.py", "wrench.m"))
    document = calibration | {"made_by": text, "date": text, "sensor_serial": text}
    path.write_text(json.dumps(document))
    program("export", path, code, "--edited", "-q")
    module = ast.parse(code.read_bytes())
    docstring = ast.get_docstring(module, clean=False)
    assert docstring is not None and text in docstring.replace("\\`", "`")
    # Imports numpy, assigns constants, defines a function: nothing else is run.
    kinds = {type(statement) for statement in module.body[1:]}
    assert kinds <= {ast.Import, ast.Assign, ast.FunctionDef}, kinds
    ran = subprocess.run([sys.executable, code], capture_output=True, text=True, check=True)
    assert (ran.stdout, ran.stderr) == ("", "")
    # Its comments are those of the calibration without text.
    program("export", path, matlab, "--edited", "-q")
    exported = matlab.read_text()
    assert not invisible(exported)
    lines = exported.split("\n")
    assert lines[0].startswith("function w = ") and lines[1].startswith("%")
    assert all(line.startswith("%") or line == "" for line in lines[1:6]), lines[:7]


class Content(HTMLParser):
    """What a browser shows, and which elements there are."""

    def __init__(self, document: str) -> None:
        super().__init__()
        self.text, self.tags = "", set[str]()
        self.feed(document)

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.tags.add(tag)

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.parametrize("text", texts()[:24])
def test_a_log_of_any_name_is_named_in_every_output(text: str, logs: list[Path], tmp_path: Path) -> None:
    name = "".join(c for c in text if c not in "/\0")[:60].strip() or "a"
    if name.startswith("-"):
        name = "a" + name
    log, report, figure = tmp_path / (name + ".csv"), tmp_path / "report.html", tmp_path / "figure.svg"
    log.write_text(logs[0].read_text())
    arguments = ["fit", log.name, "--model", "linear", "--serial", name]
    line = [shellcal.program(), *arguments, "--report", report, "-o", tmp_path / "c.json", "--plot", figure]
    done = subprocess.run([*map(str, line), "--json"], capture_output=True, cwd=tmp_path, check=True)
    for stream in (done.stdout.decode(), done.stderr.decode()):
        assert not invisible(stream), stream
    json.loads(done.stdout)
    assert json.loads((tmp_path / "c.json").read_text())["sources"][0]["path"] == log.name
    assert json.loads((tmp_path / "c.json").read_text())["sensor_serial"] == name
    content = Content(report.read_text())
    assert "blink" not in content.tags and {"table", "svg"} <= content.tags
    xml.fromstring(figure.read_text())
    # As CSV, by a reader of CSV.
    line = [shellcal.program(), "eval", "c.json", log.name, "--plot", figure.name, "--as", "csv"]
    done = subprocess.run(line, capture_output=True, cwd=tmp_path, check=True)
    assert not invisible(done.stdout.decode() + done.stderr.decode())
    assert len({len(row) for row in csv.reader(io.StringIO(done.stdout.decode()))}) == 1
    xml.fromstring(figure.read_text())


# What is drawn has no levers that a shell could have.
@pytest.mark.filterwarnings("ignore:moments / forces")
@pytest.mark.parametrize("seed", range(12))
def test_exported_code_is_what_convert_writes(seed: int, tmp_path: Path) -> None:
    """Models, channels and units drawn from the seed."""
    draw = np.random.default_rng(seed)
    channels, rows = int(draw.integers(1, 9)), int(draw.integers(200, 400))
    model = str(draw.choice(["linear", "quadratic", "cubic"]))
    X = draw.integers(0, 4096, (rows, channels)).astype(float)
    truth = draw.normal(size=(channels, 6)) * 10.0 ** draw.integers(-4, 2)
    Y = X @ truth + draw.normal(size=(rows, 6))
    calibration, code, log = (tmp_path / name for name in ("c.json", "drawn.py", "log.csv"))
    shellcal.Calibration(model, intercept=bool(draw.integers(2))).fit(X, Y).save(calibration)
    names = ",".join(f"s{i + 1}" for i in range(channels))
    np.savetxt(log, X, fmt="%d", delimiter=",", header=names, comments="")
    untouched = ["--no-tare", "--no-lowpass", "--all-rows"]
    program("convert", calibration, log, *untouched, "-o", tmp_path / "out.csv", "-q")
    program("export", calibration, code, "-q")
    out = np.genfromtxt(tmp_path / "out.csv", delimiter=",", names=True)
    expected = np.column_stack([out[name] for name in ("fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm")])
    script = f"import sys; sys.path.insert(0, ''); import numpy as np, drawn; np.save('w.npy', drawn.wrench(np.loadtxt({str(log)!r}, delimiter=',', skiprows=1, ndmin=2)))"
    subprocess.run([sys.executable, "-c", script], cwd=tmp_path, check=True)
    found = np.load(tmp_path / "w.npy")
    # Sums of up to 45 products, each rounded, relative to the largest.
    assert np.abs(found - expected).max() <= 1e-12 * max(1.0, np.abs(expected).max())
