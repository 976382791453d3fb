"""How far a model may be trusted on poses that it has not seen, and which model to take."""

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
    """Errors on groups that were held out, beside those on rows that were held out at random.

    Parameters
    ----------
    X, y, groups, sample_weight
        As for `Calibration.fit`; `groups` have to be given.
    model : str
        As for `Calibration`.
    folds : int, optional
        Folds of groups; each group alone unless told otherwise.
    options
        Further parameters of `Calibration`, such as `ridge`.

    Returns
    -------
    dict
        ``grouped`` and ``random``: for each axis ``rms`` and ``bias``, predicted less measured, in N and
        N·m; ``groups``, ``folds``, ``rows``, and the groups that are ``undetermined``: without them the
        model cannot be fitted.
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
    """The smallest model that predicts new groups as well as the best of them, fitted.

    `diagnostics_["selection"]` has all candidates with their errors. `X`, `y`, `groups` and
    `sample_weight` are as for `Calibration.fit`, `options` as for `Calibration`.
    """
    return Calibration("auto", **options).fit(X, y, sample_weight, groups=groups)
