"""Python's results have the same bits as the program's."""

from __future__ import annotations

import json
import subprocess
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import fitted, program

import shellcal
from shellcal import Calibration


def of(calibration: Calibration) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(calibration.to_json())
    return document


@pytest.mark.parametrize("model", ["linear", "cubic", "quadratic", "poly3"])
def test_coefficients_and_standard_errors(
    logs: list[Path], table: shellcal.Table, tmp_path: Path, model: str
) -> None:
    expected = fitted(tmp_path, logs[1], "--model", model, "--covariance", "rows")
    found = of(Calibration(model, covariance="rows").fit(table.X, table.Y))
    for field in ("model", "terms", "scaling", "coefficients", "valid_range", "solver"):
        assert found[field] == expected[field], field
    for field in ("residual", "degrees_of_freedom", "coefficients"):
        assert found["covariance"][field] == expected["covariance"][field], field
    for field in ("rows", "rank", "condition"):
        assert found["diagnostics"][field] == expected["diagnostics"][field], field
    for axis in range(6):
        ours, theirs = (of["diagnostics"]["train"][axis] for of in (found, expected))
        assert ours["max"] == theirs["max"]
        # Sums of squares of 1700 numbers, added up in different blocks.
        assert ours["rms"] == pytest.approx(theirs["rms"], rel=1e-12)


@pytest.mark.parametrize("folds", [None, 10])
def test_held_out_errors_and_covariance_by_group(
    logs: list[Path], table: shellcal.Table, tmp_path: Path, folds: int | None
) -> None:
    cv = "--cv" if folds is None else f"--cv={folds}"
    expected = fitted(tmp_path, logs[1], cv, "--covariance", "groups")
    calibration = Calibration("cubic", cv=folds or True, covariance="groups")
    found = of(calibration.fit(table.X, table.Y, groups=table.groups))
    ours, theirs = (of["diagnostics"]["cross_validation"] for of in (found, expected))
    for field in ("groups", "folds", "rows", "undetermined", "grouped", "random_folds", "random"):
        assert ours[field] == theirs[field], field
    for field in ("residual", "coefficients"):
        assert found["covariance"][field] == expected["covariance"][field], field
    alone = shellcal.cross_validate(table.X, table.Y, table.groups, folds=folds)
    assert alone["grouped"] == theirs["grouped"]


def test_the_choice_of_a_model(logs: list[Path], table: shellcal.Table, tmp_path: Path) -> None:
    partial, merged = tmp_path / "sums.json", tmp_path / "merged.json"
    program("fit", logs[1], "--model", "auto", "--groups", "--partial", partial)
    program("merge", partial, "--model", "auto", "-o", merged)
    expected = json.loads(merged.read_text())["diagnostics"]["selection"]
    with np.errstate(all="raise"):
        found = shellcal.choose_model(table.X, table.Y, table.groups, covariance="none")
    assert found.diagnostics_["selection"] == expected


@pytest.mark.parametrize("folds", [None, 5])
def test_the_physics_model(
    logs: list[Path], table: shellcal.Table, tmp_path: Path, folds: int | None
) -> None:
    arguments = [] if folds is None else [f"--cv={folds}"]
    expected = fitted(tmp_path, logs[1], "--model", "physics", *arguments)
    calibration = Calibration("physics", cv=folds or False)
    found = of(calibration.fit(table.X, table.Y, groups=table.groups))
    for field in ("model", "axes", "physics", "intervals", "valid_range", "schema_version"):
        assert found[field] == expected[field], field
    for field in ("rows", "rank", "cross_validation"):
        assert found["diagnostics"].get(field) == expected["diagnostics"].get(field), field
    for axis in range(6):
        ours, theirs = (of["diagnostics"]["train"][axis] for of in (found, expected))
        assert ours["max"] == theirs["max"]
        # Sums of squares of 1700 numbers, added up in different blocks.
        assert ours["rms"] == pytest.approx(theirs["rms"], rel=1e-12)
    whole = Calibration.load(tmp_path / "fitted.json")
    X = shellcal.read_log(logs[0]).X
    pairs = zip(*(one.predict(X, return_std=True, interval=0.9) for one in (calibration, whole)))
    for ours, theirs in pairs:
        assert np.isfinite(ours).all() and (ours == theirs).all()
    with pytest.raises(AttributeError, match="physics model has no coefficients"):
        calibration.coefficients_


def test_rows_of_physics_without_groups_are_held_out_in_stretches(table: shellcal.Table) -> None:
    verdict = Calibration("physics", cv=4).fit(table.X, table.Y).verdict_
    assert any("judged by 40 blocks of time, held out in 4 folds" in line for line in verdict)


@pytest.mark.parametrize(
    "options",
    [
        {"model": "cubic", "covariance": "groups", "cv": 5},
        {"model": "linear", "solver": "tsqr", "covariance": "rows"},
        {"model": "auto"},
        {"model": "physics"},
    ],
)
def test_whole_weights_are_repeated_rows(table: shellcal.Table, options: dict[str, Any]) -> None:
    weights = np.random.default_rng(3).integers(0, 4, table.rows)
    X, Y, groups = (np.repeat(array, weights, axis=0) for array in (table.X, table.Y, table.groups))
    expected = of(Calibration(**options).fit(X, Y, groups=groups))
    found = of(Calibration(**options).fit(table.X, table.Y, weights, groups=table.groups))
    # The description of the arrays differs; all results are the same.
    for document in (expected, found):
        del document["sources"], document["checksum"]
    assert found == expected


