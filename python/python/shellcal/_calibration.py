"""Calibrations: conversion of readings to wrenches, with reliable error estimates."""

from __future__ import annotations

import inspect
import json
import os
import sys
import warnings
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _arrays, _html, _options, _progress
from ._errors import ArrayError, NotFittedError, OptionError, ShellcalWarning
from ._files import PathLike, write_whole
from ._native import Fitted
from ._native import fit as _fit
from ._origin import made_by


Rows = tuple[
    _arrays.Matrix,
    _arrays.Matrix,
    _arrays.Labels | None,
    npt.NDArray[np.uint32] | None,
    _arrays.Matrix | None,
    _arrays.Matrix | None,
]


class Calibration:
    """The calibration of an optical force/torque sensor, by exact least squares.

    Parameters
    ----------
    model : {"linear", "cubic", "quadratic", "cubic+products", "poly3", "auto", "physics"}
        ``"auto"`` compares all models on held-out groups (`groups`, or poses, or blocks of time). It takes the
        smallest polynomial that predicts them as well as the best, with its ridge, or the physics model if that
        predicts them better. ``"physics"`` inverts the response of photointerrupters to a wrench: for few poses, and
        for loads outside their range. It holds all rows in memory, takes some seconds, and does not use `intercept`,
        `ridge`, `solver`, `truncate` and `covariance`.
    intercept : bool
        Whether to fit a constant.
    ridge : float
        λ ≥ 0 of a penalty on coefficients, relative to features of norm one.
    solver : str
        ``"exact"`` by default: integer sums without rounding, exact to the last digit, with the same bits for any
        order of the rows. Readings that are not counts of a converter are solved by refined QR, with a warning if that
        loses digits. The others are those of ``shellcal fit --solver``.
    truncate : float, optional
        With ``solver="svd"``: leaves out directions with a singular value below this fraction of the largest.
    lag : float or "auto"
        Delay of the reference after the readings, s; in rows without `time`. ``"auto"`` estimates it.
    memory_terms : sequence of float or "auto"
        Time constants, s, of the terms ``s - EMA(s)`` that are added for each channel; in rows without `time`.
        ``"auto"`` takes those that lower the errors on held-out rows. Rows must be in the order of time.
    cv : bool or int
        Whether `fit` also computes errors on held-out groups: each group alone, or in this many folds. With
        ``model="auto"`` it always does.
    covariance : {"auto", "groups", "rows", "none"}
        Source of the standard errors: ``"auto"`` takes groups if there are at least ten, otherwise rows.
    seed : int
        Seed of the random split that `cv` compares with.
    threads : int
        Number of threads, 0 for one per core. No result depends on it.
    serial : str, optional
        The label of the sensor, for the file.

    Attributes
    ----------
    n_features_in_ : int
        Channels.
    document_ : dict
        The content of the calibration file: coefficients, diagnostics, covariance.
    coefficients_ : ndarray of shape (terms, 6)
        For readings ``z = (s - centre) / scale``, in N and N·m. Not available for the physics model.
    terms_ : list of str
        The feature of each row of `coefficients_`.
    diagnostics_ : dict
        Rows, rank, condition number and errors, also on held-out groups.
    verdict_ : list of str
        Assessment of the calibration: the error on data that were not used for the fit, the 95 % interval of a sample,
        suitable uses, and recommended further recordings.
    """

    document_: dict[str, Any]
    n_features_in_: int
    verdict_: list[str]
    feature_names_in_: Any
    _fitted: Fitted
    _outputs: int | None
    #: A sample of the rows for the figure; or the figure.
    _shown: tuple[_arrays.Matrix, _arrays.Matrix] | str | None

    def __init__(
        self,
        model: str = "auto",
        *,
        intercept: bool = True,
        ridge: float = 0.0,
        solver: str = "exact",
        truncate: float | None = None,
        lag: float | str = 0.0,
        memory_terms: Any = (),
        cv: bool | int = False,
        covariance: str = "auto",
        seed: int = 1,
        threads: int = 0,
        serial: str | None = None,
    ) -> None:
        self.model = model
        self.intercept = intercept
        self.ridge = ridge
        self.solver = solver
        self.truncate = truncate
        self.lag = lag
        self.memory_terms = memory_terms
        self.cv = cv
        self.covariance = covariance
        self.seed = seed
        self.threads = threads
        self.serial = serial

    # The interface of a scikit-learn estimator, without importing scikit-learn.

    @classmethod
    def _names(cls) -> list[str]:
        return sorted(name for name in inspect.signature(cls.__init__).parameters if name != "self")

    def get_params(self, deep: bool = True) -> dict[str, Any]:
        """The parameters by name."""
        return {name: getattr(self, name) for name in self._names()}

    def set_params(self, **params: Any) -> Calibration:
        """Sets parameters by name."""
        names = self._names()
        for name, value in params.items():
            if name not in names:
                raise OptionError(f"no parameter `{name}`, expected one of {', '.join(names)}")
            setattr(self, name, value)
        return self

    def __sklearn_tags__(self) -> Any:
        from sklearn.utils import InputTags, RegressorTags, Tags, TargetTags

        return Tags(
            estimator_type="regressor",
            target_tags=TargetTags(required=True, multi_output=True),
            input_tags=InputTags(),
            regressor_tags=RegressorTags(),
        )

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "_fitted")

    # Fitting

    def fit(
        self,
        X: Any,
        y: Any = None,
        sample_weight: Any = None,
        *,
        groups: Any = None,
        time: Any = None,
    ) -> Calibration:
        """Fits the model.

        Parameters
        ----------
        X : array of shape (n, channels)
            Readings, counts: one row per sample. Not copied if the type is `float64`, for any strides.
        y : array of shape (n, 6)
            The wrench measured by the reference: Fx, Fy, Fz in N, Mx, My, Mz in N·m. Fewer columns are the first of
            these.
        sample_weight : array of shape (n,), optional
            Integers are repetitions of a row: the result is, to the last bit, that of a fit to the repeated rows, and
            takes as long. Other numbers w weight the squares of errors, as if the variance of a row were divided by w;
            standard errors are for a sample of weight 1. Such rows have no exact sums: they are solved by refined QR,
            with a warning, without `cv`, `ridge` or errors by group, and ``"auto"`` takes the cubic model.
            Diagnostics count every row once. 0 leaves a row out.
        groups : array of shape (n,), optional
            A label per row for rows that resemble each other: pose, session, file. Standard errors, held-out errors and
            the choice of a model are based on these groups.

        Returns
        -------
        Calibration
            This calibration.

        Raises
        ------
        ArrayError
            If the shape, type or content of an array is unsuitable.
        FitError
            If the rows do not determine the coefficients.
        """
        names = _column_names(X)
        readings = _arrays.readings(X)
        count = readings.shape[0]
        wrench = _arrays.wrench(y, count)
        repeats, weights, kept = _arrays.weights(sample_weight, count)
        labels = _arrays.labels(groups, count)
        times = _arrays.times(time, count)
        if kept is not None and weights is not None:
            readings, wrench, weights = readings[kept], wrench[kept], weights[kept]
            labels = None if labels is None else (labels[0][kept], labels[1])
            times = None if times is None else times[kept]
        rows = (readings, wrench, labels, repeats, weights, times)
        with _progress.shown("fit", "row") as progress:
            fitted, messages, self.verdict_ = self._fit_rows(rows, progress)
        for message in messages:
            warnings.warn(message, ShellcalWarning, stacklevel=2)
        self._take(fitted)
        self._outputs = None if np.asarray(y).ndim == 1 else wrench.shape[1]
        # Without consecutive rows, memory terms cannot be evaluated.
        self._shown = None if fitted.has_memory() else _some_rows(readings, wrench)
        if names is not None:
            self.feature_names_in_ = names
        elif hasattr(self, "feature_names_in_"):
            del self.feature_names_in_
        return self

    def _fit_rows(self, rows: Rows, progress: Any) -> tuple[Fitted, list[str], list[str]]:
        if self.model == "physics":
            _options.physics(
                {
                    "ridge": _options.number("ridge", self.ridge) != 0.0,
                    "solver": self.solver != "exact",
                    "intercept": not self.intercept,
                    "truncate": self.truncate is not None,
                }
            )
        return _fit(
            rows,
            model=_options.text("model", self.model),
            intercept=bool(self.intercept),
            ridge=_options.number("ridge", self.ridge),
            solver=_options.text("solver", self.solver),
            truncate=None if self.truncate is None else _options.number("truncate", self.truncate),
            lag=None if self.lag == "auto" else _options.number("lag", self.lag),
            memory_terms=_options.time_constants(self.memory_terms),
            cross_validation=_options.folds(self.cv),
            seed=_options.count("seed", self.seed),
            covariance=_options.text("covariance", self.covariance),
            threads=_options.count("threads", self.threads, most=1024),
            made_by=made_by(),
            serial=self.serial,
            progress=progress,
        )

    def _take(self, fitted: Fitted) -> None:
        self._fitted = fitted
        self._shown = None
        self._outputs = len(_arrays.AXES)
        self.document_ = json.loads(fitted.to_json())
        self.n_features_in_ = fitted.channels()

    def _known(self) -> Fitted:
        if hasattr(self, "_fitted"):
            return self._fitted
        message = "this Calibration is not fitted yet: call `fit`, or `Calibration.load` a file"
        if "sklearn" in sys.modules:
            from sklearn.exceptions import NotFittedError as Expected

            raise Expected(message)
        raise NotFittedError(message)

    # Conversion of readings to wrenches

    def predict(
        self,
        X: Any,
        return_std: bool = False,
        interval: float | None = None,
        *,
        time: Any = None,
    ) -> Any:
        """Returns the wrench of every row, without a tare.

        Parameters
        ----------
        X : array of shape (n, channels)
            Readings, counts.
        return_std : bool
            Whether to return standard errors, too.
        interval : float, optional
            Level, such as 0.95, of intervals for new samples whose bounds are returned, too.
        time : array of shape (n,), optional
            The time of each row, s, which memory terms need; rows must then be those of one recording, in order. If the
            reference has a lag, the wrenches are those that it shows at these times.

        Returns
        -------
        wrench : ndarray of shape (n, axes)
            Fx, Fy, Fz in N, Mx, My, Mz in N·m, as far as the calibration has them; of shape (n,) after a fit to a single column.
        std : ndarray of that shape
            If `return_std`.
        lower, upper : ndarrays of that shape
            If `interval`.
        """
        fitted = self._known()
        self._check_names(X)
        readings = _arrays.readings(X, fitted.channels())
        if interval is not None and not 0.0 < _options.number("interval", interval) < 1.0:
            raise OptionError(f"interval is `{interval}`, expected a share between 0 and 1 such as 0.95")
        wants_errors = return_std or interval is not None
        if wants_errors and not fitted.has_standard_errors():
            raise OptionError(
                "this calibration has no standard errors",
                hint="fit with covariance=\"auto\", and with twice as many groups as features",
            )
        times = _arrays.times(time, readings.shape[0])
        wrench, std = fitted.predict(readings, wants_errors, times)
        found = [wrench]
        if return_std and std is not None:
            found.append(std)
        if interval is not None and std is not None:
            reach = std * np.asarray(fitted.interval_factors(float(interval)))
            found += [wrench - reach, wrench + reach]
        shaped = [self._shape(array) for array in found]
        return shaped[0] if len(shaped) == 1 else tuple(shaped)

    def _shape(self, wrench: _arrays.Matrix) -> _arrays.Matrix:
        if self._outputs is None:
            return wrench[:, 0]
        return wrench[:, : self._outputs]

    def convert(self, readings: Any, time: float | None = None) -> _arrays.Matrix:
        """Returns the wrench of one frame quickly, with the same bits as `predict`, for real-time loops.

        Memory terms continue from the previous frame, and restart when time jumps, as at the start of a log: for two
        boards, load the calibration twice. With a lag the wrench is at the time of the readings, which `predict` shifts.

        Parameters
        ----------
            One value per channel.
            One for each channel.
            Time of the frame, s; required for a calibration with memory terms.
            When it was taken, s; of a calibration with memory terms.
        """
        return self._known().convert(readings, time)

    def out_of_range(self, X: Any) -> Any:
        """Returns for each row whether a reading is outside the range of the training data."""
        fitted = self._known()
        return np.asarray(fitted.out_of_range(_arrays.readings(X, fitted.channels())))

    def score(self, X: Any, y: Any, sample_weight: Any = None, *, time: Any = None) -> float:
        """Returns R², the mean over the axes: 1 is perfect, 0 no better than the mean load. `sample_weight` weights
        the squares."""
        predicted = np.asarray(self.predict(X, time=time))
        predicted = predicted.reshape(predicted.shape[0], -1)
        measured = _arrays.wrench(y, predicted.shape[0])
        if measured.shape[1] != predicted.shape[1]:
            raise ArrayError(
                f"Y has {measured.shape[1]} columns, the calibration predicts {predicted.shape[1]}"
            )
        repeats, weights, _ = _arrays.weights(sample_weight, predicted.shape[0])
        each = repeats if weights is None else weights
        by_row = np.ones((predicted.shape[0], 1)) if each is None else each.reshape(-1, 1)
        middle = (by_row * measured).sum(axis=0) / by_row.sum()
        residual = (by_row * (measured - predicted) ** 2).sum(axis=0)
        spread = (by_row * (measured - middle) ** 2).sum(axis=0)
        of_axis = np.where(residual == 0.0, 1.0, 0.0)
        np.divide(residual, spread, out=of_axis, where=spread > 0.0)
        return float(np.where(spread > 0.0, 1.0 - of_axis, of_axis).mean())

    # Files

    @classmethod
    def load(cls, path: PathLike, *, edited: bool = False) -> Calibration:
        """Loads a calibration from a file of ``shellcal fit`` or `save`; with `edited`, a file changed since then."""
        return cls._of(Fitted.load(os.fspath(path), edited))

    @classmethod
    def from_json(cls, document: str | bytes, name: str = "<json>", *, edited: bool = False) -> Calibration:
        """Loads a calibration from a document; with `edited`, one changed since it was written."""
        data = document.encode() if isinstance(document, str) else document
        return cls._of(Fitted.parse(data, name, edited))

    @classmethod
    def _of(cls, fitted: Fitted) -> Calibration:
        new = cls()
        new._take(fitted)
        model = new.document_["model"]
        if isinstance(model, dict):
            new.model, new.intercept = model["basis"], model["intercept"]
        else:
            new.model = model
        solver = new.document_.get("solver")
        if solver is not None:
            new.solver, new.ridge = solver["name"], solver["ridge"]
        new.lag = (new.document_.get("lag") or {"by": 0.0})["by"]
        new.memory_terms = tuple((new.document_.get("memory") or {"time_constants": ()})["time_constants"])
        new.serial = new.document_.get("sensor_serial")
        return new

    def to_json(self) -> str:
        """Returns the document, as ``shellcal fit`` writes it."""
        return self._known().to_json()

    def save(self, path: PathLike) -> None:
        """Writes the document to a file, completely or not at all."""
        write_whole(path, self.to_json().encode())

    def __getstate__(self) -> dict[str, Any]:
        state = dict(self.__dict__)
        # The rows of the figure are not pickled.
        state.pop("_shown", None)
        if "_fitted" in state:
            state["_fitted"] = state["_fitted"].to_json()
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._shown = None
        if "_fitted" in state:
            self._fitted = Fitted.parse(state["_fitted"].encode(), "<pickle>", False)

    # Properties and display

    @property
    def diagnostics_(self) -> dict[str, Any]:
        self._known()
        found: dict[str, Any] = self.document_.get("diagnostics") or {}
        return found

    @property
    def coefficients_(self) -> _arrays.Matrix:
        self._known()
        return np.asarray(self._of_polynomial("coefficients"))

    @property
    def terms_(self) -> list[str]:
        self._known()
        terms: list[str] = self._of_polynomial("terms")
        return terms

    def _of_polynomial(self, field: str) -> Any:
        if field not in self.document_:
            raise AttributeError(
                f"a calibration by the physics model has no {field}: its parameters are in document_[\"physics\"]"
            )
        return self.document_[field]

    def __repr__(self) -> str:
        defaults = inspect.signature(type(self).__init__).parameters
        given = (name for name in self._names() if getattr(self, name) != defaults[name].default)
        return f"Calibration({', '.join(f'{name}={getattr(self, name)!r}' for name in given)})"

    def _repr_html_(self) -> str:
        if not hasattr(self, "_fitted"):
            return _html.escaped(f"{self!r}, not fitted")
        name = self._fitted.name()
        figure = self._shown
        if isinstance(figure, tuple):
            readings, wrench = figure
            of = self.diagnostics_.get("rows", 0)
            title = f"Calibration {name}"
            if len(readings) < of:
                title += f", {len(readings)} of {of} rows"
            figure = self._fitted.figure(readings, wrench, title)
        return _html.calibration(name, self.document_, figure)

    def _check_names(self, X: Any) -> None:
        known, found = getattr(self, "feature_names_in_", None), _column_names(X)
        if found is None and known is not None:
            warnings.warn(
                "X does not have valid feature names, but Calibration was fitted with feature names",
                UserWarning,
                stacklevel=3,
            )
        elif found is not None and known is None and hasattr(self, "_fitted"):
            warnings.warn(
                "X has feature names, but Calibration was fitted without feature names",
                UserWarning,
                stacklevel=3,
            )
        elif found is not None and known is not None and list(found) != list(known):
            raise ArrayError(
                "The feature names should match those that were passed during fit.\n"
                + _differences(list(known), list(found))
            )


#: Maximum number of rows in the figure of a notebook.
_SHOWN = 4000


def _some_rows(
    readings: _arrays.Matrix, wrench: _arrays.Matrix
) -> tuple[_arrays.Matrix, _arrays.Matrix]:
    """Returns the rows of a figure: all, or a reproducible random sample."""
    rows = len(readings)
    if rows <= _SHOWN:
        return readings.copy(), wrench.copy()
    places = np.random.default_rng(1).integers(0, rows, _SHOWN)
    return readings[places], wrench[places]


def _differences(known: list[str], found: list[str]) -> str:
    unseen = sorted(set(found) - set(known))
    missing = sorted(set(known) - set(found))
    text = ""
    if unseen:
        text += "Feature names unseen at fit time:\n" + "".join(f"- {name}\n" for name in unseen[:5])
    if missing:
        text += "Feature names seen at fit time, yet now missing:\n"
        text += "".join(f"- {name}\n" for name in missing[:5])
    if not unseen and not missing:
        text += "Feature names must be in the same order as they were in fit.\n"
    return text


def _column_names(X: Any) -> Any:
    columns = getattr(X, "columns", None)
    if columns is None or not all(isinstance(name, str) for name in columns):
        return None
    return np.asarray(list(columns), dtype=object)
