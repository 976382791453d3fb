"""Unusable input is rejected with a hint; the package never panics."""

from __future__ import annotations

import random
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import counts

import shellcal
from shellcal import Calibration, Partial

X, Y = counts(120, channels=3)

CASES: list[tuple[Any, Any, str]] = [
    (X[:, 0], Y, "Reshape your data"),
    (X[None], Y, "Expected 2D array, got 3D"),
    (X[:50], Y, "Y has 120 rows, X has 50"),
    (X, Y[:, :0], "expected 6: Fx, Fy, Fz"),
    (X, np.hstack([Y, Y]), "Y has 12 columns"),
    (X[:0], Y[:0], "0 sample"),
    (X[:, :0], Y, "0 feature"),
    (X, None, "requires y to be passed"),
    (np.where(X == X[7, 1], np.nan, X), Y, r"X contains NaN in row \d+, column \d \(`s"),
    (X, np.where(Y == Y[5, 2], np.inf, Y), r"Y contains infinity .* row 5, column 2 \(`fz_n`\)"),
    (X.astype(str), Y, "expected numbers"),
    (X.astype(complex), Y, "Complex data not supported"),
    (np.zeros((3, 1_000_000), np.float32), Y[:3], "at most 255 channels"),
    (np.array([["a", 1.0]] * 120, dtype=object), Y, r"X\[0, 0\] is 'a'"),
    (np.zeros((120, 3), dtype="M8[s]"), Y, "expected numbers"),
    ([[1, 2], [3]], Y, "inhomogeneous"),
    (X, Y * 1e200, "overflow|too large"),
    (np.full((120, 3), 7.0), Y, "same readings|never|only"),
]


@pytest.mark.parametrize(("readings", "wrench", "expected"), CASES)
def test_arrays_that_cannot_be_used_are_named(readings: Any, wrench: Any, expected: str) -> None:
    with warnings.catch_warnings(), pytest.raises(ValueError, match=expected):
        warnings.simplefilter("ignore", shellcal.ShellcalWarning)
        Calibration("linear").fit(readings, wrench)


