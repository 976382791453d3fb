"""Reliability of a model on new poses, and choice of a model."""

from __future__ import annotations

from typing import Any

from ._calibration import Calibration
from ._errors import OptionError


def cross_validate(
    X: Any,
    y: Any,
    groups: Any,
    *,
    model: str = "cubic",
    folds: int | None = None,
    sample_weight: Any = None,
    **options: Any,
) -> dict[str, Any]:
    """Returns errors on held-out groups and, for comparison, on rows held out at random.

    Parameters
    ----------
    X, y, groups, sample_weight
        As for `Calibration.fit`; `groups` are required.
    model : str
        As for `Calibration`.
    folds : int, optional
        Number of folds of groups; by default each group is a fold.
    options
        Further parameters of `Calibration`, such as `ridge`.

    Returns
    -------
    dict
        ``grouped`` and ``random``: for each axis ``rms`` and ``bias``, predicted minus measured, in N and N·m;
        ``groups``, ``folds``, ``rows``, and the ``undetermined`` groups, without which the model cannot be fitted.
    """
    if model == "auto":
        raise OptionError("cross_validate is for one model; choose_model compares all")
    options = {"covariance": "none", **options, "cv": True if folds is None else folds}
    fitted = Calibration(model, **options).fit(X, y, sample_weight, groups=groups)
    found: dict[str, Any] = fitted.diagnostics_["cross_validation"]
    return found


def choose_model(
    X: Any, y: Any, groups: Any, *, sample_weight: Any = None, **options: Any
) -> Calibration:
    """Fits and returns the smallest model that predicts new groups as well as the best one.

    `diagnostics_["selection"]` has all candidates with their errors. `X`, `y`, `groups` and
    `sample_weight` are as for `Calibration.fit`, `options` as for `Calibration`.
    """
    return Calibration("auto", **options).fit(X, y, sample_weight, groups=groups)
