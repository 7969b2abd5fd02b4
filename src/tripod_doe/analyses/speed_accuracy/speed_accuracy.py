"""Error against CPU time of every method and model: references, errors, prices, Pareto front, price at a target.

Numerical error is the difference of a run to the reference of its own scene and model, model error that to the
reference of the finest model. Of the finest finished runs of all methods, the two that agree best in all quantities
together are selected. The more expensive one is the reference, and their difference is its own error, since the two
methods share no discretisation; but not less than the better of the two converges to by itself, since of many methods
two agree by chance. Errors below it are known only to be below it.
"""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field

from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.speed_accuracy.timed_runs import BY_ACCURACY, QUANTITIES, Case, TimedRun, read_cases
from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.model_interface import Flag, Outcome
from tripod_doe.study.definition.study_file_schema import Table


class Known(Flag):
    """How a price at the target error is known; the integer is the CF flag value."""

    INTERPOLATED = 0
    AT_MOST = 1
    NOT_REACHED = 2
    PRICE_ONLY = 3
    FAILED = 4
    LIMITED = 5


_KNOWN_MEANINGS = (
    "interpolated: between two finished runs, on logarithmic scales; at_most: the coarsest run meets the target, a "
    "coarser one might too; limited: the coarsest run that does not fail meets it, so that stability sets the price; "
    "not_reached: no finished run meets it; price_only: no run reached its end, so this is the price of the cheapest "
    "one that did not fail, extrapolated from the part that it simulated; failed: all runs failed"
)


_SURE = (Known.INTERPOLATED, Known.AT_MOST, Known.LIMITED)


class SpeedAccuracySettings(Table):
    """Settings of speed-accuracy as a step of a workflow."""

    target: float = Field(0.005, gt=0, lt=1, description="relative error at which prices are compared")


@dataclass(frozen=True)
class _Reference:
    """The reference run of a case, the method that agrees with it best, and its own error per quantity."""

    run: TimedRun
    witness: str
    errors: Mapping[str, float]


@dataclass(frozen=True)
class _Price:
    """CPU seconds per simulated second at the target error, and how that is known."""

    value: float
    known: Known


@makes_kind("speed-accuracy")
def speed_accuracy(cubes: Mapping[str, xr.Dataset], settings: SpeedAccuracySettings) -> xr.Dataset:
    """Compare methods and models by error and price.

    Args:
        cubes: Cubes of method studies with their costs, one per scene.

    Returns:
        Along ``run``: prices, work, outcome; along run and ``quantity`` the relative errors and whether the run is on
        the front; along ``case`` (scene and model) the references; along case, ``method`` and quantity the price at the
        target, as ``price`` in CPU seconds per simulated second and as ratio to the case's default method.

    Raises:
        InputError: If a cube has no costs or nothing to compare.
    """
    cases = read_cases(cubes)
    if not cases:
        raise InputError("there is no run of any method in these cubes")
    references = {case.label: _reference(case) for case in cases}
    finest = {case.scene: case.label for case in cases if references[case.label] is not None}
    several = {case.scene for case in cases if sum(other.scene == case.scene for other in cases) > 1}
    truths = {
        case.label: references.get(finest.get(case.scene, "")) if case.scene in several else None for case in cases
    }
    parts = _run_variables(cases, references, truths) | _case_variables(cases, references, settings.target)
    used = {quantity.name for case in cases for quantity in case.quantities}
    names = [quantity.name for quantity in QUANTITIES if quantity.name in used]
    result = xr.Dataset(parts, attrs={"title": "Speed and accuracy", "target": settings.target})
    result["quantity"] = [quantity.name for quantity in QUANTITIES]
    result["quantity_meaning"] = "quantity", [quantity.meaning for quantity in QUANTITIES]
    return result.sel(quantity=names)


def _distance(answer: FloatArray, truth: FloatArray) -> float:
    """Norm of the difference over the norm of the truth; NaN if they cannot be compared."""
    size = float(np.linalg.norm(truth))
    if answer.shape != truth.shape or size == 0.0:
        return math.nan
    return float(np.linalg.norm(answer - truth)) / size


