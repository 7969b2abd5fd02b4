"""Gaussian processes and polynomials of numbers over encoded factors: of each number whichever predicts better.

A surrogate is plain numbers, so that a page can evaluate it. Its errors are those at points that it was not fitted to.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from tripod_doe.array_types import FloatArray, IntArray

KINDS = ("polynomial", "gaussian-process")
"""Kinds of surrogates, in the order of their flags."""

LEAST_SCALE = 0.01
"""Of an envelope; where it is less, the rounding of values over it would be learned."""

_DEGREE = 3
_MOST_TERMS = 1000  # of a polynomial; more inputs get one of the second degree
_PROCESS_POINTS = 300  # for a Gaussian process: a page evaluates all of them
_TOGETHER = 50_000_000  # numbers that are in memory at a time
_MOST_INPUTS, _MOST_WORK = 200, 2_000_000  # of a surrogate that is read, and centres, inputs and components: some 10 s
_LEAST_NOISE = 1e-7  # part of the variance; with less, weights grow until their sum loses the digits of a page
_FEWEST_LEVELS = 5  # of an input that is asked between them: with the inner ones left out, fewer tell of a line alone
_FEW_FOLDS = 3  # that compare envelopes
_MINOR = 1e-3  # spread over the largest one below which a component is worth no Gaussian process


Fold = tuple[IntArray, IntArray]
"""Points that are seen, and points that are left out."""


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

    @cached_property
    def _factors(self) -> IntArray:
        """Inputs that are multiplied in each term, shape (term, degree); the number of inputs stands for 1."""
        terms, width = self.exponents.shape
        factors = np.full((terms, self.exponents.sum(axis=1).max(initial=0)), width)
        for row, powers in zip(factors, self.exponents, strict=True):
            row[: powers.sum()] = np.repeat(np.arange(width), powers)
        return factors

    def predict(self, places: FloatArray) -> FloatArray:
        """All components at some inputs, shape (point, input) -> (point, component)."""
        together = max(1, _TOGETHER // (self._factors.size + len(self.centres) + 1))
        parts = [self._predict(places[start : start + together]) for start in range(0, len(places), together)]
        return np.concatenate(parts)

    def _predict(self, places: FloatArray) -> FloatArray:
        from scipy.spatial.distance import cdist  # slow to import: few pages have such a part

        columns = np.column_stack([places, np.ones(len(places))])
        answers = columns[:, self._factors].prod(axis=2) @ self.coefficients.T
        for at in np.flatnonzero(self.kinds):
            gap = cdist(places / self.lengths[at], self.centres / self.lengths[at], "sqeuclidean")
            answers[:, at] += np.exp(-0.5 * gap) @ self.weights[at]
        return np.asarray(answers)

    def refuse_strange(self, inputs: int, components: int, points: int) -> None:
        """Refuse (ValueError) surrogates of other sizes than `learn` gives, and those that would take long."""
        terms, centres = len(self.exponents), len(self.centres)
        refuse_unlike("exponents", self.exponents, (terms, inputs), "i")
        refuse_unlike("coefficients", self.coefficients, (components, terms))
        refuse_unlike("centres", self.centres, (centres, inputs))
        refuse_unlike("weights", self.weights, (components, centres))
        refuse_unlike("lengths", self.lengths, (components, inputs))
        refuse_unlike("errors", self.errors, (points, components))
        if (self.exponents < 0).any() or (self.exponents.sum(axis=1) > _DEGREE).any() or (self.lengths <= 0).any():
            raise ValueError("an exponent or a length is out of range")
        most = max(_MOST_TERMS, comb(inputs + _DEGREE - 1, _DEGREE - 1))
        if inputs > _MOST_INPUTS or terms > most or self.centres.size * components > _MOST_WORK:
            raise ValueError(f"too large: {inputs} inputs, {terms} terms, {centres} centres, {components} components")


def refuse_unlike(name: str, values: NDArray[Any], shape: tuple[int, ...], kind: str = "f") -> None:
    """Refuse (ValueError) an array of another shape or kind, or with values that are not finite."""
    if values.shape != shape or values.dtype.kind != kind or not np.isfinite(values).all():
        raise ValueError(f"{name}: expected finite numbers of the shape {shape}")


@dataclass(frozen=True)
class Known:
    """Zeros and mirrors of components, known before anything is learned."""

    # envelope: a function of the point, shape (point,), that is zero where the components marked by `vanishes` are;
    # these are learned over it
    envelope: FloatArray
    vanishes: NDArray[np.bool_]  # shape (component,)
    mirrored: IntArray  # inputs that change their sign together
    parity: IntArray  # 1 for components that stay as they are then, -1 for those that change sign, else 0

    @classmethod
    def nothing(cls, points: int, components: int) -> Known:
        """Without knowledge."""
        no = np.zeros(components, np.int64)
        return cls(np.ones(points), no.astype(bool), no[:0], no)

    def scale(self, component: int) -> FloatArray:
        """What a component is learned over, shape (point,); 1 where it is learned as it is."""
        return self.envelope if self.vanishes[component] else np.ones_like(self.envelope)

    def flipped(self, places: FloatArray) -> FloatArray:
        """Places on the other side of the mirror."""
        other = places.copy()
        other[:, self.mirrored] *= -1
        return other


def learn(places: FloatArray, values: FloatArray, seed: int, folds: int = 5, known: Known | None = None) -> Surrogates:
    """Fit a surrogate to each component.

    Args:
        places: Inputs from -1 to 1, shape (point, input).
        values: Shape (point, component).
        folds: Parts of the points, each predicted by a fit to the others.
        known: Zeros and symmetries, which the surrogates then have exactly. Components that vanish are given over the
            envelope, their errors are not.
    """
    known = known or Known.nothing(*values.shape)
    parts = _folds(places, known, seed, folds)
    exponents = _exponents(places.shape[1])
    centres = places if len(places) <= _PROCESS_POINTS else places[:0]
    if len(centres) and known.parity.any():
        centres = np.concatenate([centres, known.flipped(centres)])
    weights, lengths = np.zeros((values.shape[1], len(centres))), np.ones((values.shape[1], places.shape[1]))
    worth = values.std(axis=0) > _MINOR * values.std(axis=0).max()
    with warnings.catch_warnings(), threadpool_limits(1):  # small problems: threads would wait for each other
        warnings.simplefilter("ignore")  # a length scale at its bound shows in the errors
        coefficients, errors = _all_polynomials(places, values, exponents, parts, known)
        for at in map(int, np.flatnonzero(worth) if len(centres) else ()):
            other = known.flipped(places) if known.parity[at] else None
            process = _process(places, values[:, at], parts, known.scale(at), other, int(known.parity[at]))
            constant, own, scales, unseen = process
            if (unseen**2).mean() < (errors[:, at] ** 2).mean():
                coefficients[at] = np.eye(1, len(exponents))[0] * constant
                weights[at, : own.size], lengths[at], errors[:, at] = own, scales, unseen
    return Surrogates(exponents, coefficients, centres, weights, lengths, errors)


def polynomial_error(places: FloatArray, values: FloatArray, seed: int, known: Known) -> float:
    """Sum of the squared errors of polynomials at points left out of the fit; see `learn`."""
    with warnings.catch_warnings(), threadpool_limits(1):
        warnings.simplefilter("ignore")
        parts = _folds(places, known, seed, _FEW_FOLDS)
        return float((_all_polynomials(places, values, _exponents(places.shape[1]), parts, known)[1] ** 2).sum())


def _one_side(places: FloatArray, known: Known) -> FloatArray:
    """Places with their mirror images on the same side, where the surrogates are mirrored."""
    if not known.parity.any():
        return places
    numbers = places[:, known.mirrored]
    first = np.take_along_axis(numbers, (numbers != 0).argmax(axis=1)[:, None], axis=1)
    return np.where(first < 0, known.flipped(places), places)


def _folds(places: FloatArray, known: Known, seed: int, folds: int) -> list[Fold]:
    """Parts of the points, all points of a place in one of them, or they would be known there; then inner levels."""
    from sklearn.model_selection import KFold  # slow to import: every study would wait for it

    different, place = np.unique(_one_side(places, known), axis=0, return_inverse=True)
    count, place = len(different), place.ravel()
    if count == len(places):
        place = np.arange(count)
    parts = KFold(min(folds, count), shuffle=True, random_state=seed).split(np.arange(count))
    left_out = [np.isin(place, out) for _, out in parts] + _levels(places, folds)
    return [(np.flatnonzero(~out), np.flatnonzero(out)) for out in left_out]


def between_levels(column: NDArray[Any]) -> bool | None:
    """Whether levels that are left out tell how a surrogate errs between levels; None of a factor without levels."""
    levels, counts = np.unique(column, return_counts=True)
    if 2 * levels.size > column.size:
        return None
    return levels.size >= _FEWEST_LEVELS and 2 * int((counts + counts[::-1])[1:-1].max()) <= column.size


def _levels(places: FloatArray, folds: int) -> list[NDArray[np.bool_]]:
    """Points at inner levels of an input, shape (point,) each; symmetric ones tell of each other."""
    parts = []
    for column in places.T:
        if between_levels(column):
            levels, code = np.unique(column, return_inverse=True)
            depth = np.minimum(code, levels.size - 1 - code)  # from the ends
            several = min(int(depth.max()), folds)
            parts += [(depth > 0) & (depth % several == part) for part in range(several)]
    return parts


def _errors(values: FloatArray, parts: Sequence[Fold], predict: Callable[..., FloatArray]) -> FloatArray:
    """Errors at points that are left out, the largest of each; `predict` takes points that are seen, and these."""
    errors = np.zeros_like(values)
    for seen, out in parts:
        found = predict(seen, out) - values[out]
        errors[out] = np.where(np.abs(found) > np.abs(errors[out]), found, errors[out])
    return errors


def _exponents(width: int) -> NDArray[np.int8]:
    """Exponents of all terms of a polynomial, the constant first, shape (term, input)."""
    from sklearn.preprocessing import PolynomialFeatures

    terms = PolynomialFeatures(_DEGREE).fit(np.zeros((1, width)))
    if terms.n_output_features_ > _MOST_TERMS:
        terms = PolynomialFeatures(_DEGREE - 1).fit(np.zeros((1, width)))
    return np.asarray(terms.powers_, np.int8)


def _all_polynomials(
    places: FloatArray, values: FloatArray, exponents: NDArray[np.int8], parts: Sequence[Fold], known: Known
) -> tuple[FloatArray, FloatArray]:
    """Coefficients of all components, shape (component, term), only of terms that have their symmetry; and errors."""
    coefficients, errors = np.zeros((values.shape[1], len(exponents))), np.zeros(values.shape)
    odd = (exponents[:, known.mirrored].sum(axis=1) % 2).astype(bool)
    for parity, vanishes in sorted(set(zip(known.parity.tolist(), known.vanishes.tolist(), strict=True))):
        alike = np.flatnonzero((known.parity == parity) & (known.vanishes == vanishes))
        terms = np.flatnonzero({1: ~odd, -1: odd, 0: odd | True}[parity])
        scale = known.scale(int(alike[0]))
        fitted, unseen = _polynomials(places, values[:, alike], exponents[terms], parts, scale)
        coefficients[np.ix_(alike, terms)], errors[:, alike] = fitted, unseen
    return coefficients, errors


def _polynomials(
    places: FloatArray, values: FloatArray, exponents: NDArray[np.int8], parts: Sequence[Fold], scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Coefficients of all components over a scale, shape (component, term), and their errors at unseen points."""
    from sklearn.linear_model import RidgeCV

    terms = np.prod(places[:, None, :] ** exponents, axis=2)
    constant = not exponents[0].any()  # a component that changes sign has none
    size = np.where(values.std(axis=0) > 0, values.std(axis=0), 1.0)
    over = values / np.maximum(scale, LEAST_SCALE)[:, None] / size

    def fit(rows: IntArray) -> FloatArray:
        rows = rows[scale[rows] >= LEAST_SCALE]
        ridge = RidgeCV(np.logspace(-8, 2, 11), alpha_per_target=True, fit_intercept=constant)
        levels = [np.unique(column).size for column in places[rows].T]  # x^3 is x at -1, 0 and 1
        separable = np.flatnonzero((exponents < levels).all(axis=1))[int(constant) :]
        ridge.fit(terms[np.ix_(rows, separable)], over[rows], sample_weight=scale[rows] ** 2)
        slopes = np.zeros((values.shape[1], len(exponents)))
        slopes[:, 0] = ridge.intercept_  # 0 without a constant, whose place a term then has
        slopes[:, separable] = ridge.coef_
        return slopes

    errors = _errors(values, parts, lambda seen, out: scale[out, None] * (terms[out] @ fit(seen).T) * size)
    return fit(np.arange(len(places))) * size[:, None], errors


