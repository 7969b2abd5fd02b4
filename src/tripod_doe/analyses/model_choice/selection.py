"""Selection of a candidate at every point: the cheapest one whose predicted error is small enough.

A pilot ran several candidates at a few points. Its results give the difference of each candidate to the reference (the
finest candidate that finished there), relative to the allowed error. The error at any other point is predicted as the
root of the sum of three squares:

- the difference to the reference, interpolated with its sign (cubic radial functions and a linear trend, over the
  design scaled to its ranges);
- the uncertainty of the reference (`pilot_errors`), and
- the interpolation error at the pilot points, each left out in turn; the last two are means over the pilot points,
  weighted by the inverse squares of the distances.

The largest error of all quantities counts. A candidate is not taken where it failed at one of the nearest pilot points
(as many as the design has dimensions, and one more). Where not even the reference is expected to meet the accuracy, a
candidate is accepted whose error exceeds the error of the reference by at most 10 %.

The limit of the predicted error is calibrated on the pilot: each of its points is left out in turn, its candidate is
chosen from the others, and it counts as a miss if the error of that candidate exceeds the accuracy, and exceeds the
error of the reference by more than 10 %. The limit is the largest one at and below which (misses + 1) / (points + 1)
is at most 1 - confidence. This is conformal risk control (Angelopoulos et al., "Conformal risk control", ICLR 2024): if
the points of the study were drawn from the distribution of the pilot's, the accuracy would be met in the stated share
of them. They are not quite: the pilot includes the edges of the design, where leaving a point out means extrapolation,
so it misses more often than the study.

The price of a candidate is its counted force evaluations, averaged over the pilot, times the recorded seconds per
evaluation.
"""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field

from tripod_doe.analyses.encoding import in_unit_cube
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.model_choice.pilot_errors import AS_GOOD, HOPELESS, PilotErrors, pilot_errors
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import InputError
from tripod_doe.model_interface import Candidate, cf_flags
from tripod_doe.study.definition.accuracy_table import AUTO, AutoModel
from tripod_doe.study.definition.study_file import load_study
from tripod_doe.study.definition.study_file_schema import Table
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.designs import make_points

_LIMITS = np.linspace(1.0, 0.0, 101)


class ChooseSettings(Table):
    """Settings of the analysis ``choose``."""

    study: str = Field(
        description='study file with model = "auto" for whose points the model is chosen, relative to the workflow file'
    )


def choose(measured: PilotErrors, columns: Mapping[str, NDArray[Any]], auto: AutoModel) -> xr.Dataset:
    """Choose a candidate for every point.

    Args:
        columns: Factors of the points, each of shape (point,).

    Returns:
        Along ``point``: the factors, the chosen parameters, the number of the candidate, the estimated relative error
        of every quantity and whether it meets the accuracy. Along ``candidate``: price and number of points. Along
        ``pilot_point``: the factors and the measured relative errors.
    """
    prediction = _Prediction(measured)
    limit, misses = prediction.limit(auto.confidence)
    expected = prediction.errors(in_unit_cube(columns, measured.columns))
    candidate = _cheapest(expected.max(axis=2), measured.prices, limit)
    every = np.arange(candidate.size)
    choice = labelled(measured, columns, auto, candidate, expected[every, candidate])
    study = float(measured.prices[candidate].sum())
    return choice.assign_attrs(
        {
            "limit": max(limit, 0.0),
            "misses": misses,
            "price_study_s": study,
            "price_pilot_s": measured.price,
            "price_reference_s": float(measured.prices[-1] * candidate.size),
        }
    )


@makes_kind("choose")
def choose_for_study(cubes: Mapping[str, xr.Dataset], settings: ChooseSettings, folder: StudyFolder) -> xr.Dataset:
    """The candidate of every point of a study file, from the cube of any pilot: a design table, see `choose`.

    Args:
        cubes: One cube: candidates of the scene at points that span those of the study.
        folder: Where its file is looked for.

    Raises:
        InputError: If the study names its model, or the pilot does not serve it.
    """
    if len(cubes) != 1:
        raise InputError(f"choose needs one pilot as its input, not {len(cubes)}")
    path = folder.file(settings.study, "study")
    study = load_study(path, folder.around(path))
    if study.auto_model is None:
        raise InputError(f'{study.origin}: the study names its model; set model = "{AUTO}" and [accuracy]')
    points = make_points(study)
    columns = {name: column[points.allowed] for name, column in points.columns.items()}
    measured = pilot_errors(next(iter(cubes.values())), list(columns), study.auto_model)
    return choose(measured, columns, study.auto_model)