def test_every_layout_of_an_array_gives_the_same_bits(table: shellcal.Table) -> None:
    X, Y = table.X, table.Y
    expected = Calibration("cubic").fit(X, Y).coefficients_
    wide = np.zeros((X.shape[0], 2 * X.shape[1]))
    wide[:, ::2] = X
    views = [np.asfortranarray(X), wide[:, ::2], X[::-1][::-1], X.astype(np.float32), X.astype(int)]
    views.append(X.astype(X.dtype.newbyteorder()))
    frozen = X.copy()
    frozen.flags.writeable = False
    views.append(frozen)
    raw = np.zeros(X.nbytes + 1, np.uint8)
    odd = raw[1:].view(np.float64).reshape(X.shape)
    odd[:] = X
    assert not odd.flags.aligned
    views.append(odd)
    for view in views:
        assert (Calibration("cubic").fit(view, Y).coefficients_ == expected).all()
    shuffled = np.random.default_rng(1).permutation(len(X))
    assert (Calibration("cubic").fit(X[shuffled], Y[shuffled]).coefficients_ == expected).all()
    assert (Calibration("cubic", threads=1).fit(X, Y).coefficients_ == expected).all()


def test_predictions_are_those_of_convert(
    logs: list[Path], table: shellcal.Table, tmp_path: Path
) -> None:
    calibration = shellcal.fit_logs(logs[1], model="cubic")
    with pytest.warns(shellcal.ShellcalWarning, match="outside the calibrated range"):
        converted = shellcal.convert(
            calibration, logs[0], no_tare=True, no_lowpass=True, all_rows=True, interval=95
        )
    X = shellcal.read_log(logs[0]).X
    wrench, std, lower, upper = calibration.predict(X, return_std=True, interval=0.95)
    for axis, name in enumerate(["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"]):
        stem, unit = name.split("_")
        for ours, theirs in [
            (wrench, name),
            (std, f"{stem}_se_{unit}"),
            (lower, f"{stem}_lower_{unit}"),
            (upper, f"{stem}_upper_{unit}"),
        ]:
            # Bounds may be added up in another order, and the table may have fewer digits.
            assert np.allclose(ours[:, axis], converted[theirs], rtol=1e-6, atol=1e-6), theirs


def test_a_fit_of_logs_is_the_file_of_the_program(logs: list[Path], tmp_path: Path) -> None:
    expected = fitted(tmp_path, logs[0], logs[1], "--test", logs[2], "--cv")
    assert of(shellcal.fit_logs(logs[:2], logs[2], model="cubic", cv=True)) == expected


def test_documents_pass_both_ways(logs: list[Path], table: shellcal.Table, tmp_path: Path) -> None:
    calibration = Calibration("cubic", serial="shell 7").fit(table.X, table.Y)
    path = tmp_path / "calibration.json"
    calibration.save(path)
    assert path.read_text() == calibration.to_json()
    program("eval", path, logs[2])
    again = Calibration.load(path)
    assert again.to_json() == calibration.to_json()
    assert (again.model, again.serial) == ("cubic", "shell 7")
    assert (again.predict(table.X) == calibration.predict(table.X)).all()


def test_warnings_are_those_of_the_program(tmp_path: Path) -> None:
    """Few poses, few rows, readings that are not counts: both warn of each, in the same words."""
    random = np.random.default_rng(5)
    poses = np.repeat(np.arange(12), 4)
    loads = random.normal(size=(12, 6))[poses]
    X = 2000 + loads @ random.normal(size=(6, 8)) * 200 + random.normal(size=(48, 8))
    # Two nearly equal channels: only then does it matter that sums are not exact.
    X[:, 7] = X[:, 0] + 1e-8 * random.normal(size=48)
    names = [f"s{i}" for i in range(1, 9)] + ["fx_n", "fy_n", "fz_n", "mx_nm", "my_nm", "mz_nm"]
    log = tmp_path / "few.csv"
    with log.open("w") as file:
        file.write(",".join([*names, "group"]) + "\n")
        for row, load, pose in zip(X, loads, poses):
            file.write(",".join(repr(float(x)) for x in [*row, *load]) + f",pose {pose}\n")
    output = tmp_path / "few.json"
    line = [shellcal.program(), "fit", log, "--model", "cubic", "--covariance", "auto", "-o", output]
    done = subprocess.run([str(word) for word in line], capture_output=True, text=True, check=True)
    said = {text for text in done.stderr.splitlines() if text.startswith("warning: ")}
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        Calibration("cubic").fit(X, loads, groups=[f"pose {pose}" for pose in poses])
    found = {f"warning: {of.message}" for of in told}
    assert len(found) >= 3 and found == said
