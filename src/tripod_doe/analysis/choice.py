"""Choice of model: from a pilot that ran several rungs at a few points to the cheapest rung that is enough at each.

The pilot tells at each of its points how far each rung is from the finest one, the reference, relative to the accuracy
asked for; the numerical error of the reference, which has nothing to do with that difference, is added as squares. The
worst of all quantities counts. Between pilot points it is interpolated (linear radial functions over the design, scaled
to its ranges). At any point the cheapest rung is taken whose interpolated error stays below a limit, else the
reference.

How strict the limit must be is tried on the pilot itself: every pilot point is left out in turn, its rung chosen from
the others, and counted as a miss where that rung's own error there is above the accuracy. The limit is the loosest at
which, and below which, (misses + 1) / (points + 1) is at most 1 - confidence. This is conformal risk control
(Angelopoulos et al., "Conformal risk control", ICLR 2024): if the points of the study were drawn like those of the
pilot, the accuracy would be met in the stated share of them. They are not quite: the pilot reaches to the edges of the
design, where leaving a point out means extrapolating, so that its misses are rather more than those of the study.

A rung's price is its counted force evaluations, a mean over the pilot, times the recorded seconds of an evaluation.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field
from scipy.interpolate import RBFInterpolator

from tripod_doe.errors import InputError, near_match
from tripod_doe.quantities import Rung
from tripod_doe.results import Outcome
from tripod_doe.study.accuracy import AUTO, Accuracy, Demand
from tripod_doe.study.definition import load_study
from tripod_doe.study.designs import make_points
from tripod_doe.study.pilot import normalised

__all__ = ["ChooseSettings", "Evidence", "choose", "choose_for_study", "evidence", "without_pilot"]

FloatArray = NDArray[np.float64]

_HOPELESS = 10.0
"""Error over the allowed one that also stands for a rung that failed: how bad it is no longer matters, and a larger
number would spoil the interpolation far around."""

_LIMITS = np.linspace(1.0, 0.0, 101)


class ChooseSettings(BaseModel):
    """Settings of the analysis ``choose``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    study: str = Field(
        description='study file with model = "auto" for whose points the model is chosen, relative to the workflow file'
    )


@dataclass(frozen=True)
class Evidence:
    """What a pilot tells.

    Attributes
    ----------
    columns
        Factors of the pilot points, each of shape (pilot point,).
    rungs
        The rungs that it ran, from the cheapest to the reference.
    errors
        Error over the allowed one, shape (pilot point, rung, quantity), at most `_HOPELESS`.
    prices
        CPU seconds a run of each rung, shape (rung,).
    """

    columns: dict[str, NDArray[Any]]
    rungs: tuple[Rung, ...]
    errors: FloatArray
    prices: FloatArray

    @property
    def worst(self) -> FloatArray:
        """Error of the worst quantity over the allowed one, shape (pilot point, rung)."""
        return np.asarray(self.errors.max(axis=2))

    @property
    def price(self) -> float:
        """CPU seconds of the pilot."""
        return float(self.prices.sum() * self.errors.shape[0])


