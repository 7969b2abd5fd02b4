"""A surrogate as plain numbers, so that a page can ask it what the outputs would be for other values of the factors.

Components are learnt one by one: outputs as they are, orders as the cosine and sine parts of their waves, which are
smooth where amplitude and phase are not. Each is a polynomial of the third degree or a Gaussian process, whichever
misses less at points that it has not seen. These misses go with it, so that a page can draw bands around its answers.
"""

from __future__ import annotations

import json
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from tripod_doe.analyses.outputs import OutputTable
from tripod_doe.analyses.sample import Sample
from tripod_doe.analyses.sensitivity.distributions import SAMPLED_DESIGNS
from tripod_doe.array_types import FloatArray, IntArray

ATTRIBUTE = "what_if"
"""Attribute of a result that holds all that is no array."""

_DEGREE = 3
_MOST_TERMS = 1000  # of a polynomial; more inputs get one of the second degree
_PROCESS_POINTS = 300  # that a Gaussian process learns from: the page evaluates all of them
_SHOWN_POINTS = 2000  # computed points that a page can show and take bands from
_MOST_COMPONENTS = 26  # thirteen orders, two parts each
_FOLDS = 5
_TOGETHER = 500  # points that are predicted at once
_LEAST_NOISE = 1e-7  # part of the variance; with less, weights grow until their sum loses the digits of a page
_MINOR = 1e-3  # spread over the largest one below which a component is worth no Gaussian process
_AMPLITUDE, _PHASE = "thrust_amplitude", "thrust_phase_deg"


@dataclass(frozen=True)
class Component:
    """One number that is learnt."""

    label: str  # of the output, or of the part of an order
    unit: str  # its unit
    order: int | None = None  # the order of which it is a part; None for other outputs


@dataclass(frozen=True)
class WhatIf:
    """A surrogate that can be asked."""

    # for each input its factor and either the middle and half of the range of its numbers, or the word that it is 1 for
    inputs: list[dict[str, Any]]
    # for each factor its unit, range, mean and standard deviation over the computed points, or its words
    factors: dict[str, dict[str, Any]]
    components: list[Component]  # what it predicts; the cosine parts of orders come before their sine parts
    exponents: NDArray[np.int8]  # of the terms of polynomials, shape (term, input)
    coefficients: FloatArray  # shape (component, term); 0 for Gaussian processes
    learnt: FloatArray  # inputs that the Gaussian processes learnt from, shape (learnt, input)
    weights: FloatArray  # shape (component, learnt); 0 for polynomials
    lengths: FloatArray  # length scales of Gaussian processes, shape (component, input)
    # places, values, misses: computed points: their inputs, what they gave, and by how much a surrogate without them
    # was too large, shape (computed, input or component)
    places: FloatArray
    values: FloatArray
    misses: FloatArray
    sampled: bool  # whether the computed points follow distributions of independent factors

    def predict(self, places: FloatArray) -> FloatArray:
        """All components at some inputs, shape (point, input) -> (point, component)."""
        parts = [self._predict(places[start : start + _TOGETHER]) for start in range(0, len(places), _TOGETHER)]
        return np.concatenate(parts)

    def _predict(self, places: FloatArray) -> FloatArray:
        terms = np.prod(places[:, None, :] ** self.exponents, axis=2)
        found = terms @ self.coefficients.T
        for at in np.flatnonzero(self.weights.any(axis=1)):
            gap = (places[:, None, :] - self.learnt) / self.lengths[at]
            found[:, at] += np.exp(-0.5 * (gap**2).sum(axis=2)) @ self.weights[at]
        return np.asarray(found)

    def encoded(self, **values: float | str) -> FloatArray:
        """One point as inputs, shape (1, input)."""
        row = [
            float(values[entry["factor"]] == entry["word"])
            if "word" in entry
            else (float(values[entry["factor"]]) - entry["middle"]) / entry["half"]
            for entry in self.inputs
        ]
        return np.array([row])