def full_candidates(auto: AutoModel) -> tuple[Candidate, ...]:
    """The full model, with its usual numerical error first; the finest candidate where none is full."""
    return tuple(candidate for candidate in auto.candidates if candidate.full) or auto.candidates[-1:]


def without_pilot(columns: Mapping[str, NDArray[Any]], auto: AutoModel) -> xr.Dataset:
    """The full model at every point of a study that is too small for a pilot; its errors are unknown."""
    candidates = full_candidates(auto)[:1]
    count = len(next(iter(columns.values())))
    measured = PilotErrors(
        {name: column[:0] for name, column in columns.items()},
        candidates,
        np.zeros((0, 1, len(auto.accuracy.quantities))),
        np.zeros((0, len(auto.accuracy.quantities))),
        np.array([candidates[0].price]),
        np.zeros(1, int),
    )
    choice = labelled(
        measured, columns, auto, np.zeros(count, int), np.full((count, len(auto.accuracy.quantities)), np.nan)
    )
    price = float(candidates[0].price * count)
    return choice.assign_attrs(
        {"limit": 0.0, "misses": 0, "price_study_s": price, "price_pilot_s": 0.0, "price_reference_s": price}
    )


class _Prediction:
    """Errors of all candidates, predicted from a pilot at any place of the design, and the largest accepted one."""

    def __init__(self, measured: PilotErrors) -> None:
        self._pilot = measured
        self._places = in_unit_cube(measured.columns, measured.columns)
        every = np.arange(measured.count)
        blind = np.stack([self._differences(every != i, self._places[i : i + 1])[0] for i in every])
        self._missed = np.square(np.nan_to_num(blind - measured.differences))
        self._blind = np.stack([self._errors(every != i, self._places[i : i + 1], blind[i : i + 1])[0] for i in every])

    def errors(self, places: FloatArray) -> FloatArray:
        """Estimated errors over the allowed ones at places, shape (place, candidate, quantity)."""
        every = np.ones(self._pilot.count, bool)
        return self._errors(every, places, self._differences(every, places))

    def _differences(self, known: NDArray[np.bool_], places: FloatArray) -> FloatArray:
        """Differences to the reference, interpolated between the known points where each candidate finished."""
        differences = np.stack(
            [
                _interpolate(self._places[usable], candidate[usable], places)
                for candidate in np.moveaxis(self._pilot.differences, 1, 0)
                for usable in [known & np.isfinite(candidate).all(axis=1)]
            ],
            axis=1,
        )
        return np.clip(differences, -HOPELESS, HOPELESS)

    def _errors(self, known: NDArray[np.bool_], places: FloatArray, differences: FloatArray) -> FloatArray:
        weights = _weights(self._places[known], places)
        numerical = np.square(np.tensordot(weights, self._pilot.numerical[known], 1))
        missed = np.tensordot(weights, self._missed[known], 1)
        uncertain = numerical[:, None] * np.square(self._pilot.uncertain[:, None])
        errors = np.sqrt(np.square(differences) + uncertain + missed)
        failed = np.asarray(np.isnan(self._pilot.differences[known]).any(axis=2))
        around = np.argsort(-weights, axis=1, kind="stable")[:, : places.shape[1] + 1]
        near = np.asarray(failed[around].any(axis=1))
        return np.where(near[:, :, None], HOPELESS, np.minimum(errors, HOPELESS))

    def limit(self, confidence: float) -> tuple[float, int]:
        """Largest accepted predicted error, over the allowed one, and the number of pilot points that it misses."""
        rows, accepted, misses = np.arange(self._pilot.count), self._pilot.accepted, []
        for limit in _LIMITS:
            candidate = _cheapest(self._blind.max(axis=2), self._pilot.prices, float(limit))
            misses.append(int((~accepted[rows, candidate]).sum()))
        most_below = np.maximum.accumulate(misses[::-1])[::-1]
        allowed = (most_below + 1) / (rows.size + 1) <= 1 - confidence + 1e-12
        if not allowed.any():
            return -1.0, 0  # too few pilot points for such a confidence: only the reference is taken
        return float(_LIMITS[allowed.argmax()]), misses[int(allowed.argmax())]


def _interpolate(known: FloatArray, values: FloatArray, places: FloatArray) -> FloatArray:
    """Values at known places, shape (known, column), interpolated at others, shape (place, column).

    Cubic radial functions with a linear trend; the solution of least norm where the places do not determine the trend.
    """
    if known.shape[0] == 0:
        return np.full((places.shape[0], values.shape[1]), HOPELESS)
    trend = np.hstack([np.ones((known.shape[0], 1)), known])
    nothing = np.zeros((trend.shape[1], trend.shape[1]))
    system = np.block([[_distances(known, known) ** 3, trend], [trend.T, nothing]])
    right = np.vstack([values, np.zeros((trend.shape[1], values.shape[1]))])
    solution = np.linalg.lstsq(system, right, rcond=None)[0]
    basis = np.hstack([_distances(places, known) ** 3, np.ones((places.shape[0], 1)), places])
    return np.asarray(basis @ solution)


