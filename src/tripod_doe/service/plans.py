"""Prices of uploaded studies and workflows, before anything of them runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tripod_doe.analysis.model_choice.study_choice import describe_choice
from tripod_doe.analysis.multifidelity.study_split import describe_split
from tripod_doe.service.limits import Limits
from tripod_doe.service.problems import TooLargeError
from tripod_doe.service.uploads import STUDY
from tripod_doe.study.definition import Study, parse_study
from tripod_doe.study.designs import point_count
from tripod_doe.study.plan import Plan, plan
from tripod_doe.workflow.analyses import check_analyses
from tripod_doe.workflow.definition import load_workflow

__all__ = ["plan_study", "plan_upload"]

_COUNTS = ("points", "unique", "excluded", "bytes")


def plan_upload(folder: Path, main: str, limits: Limits, timing: bool) -> dict[str, Any]:
    """Check an upload and give its counts and its price.

    Parameters
    ----------
    folder
        Where its files are.
    main
        Name of the submitted file: a study's or a workflow's.
    limits
        What is allowed.
    timing
        Whether points are timed, for at most ten seconds; otherwise recorded prices are used where there are any.

    Returns
    -------
    dict
        For a workflow the sums over its studies, and each of them under ``steps``.

    Raises
    ------
    InputError
        If anything in it cannot be used.
    TooLargeError
        If it goes beyond a limit.
    """
    if main == STUDY:
        study = parse_study((folder / main).read_text(encoding="utf-8"), main, folder, functions=False)
        check_analyses(study)
        return plan_study(study, limits, timing)
    workflow = load_workflow(folder / main)
    steps = {}
    for name, step in workflow.steps.items():
        price = {} if step.study is None else plan_study(step.study, limits, timing=False)
        steps[name] = {"kind": step.table.kind, "inputs": list(step.inputs)} | price
    head = workflow.file.workflow
    studies = [step for step in steps.values() if "points" in step]
    whole: dict[str, Any] = {"name": head.name, "question": head.question, "kind": "workflow", "steps": steps}
    whole |= {key: sum(study[key] or 0 for study in studies) for key in _COUNTS}
    whole |= {"cpu_seconds": _total([study["cpu_seconds"] for study in studies]), "timed": 0}
    blocks = [study["blocks"] for study in studies]
    whole["blocks"] = None if None in blocks else sum(blocks)
    whole["warnings"] = [f"{name}: {text}" for name, step in steps.items() for text in step.get("warnings", [])]
    _check_limits(whole, limits)
    return whole


def plan_study(study: Study, limits: Limits, timing: bool) -> dict[str, Any]:
    """Counts and price of one study; see `plan_upload`."""
    counted = point_count(study)
    if counted > limits.points:  # before any point is made
        raise TooLargeError(f"{study.origin}: {counted:,} points; at most {limits.points:,} are allowed here")
    price = plan(study, timing, recorded=True)
    told = _told(study, price)
    _check_limits(told, limits, study.origin)
    return told


def _told(study: Study, price: Plan) -> dict[str, Any]:
    """A plan as JSON."""
    return {
        "name": study.file.study.name,
        "question": study.file.study.question,
        "kind": "study",
        "points": price.points,
        "unique": price.unique,
        "excluded": price.excluded,
        "blocks": price.blocks,
        "bytes": price.cube_bytes,
        "cpu_seconds": _seconds(price.cpu_hours),
        "timed": price.timed,
        "model_chosen_by_pilot": price.chosen,
        "choice": describe_choice(study, None).splitlines() if price.chosen else describe_split(study, None),
        "foreseen": [{"outcome": f.outcome.label, "reason": f.reason, "count": f.count} for f in price.foreseen],
        "models": list(price.models),
        "warnings": list(price.warnings),
        "expected_outcomes": list(study.file.run.expected_outcomes),
    }


def _seconds(hours: tuple[float, float, float] | None) -> dict[str, float] | None:
    return hours and dict(zip(("low", "mean", "high"), (3600 * value for value in hours), strict=True))


def _total(prices: Sequence[dict[str, float] | None]) -> dict[str, float] | None:
    """The sum of prices; none where one is not known."""
    known = [price for price in prices if price is not None]
    if len(known) < len(prices):
        return None
    return {end: math.fsum(price[end] for price in known) for end in ("low", "mean", "high")}


def _check_limits(told: dict[str, Any], limits: Limits, origin: str = "workflow.toml") -> None:
    price = told["cpu_seconds"]
    hours = price["mean"] / 3600 if price else 0.0
    for value, most, what in (
        (told["points"], limits.points, "points"),
        (told["bytes"] or 0, limits.cube_bytes, "bytes in its cubes"),
        (hours, limits.cpu_hours, "CPU-hours"),
    ):
        if value > most:
            raise TooLargeError(f"{origin}: {value:,.6g} {what}; at most {most:,.6g} are allowed here")
