"""Timed runs of the cubes of method studies: settings, results and costs of each."""

import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.model_interface import Outcome, Simulator
from tripod_doe.number_text import level
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.definition.study_file_schema import parse_file

_SETTINGS = ("step_s", "relative_tolerance", "accuracy")
"""Parameters that control the error of a run; the first one that a run has applies to it."""

BY_ACCURACY = "by accuracy"
"""Stands for the method of runs that find their tolerance by themselves."""

_OF_A_RUN = ("model", "method", *_SETTINGS, "evaluation_budget", "replicate")
"""Parameters in which the compared runs of one point may differ."""


@dataclass(frozen=True)
class Quantity:
    """A named part of a run's results; its error is the norm of the difference over the norm of the reference."""

    name: str  # label along ``quantity``
    meaning: str  # description
    # variable, select, last: its place in a cube: the variable, labels along its dimensions, and dimensions of which
    # only the last entry is used
    variable: str
    select: Mapping[str, Any]
    last: tuple[str, ...] = ()


QUANTITIES = (
    Quantity("third_order", "third order of the thrust", "thrust_amplitude", {"order": 3}),
    Quantity("second_order", "second order of the thrust", "thrust_amplitude", {"order": 2}),
    Quantity("waveform", "waveform of the thrust (rms)", "thrust", {}),
    Quantity(
        "needle_skew",
        "mean skew of the needles in the last revolution",
        "needle_skew_summary_deg",
        {"statistic": "mean"},
        ("cycle",),
    ),
    Quantity("groove_third_order", "third order of the groove's thrust", "groove_thrust_amplitude", {"order": 3}),
    Quantity("groove_first_order", "first order of the groove's thrust", "groove_thrust_amplitude", {"order": 1}),
    Quantity("groove_waveform", "waveform of the groove's thrust (rms)", "groove_thrust", {}),
    Quantity("trunnion_skew", "skew of the most loaded needle (rms)", "needle_skew_deg", {}),
    Quantity("ring_drift", "shift of the needles along the trunnion (rms)", "needle_drift_mm", {}),
    Quantity("needle_drift", "drift of the needle (rms over its path)", "axial_path_mm", {}),
    Quantity("axial_force", "axial force on the groove", "axial_force_n", {}),
)
"""Quantities in the order of reports; a scene is compared by the first one that it has."""


@dataclass(frozen=True)
class TimedRun:
    """One run of a method at one setting, with its repetitions."""

    # method, kind, setting: the method, or `BY_ACCURACY`; ``step_s``, ``relative_tolerance`` or ``accuracy``, and its
    # value
    method: str
    kind: str
    setting: float
    # outcome, detail: how it ended
    outcome: Outcome
    detail: str
    # CPU seconds per simulated second of each repetition, shape (repetition,); for a failed run, per second simulated
    # until the failure
    seconds: FloatArray
    # steps, force_evaluations, solves: counted work
    steps: float
    force_evaluations: float
    solves: float
    answers: Mapping[str, FloatArray]  # results by quantity; empty if it did not finish

    @property
    def finished(self) -> bool:
        """Whether its results may be used."""
        return self.outcome is Outcome.FINISHED

    @property
    def described(self) -> str:
        """Method and setting in words."""
        words = {"step_s": f"{self.method}, step", "relative_tolerance": f"{self.method}, tolerance"}
        return f"{words.get(self.kind, 'accuracy')} {level(self.setting)}"

    @cached_property
    def price(self) -> float:
        """Median CPU seconds per simulated second; NaN if nothing was simulated."""
        known = self.seconds[np.isfinite(self.seconds)]
        return float(np.median(known)) if known.size else math.nan


@dataclass(frozen=True)
class Case:
    """All runs of one scene with one model."""

    # scene, model: the step of the workflow, and the model; empty if the scene has only one
    scene: str
    model: str
    runs: tuple[TimedRun, ...]  # its runs, by method, the coarsest setting first
    quantities: tuple[Quantity, ...]  # quantities that the scene has
    # default_method, default_setting: default method, or `BY_ACCURACY`, and its default step, tolerance or accuracy
    default_method: str
    default_setting: float

    @property
    def label(self) -> str:
        """Scene and model as one name."""
        return f"{self.scene} {self.model}".strip()

    def of(self, method: str) -> list[TimedRun]:
        """Its runs with one method, the coarsest first."""
        return [run for run in self.runs if run.method == method]

    @property
    def methods(self) -> list[str]:
        """Its methods, each once."""
        return list(dict.fromkeys(run.method for run in self.runs))


