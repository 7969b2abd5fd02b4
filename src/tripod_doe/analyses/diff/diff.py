"""Differences of two studies with their results: in the questions, in the code, and in the results."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from tripod_doe.analyses.diff.definitions import (
    KeyDifference,
    parameter_differences,
    program_differences,
    study_differences,
)
from tripod_doe.analyses.diff.shared_points import shared_points
from tripod_doe.analyses.output_table import without_zero
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import InputError, near_match, option
from tripod_doe.model_interface import Outcome
from tripod_doe.phases import amplitude_of, is_phase, shorter_way
from tripod_doe.study.cube.dataset import COST_VARIABLES, RECORD_ROLE, RESPONSE_ROLE
from tripod_doe.study.definition.toml_text import read_text
from tripod_doe.study.result_directory.open_cube import opened_cube

_AMPLITUDE = "thrust_amplitude"
_ROUNDING = 1e-12  # part of the largest magnitude of a variable up to which its values count as equal
NO_PHASE = 1e-3
"""Part of the largest amplitude of a point below which a phase is chance, and is not compared."""


@dataclass(frozen=True)
class ResultDifference:
    """The largest difference, B less A, of one part of a variable over the shared points."""

    variable: str
    part: dict[str, Any]  # labels of its other dimensions, as ``{"order": 3}``
    unit: str
    difference: float  # of the point where its magnitude is largest
    relative: float  # the difference over the value in A there; NaN where that is 0, and of phases and levels
    at: dict[str, Any]  # values of the factors there
    a: float
    b: float
    weight: float  # magnitude of the difference over the largest magnitude of the variable, by which they are ordered
    compared: int  # shared points with a number on both sides


@dataclass(frozen=True)
class OneSided:
    """A part of a variable with a number in one of two results alone."""

    variable: str
    part: dict[str, Any]
    points: int  # shared points at which that is so


@dataclass(frozen=True)
class EqualVariable:
    """A variable whose numbers are equal in two results wherever both have one."""

    variable: str
    numbers: int  # parts with numbers, as the orders
    points: int  # the least number of shared points at which a part is compared


@dataclass(frozen=True)
class OutcomeDifference:
    """A shared point that ended in another way."""

    at: dict[str, Any]
    a: str
    b: str


@dataclass(frozen=True)
class Diff:
    """All differences of two studies; `results` and `outcomes` only where both have results."""

    study: list[KeyDifference]
    parameters: list[KeyDifference] = field(default_factory=list)  # of one value in each cube, set by no study file
    program: list[KeyDifference] = field(default_factory=list)
    units: list[KeyDifference] = field(default_factory=list)  # of variables that are not compared for them
    points: dict[str, int] = field(default_factory=dict)  # numbers of points: a, b, shared
    outcomes: list[OutcomeDifference] = field(default_factory=list)
    results: list[ResultDifference] = field(default_factory=list)  # the largest first
    one_sided: list[OneSided] = field(default_factory=list)
    equal: list[EqualVariable] = field(default_factory=list)
    compared: list[str] = field(default_factory=list)  # the variables
    others: list[str] = field(default_factory=list)  # further variables that both have, which were not compared
    note: str = ""  # why results were not compared


def diff(a: str | Path, b: str | Path, variables: Collection[str] = ()) -> Diff:
    """Compare two studies, and their results at the points that they share.

    Args:
        a, b: Result directories, cubes (.nc) or study files (.toml).
        variables: Variables to compare. By default the orders of the thrust with results of their own; of a scene or a
            function without them, all outputs with numbers.

    Raises:
        InputError: If one cannot be read, or a variable is in neither.
    """
    with ExitStack() as opened:
        first, second = _read_side(Path(a), opened), _read_side(Path(b), opened)
        if not isinstance(first, str) and not isinstance(second, str):
            return diff_cubes(first, second, variables)
    texts = [side if isinstance(side, str) else str(side.attrs.get("study", "")) for side in (first, second)]
    return Diff(study_differences(*texts), note="results are compared where both are result directories or cubes")


def diff_cubes(a: xr.Dataset, b: xr.Dataset, variables: Collection[str] = ()) -> Diff:
    """Compare two open cubes; see `diff`."""
    study = study_differences(str(a.attrs.get("study", "")), str(b.attrs.get("study", "")))
    return _with_results(a, b, study, variables)


def _read_side(path: Path, opened: ExitStack) -> xr.Dataset | str:
    """One side of the comparison: a cube, open and read in parts, or the text of a study file."""
    if path.suffix == ".toml":
        return read_text(path, "study file")
    cube = opened.enter_context(opened_cube(path))
    if "outcome" not in cube:
        raise InputError(f"{path}: holds no points of a study: give a result directory, a cube or a study file")
    return cube


def _with_results(a: xr.Dataset, b: xr.Dataset, study: list[KeyDifference], variables: Collection[str]) -> Diff:
    parameters = parameter_differences(a, b, [one.key.removeprefix("base.") for one in study])
    program = program_differences(a, b)
    names, others = _compared_variables(a, b, variables)
    units = [KeyDifference(name, _unit(a, name), _unit(b, name)) for name in names if _unit(a, name) != _unit(b, name)]
    names = [name for name in names if name not in {one.key for one in units}]
    try:
        at, rows_a, rows_b = shared_points(a, b)
    except InputError as error:
        return Diff(study, parameters, program, units, note=str(error))
    points = {"a": a["outcome"].size, "b": b["outcome"].size, "shared": len(at)}
    outcomes = _outcome_differences(a, b, at, rows_a, rows_b)
    one_sided: list[OneSided] = []
    parts = [part for name in names for part in _parts(a, b, name, at, (rows_a, rows_b), one_sided)]
    changed = sorted((part for part in parts if part.weight > _ROUNDING), key=lambda part: -part.weight)
    differ = {part.variable for part in changed} | {part.variable for part in one_sided}
    counts = {name: [part.compared for part in parts if part.variable == name] for name in names if name not in differ}
    equal = [EqualVariable(name, len(own), min(own)) for name, own in counts.items() if own]
    note = "" if len(at) else "No point of A has the same factor values as a point of B."
    return Diff(study, parameters, program, units, points, outcomes, changed, one_sided, equal, names, others, note)


def _compared_variables(a: xr.Dataset, b: xr.Dataset, wanted: Collection[str]) -> tuple[list[str], list[str]]:
    """Variables to compare, and the others that both cubes have with a number for each point."""
    both = [str(name) for name in a.data_vars if name in b.data_vars and _is_output(a, str(name))]
    for name in wanted:
        if name not in both:
            raise InputError(f"{option('variable', name)}: not a variable of both{near_match(name, both)}")
    outputs = [name for name in both if name not in COST_VARIABLES and a[name].attrs.get("role") != RECORD_ROLE]
    if _AMPLITUDE in outputs:
        main = [name for name in outputs if name == _AMPLITUDE or a[name].attrs.get("role") == RESPONSE_ROLE]
    else:
        main = outputs
    compared = list(dict.fromkeys(wanted)) or main
    return compared, [name for name in outputs if name not in compared]


def _is_output(cube: xr.Dataset, name: str) -> bool:
    array = cube[name]
    return name != "outcome" and array.dtype.kind in "fiu" and set(cube["outcome"].dims) <= set(array.dims)


def _unit(cube: xr.Dataset, name: str) -> str:
    return str(cube[name].attrs.get("units") or "1")


def _by_point(cube: xr.Dataset, name: str, rows: IntArray) -> tuple[FloatArray, list[dict[str, Any]]]:
    """Values of chosen points, shape (point, part), and the labels of each part."""
    design = [str(dim) for dim in cube["outcome"].dims]
    others = [str(dim) for dim in cube[name].dims if dim not in design]
    values = cube[name].transpose(*design, *others).values.astype(float)
    flat = values.reshape(cube["outcome"].size, -1)[rows]
    amplitude = amplitude_of(name)
    if amplitude in cube and cube[amplitude].dims == cube[name].dims:
        sizes, _ = _by_point(cube, amplitude, rows)
        flat = np.where(sizes > NO_PHASE * np.nanmax(sizes, axis=1, keepdims=True, initial=0.0), flat, np.nan)
    labels = [cube[dim].values.tolist() if dim in cube.coords else list(range(cube.sizes[dim])) for dim in others]
    places = np.ndindex(*(len(own) for own in labels))
    return flat, [{dim: labels[k][i] for k, (dim, i) in enumerate(zip(others, place, strict=True))} for place in places]


def _parts(
    a: xr.Dataset,
    b: xr.Dataset,
    name: str,
    at: pd.DataFrame,
    rows: tuple[IntArray, IntArray],
    one_sided: list[OneSided],
) -> list[ResultDifference]:
    """Differences of all parts of a variable that both cubes hold; adds those with a number in one study only."""
    first, labels = _by_point(a, name, rows[0])
    second, others = _by_point(b, name, rows[1])
    wraps = is_phase(a[name])
    column = {tuple(part.items()): k for k, part in enumerate(others)}
    shared = [(k, column[tuple(part.items())]) for k, part in enumerate(labels) if tuple(part.items()) in column]
    largest = float(np.nanmax(np.abs(np.concatenate([first.ravel(), second.ravel()])), initial=0.0))
    unit = _unit(a, name)
    parts = []
    for k, other in shared:
        change = second[:, other] - first[:, k]
        if wraps:
            change = shorter_way(change)
        known = np.isfinite(change)
        lost = int((np.isfinite(first[:, k]) != np.isfinite(second[:, other])).sum())
        if lost:
            one_sided.append(OneSided(name, labels[k], lost))
        if not known.any():
            continue
        row = int(np.nanargmax(np.abs(np.where(known, change, np.nan))))
        old, new, size = float(first[row, k]), float(second[row, other]), float(change[row])
        relative = size / abs(old) if old and not without_zero(a[name]) else float("nan")
        weight = abs(size) / largest if largest else 0.0
        values = _point(at, row)
        parts.append(
            ResultDifference(name, labels[k], unit, size, relative, values, old, new, weight, int(known.sum()))
        )
    return parts


def _outcome_differences(
    a: xr.Dataset, b: xr.Dataset, at: pd.DataFrame, rows_a: IntArray, rows_b: IntArray
) -> list[OutcomeDifference]:
    first, second = a["outcome"].values.ravel()[rows_a], b["outcome"].values.ravel()[rows_b]
    return [
        OutcomeDifference(_point(at, int(row)), Outcome(int(first[row])).label, Outcome(int(second[row])).label)
        for row in np.flatnonzero(first != second)
    ]


def _point(at: pd.DataFrame, row: int) -> dict[str, Any]:
    """Values of the factors at a shared point, as plain numbers and texts."""
    values: Sequence[Any] = at.iloc[row].tolist()
    return dict(zip(map(str, at.columns), values, strict=True))
