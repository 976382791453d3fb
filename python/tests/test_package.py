"""The package as a whole: imports, types, threads, signals, scikit-learn, tables."""

from __future__ import annotations

import base64
import gc
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import types
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import counts, program

import shellcal
from shellcal import Calibration

PACKAGE = Path(shellcal.__file__).parent


def test_types_are_checked() -> None:
    pytest.importorskip("mypy")
    command = [sys.executable, "-m", "mypy", "--config-file", "pyproject.toml"]
    root = Path(__file__).parent.parent
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_stubs_name_what_there_is() -> None:
    from shellcal import _native

    stub = (PACKAGE / "_native.pyi").read_text()
    for name, thing in vars(_native).items():
        if name.startswith("_") and name != "__version__":
            continue
        assert name in stub
        for method in vars(thing) if isinstance(thing, type) else ():
            assert method.startswith("_") or f"def {method}(" in stub, method
    for name in shellcal.__all__:
        assert getattr(shellcal, name) is not None
        assert f" as {name}" in (PACKAGE / "__init__.pyi").read_text()


def test_importing_loads_neither_numpy_nor_anything_else_that_is_large() -> None:
    code = "import shellcal, sys; print(sorted({'numpy', 'pandas', 'sklearn'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_everything_public_is_documented() -> None:
    for name in shellcal.__all__:
        thing = getattr(shellcal, name)
        assert thing.__doc__, name
        for method in vars(thing) if isinstance(thing, type) else ():
            attribute = getattr(thing, method)
            if not method.startswith("_") and callable(attribute):
                assert attribute.__doc__ or method in ("__hash__",), f"{name}.{method}"


def test_other_threads_run_during_a_fit() -> None:
    X, Y = counts(300_000)
    ticks, done = 0, threading.Event()

    def tick() -> None:
        nonlocal ticks
        while not done.is_set():
            ticks += 1
            time.sleep(0.001)

    ticker = threading.Thread(target=tick)
    ticker.start()
    before = ticks
    Calibration("poly3", threads=1).fit(X, Y)
    during = ticks - before
    done.set()
    ticker.join()
    # If a fit of a few hundred milliseconds held the lock, the other thread would get one or two ticks.
    assert during > 20


@pytest.mark.skipif(os.name == "nt", reason="signals are those of POSIX")
def test_ctrl_c_ends_a_fit() -> None:
    code = """
import numpy as np, shellcal, signal, sys
# Where the tests run in the background of a shell, Ctrl-C is ignored from the start.
signal.signal(signal.SIGINT, signal.default_int_handler)
X = np.random.default_rng(0).integers(0, 4096, (4096, 8)).astype(float)
# Rows without end, in the memory of a few.
X = np.lib.stride_tricks.as_strided(X[:1], (900_000_000, 8), (0, 8))
print("ready", flush=True)
try:
    shellcal.Calibration("poly3").fit(X, X[:, :6])
except KeyboardInterrupt:
    print("interrupted")
"""
    # The check for finite values also takes a while for that many rows: not of interest here.
    code = code.replace("import numpy", "import shellcal._arrays as a; a._finite = lambda x, *_: x\nimport numpy")
    run = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None and run.stdout.readline() == "ready\n"
    time.sleep(0.5)
    run.send_signal(signal.SIGINT)
    assert run.communicate(timeout=60)[0] == "interrupted\n"


def test_results_can_be_copied_and_sent() -> None:
    X, Y = counts(200)
    calibration = Calibration("linear", covariance="rows").fit(X, Y)
    again = pickle.loads(pickle.dumps(calibration))
    assert again.to_json() == calibration.to_json()
    assert (again.predict(X) == calibration.predict(X)).all()


def figure(html: str) -> str:
    """The SVG document in a notebook's HTML."""
    return base64.b64decode(html.split("data:image/svg+xml;base64,")[1].split('"')[0]).decode()