def evidence(pilot: xr.Dataset, names: list[str], accuracy: Accuracy) -> Evidence:
    """Read off a pilot how much each rung misses, and what it costs.

    Parameters
    ----------
    pilot
        A cube with its costs, of any design that runs some of the rungs of `accuracy` at some points.
    names
        The factors of the study that is to be run.
    accuracy
        What is asked for.

    Raises
    ------
    InputError
        If the cube lacks a factor, a quantity or a rung, or the reference finished nowhere.
    """
    shape = pilot["outcome"].shape
    cells = {name: _column(pilot, name) for name in [*names, *accuracy.parameters]}
    rung_of = np.full(int(np.prod(shape)), -1)
    for number, rung in enumerate(accuracy.rungs):
        alike = [_equal(cells[name], value) for name, value in rung.values.items()]
        rung_of[np.all(alike, axis=0)] = number
    ran = [number for number in range(len(accuracy.rungs)) if (rung_of == number).any()]
    if len(ran) < 2:
        raise InputError("the pilot ran less than two rungs of the ladder: nothing can be compared")
    places = normalised({name: cells[name] for name in names}, {name: cells[name] for name in names})
    _, first, point_of = np.unique(places.round(12), axis=0, return_index=True, return_inverse=True)
    table = np.full((first.size, len(ran)), -1)
    for position, number in enumerate(ran):
        chosen = np.flatnonzero(rung_of == number)
        table[point_of[chosen], position] = chosen
    rungs = tuple(accuracy.rungs[number] for number in ran)
    errors = np.stack([_errors(pilot, demand, table, accuracy.floor) for demand in accuracy.demands], axis=2)
    known = np.isfinite(errors[:, -1]).all(axis=1)
    if not known.any():
        raise InputError(f"the pilot's reference ({rungs[-1].label}) finished at no point: nothing can be compared")
    columns = {name: cells[name][first][known] for name in names}
    errors = np.minimum(np.nan_to_num(errors[known], nan=_HOPELESS), _HOPELESS)
    return Evidence(columns, rungs, errors, _prices(pilot, table, rungs))


def _column(pilot: xr.Dataset, name: str) -> NDArray[Any]:
    """A parameter in every cell of a cube, shape (cell,), whether it varies or all share it."""
    if name in pilot.coords:
        return np.asarray(xr.broadcast(pilot["outcome"], pilot[name])[1].values.reshape(-1))
    fixed = json.loads(str(pilot.attrs.get("fixed_parameters", "{}")))
    if name not in fixed:
        known = near_match(name, [*(str(key) for key in pilot.coords), *fixed])
        raise InputError(f"the pilot does not tell {name}, which the study varies or has chosen{known}")
    return np.full(pilot["outcome"].size, fixed[name])


def _equal(column: NDArray[Any], value: object) -> NDArray[np.bool_]:
    if isinstance(value, str):
        return np.asarray(column.astype(str) == value)
    return np.isclose(column.astype(float), float(value), rtol=1e-9, atol=0)  # type: ignore[arg-type]


def _errors(pilot: xr.Dataset, demand: Demand, table: NDArray[np.int64], floor: float) -> FloatArray:
    """Error over the allowed one, shape (pilot point, rung); NaN where a run is missing or did not finish."""
    values, largest = _cells(pilot, demand.output, demand)
    numerical = np.zeros_like(values)
    if demand.error in pilot:
        numerical = np.nan_to_num(_cells(pilot, demand.error, demand)[0])
    usable = (table >= 0) & (pilot["outcome"].values.reshape(-1)[table] == Outcome.FINISHED)
    at = np.where(usable, values[table], np.nan)
    reference, numerical = at[:, -1:], numerical[table[:, -1:]]
    size = np.maximum(np.abs(reference), floor * largest[table[:, -1:]])
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.hypot(at - reference, numerical) / size / demand.allowed)


def _cells(pilot: xr.Dataset, name: str, demand: Demand) -> tuple[FloatArray, FloatArray]:
    """A quantity in every cell, and the largest value beside it; shape (cell,)."""
    if name not in pilot:
        known = near_match(name, [str(key) for key in pilot.data_vars])
        raise InputError(f"[accuracy]: {demand.name}: the pilot has no output {name}{known}")
    rows = pilot[name].values.reshape(pilot["outcome"].size, -1)
    if demand.label is None:
        return rows[:, 0], np.abs(rows[:, 0])
    labels = pilot[str(pilot[name].dims[-1])].values.tolist()
    if demand.label not in labels:
        raise InputError(f"[accuracy]: {demand.name}: {name} goes from {labels[0]} to {labels[-1]}")
    rotating = [position for position, label in enumerate(labels) if label != 0]
    return rows[:, labels.index(demand.label)], np.abs(rows[:, rotating]).max(axis=1)


def _prices(pilot: xr.Dataset, table: NDArray[np.int64], rungs: tuple[Rung, ...]) -> FloatArray:
    if "force_evaluations" not in pilot:
        return np.array([rung.price for rung in rungs])
    counted = np.where(table >= 0, pilot["force_evaluations"].values.reshape(-1)[table], np.nan)
    return np.asarray(np.nanmean(counted, axis=0) * [rung.evaluation_seconds for rung in rungs])