def _process(
    places: FloatArray,
    values: FloatArray,
    parts: Sequence[Fold],
    scale: FloatArray,
    other: FloatArray | None,
    parity: int,
) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """Constant, weights and length scales of one component over a scale, and its errors at unseen points.

    The length scales come from all points; each fold leaves out values only. With the places on the other side of a
    mirror, every point counts on both sides: the mean of the process then has the symmetry.
    """
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    over, usable = values / np.maximum(scale, LEAST_SCALE), scale >= LEAST_SCALE
    kernel = ConstantKernel(1.0, (1e-3, 1e2)) * RBF(np.ones(places.shape[1]), (1e-2, 1e2))
    whole = GaussianProcessRegressor(kernel + WhiteKernel(1e-6, (_LEAST_NOISE, 1.0)), normalize_y=True)
    whole.fit(places[usable], over[usable])

    def fit(rows: IntArray) -> GaussianProcessRegressor:
        rows = rows[usable[rows]]
        at, wanted = places[rows], over[rows]
        if other is not None:
            at, wanted = np.concatenate([at, other[rows]]), np.concatenate([wanted, parity * wanted])
        return GaussianProcessRegressor(whole.kernel_, optimizer=None, normalize_y=True).fit(at, wanted)

    errors = _errors(values, parts, lambda seen, out: scale[out] * fit(seen).predict(places[out]))
    process, smooth = fit(np.arange(len(places))), whole.kernel_.k1
    weights = np.zeros(len(places) if other is None else 2 * len(places))
    weights[np.flatnonzero(usable if other is None else np.tile(usable, 2))] = process.alpha_
    weights *= smooth.k1.constant_value * process._y_train_std
    return float(process._y_train_mean), weights, smooth.k2.length_scale, errors