def test_the_figure_of_many_rows_is_of_some() -> None:
    X, Y = counts(50_000)
    html = Calibration("linear").fit(X, Y)._repr_html_()
    assert "Calibration linear + offset, 4000 of 50000 rows</text>" in figure(html)
    # The memory that a notebook keeps for each displayed calibration.
    assert len(html) < 500_000


def test_a_fit_of_logs_shows_the_figure_of_the_program(logs: list[Path], tmp_path: Path) -> None:
    calibration = shellcal.fit_logs(logs[1], logs[2], model="cubic")
    program("fit", logs[1], "--model", "cubic", "--test", logs[2], "--plot", tmp_path / "fit.svg", "-q")
    assert figure(calibration._repr_html_()) == (tmp_path / "fit.svg").read_text()


def test_what_takes_long_has_a_bar_where_somebody_looks(
    logs: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from shellcal import _progress

    bars: list[Any] = []

    class Bar:
        def __init__(self, **options: Any) -> None:
            self.n, self.total, self.options, self.closed = 0, None, options, False
            bars.append(self)

        def update(self, more: int) -> None:
            assert more >= 0
            self.n += more

        def close(self) -> None:
            self.closed = True

    module: Any = types.ModuleType("tqdm.auto")
    module.tqdm = Bar
    monkeypatch.setitem(sys.modules, "tqdm", types.ModuleType("tqdm"))
    monkeypatch.setitem(sys.modules, "tqdm.auto", module)
    monkeypatch.setattr(_progress, "_DELAY", 0.0)
    shellcal.synth("trials", tmp_path / "trials")
    calibration = tmp_path / "calibration.json"
    shellcal.fit_logs(logs[1], model="cubic").save(calibration)
    manifest = tmp_path / "trials/manifest.csv"
    unseen = shellcal.batch(manifest, calibration)
    assert not bars
    monkeypatch.setattr(_progress, "_is_watched", lambda: True)
    assert shellcal.batch(manifest, calibration) == unseen
    assert bars[0].total == 25 and bars[0].n <= 25 and bars[0].closed
    assert bars[0].options["desc"] == "batch"
    del bars[:]
    X, Y = counts(300_000)
    Calibration("poly3", threads=1).fit(X, Y)
    # A pass for the sums, one for the errors and one for faults of the data; checked every 50 ms.
    assert 0 < bars[0].n <= 900_000 and bars[0].closed
    # Without tqdm there is no bar.
    del bars[:]
    monkeypatch.setitem(sys.modules, "tqdm.auto", None)
    assert shellcal.batch(manifest, calibration) == unseen and not bars


def test_results_show_themselves() -> None:
    X, Y = counts(400)
    groups = np.arange(400) // 20
    calibration = Calibration("linear", cv=True)
    assert "not fitted" in calibration._repr_html_()
    html = calibration.fit(X, Y, groups=groups)._repr_html_()
    for text in ("linear + offset", "RMS new groups", "<th>Mz</th>", "N·m"):
        assert text in html
    assert "Calibration linear + offset</text>" in figure(html) and "400 training rows" in figure(html)
    # The figure needs the rows, which neither files nor pickles contain.
    again = pickle.loads(pickle.dumps(calibration))
    assert "<img" not in again._repr_html_() and "RMS new groups" in again._repr_html_()
    assert repr(calibration) == "Calibration(cv=True, model='linear')"


def test_readings_out_of_range_are_flagged() -> None:
    X, Y = counts(200)
    calibration = Calibration("linear").fit(X, Y)
    beyond = X[:2].copy()
    beyond[1, 3] = 9000
    assert calibration.out_of_range(beyond).tolist() == [False, True]


def test_fewer_axes_are_fitted_as_the_first() -> None:
    X, Y = counts(300)
    whole, three = Calibration("linear").fit(X, Y), Calibration("linear").fit(X, Y[:, :3])
    assert (three.predict(X) == whole.predict(X)[:, :3]).all()
    one = Calibration("linear").fit(X, Y[:, 0])
    assert one.predict(X).shape == (300,) and one.score(X, Y[:, 0]) > 0.9
    assert whole.score(X, Y) == pytest.approx(
        np.mean([1 - axis for axis in ((Y - whole.predict(X)) ** 2).sum(0) / Y.var(0) / len(Y)])
    )


def test_a_log_is_an_arrow_table(logs: list[Path]) -> None:
    arrow = pytest.importorskip("pyarrow")
    table = shellcal.read_log(logs[0])
    found = arrow.table(table)
    assert found.num_rows == 900 and found.column_names == list(table)
    found.validate(full=True)
    for name in table:
        assert found[name].to_pylist() == table[name].tolist(), name


def test_a_wrench_of_some_axes_is_named(logs: list[Path]) -> None:
    whole = shellcal.read_log(logs[0])
    table = shellcal.read_log(logs[0], wrench="fz=fz_n, Fx=fx_n")
    names = [name for name in table if name.startswith(("f", "m"))]
    assert names == ["fx_n", "fz_n"]
    assert all((table[name] == whole[name]).all() for name in names)


def test_an_arrow_table_keeps_its_memory_for_as_long_as_it_is_held() -> None:
    arrow = pytest.importorskip("pyarrow")
    from shellcal import _arrow

    words = np.asarray(["", "ab", "é", "日本", "ab"])
    columns: dict[str, Any] = {"x": np.arange(10.0)[::2], "word": words, "n": np.arange(5)}
    before = len(_arrow._lent)
    found = arrow.table(shellcal.Table(columns, {}))
    column = found["word"].chunk(0)
    del columns["x"]
    del found
    gc.collect()
    assert column.to_pylist() == words.tolist()
    del column
    # An unused stream is released, too.
    capsule = shellcal.Table(columns, {}).__arrow_c_stream__()
    del capsule
    gc.collect()
    assert len(_arrow._lent) == before and not _arrow._capsules
    none = arrow.table(shellcal.Table({"x": np.empty(0), "word": np.asarray([], dtype=str)}, {}))
    assert none.num_rows == 0 and none.column_names == ["x", "word"]


def test_an_arrow_table_takes_no_pyarrow(logs: list[Path]) -> None:
    code = f"""
import sys
sys.modules["pyarrow"] = None
import shellcal
print(type(shellcal.read_log({str(logs[0])!r}).__arrow_c_stream__()).__name__)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("PyCapsule\n", "")


def test_weights_are_those_of_scikit_learn() -> None:
    linear = pytest.importorskip("sklearn.linear_model")
    X, Y = counts(500)
    for weights in (np.random.default_rng(2).integers(0, 5, 500), np.random.default_rng(2).random(500)):
        expected = linear.LinearRegression().fit(X, Y, sample_weight=weights)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            found = Calibration("linear", covariance="rows").fit(X, Y, weights)
        is_whole = weights.dtype.kind == "i"
        assert [str(one.message) for one in told] == (
            [] if is_whole else ["not solved exactly but by refined QR: sample_weight has no whole numbers"]
        )
        # scikit-learn solves in raw units, with a condition number of about 10⁴.
        assert np.allclose(found.predict(X), expected.predict(X), rtol=0, atol=1e-10)
        assert found.score(X, Y, weights) == pytest.approx(expected.score(X, Y, weights), rel=1e-9)
        residual = Y - expected.predict(X)
        rows = weights.sum() if is_whole else 500
        products = residual.T @ (weights[:, None] * residual) / (rows - 9)
        assert np.allclose(found.document_["covariance"]["residual"], products, rtol=1e-9, atol=1e-15)


def test_other_weights_leave_rows_out_and_scale_standard_errors(table: shellcal.Table) -> None:
    weights = np.random.default_rng(5).random(table.rows) + 0.1
    kept = np.arange(table.rows) % 3 > 0
    calibration = Calibration("cubic", solver="tsqr", covariance="rows")
    whole = calibration.fit(table.X[kept], table.Y[kept], weights[kept]).document_
    found = calibration.fit(table.X, table.Y, np.where(kept, weights, 0.0)).document_
    assert found == whole
    # Twice the weight for all rows is half the variance of a sample of weight 1, and the same coefficients.
    doubled = calibration.fit(table.X[kept], table.Y[kept], 4 * weights[kept]).document_
    assert np.allclose(doubled["coefficients"], whole["coefficients"], rtol=1e-10, atol=1e-14)
    residuals = (np.asarray(of["covariance"]["residual"]) for of in (doubled, whole))
    assert np.allclose(next(residuals), 4 * next(residuals), rtol=1e-10, atol=0)


def test_trials_and_simulations(tmp_path: Path, logs: list[Path]) -> None:
    calibration = shellcal.fit_logs(logs[1], model="cubic")
    shellcal.synth("trials", tmp_path / "trials")
    found = shellcal.batch(tmp_path / "trials/manifest.csv", calibration, reference="free")
    assert len(found["trials"]) == 25
    # The program warns that a channel of 4 cm is narrow for the model.
    with pytest.warns(shellcal.ShellcalWarning, match="channel of 4 cm"):
        assert shellcal.simulate()
    assert shellcal.info(logs[0])


#: Conventions of scikit-learn that this estimator does not follow, with the reason.
DEVIATIONS = {
    "check_sample_weight_equivalence_on_dense_data": "sets `cv` to a list of splits; here it is whether groups are "
    "held out. `test_whole_weights_are_repeated_rows` is the same check, bit for bit",
}


def test_scikit_learn_takes_it_for_an_estimator() -> None:
    checks = pytest.importorskip("sklearn.utils.estimator_checks")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("warnings.warn", lambda *_, **__: None)
        found = checks.check_estimator(
            Calibration("linear", ridge=1e-9), expected_failed_checks=DEVIATIONS, on_fail=None
        )
    failed = {check["check_name"]: check["exception"] for check in found if check["status"] == "failed"}
    assert not failed, failed


def test_scikit_learn_searches_and_pipes_it() -> None:
    pytest.importorskip("sklearn")
    from sklearn.model_selection import GridSearchCV, GroupKFold

    X, Y = counts(600)
    groups = np.arange(600) // 20
    search = GridSearchCV(
        Calibration("cubic", covariance="none"), {"model": ["linear", "cubic"]}, cv=GroupKFold(3)
    )
    search.fit(X, Y, groups=groups)
    assert search.best_params_ == {"model": "linear"}


def test_rows_and_units_are_chosen_as_on_the_command_line(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    lines = [f"{row / 100},{'AB'[row % 2]},{1500 + row},{row % 5}" for row in range(40)]
    path.write_text("\n".join(["t_s,name,s1,Fx", *lines]) + "\n")
    table = shellcal.read_log(path, unit="fx=lbf", where=["name=A", "s1>1509"])
    assert table.rows == 15
    # A pound-force is 4.4482216152605 N (NIST SP 811, table B.8).
    assert table["fx_n"][1] == pytest.approx(2 * 4.4482216152605, rel=1e-15)
    with pytest.raises(shellcal.OptionError, match="`volts` is no unit"):
        shellcal.read_log(path, unit="fx=volts")
    with pytest.raises(shellcal.OptionError, match="expected True, False or 'all'"):
        shellcal.read_log(path, skip_bad_rows="some")
    with path.open("a") as file:
        file.write("x,A,1,1\n" * 10)
    with pytest.raises(shellcal.LogError, match="10 of 50 rows are wrong, all in column `t_s`"):
        shellcal.read_log(path, skip_bad_rows=True)
    assert shellcal.read_log(path, skip_bad_rows="all").rows == 40
