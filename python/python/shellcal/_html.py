"""Display of results in a notebook."""

from __future__ import annotations

from base64 import b64encode
from html import escape
from typing import Any

_AXES = (("Fx", "N"), ("Fy", "N"), ("Fz", "N"), ("Mx", "N·m"), ("My", "N·m"), ("Mz", "N·m"))


def escaped(text: str) -> str:
    return f"<code>{escape(text)}</code>"


def calibration(name: str, document: dict[str, Any], figure: str | None = None) -> str:
    """Returns the table of errors, and the figure, an SVG document, if there is one."""
    diagnostics = document.get("diagnostics")
    if diagnostics is None:
        return f"<p>Calibration <b>{escape(name)}</b></p>"
    columns: list[tuple[str, list[Any]]] = []
    train = diagnostics["train"]
    columns.append(("RMS", [axis["rms"] for axis in train]))
    columns.append(("max", [axis["max"] for axis in train]))
    columns.append(("R²", [axis["r_squared"] for axis in train]))
    held_out = diagnostics.get("cross_validation")
    if held_out:
        columns.append(("RMS new groups", [axis["rms"] for axis in held_out["grouped"]]))
        if held_out["random"]:
            columns.append(("RMS random split", [axis["rms"] for axis in held_out["random"]]))
    head = "".join(f"<th>{escape(title)}</th>" for title, _ in columns)
    rows = "".join(
        f"<tr><th>{axis}</th>"
        + "".join(f"<td>{_figure(values[place])}</td>" for _, values in columns)
        + f"<td>{unit}</td></tr>"
        for place, (axis, unit) in enumerate(_AXES)
    )
    # As an image, so that the ids in the SVG document do not become part of the page.
    picture = (
        ""
        if figure is None
        else '<img alt="predicted against measured wrench, and what is left over" src="data:image/svg+xml;base64,'
        f'{b64encode(figure.encode()).decode()}">'
    )
    return (
        f"<p>Calibration <b>{escape(name)}</b>: {diagnostics['rows']} rows, rank "
        f"{diagnostics['rank']}</p><table><tr><th></th>{head}<th></th></tr>{rows}</table>{picture}"
    )


def _figure(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"
