"""Partial fits: every order gives the bits of one fit."""

from __future__ import annotations

import copy
import itertools
import pickle
from pathlib import Path

import numpy as np
import pytest
from conftest import counts, program

import shellcal
from shellcal import Partial


def test_merged_logs_are_those_of_the_program_in_any_order(logs: list[Path], tmp_path: Path) -> None:
    path = tmp_path / "all.json"
    program("fit", *logs, "--groups", "--partial", path)
    merged = tmp_path / "merged.json"
    program("merge", path, "--cv", "-o", merged)
    parts = [shellcal.partial_fit(log, groups=True) for log in logs]
    for order in itertools.permutations(parts):
        whole = shellcal.merge(map(copy.copy, order))
        assert whole.to_bytes() == path.read_bytes()
        assert whole.solve(cv=True).to_json() == merged.read_text()
    assert whole.rows == 3000
    assert [rows for _, _, rows in whole.sources] == [900, 1700, 400]
    assert Partial.load(path) == whole


def test_arrays_in_parts_are_the_fit_of_all() -> None:
    X, Y = counts(3000)
    groups = np.arange(3000) // 20
    whole = shellcal.Calibration("linear", covariance="groups").fit(X, Y, groups=groups)
    parts = []
    for number, part in enumerate(np.array_split(np.arange(3000), 7)):
        partial = Partial("linear", groups=True)
        partial.add(X[part], Y[part], groups=groups[part], name=f"part-{number}")
        parts.append(pickle.loads(pickle.dumps(partial)))
    tree = [shellcal.merge(parts[i::3]) for i in range(3)]
    fitted = shellcal.merge(reversed(tree)).solve(cv=True, covariance="groups")
    assert (fitted.coefficients_ == whole.coefficients_).all()
    assert fitted.document_["covariance"]["residual"] == whole.document_["covariance"]["residual"]
    alone = shellcal.cross_validate(X, Y, groups, model="linear")
    assert fitted.diagnostics_["cross_validation"]["grouped"] == alone["grouped"]


def test_rows_are_counted_once() -> None:
    X, Y = counts(200)
    partial = Partial("linear").add(X, Y)
    before = partial.to_bytes()
    with pytest.raises(shellcal.CountedTwiceError, match="counted already") as caught:
        partial.add(X, Y, name="under another name")
    assert caught.value.hint is not None
    with pytest.raises(shellcal.CountedTwiceError):
        partial.merge(partial)
    assert partial.to_bytes() == before
    skipped: list[str] = []
    again = shellcal.merge([partial, copy.copy(partial)], duplicates="skip", skipped=skipped)
    assert again == partial and skipped == ["<array>"]


def test_parts_of_other_fits_are_refused() -> None:
    X, Y = counts(200)
    linear = Partial("linear").add(X, Y)
    other = counts(200, seed=1)
    with pytest.raises(shellcal.MergeError, match="expected `linear"):
        linear.merge(Partial("cubic").add(*other))
    with pytest.raises(shellcal.MergeError, match="channels"):
        linear.merge(Partial("linear").add(other[0][:, :7], other[1]))
    with pytest.raises(shellcal.MergeError, match="sums of groups"):
        linear.merge(Partial("linear", groups=True).add(*other, groups=np.arange(200) % 9))
    with pytest.raises(shellcal.OptionError, match="give groups="):
        Partial("linear", groups=True).add(*other)
    with pytest.raises(shellcal.FitError, match="cannot take these rows|exact"):
        Partial("linear").add(other[0] + 0.123456789, other[1])
    with pytest.raises(shellcal.OptionError, match="no rows"):
        Partial().solve()
    with pytest.raises(shellcal.FitError, match="too few"):
        Partial("quadratic").add(other[0][:20], other[1][:20]).solve()


def test_documents_that_were_changed_are_refused() -> None:
    X, Y = counts(200)
    document = Partial("linear", groups=True).add(X, Y, groups=np.arange(200) % 9).to_bytes()
    assert Partial.from_bytes(document).to_bytes() == document
    with pytest.raises(shellcal.DocumentError, match="checksum"):
        Partial.from_bytes(document.replace(b'"seed": 1', b'"seed": 2'))
    with pytest.raises(shellcal.DocumentError) as caught:
        Partial.from_bytes(document[:1000])
    assert caught.value.line is not None and caught.value.column is not None
    assert len(Partial.read_all(document + document)) == 2