def _weights(known: FloatArray, places: FloatArray) -> FloatArray:
    """Shares of the known places by the inverse squares of their distances, shape (place, known)."""
    inverse = 1 / np.maximum(_distances(places, known), 1e-9) ** 2
    return np.asarray(inverse / inverse.sum(axis=1, keepdims=True))


def _distances(some: FloatArray, others: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(some[:, None] - others[None], axis=2))


def _cheapest(expected: FloatArray, prices: FloatArray, limit: float) -> IntArray:
    """The cheapest candidate with an expected error (point, candidate) below a limit, or near the last one's."""
    order = np.argsort(prices, kind="stable")
    order = order[: int(np.flatnonzero(order == prices.size - 1)[0]) + 1]  # none more expensive than the reference
    reference = expected[:, -1:]
    enough = np.where((reference > 1) & (limit >= 0), AS_GOOD * reference, limit)
    trusted = expected[:, order] <= enough
    trusted[:, -1] = True
    return np.asarray(order[trusted.argmax(axis=1)])


def labelled(
    measured: PilotErrors,
    columns: Mapping[str, NDArray[Any]],
    auto: AutoModel,
    candidate: IntArray,
    error: FloatArray,
    met: NDArray[np.bool_] | None = None,
) -> xr.Dataset:
    """A choice with its labels: `candidate` by number, shape (point,), `error` over the allowed, (point, quantity).

    The accuracy is expected to be met where `met`, shape (point,), says so; by default where `error` is at most one.
    """
    allowed = np.array([quantity.allowed for quantity in auto.accuracy.quantities])
    numbers, labels = np.arange(len(measured.candidates), dtype=np.int32), [way.label for way in measured.candidates]
    chosen = {name: np.array([way.values[name] for way in measured.candidates])[candidate] for name in auto.parameters}
    expected = (error <= 1).all(axis=1) if met is None else met
    flags = np.where(np.isnan(error).any(axis=1), -1, expected).astype(np.int8)
    return xr.Dataset(
        {
            **{name: ("point", _text(column), {"long_name": f"factor {name}"}) for name, column in columns.items()},
            **{name: ("point", column, {"long_name": f"chosen {name}"}) for name, column in chosen.items()},
            "candidate": ("point", candidate.astype(np.int32), {"long_name": "number of the chosen candidate"}),
            "error_estimate": (
                ("point", "quantity"),
                error * allowed,
                {"long_name": "estimated relative error, of the model and numerical", "units": "1"},
            ),
            "accuracy_met": (
                "point",
                flags,
                cf_flags(
                    "whether the accuracy is expected to be met with the confidence asked for",
                    ["unknown", "no", "yes"],
                    -1,
                ),
            ),
            "price": (
                "candidate_number",
                measured.prices,
                {"long_name": "CPU time per run, from counted work", "units": "s"},
            ),
            "points_of_candidate": (
                "candidate_number",
                np.bincount(candidate, minlength=len(measured.candidates)).astype(np.int32),
                {"long_name": "points that run with the candidate", "units": "1"},
            ),
            "pilot_error": (
                ("pilot_point", "candidate_number", "quantity"),
                measured.errors * allowed,
                {"long_name": "relative error measured by the pilot, at most ten times the allowed one", "units": "1"},
            ),
            **{
                f"pilot_{name}": ("pilot_point", _text(column), {"long_name": f"{name} of the pilot point"})
                for name, column in measured.columns.items()
            },
        },
        coords={
            "candidate_number": ("candidate_number", numbers, {"long_name": "candidate"}),
            "candidate_label": ("candidate_number", labels, {"long_name": "candidate in words"}),
            "quantity": (
                "quantity",
                [quantity.name for quantity in auto.accuracy.quantities],
                {"long_name": "quantity asked for"},
            ),
        },
        attrs={
            "accuracy": json.dumps({quantity.name: quantity.allowed for quantity in auto.accuracy.quantities}),
            "confidence": auto.confidence,
            "floor": auto.accuracy.floor,
            "pilot_unknown": int((~measured.known).sum()),
        },
    )


def _text(column: NDArray[Any]) -> NDArray[Any]:
    return column.astype(str) if column.dtype == object else column
