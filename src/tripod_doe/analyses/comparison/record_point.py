"""The point that a record is compared with: what the record states of its operating point, and the model there.

A point that the cube lacks is simulated.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.analyses.comparison.model_point import model_point, parameters_of
from tripod_doe.analyses.diff.definitions import fixed_parameters, parsed_study
from tripod_doe.analyses.diff.shared_points import factors_of
from tripod_doe.errors import InputError, option
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.measurements.measurement import Measurement
from tripod_doe.measurements.operating_point import differ
from tripod_doe.number_text import level, level_or_word, with_unit
from tripod_doe.page_parts.words import listed, spoken, unit_text
from tripod_doe.study.query.query import cell_count
from tripod_doe.study.simulate import simulate

_SAME = 0.01  # relative difference up to which a measured value counts as a level of the cube
_STEADY = 0.05  # relative change of speed below which a record has one speed
_TURNS = 2  # least number of revolutions from which a speed is computed


@dataclass(frozen=True)
class RecordRow:
    """A record to compare: its file, and what the table says of it."""

    path: Path
    values: Mapping[str, float | str] = field(default_factory=dict)  # of parameters, by name


@dataclass(frozen=True)
class RecordPoint:
    """The model at the operating point of a record."""

    point: xr.Dataset
    simulated: bool = False  # whether the cube lacks it
    replaced: str = ""  # what it has in place of the values of the record, as a sentence


def with_stated_values(cube: xr.Dataset, row: RecordRow, measurement: Measurement, select: Sequence[str]) -> RecordRow:
    """A record with what it states of its operating point, where the table and the selection say nothing.

    A value within a hundredth of a level of the cube counts as that level. The speed is the mean over the revolutions;
    where the cube has several speeds around it, each revolution of a record with time is compared at its own speed.
    """
    known = {*row.values, *(text.partition("=")[0] for text in select)}
    of_joint = str(cube.attrs.get("source", "")).endswith("simulator joint")
    factors, fixed = factors_of(cube), fixed_parameters(cube)
    stated = {**measurement.operating, **_own_speed(measurement)}
    values: dict[str, float | str] = {}
    for name, value in stated.items():
        if name in known or not (name in factors or of_joint):
            continue
        levels = np.unique(cube[name].values if name in factors else [fixed.get(name, _default(name))]).astype(float)
        is_tracked = name == "speed_rpm" and measurement.time_s is not None
        if is_tracked and levels.size > 1 and levels[0] <= value <= levels[-1]:
            continue
        near = float(levels[np.argmin(np.abs(levels - value))])
        values[name] = near if abs(near - value) <= _SAME * abs(value) else value
    return replace(row, values={**values, **row.values}) if values else row


def overruled(row: RecordRow, measurement: Measurement, select: Sequence[str]) -> str:
    """What a record states of its operating point where the table or the selection says otherwise, as a sentence."""
    asked, stated = {**_selected(select), **row.values}, {**measurement.operating, **_own_speed(measurement)}
    parts = [
        f"{_in_words(name, stated[name])}, while {with_unit(level(value), unit_text(JOINT_PARAMETERS[name].unit))} is "
        "selected"
        for name, value in asked.items()
        if name in stated and isinstance(value, int | float) and differ(value, stated[name])
    ]
    return f"The record states {listed(parts)}: the selection is used." if parts else ""


def _own_speed(measurement: Measurement) -> dict[str, float]:
    """Mean speed of a record that does not run up; nothing where its time is not known."""
    angle, time = measurement.rotation_deg, measurement.time_s
    if time is None or angle.size < 2 or not angle[-1] > angle[0] + _TURNS * 360:
        return {}
    whole = np.arange(angle[0], angle[-1], 360.0)
    speed = 60 / np.diff(np.interp(whole, angle, time))
    return {"speed_rpm": float(speed.mean())} if np.ptp(speed) < _STEADY * speed.mean() else {}


def _default(name: str) -> float:
    default = JOINT_PARAMETERS[name].default
    return float(default) if isinstance(default, int | float) else math.nan


def point_of_record(cube: xr.Dataset, row: RecordRow, select: Sequence[str] = (), nearest: bool = False) -> RecordPoint:
    """The model at the operating point of a record: a point of the cube, the nearest one, or a point simulated for it.

    Raises:
        InputError: If the selection leaves several points, or the cube lacks the point and it cannot be simulated.
    """
    factors = factors_of(cube)
    own = [f"{name}={value}" for name, value in row.values.items() if name in factors]
    given = {text.partition("=")[0] for text in own}
    wanted = [*own, *(text for text in select if text.partition("=")[0] not in given)]
    asked = {**_selected(select), **row.values}
    if nearest:
        point = model_point(cube, wanted, nearest).load()
        return RecordPoint(point, replaced=_replacements(asked, point))
    try:
        if moved := [
            name for name in row.values if name not in factors and not _is_constant(cube, name, row.values[name])
        ]:
            raise InputError(_lacking(cube, moved[0], row.values[moved[0]]))
        return RecordPoint(model_point(cube, wanted).load())
    except InputError:
        if not row.values or not str(cube.attrs.get("source", "")).endswith("simulator joint"):
            raise
        known = _base(cube) | asked
        if set(factors) - known.keys() - {"replicate"}:
            cell_count(cube, "outcome", wanted)  # a selection of no label is named first
            raise
        return RecordPoint(model_point(simulate(**known)), simulated=True)


def _selected(select: Sequence[str]) -> dict[str, float | str]:
    """Parameters of the joint with one selected value each."""
    chosen = {}
    for text in select:
        name, _, value = text.partition("=")
        if name in JOINT_PARAMETERS:
            with suppress(InputError):  # several values, or a range
                chosen[name] = JOINT_PARAMETERS[name].typed(value)
    return chosen


def _base(cube: xr.Dataset) -> dict[str, Any]:
    """Base values of the study of a cube, and factors of one value; without a model that a pilot chose."""
    base = dict(parsed_study(str(cube.attrs.get("study", ""))).get("base", {}))
    if base.get("model") == "auto":
        del base["model"]
    alone = {name: np.unique(cube[name].values) for name in factors_of(cube)}
    return base | {name: values.item() for name, values in alone.items() if values.size == 1}


def _shared_value(cube: xr.Dataset, name: str) -> Any:
    return fixed_parameters(cube).get(name, JOINT_PARAMETERS[name].default)


def _is_constant(cube: xr.Dataset, name: str, value: float | str) -> bool:
    """Whether all points of a cube have this value of a parameter that is not a factor."""
    known = _shared_value(cube, name)
    if isinstance(known, int | float) and isinstance(value, int | float):
        return math.isclose(known, value, rel_tol=1e-9)
    return bool(known == value)


def _lacking(cube: xr.Dataset, name: str, value: float | str) -> str:
    """Why a point cannot be taken from a cube, and what to do."""
    own = _shared_value(cube, name)
    shared = f"at {_in_words(name, own)}" if isinstance(own, int | float | str) else f"without {spoken(name)}"
    return (
        f"the record is at {_in_words(name, value)}, all points of the cube {shared}; choose the other factors by "
        f"{option('select')} to simulate its point, or take the nearest of the cube with {option('nearest', True)}"
    )


def _replacements(asked: Mapping[str, float | str], point: xr.Dataset) -> str:
    """Which values the nearest point has in place of those asked for, as a sentence; empty where it has them all."""
    known = parameters_of(point)
    parts = [
        f"{_in_words(name, known[name])} in place of {_in_words(name, value).removeprefix(spoken(name) + ' ')}"
        for name, value in asked.items()
        if name in known and known[name] != value
    ]
    return f"The nearest point of the cube is compared: {listed(parts)}." if parts else ""


def _in_words(name: str, value: float | str) -> str:
    return with_unit(f"{spoken(name)} {level_or_word(value)}", unit_text(JOINT_PARAMETERS[name].unit))
