"""Surrogates of numbers over encoded factors: each a polynomial or a Gaussian process, whichever predicts better.

A surrogate is plain numbers, so that a page can evaluate it. Its errors are those at points that it was not fitted to.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from tripod_doe.array_types import FloatArray, IntArray

KINDS = ("polynomial", "gaussian-process")
"""Kinds of surrogates, in the order of their flags."""

_DEGREE = 3
_MOST_TERMS = 1000  # of a polynomial; more inputs get one of the second degree
_PROCESS_POINTS = 300  # for a Gaussian process: a page evaluates all of them
_TOGETHER = 500  # points that are predicted together
_LEAST_NOISE = 1e-7  # part of the variance; with less, weights grow until their sum loses the digits of a page
_MINOR = 1e-3  # spread over the largest one below which a component is worth no Gaussian process


@dataclass(frozen=True)
class Surrogates:
    """Surrogates of several components over the same inputs: the sum of a polynomial and of radial functions each."""

    exponents: NDArray[np.int8]  # of the terms of polynomials, shape (term, input)
    coefficients: FloatArray  # shape (component, term); only the constant for Gaussian processes
    centres: FloatArray  # inputs of the points of Gaussian processes, shape (centre, input)
    weights: FloatArray  # shape (component, centre); 0 for polynomials
    lengths: FloatArray  # length scales of Gaussian processes, shape (component, input)
    errors: FloatArray  # prediction less value at points left out of the fit, shape (point, component)

    @property
    def kinds(self) -> IntArray:
        """Position of each component's kind in `KINDS`."""
        return np.asarray(self.weights.any(axis=1), np.int64)

    def predict(self, places: FloatArray) -> FloatArray:
        """All components at some inputs, shape (point, input) -> (point, component)."""
        parts = [self._predict(places[start : start + _TOGETHER]) for start in range(0, len(places), _TOGETHER)]
        return np.concatenate(parts)

    def _predict(self, places: FloatArray) -> FloatArray:
        answers = np.prod(places[:, None, :] ** self.exponents, axis=2) @ self.coefficients.T
        for at in np.flatnonzero(self.kinds):
            gap = (places[:, None, :] - self.centres) / self.lengths[at]
            answers[:, at] += np.exp(-0.5 * (gap**2).sum(axis=2)) @ self.weights[at]
        return np.asarray(answers)


def learn(places: FloatArray, values: FloatArray, seed: int, folds: int = 5) -> Surrogates:
    """Fit a surrogate to each component.

    Parameters
    ----------
    places
        Inputs from -1 to 1, shape (point, input).
    values
        Shape (point, component).
    seed
        Of the division into folds.
    folds
        Parts of the points, each predicted by a fit to the others.
    """
    from sklearn.model_selection import KFold  # slow to import: every study would wait for it

    parts = KFold(min(folds, len(places)), shuffle=True, random_state=seed)
    exponents = _exponents(places.shape[1])
    centres = places if len(places) <= _PROCESS_POINTS else places[:0]
    weights, lengths = np.zeros((values.shape[1], len(centres))), np.ones((values.shape[1], places.shape[1]))
    with warnings.catch_warnings(), threadpool_limits(1):  # small problems: threads would wait for each other
        warnings.simplefilter("ignore")  # a length scale at its bound shows in the errors
        coefficients, errors = _polynomials(places, values, exponents, parts)
        spread = values.std(axis=0)
        for at in np.flatnonzero(spread > _MINOR * spread.max()) if len(centres) else ():
            constant, own, scales, unseen = _process(places, values[:, at], parts)
            if (unseen**2).mean() < (errors[:, at] ** 2).mean():
                coefficients[at] = np.eye(1, len(exponents))[0] * constant
                weights[at], lengths[at], errors[:, at] = own, scales, unseen
    return Surrogates(exponents, coefficients, centres, weights, lengths, errors)


def _exponents(width: int) -> NDArray[np.int8]:
    """Exponents of all terms of a polynomial, the constant first, shape (term, input)."""
    from sklearn.preprocessing import PolynomialFeatures

    terms = PolynomialFeatures(_DEGREE).fit(np.zeros((1, width)))
    if terms.n_output_features_ > _MOST_TERMS:
        terms = PolynomialFeatures(_DEGREE - 1).fit(np.zeros((1, width)))
    return np.asarray(terms.powers_, np.int8)


def _polynomials(
    places: FloatArray, values: FloatArray, exponents: NDArray[np.int8], parts: object
) -> tuple[FloatArray, FloatArray]:
    """Coefficients of all components, shape (component, term), and their errors at unseen points."""
    from sklearn.linear_model import RidgeCV
    from sklearn.model_selection import cross_val_predict

    terms = np.prod(places[:, None, :] ** exponents[1:], axis=2)
    scale = np.where(values.std(axis=0) > 0, values.std(axis=0), 1.0)
    ridge = RidgeCV(np.logspace(-8, 2, 11), alpha_per_target=True)
    unseen = cross_val_predict(ridge, terms, values / scale, cv=parts).reshape(values.shape)
    ridge.fit(terms, values / scale)
    coefficients = np.concatenate([np.reshape(ridge.intercept_, (-1, 1)), np.atleast_2d(ridge.coef_)], axis=1)
    return coefficients * scale[:, None], unseen * scale - values


def _process(places: FloatArray, values: FloatArray, parts: object) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """Constant, weights and length scales of one component, and its errors at unseen points.

    The length scales come from all points; each fold leaves out values only.
    """
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
    from sklearn.model_selection import cross_val_predict

    kernel = ConstantKernel(1.0, (1e-3, 1e2)) * RBF(np.ones(places.shape[1]), (1e-2, 1e2))
    process = GaussianProcessRegressor(kernel + WhiteKernel(1e-6, (_LEAST_NOISE, 1.0)), normalize_y=True)
    process.fit(places, values)
    fixed = GaussianProcessRegressor(process.kernel_, optimizer=None, normalize_y=True)
    unseen = cross_val_predict(fixed, places, values, cv=parts)
    smooth = process.kernel_.k1
    weights = process.alpha_ * smooth.k1.constant_value * process._y_train_std
    return float(process._y_train_mean), weights, smooth.k2.length_scale, unseen - values
