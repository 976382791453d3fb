"""Builds the wheel with maturin, after building the program and copying it to maturin's folder of scripts.

Maturin packs an extension or a program into a wheel, not both. Ruff and uv are programs only; this package needs both,
in the same version. So the program is a file among the `scripts` of the wheel's data, which pip puts on the path.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path
from typing import Any

import maturin

PACKAGE = Path(__file__).resolve().parent.parent
SCRIPTS = PACKAGE / "wheel-data" / "scripts"


def _build_program() -> None:
    name = "shellcal.exe" if os.name == "nt" else "shellcal"
    cargo = os.environ.get("CARGO", "cargo")
    build = [cargo, "build", "--release", "--package", "shellcal", "--bin", "shellcal"]
    subprocess.run(build, cwd=PACKAGE.parent, check=True)
    target = Path(os.environ.get("CARGO_TARGET_DIR", PACKAGE.parent / "target"))
    SCRIPTS.mkdir(parents=True, exist_ok=True)
    shutil.copy2(PACKAGE.parent / target / "release" / name, SCRIPTS / name)


def build_wheel(directory: str, settings: Any = None, metadata: str | None = None) -> str:
    _build_program()
    return str(maturin.build_wheel(directory, settings, metadata))


def build_editable(directory: str, settings: Any = None, metadata: str | None = None) -> str:
    _build_program()
    return str(maturin.build_editable(directory, settings, metadata))


def prepare_metadata_for_build_wheel(directory: str, settings: Any = None) -> str:
    SCRIPTS.mkdir(parents=True, exist_ok=True)
    return str(maturin.prepare_metadata_for_build_wheel(directory, settings))


prepare_metadata_for_build_editable = prepare_metadata_for_build_wheel
get_requires_for_build_wheel = maturin.get_requires_for_build_wheel
get_requires_for_build_editable = maturin.get_requires_for_build_editable
