"""The error of each model of the joint at any operating point, from errors measured at other points.

`model_errors.csv` holds the third order of each model relative to `needles`, at operating points that cover the
field in which joints are used (`benchmarks/model_error.py` makes it from nine studies). At points without a `needles`
run, `equilibrium` is compared with `rollers`, and the typical error of `rollers` is added; `kinetostatic` is compared
with needles of constant skew, as in `rollers`, and its typical error against `needles` is added. The errors at the most
similar measured points give the estimate: the median is the typical error; the limit is the 90th percentile, each error
with the numerical error of its reference added, since below that nothing was measured. Similarity
uses the ratios on which the errors depend. The record contains few self-excited vibrations: `vibration_record` holds
the error that a balance makes by omitting vibration. Every error of a similar point is combined with every such error
of joints with similar angle and friction, unless a result says whether the joint vibrates. The error is unknown outside
the measured range, and if one of the two models has no result at most similar points.

Errors of the second order are recorded at points with a `needles` run of small numerical error. `similar_errors` gives
the errors of both orders at each similar point, to choose a model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.joint.known_errors.nearest import ALIKE, nearest_rows
from tripod_doe.joint.known_errors.operating_ratios import RATIOS, WEIGHTS, coordinates, has_no_thrust, operating_ratios
from tripod_doe.joint.known_errors.vibration_record import vibration_errors
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.model_interface import Accuracy, Quantity
from tripod_doe.number_text import value_range

RECORDED = Path(__file__).with_name("model_errors.csv")
"""File of the measured errors."""

COMPARED, FINEST = ("equilibrium", "kinetostatic", "rollers"), "needles"
"""Models, and the reference model of each measured error."""

WITHOUT_VIBRATION = ("equilibrium", "kinetostatic")
"""Models in which no joint vibrates by itself."""

QUANTITY = "third order"
"""The output and order whose errors every answer states."""

_FAR = 1e6
"""Coordinate of a ratio that has no logarithm: far from all measured points."""
_NO_REFERENCE = "this is the finest model, which the others are compared with"
_NOT_COMPARED = "it was not compared with the others"
WITHOUT_ITS_VIBRATION = "the joint vibrates by itself, and this model leaves the vibration out"
NOT_LOOKED_AT = "similar joints vibrate by themselves (the output vibrates shows whether these do)"
_NO_ANSWER = "for most of the similar points one of the models did not finish"


@dataclass(frozen=True)
class _Measured:
    """Points at which the models were compared."""

    names: tuple[str, ...]  # names of the ratios
    values: FloatArray  # of the ratios, shape (measured, ratio)
    places: FloatArray  # their coordinates, over the spread of each, shape (measured, ratio)
    spread: FloatArray  # standard deviations of the coordinates over their `WEIGHTS`, shape (ratio,)
    # by model: relative error of its third order, shape (measured,); NaN if one of the two models has no result,
    # infinite if not run
    errors: dict[str, FloatArray]
    inexact: FloatArray  # relative numerical error of the runs that they refer to, shape (measured,)
    # second over third order of `needles`, shape (measured,); NaN if its numerical error is too large
    second: FloatArray
    # by model: error of the second order over the third order of `needles`, shape (measured,)
    second_missed: dict[str, FloatArray]
    # the parameters that were varied, or set, shape (measured,) each; all others had their defaults
    given: dict[str, FloatArray]

    def ranges(self, model: str) -> tuple[FloatArray, FloatArray]:
        """Least and largest value of each ratio where a model was compared, shape (ratio,)."""
        values = self.values[~np.isinf(self.errors[model])]
        return values.min(axis=0), values.max(axis=0)

    def outside(self, ratio: int, low: float, high: float) -> str:
        """Reason for an unknown error if a ratio leaves its range."""
        name = self.names[ratio]
        meaning = "" if name in JOINT_PARAMETERS else f" ({RATIOS[name]})"
        return f"{name}{meaning} is outside of the compared range {value_range(low, high)}"

    def near(self, model: str, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Errors of a model at the measured points nearest to some places, and what they are at most.

        Shape (place, nearest) each.
        """
        asked = ~np.isinf(self.errors[model])
        nearest = nearest_rows(self.places[asked], places, ALIKE)
        errors = self.errors[model][asked][nearest]
        return errors, errors + self.inexact[asked][nearest]

    def over_allowed(self, model: str, quantity: Quantity, floor: float) -> FloatArray | None:
        """Errors of a model over the allowed error, shape (measured,), as `errors`; None if not measured."""
        if quantity.output != "thrust_amplitude" or quantity.label not in (2, 3):
            return None
        if quantity.label == 3:
            return self.errors[model] / quantity.allowed
        size = np.maximum(self.second, floor * np.maximum(1, self.second))
        return np.where(np.isnan(self.second), np.inf, self.second_missed[model] / (size * quantity.allowed))

    def speaks_of(self, points: Mapping[str, NDArray[Any]], asked: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether every parameter of a point is within its range at some measured points, shape (point,)."""
        inside = np.ones(len(points["torque_n_m"]), bool)
        for name, parameter in JOINT_PARAMETERS.items():
            if parameter.group == "numerics":
                continue
            if name in self.given:
                low, high = np.quantile(self.given[name][asked], [0.01, 0.99])  # a few points make no range
                inside &= (points[name] >= low) & (points[name] <= high)
            elif parameter.default is None:
                inside &= np.isnan(points[name])
            else:
                inside &= points[name] == parameter.default
        return inside


def _median_and_limit(errors: FloatArray, at_most: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Median of each row of errors, ninth decile of what they are at most; NaN if most numbers of the row are NaN."""
    return _quantile(errors, 0.5), _quantile(at_most, 0.9)


def _quantile(errors: FloatArray, share: float) -> FloatArray:
    """Quantile of each row, which is sorted in place; NaN if most numbers of the row are NaN."""
    errors.sort(axis=1)  # NaN last
    if np.isfinite(errors[:, -1]).all():  # the usual case: the quantile has the same index in all rows
        return errors[:, math.ceil(share * (errors.shape[1] - 1))]
    known = np.isfinite(errors).sum(axis=1)
    at = np.ceil(share * np.maximum(known - 1, 0)).astype(int)
    return np.where(2 * known > errors.shape[1], errors[np.arange(len(errors)), at], np.nan)


@cache
def _measured() -> _Measured:
    with RECORDED.open(encoding="utf-8") as file:
        table = np.genfromtxt(file, delimiter=",", names=True, skip_header=1)
    given = set(table.dtype.names or ())
    ratios = operating_ratios(
        {
            name: table[name] if name in given else parameter.column([parameter.default] * table.size)
            for name, parameter in JOINT_PARAMETERS.items()
        }
    )
    values, places = np.stack(list(ratios.values()), axis=1), coordinates(ratios)
    parameters = {name: table[name] for name in given if name in JOINT_PARAMETERS}
    second_missed = {model: np.abs(table[f"{model}_2"] - table["needles_2"]) for model in COMPARED}
    spread = places.std(axis=0) / [WEIGHTS.get(name, 1.0) for name in ratios]
    direct = table["needles"] == 1
    errors = {model: np.abs(table[model]) for model in COMPARED}
    errors["rollers"][~direct] = np.inf
    inexact = np.where(np.isnan(table["inexact"]), np.nanmedian(table["inexact"]), table["inexact"])
    measured = _Measured(
        tuple(ratios), values, places / spread, spread, errors, inexact, table["needles_2"], second_missed, parameters
    )
    errors["equilibrium"][~direct] += _quantile(measured.near("rollers", measured.places[~direct])[0], 0.5)
    beside = errors["kinetostatic"][~direct]
    errors["kinetostatic"][~direct] = np.inf  # only while its error against needles is looked up
    errors["kinetostatic"][~direct] = beside + _quantile(
        measured.near("kinetostatic", measured.places[~direct])[0], 0.5
    )
    return measured


def known_errors(model: str, points: Mapping[str, NDArray[Any]]) -> tuple[FloatArray, FloatArray, NDArray[np.object_]]:
    """Estimate the error of a model in the third order of some points.

    Args:
        model: Name of the model that simulates all these points.
        points: Every parameter by name, in the unit of its name, each of shape (point,).

    Returns:
        expected, limit, unknown: See `simulator.ModelErrors`; each of shape (point,).
    """
    vibration = vibration_errors(points)
    return errors_at(model, operating_ratios(points), vibration, np.zeros(len(vibration), bool))


def errors_at(
    model: str, ratios: Mapping[str, FloatArray], vibration: FloatArray, vibrates: NDArray[np.bool_]
) -> tuple[FloatArray, FloatArray, NDArray[np.object_]]:
    """As `known_errors`, of points with these ratios and errors by leaving out vibration (`vibration_errors`).

    At points that vibrate, the error of a model without vibration is unknown.
    """
    count = len(vibration)
    expected, limit = np.full((2, count), np.nan)
    if model not in COMPARED:
        return expected, limit, np.full(count, _NO_REFERENCE if model == FINEST else _NOT_COMPARED, object)
    measured = _measured()
    values = np.stack([ratios[name] for name in measured.names], axis=1)
    low, high = measured.ranges(model)
    inside = (values >= low) & (values <= high)
    within = inside.all(axis=1)
    near = measured.near(model, coordinates(ratios)[within] / measured.spread)
    expected[within], limit[within] = _median_and_limit(*near)
    if model in WITHOUT_VIBRATION:
        by_vibration = vibration[within]
        may = by_vibration.any(axis=1)
        rows = np.flatnonzero(within)[may]
        pairs = (rows.size, ALIKE * by_vibration.shape[1])
        both = [(each[may, :, None] + by_vibration[may, None, :]).reshape(pairs) for each in near]
        expected[rows], limit[rows] = _median_and_limit(*both)
    unknown = np.full(count, "", object)
    nothing = has_no_thrust(ratios)  # there all models agree
    expected[nothing], limit[nothing] = 0.0, 0.0
    unknown[np.isnan(expected)] = _NO_ANSWER
    for ratio in range(len(measured.names))[::-1]:  # the first of several reasons wins
        unknown[~inside[:, ratio] & ~nothing] = measured.outside(ratio, low[ratio], high[ratio])
    if model in WITHOUT_VIBRATION:
        unknown[vibrates], expected[vibrates], limit[vibrates] = WITHOUT_ITS_VIBRATION, np.nan, np.nan
    return expected, limit, unknown


def similar_errors(
    model: str, points: Mapping[str, NDArray[Any]], accuracy: Accuracy, vibrates: FloatArray | None = None
) -> FloatArray | None:
    """Errors of a model in the required quantities of a study, at the measured points most similar to each point.

    Args:
        model, points: As for `known_errors`.
        vibrates: Whether joints vibrate, 1 or 0; NaN to use similar recorded joints; shape (point,).

    Returns:
        Over the allowed errors, shape (point, similar, quantity); NaN if one of the two models has no result or the
        point is unlike the measured points: a parameter leaves its range, or the similar points are farther away than
        for nine of ten measured points. None if a quantity was not measured.
    """
    measured = _measured()
    known = model if model in COMPARED else COMPARED[0]
    by_quantity = [measured.over_allowed(known, quantity, accuracy.floor) for quantity in accuracy.quantities]
    recorded = [errors for errors in by_quantity if errors is not None]
    if len(recorded) < len(by_quantity):
        return None
    errors = np.stack(recorded, axis=-1)
    similar = np.full((len(points["torque_n_m"]), ALIKE, errors.shape[-1]), np.nan)
    if model != known:
        return similar
    asked = np.asarray(~np.isinf(errors).any(axis=-1))
    inside = measured.speaks_of(points, asked)
    ratios = operating_ratios({name: column[inside] for name, column in points.items()})
    places = coordinates(ratios) / measured.spread
    places[~np.isfinite(places)] = _FAR
    nearest = nearest_rows(measured.places[asked], places, ALIKE)
    near = _apart(measured.places[asked], places, nearest) <= _usual_distance(measured.places[asked])
    similar[inside] = np.where(near[:, None, None], errors[asked][nearest], np.nan)
    if model in WITHOUT_VIBRATION:
        by_vibration = _by_vibration(points, accuracy)
        if vibrates is not None:
            by_vibration[vibrates == 0], by_vibration[vibrates == 1] = 0.0, np.nan
        similar += by_vibration
    return similar


def _by_vibration(points: Mapping[str, NDArray[Any]], accuracy: Accuracy) -> FloatArray:
    """Errors from omitting vibration over the allowed errors, shape (point, similar, quantity).

    For the second order no record exists: NaN if a similar joint vibrates.
    """
    third = vibration_errors(points)[:, :ALIKE]
    second = np.where(third > 0, np.nan, 0.0)
    return np.stack([third / each.allowed if each.label == 3 else second for each in accuracy.quantities], axis=-1)


def _apart(known: FloatArray, places: FloatArray, nearest: IntArray) -> FloatArray:
    """Distance of each place to the farthest of its nearest known places, shape (len(places),)."""
    return np.asarray(np.linalg.norm(known[nearest[:, -1]] - places, axis=1))


def _usual_distance(known: FloatArray) -> float:
    """Distance within which nine of ten known places have their nearest neighbours."""
    apart = np.sort(np.linalg.norm(known[:, None] - known, axis=2), axis=1)
    return float(np.quantile(apart[:, ALIKE], 0.9))  # each place is its own nearest
