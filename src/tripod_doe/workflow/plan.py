"""Plan of a workflow before anything runs: the plans of its studies, and their sum."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from tripod_doe.number_text import duration, size
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.plan import RECORDED, Plan, plan
from tripod_doe.workflow.tolerance_confirmation import confirming_points
from tripod_doe.workflow.workflow import Workflow, load_workflow
from tripod_doe.workflow.workflow_file import StudyStep


@dataclass(frozen=True)
class WorkflowPlan:
    """Counts and prices of the studies of a workflow."""

    steps: Mapping[str, Plan]  # plan of each study step, by its name; the other steps compute no points

    @property
    def cpu_hours(self) -> tuple[float, float, float] | None:
        """Sums of the lower quartiles, means and upper quartiles; None where a price is not known."""
        prices = [step.cpu_hours for step in self.steps.values() if step.able]
        known = [price for price in prices if price is not None]
        if len(known) < len(prices):
            return None
        low, mean, high = (math.fsum(ends) for ends in zip((0.0, 0.0, 0.0), *known, strict=True))
        return low, mean, high

    def describe(self, workers: int = 2) -> str:
        """The plan as text: a line per study, their sum, and the warnings of each."""
        width = max(map(len, (*self.steps, "all studies")))
        lines = [f"{name:{width}}  {_table_line(step)}" for name, step in self.steps.items()]
        points = sum(step.points for step in self.steps.values())
        stored = sum(step.cube_bytes or 0 for step in self.steps.values())
        lines.append(f"{'all studies':{width}}  {points:7,} points  {_price(self.cpu_hours):>8}  {size(stored)}")
        if self.cpu_hours:
            wall = duration(self.cpu_hours[1] * 3600 / workers)
            lines.append(f"{'wall time':{width}}  about {wall} on {workers} workers, without analyses and pages")
        if any(step.cpu_hours and not step.timed for step in self.steps.values()):
            lines.append(f"prices are {RECORDED}")
        for name, step in self.steps.items():
            foreseen = (f"{f.count:,} of {step.unique:,} points {f.outcome.label}: {f.reason}" for f in step.foreseen)
            more = [f"a pilot; then at most {step.most_points:,} points in all"] if step.most_points else []
            more += [f"at most {step.confirming:,} points beyond these confirm proposals"] if step.confirming else []
            lines += [f"{name}: {text}" for text in (*more, *foreseen, *step.warnings)]
        return "\n".join(lines)


def plan_workflow(path: str | Path, quick: bool = False, timing: bool = True, untrusted: bool = False) -> WorkflowPlan:
    """Count the points of the studies of a workflow; nothing is run or written.

    Args:
        path: The workflow file.
        quick: Whether to apply the overrides of [quick].
        timing: Whether to time points, for at most ten seconds per study, where no price is recorded.
        untrusted: For a file from a stranger: refuse functions, and files outside of its folder.

    Raises:
        InputError: If a file of it cannot be used.
    """
    workflow = load_workflow(path, quick, StudyFolder.of(path, untrusted))
    return WorkflowPlan(plans_of(workflow, partial(_plan_study, timing=timing)))


def plans_of(workflow: Workflow, plan_one: Callable[[Study], Plan]) -> dict[str, Plan]:
    """The plan of each study step of a workflow, by its name, with the points that the step gets from another one.

    Args:
        plan_one: Plans a study by itself.
    """
    plans: dict[str, Plan] = {}
    for name, step in workflow.steps.items():
        if step.study is not None and isinstance(step.table, StudyStep):
            own, source = plan_one(step.study), step.table.table
            plans[name] = _with_points_of_input(own, _most_rows(workflow, source, plans)) if source else own
    return plans


def _most_rows(workflow: Workflow, source: str, plans: Mapping[str, Plan]) -> int:
    """The most points in the result of a step: of an analysis those that it lists, or of all studies that it reads."""
    if source in plans:
        return max(plans[source].points, plans[source].most_points)
    return workflow.steps[source].listed or sum(
        _most_rows(workflow, needed, plans) for needed in workflow.steps[source].inputs
    )


def _with_points_of_input(own: Plan, rows: int) -> Plan:
    """A plan with the points of another step in place of its own, at the mean price of its own."""
    share = rows / max(own.unique, 1)

    def scaled(value: int | None) -> int | None:
        return value and math.ceil(value * share)

    return replace(
        own,
        points=rows,
        unique=rows,
        excluded=0,
        blocks=scaled(own.blocks),
        cpu_hours=own.cpu_hours and scale(own.cpu_hours, share),
        cube_bytes=scaled(own.cube_bytes),
        written_bytes=scaled(own.written_bytes),
        memory_bytes=math.ceil(own.memory_bytes * share),
        foreseen=(),
        most_points=0,
        warnings=(
            *own.warnings,
            f"at most {rows:,} points, all of the step that it names, at the mean price of its own",
        ),
    )


def scale(hours: tuple[float, float, float], share: float) -> tuple[float, float, float]:
    """A price of a number of points for a share of it."""
    return hours[0] * share, hours[1] * share, hours[2] * share


def _plan_study(study: Study, timing: bool) -> Plan:
    recorded = plan(study, timing=False, recorded=True)
    known = recorded.cpu_hours is not None or recorded.chosen or not recorded.able
    price = recorded if known or not timing else plan(study)
    return replace(price, confirming=confirming_points(study))


def _table_line(step: Plan) -> str:
    """A line of the table: points, CPU time and bytes."""
    price = "chosen by a pilot" if step.chosen else _price(step.cpu_hours)
    return f"{step.points:7,} points  {price:>8}  {'' if step.cube_bytes is None else size(step.cube_bytes)}".rstrip()


def _price(cpu_hours: tuple[float, float, float] | None) -> str:
    return "not known" if cpu_hours is None else f"{duration(cpu_hours[1] * 3600)} CPU"