def neighbours(count: int) -> int:
    """How many of the nearest computed points a band is taken from."""
    return min(max(12, count // 20), count - 1)


def what_if(sample: Sample, tables: list[OutputTable], cube: xr.Dataset, seed: int) -> xr.Dataset:
    """The surrogate of the main outputs as variables and one attribute of a result.

    Parameters
    ----------
    sample
        The points to learn from.
    tables
        The outputs that are asked for; with thrust_amplitude and its phases in the cube, the waves of the orders.
    cube
        The cube of the points.
    seed
        Of the division into parts that are predicted by the others.
    """
    inputs, factors, places = _encoded(sample, cube)
    components, values = _components(tables, cube, sample.rows)
    exponents = _exponents(places.shape[1])
    learnt = np.arange(len(places) if len(places) <= _PROCESS_POINTS else 0)
    weights, lengths = np.zeros((len(components), learnt.size)), np.ones((len(components), places.shape[1]))
    with warnings.catch_warnings(), threadpool_limits(1):  # small problems: threads would wait for each other
        warnings.simplefilter("ignore")  # a length scale at its bound: its misses tell
        coefficients, misses = _polynomials(places, values, exponents, seed)
        spread = values.std(axis=0)
        for at in np.flatnonzero(spread > _MINOR * spread.max()) if learnt.size else ():
            constant, own, scales, unseen = _process(places, values[:, at], seed)
            if (unseen**2).mean() < (misses[:, at] ** 2).mean():
                coefficients[at] = np.eye(1, len(exponents))[0] * constant
                weights[at], lengths[at], misses[:, at] = own, scales, unseen
    shown = np.arange(min(_SHOWN_POINTS, len(places)))
    told = {
        "inputs": inputs,
        "factors": factors,
        "sampled": sample.design.kind in SAMPLED_DESIGNS and not sample.design.correlation,
        "components": [[each.label, each.unit, each.order] for each in components],
    }
    data = {
        "what_if_exponents": (("what_if_term", "what_if_input"), exponents),
        "what_if_coefficients": (("what_if_component", "what_if_term"), coefficients),
        "what_if_learnt": (("what_if_learnt_point", "what_if_input"), places[learnt]),
        "what_if_weights": (("what_if_component", "what_if_learnt_point"), weights),
        "what_if_lengths": (("what_if_component", "what_if_input"), lengths),
        "what_if_places": (("what_if_point", "what_if_input"), places[shown]),
        "what_if_values": (("what_if_point", "what_if_component"), values[shown]),
        "what_if_misses": (("what_if_point", "what_if_component"), misses[shown]),
    }
    result = xr.Dataset(data, attrs={ATTRIBUTE: json.dumps(told)})
    for name in result.data_vars:
        result[name].attrs["long_name"] = f"surrogate of the page: {str(name).removeprefix('what_if_')}"
    return result


def read_what_if(result: xr.Dataset) -> WhatIf | None:
    """The surrogate in the result of an analysis; None where it has none."""
    if ATTRIBUTE not in result.attrs:
        return None
    told = json.loads(result.attrs[ATTRIBUTE])
    names = ("exponents", "coefficients", "learnt", "weights", "lengths", "places", "values", "misses")
    arrays = {name: result[f"what_if_{name}"].values for name in names}
    return WhatIf(
        told["inputs"],
        told["factors"],
        [Component(*each) for each in told["components"]],
        **arrays,
        sampled=told["sampled"],
    )


def _encoded(sample: Sample, cube: xr.Dataset) -> tuple[list[dict[str, Any]], dict[str, dict[str, Any]], FloatArray]:
    """Inputs, factors, and the points as inputs from -1 to 1, a column for each word but the first."""
    inputs: list[dict[str, Any]] = []
    factors: dict[str, dict[str, Any]] = {}
    columns = []
    for name, column in sample.columns.items():
        unit = str(cube[name].attrs.get("units", "1"))
        if column.dtype.kind in "fiu":
            numbers = column.astype(float)
            low, high = float(numbers.min()), float(numbers.max())
            middle, half = (low + high) / 2, (high - low) / 2 or 1.0
            inputs.append({"factor": name, "middle": middle, "half": half})
            columns.append((numbers - middle) / half)
            factors[name] = {
                "unit": unit,
                "low": low,
                "high": high,
                "mean": float(numbers.mean()),
                "std": float(numbers.std()),
                "whole": bool((numbers % 1 == 0).all()),
            }
        else:
            words = [str(word) for word in np.unique(column.astype(str))]
            inputs += [{"factor": name, "word": word} for word in words[1:]]
            columns += [(column.astype(str) == word).astype(float) for word in words[1:]]
            factors[name] = {"unit": "", "words": words}
    return inputs, factors, np.stack(columns, axis=1)


def _components(tables: list[OutputTable], cube: xr.Dataset, rows: IntArray) -> tuple[list[Component], FloatArray]:
    """What is learnt, with its values, shape (point, component)."""
    if any(table.name == _AMPLITUDE for table in tables) and _PHASE in cube:
        amplitude, phase = (cube[name].isel(point=rows).values.astype(float) for name in (_AMPLITUDE, _PHASE))
        wave = amplitude * np.exp(1j * np.radians(phase))
        unit, orders = str(cube[_AMPLITUDE].attrs.get("units", "1")), cube["order"].values.tolist()
        parts = [("cosine", wave.real), ("sine", wave.imag)]
        components = [Component(f"{part} part of order {order}", unit, order) for part, _ in parts for order in orders]
        return components, np.concatenate([values for _, values in parts], axis=1)
    components, columns = [], []
    for table in tables:
        unit = str(table.variable.attrs.get("units", "1"))
        labels = table.keys[1:] if len(table.keys) - 1 == table.values.shape[1] else _numbered(table)
        for at in np.flatnonzero(table.varies):
            components.append(Component(labels[at], unit))
            columns.append(table.values[:, at] + table.centre[at])
    return components[:_MOST_COMPONENTS], np.stack(columns[:_MOST_COMPONENTS], axis=1)


def _numbered(table: OutputTable) -> list[str]:
    count = table.values.shape[1]
    return [table.name] if count == 1 else [f"{table.name} {at}" for at in range(count)]


def _exponents(width: int) -> NDArray[np.int8]:
    """Exponents of all terms of a polynomial, the constant first, shape (term, input)."""
    from sklearn.preprocessing import PolynomialFeatures

    terms = PolynomialFeatures(_DEGREE).fit(np.zeros((1, width)))
    if terms.n_output_features_ > _MOST_TERMS:
        terms = PolynomialFeatures(_DEGREE - 1).fit(np.zeros((1, width)))
    return np.asarray(terms.powers_, np.int8)


def _polynomials(
    places: FloatArray, values: FloatArray, exponents: NDArray[np.int8], seed: int
) -> tuple[FloatArray, FloatArray]:
    """Coefficients of all components, shape (component, term), and what they miss at unseen points."""
    from sklearn.linear_model import RidgeCV
    from sklearn.model_selection import KFold, cross_val_predict

    terms = np.prod(places[:, None, :] ** exponents[1:], axis=2)
    scale = np.where(values.std(axis=0) > 0, values.std(axis=0), 1.0)
    ridge = RidgeCV(np.logspace(-8, 2, 11), alpha_per_target=True)
    folds = KFold(_FOLDS, shuffle=True, random_state=seed)
    unseen = cross_val_predict(ridge, terms, values / scale, cv=folds).reshape(values.shape)
    ridge.fit(terms, values / scale)
    found = np.concatenate([np.reshape(ridge.intercept_, (-1, 1)), np.atleast_2d(ridge.coef_)], axis=1)
    return found * scale[:, None], unseen * scale - values


def _process(places: FloatArray, values: FloatArray, seed: int) -> tuple[float, FloatArray, FloatArray, FloatArray]:
    """Constant, weights and length scales of one component, and what it misses at unseen points.

    The length scales are those of all points; what is unseen are the values.
    """
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
    from sklearn.model_selection import KFold, cross_val_predict

    kernel = ConstantKernel(1.0, (1e-3, 1e2)) * RBF(np.ones(places.shape[1]), (1e-2, 1e2))
    process = GaussianProcessRegressor(kernel + WhiteKernel(1e-6, (_LEAST_NOISE, 1.0)), normalize_y=True)
    process.fit(places, values)
    fixed = GaussianProcessRegressor(process.kernel_, optimizer=None, normalize_y=True)
    folds = KFold(_FOLDS, shuffle=True, random_state=seed)
    unseen = cross_val_predict(fixed, places, values, cv=folds)
    smooth = process.kernel_.k1
    weights = process.alpha_ * smooth.k1.constant_value * process._y_train_std
    return float(process._y_train_mean), weights, smooth.k2.length_scale, unseen - values
