"""Prices of uploads, before any of their points run."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from tripod_doe.analyses.fit.fit_file import load_fit
from tripod_doe.analyses.model_choice.study_choice import describe_choice
from tripod_doe.analyses.multifidelity.study_split import describe_split
from tripod_doe.analyses.optimisation.optimisation_file import load_optimisation
from tripod_doe.errors import TooLargeError
from tripod_doe.service.limits import Limits
from tripod_doe.service.requests.uploads import main_file
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.designs import make_points
from tripod_doe.study.plan import Plan, cube_bytes, plan_points
from tripod_doe.workflow.analyses import check_analyses
from tripod_doe.workflow.plan import WorkflowPlan, plans_of, scale
from tripod_doe.workflow.point_batches import POINTS
from tripod_doe.workflow.tolerance_confirmation import confirming_points
from tripod_doe.workflow.workflow import load_workflow

_ENDS = ("low", "mean", "high")
_COUNTS = ("points", "unique", "excluded", "bytes")


def plan_upload(folder: Path, kind: str, limits: Limits, timing: bool) -> dict[str, Any]:
    """Check an upload and give its counts and its price.

    Args:
        folder: Where its files are.
        kind: Kind of the submitted file, one of `KINDS`.
        limits: Limits of the service.
        timing: Whether to time points, for at most ten seconds; else recorded prices are used, if there are any.

    Returns:
        For a workflow, the sums over its studies, and each study under ``steps``; for a fit or an optimisation, its
        points also under ``steps``.

    Raises:
        InputError: If anything in it cannot be used.
        TooLargeError: If it goes beyond a limit.
    """
    place = StudyFolder(folder, trusted=False, most_points=limits.points)
    main = folder / main_file(kind)
    if kind == "study":
        study = parse_study(main.read_text(encoding="utf-8"), main.name, place)
        check_analyses(study)
        return plan_study(study, limits, timing)
    if kind != "workflow":
        return (_plan_fit if kind == "fit" else _plan_optimisation)(main, limits, timing)
    workflow = load_workflow(main, folder=place)
    steps: dict[str, dict[str, Any]] = {}
    plans = plans_of(workflow, partial(_plan_within, limits=limits, timing=False))
    for name, step in workflow.steps.items():
        steps[name] = {"kind": step.table.kind, "inputs": list(step.inputs)}
        if step.study is not None:
            steps[name] |= _described(step.study, plans[name])
    head, hours = workflow.file.workflow, WorkflowPlan(plans).cpu_hours
    studies = [step for step in steps.values() if "points" in step]
    whole: dict[str, Any] = {"name": head.name, "question": head.question, "kind": "workflow", "steps": steps}
    whole |= {key: sum(study[key] or 0 for study in studies) for key in _COUNTS}
    whole |= {"cpu_seconds": _seconds(hours), "timed": 0}
    blocks = [study["blocks"] for study in studies]
    whole["blocks"] = None if None in blocks else sum(blocks)
    whole["warnings"] = [f"{name}: {text}" for name, step in steps.items() for text in step.get("warnings", [])]
    try:
        _check_limits(limits, main.name, sum(price.most for price in plans.values()), whole["bytes"], hours)
    except TooLargeError as error:
        raise TooLargeError(f"{error}{_smaller_pilots(plans, limits)}") from error
    return whole


def _smaller_pilots(plans: Mapping[str, Plan], limits: Limits) -> str:
    """Remedy for a workflow whose pilots may take more points than are allowed."""
    piloted = [name for name, price in plans.items() if price.most_points]
    fits = sum(price.points for price in plans.values()) <= limits.points < sum(price.most for price in plans.values())
    return f": set most_points in [design] of {' and '.join(piloted)}" if piloted and fits else ""


def _plan_fit(path: Path, limits: Limits, timing: bool) -> dict[str, Any]:
    """Counts and usual price of a fit."""
    from tripod_doe.workflow.fit_plan import plan_fit

    plan, head = plan_fit(path, timing, untrusted=True), load_fit(path, untrusted=True).file.fit
    points = plan.search_points + plan.asked_points
    _check_limits(limits, path.name, points, None, plan.seconds and _hours(plan.seconds))
    models = dict.fromkeys(text for each in plan.plans for text in each.models)
    return _search(head.name, head.question, "fit", points) | {
        "cpu_seconds": plan.seconds and dict(zip(_ENDS, plan.seconds, strict=True)),
        "timed": sum(each.timed for each in plan.plans),
        "models": list(models),
        "warnings": list(dict.fromkeys(text for each in plan.plans for text in each.warnings)),
        "points_range": [count + plan.asked_points for count in plan.search_range],
        "records": plan.records,
        "unknowns": list(plan.scalars),
    }


def _plan_optimisation(path: Path, limits: Limits, timing: bool) -> dict[str, Any]:
    """Largest counts and price of an optimisation."""
    from tripod_doe.workflow.optimise_plan import plan_optimisation

    counted = plan_optimisation(path, timing=False, untrusted=True, recorded=False)
    points = sum(part.points for part in counted)
    _check_limits(limits, path.name, points, None, None)
    parts = plan_optimisation(path, timing, untrusted=True, recorded=True)
    hours = [part.cpu_hours for part in parts if part.cpu_hours]
    whole = (sum(low for low, _, _ in hours), sum(mean for _, mean, _ in hours), sum(high for _, _, high in hours))
    known = whole if len(hours) == len(parts) else None
    _check_limits(limits, path.name, points, sum(part.cube_bytes for part in parts), known)
    file = load_optimisation(path, untrusted=True).file
    head = file.optimisation
    return _search(head.name, head.question, "optimisation", points) | {
        "cpu_seconds": _seconds(known),
        "timed": sum(part.timed for part in parts),
        "bytes": sum(part.cube_bytes for part in parts),
        "parts": [{"what": part.what, "candidates": part.candidates, "points": part.points} for part in counted],
        "factors": [*file.variables, *file.scatter],
    }


def _search(name: str, question: str, kind: str, points: int) -> dict[str, Any]:
    """Fields that fits and optimisations share; for a search, a joint that jams is a result, not a failure."""
    own = {"kind": "study", "inputs": [], "points": points, "unique": points, "expected_outcomes": ["jammed"]}
    return {
        "name": name,
        "question": question,
        "kind": kind,
        "points": points,
        "unique": points,
        "excluded": 0,
        "blocks": None,
        "bytes": None,
        "warnings": [],
        "steps": {POINTS: own},
    }


def plan_study(study: Study, limits: Limits, timing: bool) -> dict[str, Any]:
    """Counts and price of one study; see `plan_upload`."""
    return _described(study, _plan_within(study, limits, timing))


def _plan_within(study: Study, limits: Limits, timing: bool) -> Plan:
    """Plan a study that is within the limits."""
    points = make_points(study)
    _check_limits(limits, study.origin, points.count, cube_bytes(study, points), None)  # before each point is judged
    price = replace(plan_points(study, points, timing, recorded=True), confirming=confirming_points(study))
    share = price.most / max(price.points, 1)  # with those that follow from a pilot or from a proposal
    hours = price.cpu_hours and scale(price.cpu_hours, 1 + price.confirming / max(price.points, 1))
    _check_limits(limits, study.origin, price.most, round((price.cube_bytes or 0) * share), hours)
    return price


def _described(study: Study, price: Plan) -> dict[str, Any]:
    """A plan as JSON."""
    more = [f"at most {price.confirming:,} points beyond these, which confirm proposals"] if price.confirming else []
    if price.most_points:
        more.append(f"this is the price of the pilot: at most {price.most_points:,} points run in all")
    return {
        "name": study.file.study.name,
        "question": study.file.study.question,
        "kind": "study",
        "points": price.points,
        "unique": price.unique,
        "excluded": price.excluded,
        "most_points": price.most if price.most_points or price.confirming else 0,
        "blocks": price.blocks,
        "bytes": price.cube_bytes,
        **price_of(price),
        "model_chosen_by_pilot": price.chosen,
        "choice": describe_choice(study, None).splitlines() if price.chosen else describe_split(study, None),
        "foreseen": [{"outcome": f.outcome.label, "reason": f.reason, "count": f.count} for f in price.foreseen],
        "models": list(price.models),
        "factors": list(study.factors),
        "warnings": [*price.warnings, *more],
        "expected_outcomes": list(study.file.run.expected_outcomes),
    }


def price_of(plan: Plan) -> dict[str, Any]:
    """The price in a plan as JSON."""
    return {"cpu_seconds": _seconds(plan.cpu_hours), "timed": plan.timed}


def _seconds(hours: tuple[float, float, float] | None) -> dict[str, float] | None:
    return hours and dict(zip(_ENDS, (3600 * value for value in hours), strict=True))


def _hours(seconds: tuple[float, float, float]) -> tuple[float, float, float]:
    return seconds[0] / 3600, seconds[1] / 3600, seconds[2] / 3600


def _check_limits(
    limits: Limits, origin: str, points: int, cube_bytes: int | None, hours: tuple[float, float, float] | None
) -> None:
    for value, most, what in (
        (points, limits.points, "points"),
        (cube_bytes or 0, limits.cube_bytes, "bytes in its cubes"),
        (hours[1] if hours else 0.0, limits.cpu_hours, "CPU-hours"),
    ):
        if value > most:
            raise TooLargeError(f"{origin}: {value:,.6g} {what}; at most {most:,.6g} are allowed here")


def plan_stored(path: Path, limits: Limits) -> dict[str, Any]:
    """Counts of the study of a result directory, as `plans.plan_upload` gives them, and its ``function``.

    Raises:
        InputError: If its study can no longer be read.
    """
    from tripod_doe.study.result_directory.stored_study import stored_study

    study = stored_study(path, limits.points)
    return plan_study(study, limits, False) | {"function": study.file.study.function}
