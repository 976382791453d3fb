"""Concurrent threads and processes give a result or an exception."""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import threading
import warnings
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from conftest import counts

import shellcal
from shellcal import Calibration, Partial


def ends(call: Any) -> Any:
    """Returns the result, or `None` if the arrays were rejected in their current state."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return call()
        except shellcal.ShellcalError as error:
            assert str(error)
            return None


@pytest.mark.parametrize("written", [np.nan, 1e300, 7.5, 0.0])
def test_arrays_may_change_during_a_fit(written: float) -> None:
    X, Y = counts(4000, channels=4)
    stop = threading.Event()

    def change() -> None:
        random = np.random.default_rng(1)
        while not stop.is_set():
            row = random.integers(0, 4000)
            X[row, row % 4] = written
            Y[row, row % 6] = written
            X[row] = 2000.0

    changing = threading.Thread(target=change)
    changing.start()
    try:
        for model in ["linear", "cubic"] * 5:
            fitted = ends(lambda: Calibration(model).fit(X, Y))
            if fitted is not None:
                assert "NaN" not in fitted.to_json() and np.isfinite(fitted.predict(counts(10, channels=4)[0])).all()
            ends(lambda: Partial("linear").add(X, Y).solve())
    finally:
        stop.set()
        changing.join()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork")
def test_a_process_that_was_forked_after_a_fit_fits_too() -> None:
    script = """
import os, sys, warnings
sys.path.insert(0, "")
from conftest import counts
from shellcal import Calibration
warnings.simplefilter("ignore")
X, Y = counts(3000)
first = Calibration("cubic").fit(X, Y).to_json()
for _ in range(3):
    child = os.fork()
    if child == 0:
        os._exit(0 if Calibration("cubic").fit(X, Y).to_json() == first else 3)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
"""
    folder = os.path.dirname(__file__)
    # The parent's threads do not exist in the child: waiting for them would never end.
    subprocess.run([sys.executable, "-c", script], cwd=folder, check=True, timeout=300)


def test_many_threads_fit_the_same_to_the_last_bit() -> None:
    X, Y = counts(2000)
    alone = Calibration("cubic").fit(X, Y)

    def work(_: int) -> tuple[str, bytes]:
        fitted = Calibration("cubic").fit(X, Y)
        return fitted.to_json(), alone.predict(X).tobytes()

    with ThreadPoolExecutor(8) as pool:
        for document, predicted in pool.map(work, range(24)):
            assert document == alone.to_json()
            assert predicted == alone.predict(X).tobytes()


@pytest.mark.skipif(not sysconfig.get_config_var("Py_GIL_DISABLED"), reason="this Python has a lock")
def test_the_lock_stays_off() -> None:
    assert not sys._is_gil_enabled()