def test_options_that_there_are_not_are_named() -> None:
    cases: list[tuple[dict[str, Any], str]] = [
        ({"model": "cubik"}, "model is `cubik`, expected one of `linear`, `cubic`"),
        ({"model": 3}, "expected a name"),
        ({"solver": "magic"}, "solver is `magic`"),
        ({"ridge": -1.0}, "not negative"),
        ({"ridge": float("nan")}, "ridge"),
        ({"ridge": "much"}, "expected a number"),
        ({"cv": 1}, "from 2 up"),
        ({"threads": -1}, "expected an integer"),
        ({"covariance": "all"}, "covariance is `all`"),
    ]
    for options, expected in cases:
        with pytest.raises(shellcal.ShellcalError, match=expected):
            Calibration(**{"model": "linear", **options}).fit(X, Y)
    with pytest.raises(shellcal.OptionError, match="no parameter `colour`"):
        Calibration().set_params(colour=1)
    for options, expected in [
        ({"ridge": 0.1}, "ridge is for polynomials"),
        ({"solver": "tsqr"}, "solver is for polynomials"),
        ({"intercept": False}, "intercept is for polynomials"),
        ({"truncate": 0.1}, "truncate is for polynomials"),
    ]:
        with pytest.raises(shellcal.OptionError, match=expected):
            Calibration("physics", **options).fit(X, Y, groups=np.arange(120) // 10)
    with pytest.raises(shellcal.FitError, match="`3` channels vary, at least `6`"):
        Calibration("physics").fit(X, Y, groups=np.arange(120) // 2)


def test_weights_that_cannot_be_used_are_named() -> None:
    each = np.full(120, 1.5)
    cases: list[tuple[Any, dict[str, Any], str]] = [
        (np.ones(7), {}, "one weight for each row"),
        (np.ones((120, 1)), {}, "one weight for each row"),
        (np.where(np.arange(120) == 3, np.nan, 1.0), {}, "sample_weight is nan in row 3"),
        (np.where(np.arange(120) == 4, -1.0, 1.0), {}, r"sample_weight is -1.0 in row 4.*\n.*leaves a row out"),
        (np.where(np.arange(120) == 4, np.inf, 1.0), {}, "sample_weight is inf in row 4"),
        (np.zeros(120), {}, "zero in every row"),
        (np.full(120, "much"), {}, "expected numbers"),
        (np.full(120, 1e9), {}, "adds up to 120000000000 rows"),
        (each, {"cv": True}, "cross-validation needs rows of equal weight"),
        (each, {"model": "physics"}, "the physics model needs"),
        (each, {"ridge": 0.1}, "a ridge needs"),
        (each, {"covariance": "groups"}, "a covariance by group needs"),
        (each, {"solver": "huber"}, "this solver needs.*\n.*integers as sample_weight"),
    ]
    for weights, options, expected in cases:
        calibration = Calibration(**{"model": "linear", **options})
        with pytest.raises(shellcal.ShellcalError, match=expected):
            calibration.fit(X, Y, weights, groups=np.arange(120) // 4)


def test_groups_that_cannot_be_used_are_named() -> None:
    for groups, expected in [
        (np.zeros(7), "one label for each row"),
        (np.zeros((120, 1)), "one label for each row"),
        (np.where(np.arange(120) == 3, np.nan, 0.0), "NaN"),
    ]:
        with pytest.raises(shellcal.ArrayError, match=expected):
            Calibration("linear").fit(X, Y, groups=groups)
    rows, wrench = counts(2200, channels=2)
    with pytest.raises(shellcal.ArrayError, match="2200 labels"):
        Calibration("linear").fit(rows, wrench, groups=np.arange(2200))
    with pytest.raises(shellcal.FitError, match="at least `2` groups"):
        Calibration("linear", cv=True).fit(X, Y, groups=["one"] * 120)


def test_a_log_is_refused_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t_s,s1,s2\n0.0,100,200\n0.1,oops,300\n")
    with pytest.raises(shellcal.LogError) as caught:
        shellcal.read_log(path)
    error = caught.value
    assert (error.file, error.line, error.column) == (str(path), 3, 2)
    assert error.hint is not None and "skip_bad_rows=True" in str(error)
    table = shellcal.read_log(path, skip_bad_rows=True)
    assert table.rows == 1 and table.about["skipped_rows"] == 1
    for options, expected in [
        ({"wrench": "1-3"}, "six columns"),
        ({"wrench": "fx=s1,fx=s2"}, "or their axes"),
        ({"wrench": "fx=s1,s2"}, "or their axes"),
        ({"wrench": "fx="}, "or their axes"),
        ({"time_unit": "hours"}, "`s`, `ms`, `us` or `ns`"),
        ({"colour": "red"}, "no option `colour`"),
        ({"sensors": "nowhere"}, "nowhere"),
    ]:
        with pytest.raises(shellcal.ShellcalError, match=expected):
            shellcal.read_log(path, **options)
    with pytest.raises(shellcal.LogError, match="cannot read"):
        shellcal.read_log(tmp_path / "missing.csv")


def test_the_program_is_quoted_with_place_and_hint(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t_s,s1,s2,fx_n,fy_n,fz_n,mx_nm,my_nm,mz_nm\n0,100,200,1,1,1,1,1,bad\n")
    with pytest.raises(shellcal.ProgramError) as caught:
        shellcal.fit_logs(path)
    error = caught.value
    assert (error.file, error.line, error.column) == (str(path), 2, 9)
    assert error.hint is not None and "--skip-bad-rows" in error.hint
    with pytest.raises(shellcal.ProgramError, match="unexpected argument"):
        shellcal.simulate(no_such_option=1)


def test_a_document_is_refused_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "calibration.json"
    path.write_text('{\n  "schema_version": 1,\n  nonsense')
    with pytest.raises(shellcal.DocumentError) as caught:
        Calibration.load(path)
    assert (caught.value.file, caught.value.line) == (str(path), 3)
    with pytest.raises(shellcal.DocumentError, match="cannot read"):
        Calibration.load(tmp_path / "missing.json")


def test_a_calibration_without_a_fit_says_so() -> None:
    for use in (lambda: Calibration().predict(X), lambda: Calibration().to_json()):
        with pytest.raises(Exception, match="not fitted yet"):
            use()


#: Seeds are numbers, so that a failure can be reproduced: `-k` and the printed seed.
CALLS = 10_000


def anything(draw: random.Random, depth: int = 0) -> Any:
    """Returns a value that a user might pass by mistake."""
    numbers = np.random.default_rng(draw.randrange(2**32))
    rows, columns = draw.choice([0, 1, 2, 7, 40]), draw.choice([0, 1, 2, 6, 8, 300])
    makers = [
        lambda: None,
        lambda: draw.choice([0, -1, 1, 2, 3.5, 2**70, float("nan"), float("inf"), True]),
        lambda: draw.choice(["", "cubic", "linear", "auto", "exact", "groups", "\0", "é" * 9]),
        lambda: numbers.integers(0, 4096, (rows, columns)),
        lambda: numbers.integers(0, 4096, (40, 2)).astype(draw.choice(["f4", "f8", ">f8", "i2", "u1"])),
        lambda: numbers.integers(0, 4096, (40, 6)).astype(float),
        lambda: numbers.normal(size=(rows, columns)) * 10.0 ** draw.randrange(-300, 300),
        lambda: numbers.integers(0, 9, 40),
        lambda: np.full((rows, columns), draw.choice([np.nan, np.inf, 0.0, 1e308])),
        lambda: np.array([[None, "x"]] * rows, dtype=object),
        lambda: numbers.integers(0, 4096, (80, 4)).astype(float)[::-2, ::2],
        lambda: np.broadcast_to(np.float64(7), (rows, columns)),
        lambda: bytes(draw.randrange(256) for _ in range(rows)),
        lambda: [anything(draw, depth + 1) for _ in range(3)] if depth < 2 else [],
        lambda: {"a": rows},
        lambda: object(),
    ]
    return draw.choice(makers)()


def test_ten_thousand_calls_at_random_end_in_a_result_or_an_exception(tmp_path: Path) -> None:
    good = Calibration("linear", covariance="rows").fit(X, Y)
    sums = Partial("linear", groups=True).add(X, Y, groups=np.arange(120) % 9).to_bytes()
    document = good.to_json().encode()
    log = tmp_path / "log.csv"

    def damaged(draw: random.Random, whole: bytes) -> bytes:
        at, data = draw.randrange(len(whole)), bytearray(whole)
        data[at : at + draw.choice([0, 1, 5])] = bytes(draw.choice([b"", b"9", b"-", b"\xff", b"}"]))
        return bytes(data[: draw.choice([at, len(data), len(data)])])

    def read(draw: random.Random) -> Any:
        log.write_bytes(damaged(draw, b"t_s,s1,s2,group\n0,1,2,a\n1,2,3,b\n2,9,9,b\n"))
        return shellcal.read_log(log)

    def call(draw: random.Random) -> Any:
        some = lambda: anything(draw)  # noqa: E731
        calls = [
            lambda: Calibration(some(), ridge=some()).fit(some(), some(), groups=some()),
            lambda: Calibration("linear", cv=some(), covariance=some()).fit(X, some(), groups=some()),
            lambda: Calibration("linear", ridge=some(), seed=some(), threads=some()).fit(X, Y),
            lambda: Calibration("linear", solver="svd", truncate=some()).fit(some(), some()),
            lambda: Calibration("linear", solver=draw.choice(["exact", "svd"])).fit(X, Y, some(), groups=some()),
            lambda: Calibration("physics", ridge=some()).fit(some(), some(), some(), groups=some()),
            lambda: good.predict(some(), return_std=some(), interval=some()),
            lambda: good.score(some(), some(), some()),
            lambda: Partial(some(), groups=some(), seed=some()).add(some(), some(), groups=some()),
            lambda: Partial("linear").add(some(), some()).solve(some(), ridge=some(), cv=some()),
            lambda: Partial.from_bytes(damaged(draw, sums)).solve(cv=draw.choice([True, False, 3])),
            lambda: Calibration.from_json(damaged(draw, document)).predict(X, interval=0.9),
            lambda: Partial.from_bytes(some()),
            lambda: shellcal.cross_validate(some(), some(), some(), model="linear"),
            lambda: read(draw),
        ]
        return draw.choice(calls)()

    ended = {"result": 0, "exception": 0}
    for seed in range(CALLS):
        draw = random.Random(seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                result = call(draw)
                ended["result"] += 1
            except (ValueError, TypeError, AttributeError, OverflowError) as error:
                assert str(error), seed
                ended["exception"] += 1
                continue
            # A panic is a `BaseException`, and fails the test.
        if isinstance(result, np.ndarray):
            assert np.isfinite(result).all(), seed
        if isinstance(result, Calibration):
            assert "NaN" not in result.to_json(), seed
    assert min(ended.values()) > CALLS / 50, ended
