"""Stability maps: the largest step up to which all runs are right, per method, and the predicted border.

The study varies the method, the step (or the tolerance) and operating points. A run is *good* if it finished and its
output lies within `limit` of the reference of its operating point, *refused* if it did not finish, and *wrong* if it
finished with another number: a failure that no check detected. The reference is in the same cube: the finest runs
of two methods that agree best (of one method, where it is alone, its two finest).

The border is predicted from the rates of the reference run (`mechanics.checks.linearisation`):

    explicit methods    reach / rate of friction or of the stiffest contact mode, whichever is less (`Method.reach`)
    linearly implicit   limit / rate of the secant's lag: always stable, but its velocities are late
    step control        the tolerance is the error aimed at, so the border is the limit itself
    all others          none: their equations are solved, and they damp what they do not resolve
"""

import math
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field

from tripod_doe.analyses.diff.shared_points import factors_of
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.mechanics.integrators.method_interface import Method
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.model_interface import Flag, Outcome
from tripod_doe.phases import JUMPS, is_phase
from tripod_doe.study.definition.simulators import load_simulator
from tripod_doe.study.definition.study_file_schema import Table, parse_file

_NUMERICS = ("step_s", "relative_tolerance")
_RATES = ("friction_rate_per_s", "contact_rate_per_s", "secant_lag_rate_per_s")
_SURE = 0.2
"""Share of the limit within which two runs must agree to be a reference."""


class RunKind(Flag):
    """Result of one run compared with the reference; the integer is the CF flag value."""

    GOOD = 0
    REFUSED = 1
    WRONG = 2
    UNKNOWN = 3
    ABSENT = 4


class Limit(Flag):
    """Limit of the step in the prediction; the integer is the CF flag value."""

    NONE = 0
    FRICTION = 1
    CONTACT = 2
    LAG = 3
    TOLERANCE = 4
    UNKNOWN = 5


class Agreement(Flag):
    """Whether measured and predicted border agree; the integer is the CF flag value."""

    NO = 0
    YES = 1
    NOT_DECIDED = 2


class StabilitySettings(Table):
    """[analysis.NAME] of kind stability."""

    output: str = Field(description="output that is compared with the reference")
    select: dict[str, float] = Field({}, description="component of the output, for instance order = 3")
    limit: float = Field(0.02, gt=0, lt=1, description="relative error up to which a run is right")
    factor: float = Field(2.0, gt=1, description="factor within which measured and predicted border agree")

    @property
    def outputs(self) -> list[str]:
        """Outputs that the study must keep."""
        return [self.output]


@dataclass(frozen=True)
class _Runs:
    """A cube as a table of runs, shape (method, case, step) each; a case is an operating point."""

    # methods, steps, cases: labels; `cases` holds the values of every factor but the numerics, each of shape (case,)
    methods: list[str]
    steps: FloatArray
    cases: dict[str, FloatArray]
    numerics: str  # name of the step or tolerance
    # outcome, value, detail: how each run ended, its output, and why
    outcome: NDArray[np.int8]
    value: FloatArray
    detail: NDArray[Any]
    rates: FloatArray  # rates of friction, contact and lag, shape (method, case, step, 3); NaN where not known


def predicted_border(method: Method, rates: FloatArray, limit: float) -> tuple[float, Limit]:
    """Predicted border, and what limits it; infinite if there is no border, NaN if rates are unknown.

    Args:
        rates: Rates of friction, of the stiffest contact mode, and of the secant's lag, 1/s.
        limit: Relative error up to which a run is good.
    """
    if method.controlled:
        return limit, Limit.TOLERANCE
    if not method.explicit and not method.lagged:
        return math.inf, Limit.NONE
    if not np.isfinite(rates).all():
        return math.nan, Limit.UNKNOWN
    friction, contact, lag = (1 / max(float(rate), 1e-300) for rate in rates)
    borders = {Limit.FRICTION: method.reach[0] * friction, Limit.CONTACT: method.reach[1] * contact}
    if method.lagged:
        borders[Limit.LAG] = limit * lag
    what = min(borders, key=lambda key: borders[key])
    return borders[what], what