def _reference(case: Case) -> _Reference | None:
    """The more expensive of the two methods whose finest runs agree best; None if fewer than two methods finished.

    Runs by accuracy have the method of others, and are no witness.
    """
    methods = [method for method in case.methods if method != BY_ACCURACY]
    finest = [done[-1] for method in methods if (done := [run for run in case.of(method) if run.finished])]
    best: _Reference | None = None
    own = {id(run): _own_convergence([each for each in case.of(run.method) if each.finished]) for run in finest}
    for one, other in itertools.combinations(sorted(finest, key=lambda run: run.price), 2):
        apart = {
            name: np.fmax(
                _distance(one.answers[name], answer),
                np.fmin(own[id(one)].get(name, np.nan), own[id(other)].get(name, np.nan)),
            )
            for name, answer in other.answers.items()
            if name in one.answers
        }
        errors = {name: float(error) for name, error in apart.items() if math.isfinite(error)}
        if errors and (best is None or _mean(errors.values()) < _mean(best.errors.values())):
            best = _Reference(other, one.method, errors)
    return best


def _own_convergence(done: Sequence[TimedRun]) -> dict[str, float]:
    """Error of the finest run of a method by its change from the next one, by quantity; empty of a single run.

    By the method's order (Richardson), or in proportion to the tolerance.
    """
    if len(done) < 2:
        return {}
    coarse, fine = done[-2:]
    order = METHODS[fine.method].order if fine.kind == "step_s" and fine.method in METHODS else 1
    further = (coarse.setting / fine.setting) ** order - 1
    names = [name for name in fine.answers if name in coarse.answers] if further > 0 else []
    return {name: _distance(coarse.answers[name], fine.answers[name]) / further for name in names}


def _mean(errors: Iterable[float]) -> float:
    """Geometric mean, so that no quantity dominates; zeros are replaced by the rounding error."""
    return float(np.exp(np.mean(np.log(np.maximum(list(errors), 1e-16)))))


def _errors(runs: Iterable[TimedRun], reference: _Reference | None) -> FloatArray:
    """Relative error of every run and quantity against a reference, shape (run, QUANTITIES)."""
    truth = reference.run.answers if reference else {}
    return np.array(
        [
            [
                _distance(run.answers[quantity.name], truth[quantity.name])
                if quantity.name in run.answers and quantity.name in truth
                else math.nan
                for quantity in QUANTITIES
            ]
            for run in runs
        ]
    )


def _own_errors(reference: _Reference | None) -> FloatArray:
    """Error of a reference itself, by quantity."""
    known = reference.errors if reference else {}
    return np.array([known.get(quantity.name, math.nan) for quantity in QUANTITIES])


def _front(prices: FloatArray, errors: FloatArray) -> NDArray[np.int8]:
    """1 for runs that none is both cheaper and more exact than, shape (run, quantity); errors floored beforehand."""
    on_front = np.zeros(errors.shape, np.int8)
    for column in range(errors.shape[1]):
        usable = np.flatnonzero(np.isfinite(errors[:, column]) & np.isfinite(prices))
        least = math.inf
        for at in usable[np.lexsort((errors[usable, column], prices[usable]))]:
            if errors[at, column] < least:
                least = errors[at, column]
                on_front[at, column] = 1
    return on_front


