#!/usr/bin/env python3
"""The choice of a model with scikit-learn: five families of features and five ridges are compared by folds of blocks of
time, the best is fitted to all rows and tested. For `bench.py choice`; prints the choice and its errors as JSON.

usage: choice_sklearn.py TRAIN.csv TEST.csv
"""

import itertools
import json
import sys

import numpy as np
import pandas
from sklearn.linear_model import Ridge
from sklearn.model_selection import GridSearchCV, GroupKFold
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, PolynomialFeatures, StandardScaler

WRENCH = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"]
SENSORS = [f"s{channel}" for channel in range(8)]
STRETCHES, FOLDS = 40, 10
RIDGES = [1e-12, 1e-8, 1e-6, 1e-4, 1e-2]


def powers(readings: np.ndarray) -> np.ndarray:
    return np.hstack([readings, readings**2, readings**3])


def powers_and_products(readings: np.ndarray) -> np.ndarray:
    pairs = itertools.combinations(range(readings.shape[1]), 2)
    return np.hstack([powers(readings), *(readings[:, [i]] * readings[:, [j]] for i, j in pairs)])


FAMILIES = {
    "linear": PolynomialFeatures(1, include_bias=False),
    "cubic": FunctionTransformer(powers),
    "quadratic": PolynomialFeatures(2, include_bias=False),
    "cubic+products": FunctionTransformer(powers_and_products),
    "poly3": PolynomialFeatures(3, include_bias=False),
}


def main(train: str, test: str) -> None:
    rows, tested = (pandas.read_csv(path) for path in (train, test))
    wrench = rows[WRENCH].to_numpy()
    # Every axis counts the same.
    scale = wrench.std(axis=0)
    pipeline = make_pipeline(StandardScaler(), FAMILIES["linear"], StandardScaler(), Ridge())
    # A ridge refers to columns with norm one.
    alphas = [ridge * len(rows) * (1 - 1 / FOLDS) for ridge in RIDGES]
    grid = {"polynomialfeatures": list(FAMILIES.values()), "ridge__alpha": alphas}
    groups = np.arange(len(rows)) * STRETCHES // len(rows)
    search = GridSearchCV(pipeline, grid, scoring="neg_mean_squared_error", cv=GroupKFold(FOLDS), n_jobs=-1)
    search.fit(rows[SENSORS].to_numpy(), wrench / scale, groups=groups)
    errors = search.predict(tested[SENSORS].to_numpy()) * scale - tested[WRENCH].to_numpy()
    chosen = search.best_params_["polynomialfeatures"]
    name = next(name for name, family in FAMILIES.items() if family is chosen or repr(family) == repr(chosen))
    print(json.dumps({"family": name, "rms": np.sqrt((errors**2).mean(axis=0)).tolist()}))


main(*sys.argv[1:])