@makes_kind("stability")
def stability_borders(cube: xr.Dataset, settings: StabilitySettings) -> xr.Dataset:
    """Measured and predicted border of every method at every operating point.

    Args:
        cube: Cube of a grid or product over ``method``, ``step_s`` or ``relative_tolerance``, and other numeric
            factors.

    Returns:
        Per method and case: ``border_low`` and ``border_high``, the last step up to which all runs are good and the
        next one (NaN and inf where there is none), ``border_predicted`` (inf for none) with ``limited_by``, ``ratio``,
        ``agrees``, ``first_failure`` (an outcome; finished means a wrong number that passed) and its detail, and
        ``wrong_runs``. Per method ``default_setting``. Per run: ``run_kind``, ``run_outcome`` and ``error``. Per case
        the reference and how well it is known.

    Raises:
        InputError: If the factors or the output are missing.
    """
    runs = _runs(cube, settings)
    reference, certainty, rates, source = _references(runs)
    certain = certainty <= _SURE * settings.limit
    apart = np.abs(runs.value - reference[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        error = np.where(apart == 0, 0.0, apart / np.abs(reference[:, None]))  # a reference may be zero
    kind = np.full(runs.outcome.shape, RunKind.REFUSED, np.int8)
    done = runs.outcome == Outcome.FINISHED
    kind[done & (error <= settings.limit)] = RunKind.GOOD
    kind[done & ~(error <= settings.limit)] = RunKind.WRONG
    kind[done & ~certain[:, None]] = RunKind.UNKNOWN
    kind[np.isin(runs.outcome, (Outcome.NOT_RUN, Outcome.NOT_APPLICABLE))] = RunKind.ABSENT
    borders = [
        [
            _border(runs, kind, m, c, predicted_border(METHODS[name], rates[c], settings.limit), settings.factor)
            for c in range(certainty.size)
        ]
        for m, name in enumerate(runs.methods)
    ]
    return _labelled(cube, runs, settings, borders, kind, error, (reference, certainty, rates, source))


def _runs(cube: xr.Dataset, settings: StabilitySettings) -> _Runs:
    """Read a cube as a table of runs."""
    names = factors_of(cube)
    numerics = [name for name in _NUMERICS if name in names]
    if "method" not in names or len(numerics) != 1:
        raise InputError("stability needs the factors method and either step_s or relative_tolerance")
    others = [name for name in names if name not in ("method", numerics[0])]
    words = [name for name in others if cube[name].dtype.kind not in "fiu"]
    if words:
        raise InputError(f"a stability map needs numeric factors, and {words[0]} is not numeric; make it a base value")
    columns = {name: xr.broadcast(cube["outcome"], cube[name])[1].values.ravel() for name in names}
    methods, which = _labels(columns["method"].astype(str))
    steps, at = np.unique(np.round(np.log(columns[numerics[0]].astype(float)), 9), return_inverse=True)
    table = np.column_stack([columns[name].astype(float) for name in others] or [np.zeros(which.size)])
    _, first, case = np.unique(table, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(np.argsort(first))  # cases as they come in the study: its base is the first
    place = (which, order[case.ravel()], at)
    shape = (len(methods), first.size, steps.size)
    detail = cube["outcome_detail"].values.ravel() if "outcome_detail" in cube else np.full(which.size, "")
    rates = [cube[name].values.ravel() if name in cube else np.full(which.size, np.nan) for name in _RATES]
    return _Runs(
        methods,
        np.exp(steps),
        {name: table[np.sort(first), i] for i, name in enumerate(others)},
        numerics[0],
        _placed(shape, place, cube["outcome"].values.ravel().astype(np.int8), np.int8(Outcome.NOT_RUN)),
        _placed(shape, place, _output(cube, settings), np.nan),
        _placed(shape, place, detail.astype(object), ""),
        np.stack([_placed(shape, place, rate, np.nan) for rate in rates], axis=-1),
    )


def _labels(column: NDArray[Any]) -> tuple[list[str], IntArray]:
    """Distinct words in the order in which they come, and which of them each row has."""
    words = list(dict.fromkeys(column.tolist()))
    return words, np.array([words.index(word) for word in column])


def _placed(shape: tuple[int, ...], place: tuple[Any, ...], column: NDArray[Any], nothing: Any) -> NDArray[Any]:
    table = np.full(shape, nothing, column.dtype)
    table[place] = column
    return table


def _output(cube: xr.Dataset, settings: StabilitySettings) -> FloatArray:
    """The output that is compared, shape (point,)."""
    if settings.output not in cube:
        known = [str(name) for name in cube.data_vars]
        raise InputError(f"output = {settings.output!r}: not in the cube{near_match(settings.output, known)}")
    values = cube[settings.output]
    if is_phase(values):
        raise InputError(f"output = {settings.output!r}: {JUMPS}")
    for dim, label in settings.select.items():
        if dim not in values.dims or label not in values[dim].values:
            raise InputError(f"select: {dim} = {label:g} is not in {settings.output}")
    values = values.sel(settings.select)
    if values.dims != cube["outcome"].dims:
        left = [str(dim) for dim in values.dims if dim not in cube["outcome"].dims]
        raise InputError(f"{settings.output} has one value per {left[0]}; choose one with select")
    return values.values.ravel().astype(float)


def _references(runs: _Runs) -> tuple[FloatArray, FloatArray, FloatArray, list[str]]:
    """Per case: the reference, the relative difference of the two runs that make it, its rates, and their methods."""
    count = runs.outcome.shape[1]
    value, certainty = np.full(count, np.nan), np.full(count, np.inf)
    rates, source = np.full((count, len(_RATES)), np.nan), [""] * count
    for c in range(count):
        done = [np.flatnonzero(runs.outcome[m, c] == Outcome.FINISHED) for m in range(len(runs.methods))]
        finest = [(m, int(steps[0])) for m, steps in enumerate(done) if steps.size]
        if len(runs.methods) == 1:
            finest = [(0, int(s)) for s in done[0][:2]]
        for one, other in combinations(finest, 2):
            a, b = runs.value[one[0], c, one[1]], runs.value[other[0], c, other[1]]
            apart = abs(a - b) / max(abs(a), abs(b), 1e-300)
            own = [_own_convergence(runs, run[0], c, done[run[0]]) for run in (one, other)]
            apart = float(np.fmax(apart, np.fmin(own[0], own[1])))  # of several methods, two agree by chance
            if apart < certainty[c]:
                better = max(one, other, key=lambda run: METHODS[runs.methods[run[0]]].order)
                certainty[c], value[c] = apart, runs.value[better[0], c, better[1]]
                rates[c] = runs.rates[better[0], c, better[1]]
                source[c] = " and ".join(dict.fromkeys((runs.methods[one[0]], runs.methods[other[0]])))
    return value, certainty, rates, source


def _own_convergence(runs: _Runs, m: int, c: int, done: IntArray) -> float:
    """Relative error of the finest of some finished runs by its change from the next one; NaN of a single run."""
    if done.size < 2:
        return math.nan
    fine, coarse = runs.value[m, c, done[:2]].tolist()
    order = METHODS[runs.methods[m]].order if runs.numerics == "step_s" else 1
    further = (runs.steps[done[1]] / runs.steps[done[0]]) ** order - 1
    return float(abs(coarse - fine) / max(abs(fine), 1e-300) / further)


def _border(
    runs: _Runs, kind: NDArray[np.int8], m: int, c: int, predicted: tuple[float, Limit], factor: float
) -> dict[str, Any]:
    """Measured border of one method at one case, against the predicted one."""
    there = np.flatnonzero(kind[m, c] != RunKind.ABSENT)
    bad = np.flatnonzero(kind[m, c, there] != RunKind.GOOD)
    first = int(bad[0]) if bad.size else there.size
    low = float(runs.steps[there[first - 1]]) if first > 0 else math.nan
    high = float(runs.steps[there[first]]) if bad.size else math.inf
    referenced = bool((kind[:, c] == RunKind.GOOD).any())
    known = referenced and there.size > 0 and not math.isnan(predicted[0])
    failed = there[first] if bad.size else None
    bounded = known and max(low * high, predicted[0]) < math.inf
    return {
        "border_low": low,
        "border_high": high,
        "border_predicted": predicted[0],
        "limited_by": predicted[1],
        "ratio": math.sqrt(low * high) / predicted[0] if bounded else math.nan,
        "agrees": _agreement(low, high, predicted[0], factor) if known else Agreement.NOT_DECIDED,
        "first_failure": Outcome.NOT_RUN if failed is None else int(runs.outcome[m, c, failed]),
        "first_detail": "" if failed is None else str(runs.detail[m, c, failed]),
        "wrong_runs": int((kind[m, c] == RunKind.WRONG).sum()),
    }


def _agreement(low: float, high: float, predicted: float, factor: float) -> Agreement:
    """Whether measured and predicted border agree; with an open bracket, any prediction beyond its end agrees."""
    if math.isinf(high):
        return Agreement(int(predicted >= low / factor))
    if math.isnan(low):
        return Agreement(int(predicted <= high * factor))
    return Agreement(int(1 / factor <= math.sqrt(low * high) / predicted <= factor))


_MEANINGS = {
    "border_low": "last step or tolerance up to which all runs are right; missing if none is",
    "border_high": "first step or tolerance whose run is not right; infinite if all are",
    "border_predicted": "predicted border; infinite for none",
    "ratio": "measured border (geometric mean of its bracket) over the predicted one",
    "first_detail": "why the first run that is not right failed",
    "wrong_runs": "runs that finished with a wrong result",
}
_FLAGS: dict[str, tuple[type[Flag], str]] = {
    "limited_by": (Limit, "what limits the step in the prediction"),
    "agrees": (Agreement, "whether measured and predicted border agree"),
    "first_failure": (Outcome, "outcome of the first run that is not right; not_run if all are right"),
}


def _labelled(
    cube: xr.Dataset,
    runs: _Runs,
    settings: StabilitySettings,
    borders: list[list[dict[str, Any]]],
    kind: NDArray[np.int8],
    error: FloatArray,
    references: tuple[FloatArray, FloatArray, FloatArray, list[str]],
) -> xr.Dataset:
    """Result as a Dataset with labels and attributes."""
    reference, certainty, rates, source = references
    unit = {"units": "s" if runs.numerics == "step_s" else "1"}
    per_border, per_run = ("method", "case"), ("method", "case", "numerics")
    columns: dict[str, Any] = {}
    for name, meaning in _MEANINGS.items():
        data = np.array([[border[name] for border in row] for row in borders])
        columns[name] = (per_border, data, {"long_name": meaning} | (unit if name.startswith("border") else {}))
    for name, (flags, meaning) in _FLAGS.items():
        data = np.array([[border[name] for border in row] for row in borders], np.int8)
        columns[name] = (per_border, data, flags.attributes(meaning))
    own = {"long_name": "default step or tolerance of the method; missing where it has none"} | unit
    columns["default_setting"] = ("method", _default_settings(cube, runs), own)
    columns["run_kind"] = (per_run, kind, RunKind.attributes("result of the run compared with the reference"))
    columns["run_outcome"] = (per_run, runs.outcome, Outcome.attributes("how the run ended"))
    columns["error"] = (per_run, error, {"long_name": "relative error of a run that finished", "units": "1"})
    known = cube[settings.output].attrs.get("units", "1")
    columns["reference"] = ("case", reference, {"long_name": f"reference of {settings.output}", "units": known})
    columns["reference_error"] = ("case", certainty, {"long_name": "relative difference of two methods", "units": "1"})
    columns["reference_source"] = ("case", np.array(source), {"long_name": "methods of the reference"})
    for i, name in enumerate(_RATES):
        columns[name] = ("case", rates[:, i], {"long_name": f"{name} of the reference", "units": "s-1"})
    coordinates: dict[str, Any] = {
        "method": ("method", np.array(runs.methods), {"long_name": "time integration method"}),
        "numerics": ("numerics", runs.steps, {"long_name": runs.numerics} | unit),
        "varied": ("case", np.array(_varied(runs.cases)), {"long_name": "factor that differs from the first case"}),
    }
    for name, values in runs.cases.items():
        coordinates[name] = ("case", values, {k: v for k, v in cube[name].attrs.items() if k in ("units", "long_name")})
    attrs = {"numerics": runs.numerics, "output": settings.output, "limit": settings.limit, "factor": settings.factor}
    return xr.Dataset(columns, coordinates, attrs | {"select": str(settings.select)})


def _default_settings(cube: xr.Dataset, runs: _Runs) -> FloatArray:
    """The default step or tolerance of each method, shape (method,); NaN if unknown."""
    try:
        file = parse_file(str(cube.attrs["study"]), "the study in the cube")
        simulator = load_simulator(file.study.scene)
    except (KeyError, InputError):  # a cube of another version, or of a user's function
        return np.full(len(runs.methods), np.nan)
    model = file.base.get("model", simulator.parameters["model"].default) if "model" in simulator.parameters else ""
    known = simulator.methods({"model": str(model)})
    return np.array([known.get(name, {}).get(runs.numerics) or np.nan for name in runs.methods], float)


def _varied(cases: dict[str, FloatArray]) -> list[str]:
    """The factor in which each case differs from the first case: base for the first, empty if there are several."""
    count = len(next(iter(cases.values()))) if cases else 1
    names = []
    for c in range(count):
        apart = [name for name, values in cases.items() if values[c] != values[0]]
        names.append(apart[0] if len(apart) == 1 else "base" if not apart else "")
    return names


def maps(borders: xr.Dataset) -> list[str]:
    """The factors that a stability analysis varies, each of which makes a map."""
    return [name for name in dict.fromkeys(borders["varied"].values.tolist()) if name not in ("base", "")]


def map_of(borders: xr.Dataset, factor: str) -> xr.Dataset:
    """The cases of one map, the base among them, by the value of their factor."""
    return borders.isel(case=np.isin(borders["varied"].values, ("base", factor))).sortby(factor)
