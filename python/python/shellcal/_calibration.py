"""Calibrations: from readings to wrenches, with errors that can be trusted."""

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
        ``"auto"`` compares all on held-out groups (`groups`, or plateaus, or stretches of time) and takes the
        smallest polynomial that predicts them as well as the best, with its ridge, or the physics model
        where that predicts them better. ``"physics"`` is what photointerrupters answer to a wrench,
        inverted: for few poses, and for loads beyond them. It holds all rows in memory, takes some seconds,
        and has no use for `intercept`, `ridge`, `solver`, `truncate` and `covariance`.
    intercept : bool
        Whether to fit a constant.
    ridge : float
        λ ≥ 0 of a penalty on coefficients, relative to features of norm one.
    solver : str
        ``"exact"`` unless told otherwise: sums of integers without rounding, right to the last place, the
        same bits for any order of the rows. Readings that are no counts of a converter are solved by
        refined QR, with a warning where that loses digits. The others are those of ``shellcal fit --solver``.
    truncate : float, optional
        With ``solver="svd"``: leaves out directions whose singular value is below this share of the
        largest.
    lag : float or "auto"
        How much later than the readings the reference shows a load, s; rows, without `time`. ``"auto"`` finds it.
    memory_terms : sequence of float or "auto"
        Time constants, s, of the terms ``s - EMA(s)`` that each channel gets; rows, without `time`. ``"auto"`` takes
        those that lower the errors on rows that were held out. Rows have to be in the order of time.
    cv : bool or int
        Whether `fit` finds the errors on held-out groups, too: each group alone, or in so many folds. With
        ``model="auto"`` it does in any case.
    covariance : {"auto", "groups", "rows", "none"}
        What standard errors come from: ``"auto"`` takes groups where there are ten, rows otherwise.
    seed : int
        How rows are assigned to the random split that `cv` compares with.
    threads : int
        0 for one per core. No result depends on it.
    serial : str, optional
        The label of the sensor, for the file.

    Attributes
    ----------
    n_features_in_ : int
        Channels.
    document_ : dict
        All that the calibration file says: coefficients, diagnostics, covariance.
    coefficients_ : ndarray of shape (terms, 6)
        For readings ``z = (s - centre) / scale``, in N and N·m. The physics model has none.
    terms_ : list of str
        The feature of each row of `coefficients_`.
    diagnostics_ : dict
        Rows, rank, condition and errors, also on held-out groups.
    verdict_ : list of str
        What the calibration is worth: the error on data that were not used for the fit, the 95 % interval of
        a sample, what to use it for, what to record next.
    """

    document_: dict[str, Any]
    n_features_in_: int
    verdict_: list[str]
    feature_names_in_: Any
    _fitted: Fitted
    _outputs: int | None
    #: Some of the rows, for the figure; or the figure.
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

    # What scikit-learn asks of an estimator, without importing it.

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

    # From rows to a calibration.

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
            Readings, counts: one row per sample. Not copied where it is of `float64`, whatever its strides.
        y : array of shape (n, 6)
            The wrench that the reference measured: Fx, Fy, Fz in N, Mx, My, Mz in N·m. Fewer columns are
            taken as the first of these.
        sample_weight : array of shape (n,), optional
            Whole numbers say how often each row is there: everything is, to the last bit, that of a fit to
            rows repeated so often, and takes as long. Other numbers w weight the squares of errors, as if
            the variance of a row were divided by w; standard errors are those of a sample of weight 1.
            No sum of such rows is exact: they are solved by refined QR, with a warning, without `cv`, `ridge` or
            errors by group, and ``"auto"`` takes the cubic model. Diagnostics count every row once. 0 leaves a row out.
        groups : array of shape (n,), optional
            A label per row of what resembles each other: pose, session, file. Standard errors, held-out
            errors and the choice of a model come from these.

        Returns
        -------
        Calibration
            This one.

        Raises
        ------
        ArrayError
            Of the shape, type or content of an array.
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
        # Of rows that are not one after the other nothing is remembered.
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

    # From readings to wrenches.

    def predict(
        self,
        X: Any,
        return_std: bool = False,
        interval: float | None = None,
        *,
        time: Any = None,
    ) -> Any:
        """The wrench of every row, without a tare.

        Parameters
        ----------
        X : array of shape (n, channels)
            Readings, counts.
        return_std : bool
            Also give standard errors.
        interval : float, optional
            Also give the bounds of the interval that holds this share of new samples, such as 0.95.
        time : array of shape (n,), optional
            The time of each row, s, which memory terms take; rows are then those of one recording, in order. Where the
            reference lagged, wrenches are those that it shows at these times.

        Returns
        -------
        wrench : ndarray of shape (n, axes)
            Fx, Fy, Fz in N, Mx, My, Mz in N·m, those that the calibration has; of shape (n,) after a fit to a single column.
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
        """The wrench of one frame, with the bits of `predict`, at the cost of one: for loops that wait for it.

        Memory terms go on from the frame before, and start anew where time jumps, as at the start of a log: for two boards
        load the calibration twice. With a lag it is the wrench at the time of the readings, which `predict` moves.

        Parameters
        ----------
        readings : sequence of float
            One for each channel.
        time : float, optional
            When it was taken, s; of a calibration with memory terms.
        """
        return self._known().convert(readings, time)

    def out_of_range(self, X: Any) -> Any:
        """For each row, whether a reading is outside the range of the training data."""
        fitted = self._known()
        return np.asarray(fitted.out_of_range(_arrays.readings(X, fitted.channels())))

    def score(self, X: Any, y: Any, sample_weight: Any = None, *, time: Any = None) -> float:
        """R², the mean of the axes: 1 is perfect, 0 no better than the mean load. Squares are weighted by
        `sample_weight`."""
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

    # The file.

    @classmethod
    def load(cls, path: PathLike, *, edited: bool = False) -> Calibration:
        """The calibration in a file of ``shellcal fit`` or of `save`; with `edited`, one that was changed since."""
        return cls._of(Fitted.load(os.fspath(path), edited))

    @classmethod
    def from_json(cls, document: str | bytes, name: str = "<json>", *, edited: bool = False) -> Calibration:
        """The calibration in a document; with `edited`, in one that was changed since it was written."""
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
        """The document, as ``shellcal fit`` writes it."""
        return self._known().to_json()

    def save(self, path: PathLike) -> None:
        """Writes the document to a file, whole or not at all."""
        write_whole(path, self.to_json().encode())

    def __getstate__(self) -> dict[str, Any]:
        state = dict(self.__dict__)
        # The rows of the figure do not travel.
        state.pop("_shown", None)
        if "_fitted" in state:
            state["_fitted"] = state["_fitted"].to_json()
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._shown = None
        if "_fitted" in state:
            self._fitted = Fitted.parse(state["_fitted"].encode(), "<pickle>", False)

    # What it says of itself.

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


#: Rows in the figure of a notebook.
_SHOWN = 4000


def _some_rows(
    readings: _arrays.Matrix, wrench: _arrays.Matrix
) -> tuple[_arrays.Matrix, _arrays.Matrix]:
    """Rows for a figure: all, or some at random, the same every time."""
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