def choose(found: Evidence, columns: Mapping[str, NDArray[Any]], accuracy: Accuracy) -> xr.Dataset:
    """The rung of every point, and what it rests on.

    Parameters
    ----------
    found
        What a pilot told.
    columns
        Factors of the points, each of shape (point,).
    accuracy
        What is asked for.

    Returns
    -------
    xarray.Dataset
        Along ``point``: the factors, the chosen parameters, the number of the rung, the estimated relative error of
        every quantity and whether it meets the accuracy. Along ``rung``: price and number of points. Along
        ``pilot_point``: the factors and the relative errors that were found.
    """
    limit, misses = _limit(found, accuracy.confidence)
    places, pilot = normalised(columns, found.columns), normalised(found.columns, found.columns)
    expected = np.stack(
        [_interpolate(pilot, found.errors[:, :, k], places) for k in range(found.errors.shape[2])], axis=2
    )
    rung = _cheapest(expected.max(axis=2), found.prices, limit)
    every = np.arange(rung.size)
    choice = _labelled(found, columns, accuracy, rung, expected[every, rung])
    study = float(found.prices[rung].sum())
    return choice.assign_attrs({
        "limit": max(limit, 0.0), "misses": misses, "price_study_s": study, "price_pilot_s": found.price,
        "price_reference_s": float(found.prices[-1] * rung.size),
    })  # fmt: skip


def choose_for_study(cubes: Mapping[str, xr.Dataset], settings: ChooseSettings, folder: Path) -> xr.Dataset:
    """The rung of every point of a study file, from the cube of any pilot: a design table, see `choose`.

    Parameters
    ----------
    cubes
        One cube: rungs of the scene's ladder at points that span those of the study.
    settings
        The study.
    folder
        Where its file is looked for.

    Raises
    ------
    InputError
        If the study names its model, or the pilot does not serve it.
    """
    if len(cubes) != 1:
        raise InputError(f"choose needs one pilot as its input, not {len(cubes)}")
    study = load_study(folder / settings.study)
    if study.accuracy is None:
        raise InputError(f'{study.origin}: it names its model; set model = "{AUTO}" and [accuracy]')
    points = make_points(study)
    columns = {name: column[points.allowed] for name, column in points.columns.items()}
    found = evidence(next(iter(cubes.values())), list(columns), study.accuracy)
    return choose(found, columns, study.accuracy)


def without_pilot(columns: Mapping[str, NDArray[Any]], accuracy: Accuracy) -> xr.Dataset:
    """The full model at every point of a study that is too small for a pilot; nothing is known of its errors."""
    rungs = tuple(rung for rung in accuracy.rungs if rung.full)[:1] or accuracy.rungs[-1:]
    count = len(next(iter(columns.values())))
    found = Evidence(
        {name: column[:0] for name, column in columns.items()},
        rungs,
        np.zeros((0, 1, len(accuracy.demands))),
        np.array([rungs[0].price]),
    )
    choice = _labelled(found, columns, accuracy, np.zeros(count, int), np.full((count, len(accuracy.demands)), np.nan))
    price = float(rungs[0].price * count)
    return choice.assign_attrs({
        "limit": 0.0, "misses": 0, "price_study_s": price, "price_pilot_s": 0.0, "price_reference_s": price,
    })  # fmt: skip


def _interpolate(known: FloatArray, values: FloatArray, places: FloatArray) -> FloatArray:
    """Values at known places, shape (known, column), interpolated at others, shape (place, column).

    Never below the smallest that is known: linear radial functions swing a little beside a jump.
    """
    if known.shape[0] < 2:
        return np.repeat(values, places.shape[0], axis=0)
    smooth = RBFInterpolator(known, values, kernel="linear")
    return np.asarray(np.clip(smooth(places), values.min(axis=0), _HOPELESS))


