"""The error of each model of the joint at any operating point, from errors that were measured at others.

`model_errors.csv` holds the third order of each model relative to that of `needles`, at operating points that cover the
field in which joints are used (`benchmarks/model_error.py` makes it from five studies). Where needles were not run, it
is relative to `rollers`, whose own typical error there is added. A point is compared with the measured ones that are
most like it, by the ratios on which the errors depend: their median is the typical error, their 90th percentile its
limit. Nothing is known outside of what was measured, and where one of the two models has no answer at most of such
points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.joint.operating_ratios import RATIOS, operating_ratios
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.quantities import number

__all__ = ["COMPARED", "FINEST", "QUANTITY", "RECORDED", "known_errors"]

FloatArray = NDArray[np.float64]

RECORDED = Path(__file__).with_name("model_errors.csv")
"""File of the measured errors."""

COMPARED, FINEST = ("equilibrium", "kinetostatic", "rollers"), "needles"
"""Models, and the one that the error of each was measured against: the end of the ladder."""

QUANTITY = "third order"
"""What the errors are of."""

_NEAREST = 10
"""Measured points that a point is compared with."""
_FEW = 500
"""Points for which no compilation is worth its time."""
_NO_REFERENCE = "this is the finest model, which the others are compared with"
_NOT_COMPARED = "it was not compared with the others"
_NO_ANSWER = "for most of the similar points one of the models did not finish"


@dataclass(frozen=True)
class _Measured:
    """Points at which the models were compared.

    Attributes
    ----------
    names
        Names of the ratios.
    low, high
        Least and largest value of each ratio, shape (ratio,).
    places
        Logarithms of the ratios, over the spread of each, shape (measured, ratio).
    spread
        Standard deviations of the logarithms, shape (ratio,).
    errors
        By model: relative error of its third order, shape (measured,); NaN where one of the two has no answer, and
        infinite where it was not asked.
    """

    names: tuple[str, ...]
    low: FloatArray
    high: FloatArray
    places: FloatArray
    spread: FloatArray
    errors: dict[str, FloatArray]

    def told(self, ratio: int) -> str:
        """Why nothing is known of points that lie outside in a ratio."""
        name = self.names[ratio]
        meaning = "" if name in JOINT_PARAMETERS else f" ({RATIOS[name]})"
        low, high = number(self.low[ratio]), number(self.high[ratio])
        return f"{name}{meaning} is outside of the compared range {low} to {high}"

    def near(self, model: str, places: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Median and ninth decile of the errors of a model at the measured points nearest to some places.

        NaN where most of those have no answer.
        """
        asked = ~np.isinf(self.errors[model])
        nearest = _nearest(self.places[asked], places)
        found = np.sort(self.errors[model][asked][nearest], axis=1)  # NaN last
        return _quantile(found, 0.5), _quantile(found, 0.9)


def _nearest(known: FloatArray, places: FloatArray) -> NDArray[np.int64]:
    """The known places nearest to some others, of equally near ones the first, shape (len(places), nearest).

    Known places that are the same to the last bit are common: their points differ in what no ratio depends on.
    """
    if len(places) <= _FEW:
        apart = np.square(places[:, None] - known).sum(axis=2)
        return np.argsort(apart, axis=1, kind="stable")[:, :_NEAREST]
    from tripod_doe.joint.nearest import nearest_places  # compiles

    return nearest_places(known, places, min(_NEAREST, len(known)))


def _quantile(found: FloatArray, share: float) -> FloatArray:
    """Quantile of the numbers of each row, which NaN follow; NaN where those are the most."""
    known = np.isfinite(found).sum(axis=1)
    at = np.ceil(share * np.maximum(known - 1, 0)).astype(int)
    return np.where(2 * known > found.shape[1], found[np.arange(len(found)), at], np.nan)


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
    values = np.stack(list(ratios.values()), axis=1)
    spread = np.log(values).std(axis=0)
    direct = table["needles"] == 1
    errors = {model: np.abs(table[model]) for model in COMPARED}
    errors["rollers"][~direct] = np.inf
    measured = _Measured(tuple(ratios), values.min(axis=0), values.max(axis=0), np.log(values) / spread, spread, errors)
    by_rollers = measured.near("rollers", measured.places[~direct])[0]
    for model in COMPARED[:2]:
        errors[model][~direct] += by_rollers
    return measured


def known_errors(model: str, points: Mapping[str, NDArray[Any]]) -> tuple[FloatArray, FloatArray, NDArray[np.object_]]:
    """What is known of the error that a model makes in the third order of some points.

    Parameters
    ----------
    model
        Name of the model that answers at all of them.
    points
        Every parameter by name, in the unit of its name, each of shape (point,).

    Returns
    -------
    expected, limit, unknown
        See `simulator.ModelErrors`; each of shape (point,).
    """
    count = len(points["torque_n_m"])
    expected, limit = np.full((2, count), np.nan)
    if model not in COMPARED:
        return expected, limit, np.full(count, _NO_REFERENCE if model == FINEST else _NOT_COMPARED, object)
    measured, ratios = _measured(), operating_ratios(points)
    values = np.stack([ratios[name] for name in measured.names], axis=1)
    inside = (values >= measured.low) & (values <= measured.high)
    within = inside.all(axis=1)
    expected[within], limit[within] = measured.near(model, np.log(values[within]) / measured.spread)
    unknown = np.full(count, "", object)
    unknown[np.isnan(expected)] = _NO_ANSWER
    for ratio in range(len(measured.names))[::-1]:  # of several, the first is told
        unknown[~inside[:, ratio]] = measured.told(ratio)
    return expected, limit, unknown