def _run_variables(
    cases: Sequence[Case], references: Mapping[str, _Reference | None], truths: Mapping[str, _Reference | None]
) -> dict[str, Any]:
    """Everything along ``run``."""
    runs = [(case, run) for case in cases for run in case.runs]
    prices = np.array([run.price for _, run in runs])
    own = [_errors(case.runs, references[case.label]) for case in cases]
    floors = [np.maximum(errors, _own_errors(references[case.label])) for case, errors in zip(cases, own, strict=True)]
    fronts = [
        _front(np.array([run.price for run in case.runs]), floored) for case, floored in zip(cases, floors, strict=True)
    ]
    model = np.vstack([_errors(case.runs, truths[case.label]) for case in cases])
    total = np.vstack([_total_errors(case, references[case.label], truths[case.label]) for case in cases])
    model_front = np.zeros(model.shape, np.int8)
    for scene in dict.fromkeys(case.scene for case in cases):  # all models of a scene compete
        rows = np.array([case.scene == scene for case, _ in runs])
        model_front[rows] = _front(prices[rows], total[rows])
    repeated = [run.seconds[np.isfinite(run.seconds)] for _, run in runs]
    spread = np.array([(values.min(), values.max()) if values.size else (np.nan, np.nan) for values in repeated])

    def along(values: Iterable[Any], meaning: str, unit: str = "") -> tuple[Any, ...]:
        return "run", np.array(list(values)), {"long_name": meaning} | ({"units": unit} if unit else {})

    def error(values: NDArray[Any], meaning: str) -> tuple[Any, ...]:
        return ("run", "quantity"), values, {"long_name": meaning, "units": "1"}

    flags = Outcome.attributes("how the run ended")
    per = "CPU seconds per simulated second"
    return {
        "scene": along((case.scene for case, _ in runs), "step of the workflow"),
        "model": along((case.model for case, _ in runs), "model; empty if the scene has only one"),
        "run_method": along((run.method for _, run in runs), "time integration method"),
        "setting_kind": along((run.kind for _, run in runs), "parameter that is set"),
        "setting": along((run.setting for _, run in runs), "step in s, relative tolerance, or accuracy"),
        "described": along((run.described for _, run in runs), "method and setting"),
        "is_default": along(
            (np.int8(_is_default(case, run)) for case, run in runs), "1 for the default method and its default setting"
        ),
        "outcome": ("run", np.array([run.outcome for _, run in runs], np.int8), flags),
        "outcome_detail": along((run.detail for _, run in runs), "reason of a failure; empty if it finished"),
        "cpu_per_second": along(
            prices, f"{per}, median of the repetitions; for a failed run, per second simulated until the failure", "1"
        ),
        "cpu_per_second_low": along(spread[:, 0], f"least {per}", "1"),
        "cpu_per_second_high": along(spread[:, 1], f"largest {per}", "1"),
        "repetitions": along((np.int32(run.seconds.size) for _, run in runs), "number of repetitions"),
        "steps": along((run.steps for _, run in runs), "steps", "1"),
        "solves": along((run.solves for _, run in runs), "factorisations of a linear system", "1"),
        "force_evaluations": along((run.force_evaluations for _, run in runs), "evaluations of all forces", "1"),
        "numerical_error": error(np.vstack(own), "relative difference to the reference of the same model"),
        "model_error": error(model, "relative difference to the reference of the finest model"),
        "total_error": error(total, "numerical error plus the error of the model, by its reference or its finest run"),
        "below_reference": error(
            np.vstack(
                [
                    np.less_equal(errors, _own_errors(references[case.label])).astype(np.int8)
                    for case, errors in zip(cases, own, strict=True)
                ]
            ),
            "1 where the numerical error is not larger than the reference's own",
        ),
        "front": error(np.vstack(fronts), "1 where no run of this scene and model is cheaper and more exact"),
        "model_front": error(
            model_front, "1 where no run of any model of this scene is cheaper and has a smaller total error"
        ),
    }


def _total_errors(case: Case, reference: _Reference | None, truth: _Reference | None) -> FloatArray:
    """Numerical error of every run plus the error of its model, shape (run, QUANTITIES).

    So a numerical error that happens to cancel the model's does not count as accuracy. Where one method alone finished,
    its finest run stands for the model.
    """
    own = reference or _finest_alone(case)
    if own is None or truth is None:
        return np.full((len(case.runs), len(QUANTITIES)), math.nan)
    of_model = 0.0 if own is truth else np.fmax(_errors([own.run], truth)[0], _own_errors(truth))
    return np.maximum(_errors(case.runs, own), _own_errors(own)) + of_model


def _finest_alone(case: Case) -> _Reference | None:
    """The finest run of the last method that finished, with the error to which it converges by itself."""
    done = [run for run in case.runs if run.finished]
    alike = [run for run in done if run.method == done[-1].method]
    return _Reference(alike[-1], "", _own_convergence(alike)) if alike else None


def _is_default(case: Case, run: TimedRun) -> bool:
    return run.method == case.default_method and math.isclose(run.setting, case.default_setting, rel_tol=1e-9)