def read_cases(cubes: Mapping[str, xr.Dataset]) -> list[Case]:
    """Sort the points of all cubes into cases.

    Raises:
        InputError: If a cube has no costs, none of the quantities, or several operating points.
    """
    return [case for name, cube in cubes.items() for case in _cases_of(name, cube)]


def _cases_of(name: str, cube: xr.Dataset) -> list[Case]:
    quantities = tuple(q for q in QUANTITIES if q.variable in cube and set(q.select) <= set(cube[q.variable].dims))
    if "simulated_seconds" not in cube:
        raise InputError(f"{name}: this cube has no costs; give the directory of a study")
    if not quantities and bool((cube["outcome"] == Outcome.FINISHED).any()):
        raise InputError(f"{name}: none of {', '.join(q.variable for q in QUANTITIES)} is kept")
    dims = cube["outcome"].dims
    points = cube.stack(run=dims, create_index=False) if dims != ("run",) else cube
    simulator = load_simulator(parse_file(cube.attrs["study"], name).study.scene)
    models = _column(points, simulator, "model")
    cases = []
    for model in dict.fromkeys(models):
        mine = points.isel(run=np.flatnonzero(models == model))
        for varied in (each for each in mine.coords if each in simulator.parameters and each not in _OF_A_RUN):
            if np.unique(mine[varied].values.astype(str)).size > 1:
                raise InputError(
                    f"{name}: runs at one point are compared, but {varied} varies; make a step for each of its values"
                )
        if not (runs := tuple(_runs(mine, simulator, quantities))):  # of no step and no tolerance
            continue
        default = simulator.effective({"model": model} if model else {})
        found_by = ((kind, float(value)) for kind in _SETTINGS if (value := default.get(kind)) is not None)
        kind, setting = next(found_by, ("", math.nan))
        method = _named(str(default["method"]), kind)
        given = tuple(q for q in quantities if any(q.name in run.answers for run in runs))
        cases.append(Case(name, model, runs, given, method, setting))
    return cases


def _column(points: xr.Dataset, simulator: Simulator, name: str) -> NDArray[np.str_]:
    """A parameter of every point: factor or base value; empty if the scene has no such parameter."""
    if name in points.coords:
        return points[name].values.astype(str)
    fixed = json.loads(str(points.attrs.get("fixed_parameters", "{}")))
    return np.full(points.sizes["run"], str(fixed.get(name, "")) if name in simulator.parameters else "")


def _named(method: str, kind: str) -> str:
    return BY_ACCURACY if kind == "accuracy" else method


def _runs(points: xr.Dataset, simulator: Simulator, quantities: Iterable[Quantity]) -> Iterable[TimedRun]:
    """Runs of the points; points that differ only in the repetition are one run."""
    methods = _column(points, simulator, "method")
    settings = {kind: _numbers(points, kind) for kind in _SETTINGS}
    groups: dict[tuple[str, str, float], list[int]] = {}
    for at, method in enumerate(methods):
        kind = next((kind for kind in _SETTINGS if math.isfinite(settings[kind][at])), "")
        if kind:
            groups.setdefault((_named(str(method), kind), kind, float(settings[kind][at])), []).append(at)
    known = list(dict.fromkeys(method for method, _, _ in groups))
    for key in sorted(groups, key=lambda key: (known.index(key[0]), -key[2])):
        run = _timed(points, key, groups[key], quantities)
        if run.outcome not in (Outcome.NOT_APPLICABLE, Outcome.NOT_RUN):
            yield run


def _numbers(points: xr.Dataset, name: str) -> FloatArray:
    if name in points.coords:
        return points[name].values.astype(float)
    fixed = json.loads(str(points.attrs.get("fixed_parameters", "{}")))
    return np.full(points.sizes["run"], float(fixed.get(name, math.nan)))


def _timed(
    points: xr.Dataset, key: tuple[str, str, float], places: list[int], quantities: Iterable[Quantity]
) -> TimedRun:
    first = points.isel(run=places[0])
    outcome = Outcome(int(first["outcome"]))
    with np.errstate(divide="ignore", invalid="ignore"):
        seconds = points["cpu_seconds"].values[places] / points["simulated_seconds"].values[places]
    answers = {}
    if outcome is Outcome.FINISHED:
        for quantity in quantities:
            value = first[quantity.variable].sel(quantity.select)
            for dim in quantity.last:
                value = value.isel({dim: -1})
            numbers = np.atleast_1d(value.values.astype(float)).ravel()
            if np.isfinite(numbers).all():
                answers[quantity.name] = numbers
    return TimedRun(
        *key,
        outcome,
        str(first["outcome_detail"].item()),
        np.where(np.isfinite(seconds), seconds, np.nan),
        float(first["steps"]),
        float(first["force_evaluations"]),
        float(first["solves"]),
        answers,
    )