def _cheapest(expected: FloatArray, prices: FloatArray, limit: float) -> NDArray[np.int64]:
    """The cheapest rung whose expected error, shape (point, rung), stays below a limit; the last where none does."""
    order = np.argsort(prices, kind="stable")
    order = order[: int(np.flatnonzero(order == prices.size - 1)[0]) + 1]  # none dearer than the reference
    trusted = expected[:, order] <= limit
    trusted[:, -1] = True
    return np.asarray(order[trusted.argmax(axis=1)])


def _limit(found: Evidence, confidence: float) -> tuple[float, int]:
    """How large an interpolated error may be, over the allowed one, and how many pilot points are then missed."""
    count, last = found.worst.shape[0], found.worst.shape[1] - 1
    pilot = normalised(found.columns, found.columns)
    blind = np.concatenate([
        _interpolate(np.delete(pilot, i, 0), np.delete(found.worst, i, 0), pilot[i : i + 1]) for i in range(count)
    ]) if count > 2 else np.full_like(found.worst, _HOPELESS)  # fmt: skip
    misses = []
    for limit in _LIMITS:
        rung = _cheapest(blind, found.prices, float(limit))
        misses.append(int(((found.worst[np.arange(count), rung] > 1) & (rung != last)).sum()))
    worst_below = np.maximum.accumulate(misses[::-1])[::-1]
    allowed = (worst_below + 1) / (count + 1) <= 1 - confidence + 1e-12
    at = int(allowed.argmax()) if allowed.any() else len(_LIMITS) - 1
    return (float(_LIMITS[at]), misses[at]) if allowed.any() else (-1.0, 0)


def _labelled(
    found: Evidence, columns: Mapping[str, NDArray[Any]], accuracy: Accuracy, rung: NDArray[np.int64], error: FloatArray
) -> xr.Dataset:
    allowed = np.array([demand.allowed for demand in accuracy.demands])
    chosen = {name: np.array([way.values[name] for way in found.rungs])[rung] for name in accuracy.parameters}
    met = np.where(np.isnan(error).any(axis=1), -1, (error <= 1).all(axis=1)).astype(np.int8)
    return xr.Dataset(
        {
            **{name: ("point", _text(column), {"long_name": f"factor {name}"}) for name, column in columns.items()},
            **{name: ("point", column, {"long_name": f"chosen {name}"}) for name, column in chosen.items()},
            "rung": ("point", rung.astype(np.int32), {"long_name": "number of the chosen rung"}),
            "error_estimate": (
                ("point", "quantity"),
                error * allowed,
                {"long_name": "estimated relative error, of the model and numerical", "units": "1"},
            ),
            "accuracy_met": ("point", met, {
                "long_name": "whether the estimated error is within the accuracy asked for",
                "flag_values": np.array([-1, 0, 1], np.int8), "flag_meanings": "unknown no yes",
            }),
            "price": ("rung_number", found.prices, {"long_name": "CPU time of a run, from counted work", "units": "s"}),
            "points_of_rung": (
                "rung_number",
                np.bincount(rung, minlength=len(found.rungs)).astype(np.int32),
                {"long_name": "points that run with the rung", "units": "1"},
            ),
            "pilot_error": (
                ("pilot_point", "rung_number", "quantity"),
                found.errors * allowed,
                {"long_name": "relative error found by the pilot, at most ten times the allowed one", "units": "1"},
            ),
            **{
                f"pilot_{name}": ("pilot_point", _text(column), {"long_name": f"{name} of the pilot point"})
                for name, column in found.columns.items()
            },
        },
        coords={
            "rung_number": ("rung_number", np.arange(len(found.rungs), dtype=np.int32), {"long_name": "rung"}),
            "rung_label": ("rung_number", [way.label for way in found.rungs], {"long_name": "rung in words"}),
            "quantity": ("quantity", [demand.name for demand in accuracy.demands], {"long_name": "quantity asked for"}),
        },
        attrs={
            "accuracy": json.dumps({demand.name: demand.allowed for demand in accuracy.demands}),
            "confidence": accuracy.confidence,
            "floor": accuracy.floor,
        },
    )  # fmt: skip


def _text(column: NDArray[Any]) -> NDArray[Any]:
    return column.astype(str) if column.dtype == object else column