def _case_variables(
    cases: Sequence[Case], references: Mapping[str, _Reference | None], target: float
) -> dict[str, Any]:
    """Everything along ``case``."""
    methods = list(dict.fromkeys(method for case in cases for method in case.methods))
    shape = (len(cases), len(methods), len(QUANTITIES))
    prices, known = np.full(shape, np.nan), np.full(shape, Known.FAILED, np.int8)
    ratios, leads = np.full(shape, np.nan), np.full((shape[0], shape[2]), np.nan)
    best = np.full((shape[0], shape[2]), "", dtype=object)
    for i, case in enumerate(cases):
        reference = references[case.label]
        errors = np.maximum(_errors(case.runs, reference), _own_errors(reference))
        for q, quantity in enumerate(QUANTITIES):
            if quantity not in case.quantities or reference is None:
                continue
            prices_of = {method: _price(case, method, errors[:, q], target) for method in case.methods}
            for method, price in prices_of.items():
                at = i, methods.index(method), q
                prices[at], known[at] = price.value, price.known
                if case.default_method in prices_of:
                    ratios[at] = price.value / prices_of[case.default_method].value
            sure = {m: p.value for m, p in prices_of.items() if p.known in _SURE}
            if sure:
                best[i, q] = min(sure, key=lambda method: sure[method])
                if case.default_method in sure:
                    leads[i, q] = sure[case.default_method] / sure[best[i, q]]
    flags = {
        "flag_values": np.array(list(Known), np.int8),
        "comment": _KNOWN_MEANINGS,
        "flag_meanings": " ".join(kind.name.lower() for kind in Known),
    }
    three = ("case", "method", "quantity")
    referred = [references[case.label] for case in cases]
    return {
        "case": ("case", [case.label for case in cases], {"long_name": "scene and model"}),
        "method": ("method", methods, {"long_name": "time integration method"}),
        "case_scene": ("case", [case.scene for case in cases], {"long_name": "step of the workflow"}),
        "case_model": ("case", [case.model for case in cases], {"long_name": "model"}),
        "default_method": ("case", [case.default_method for case in cases], {"long_name": "default method"}),
        "reference": (
            "case",
            [_described(reference) for reference in referred],
            {"long_name": "reference run, and the method that agrees with it best"},
        ),
        "reference_error": (
            ("case", "quantity"),
            np.vstack([_own_errors(r) for r in referred]),
            {
                "long_name": "relative error of the reference: difference to the finest run of another method",
                "units": "1",
            },
        ),
        "price": (
            three,
            prices,
            {"long_name": f"CPU seconds per simulated second at {100 * target:g} % error", "units": "1"},
        ),
        "price_known": (three, known, {"long_name": "how the price is known"} | flags),
        "price_ratio": (three, ratios, {"long_name": "price over the price of the default method", "units": "1"}),
        "best_method": (("case", "quantity"), best.astype(str), {"long_name": "method with the lowest price"}),
        "default_over_best": (
            ("case", "quantity"),
            leads,
            {"long_name": "price of the default method over the lowest", "units": "1"},
        ),
    }


def _described(reference: _Reference | None) -> str:
    if reference is None:
        return ""
    return f"{reference.run.described}, with {reference.witness}"


def _price(case: Case, method: str, errors: FloatArray, target: float) -> _Price:
    """Price of a method at the target error.

    Args:
        errors: Of all runs of the case, not below those of the reference, shape (run,).
    """
    rows = [(run, errors[at]) for at, run in enumerate(case.runs) if run.method == method]
    done = [(run.price, error) for run, error in rows if run.finished and math.isfinite(error)]
    if not done:
        stopped = [run.price for run, _ in rows if run.outcome is Outcome.EVALUATION_LIMIT]
        return _Price(min(stopped), Known.PRICE_ONLY) if stopped else _Price(math.nan, Known.FAILED)
    above = [at for at, (_, error) in enumerate(done) if error > target]
    if not above:
        price, cheapest = min((run.price, at) for at, (run, _) in enumerate(rows) if run.finished)
        coarser_failed = any(not run.finished for run, _ in rows[:cheapest])
        return _Price(price, Known.LIMITED if coarser_failed else Known.AT_MOST)
    if above[-1] == len(done) - 1:
        return _Price(math.nan, Known.NOT_REACHED)
    (before, coarse), (after, fine) = done[above[-1]], done[above[-1] + 1]
    share = math.log(coarse / target) / math.log(coarse / max(fine, 1e-300))
    return _Price(before * (after / before) ** share, Known.INTERPOLATED)
