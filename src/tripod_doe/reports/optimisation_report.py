"""The page of an optimisation."""

from collections.abc import Sequence
from pathlib import Path

import xarray as xr

from tripod_doe.analyses.optimisation.charts import optimisation_charts
from tripod_doe.analyses.optimisation.pareto_front import knee
from tripod_doe.analyses.optimisation.problem import Problem, pasted
from tripod_doe.analyses.optimisation.result import Solved, base_values
from tripod_doe.analyses.optimisation.sentences import find_in_optimisation
from tripod_doe.analyses.optimisation.tables import (
    ends_table,
    front_table,
    left_out_table,
    sensitivity_table,
    shown_rows,
    start_table,
)
from tripod_doe.files.checksum_list import write_listed
from tripod_doe.page_parts.answer import answer_first
from tripod_doe.page_parts.templates import render
from tripod_doe.study.failure_summary import Failure


def optimisation_lines(problem: Problem, solved: Solved) -> list[str]:
    """The sentences of an optimisation, for its page and its front."""
    return find_in_optimisation(problem, solved)


def write_optimisation_page(
    directory: Path, problem: Problem, solved: Solved, failures: Sequence[Failure], waves: xr.Dataset | None
) -> None:
    """Write the page of an optimisation, ``directory/report/index.html``.

    Raises:
        StorageError: If it cannot be written; an older one stays.
    """
    sentences, more = answer_first(optimisation_lines(problem, solved))
    head, front = problem.request.file.optimisation, solved.front
    aims = front.judged.objectives * problem.signs
    middle = knee(aims) if len(aims) else -1
    shown = list(dict.fromkeys([middle, *shown_rows(len(aims))])) if len(aims) else []
    bases = [
        (
            f"Candidate {at}{' (the knee)' if at == middle and len(aims) > 1 else ''}",
            pasted(base_values(problem, unit), problem.confirmed_base),
        )
        for at, unit in ((at, front.units[at]) for at in shown)
    ]
    page = render(
        "optimisation.html",
        title=head.name,
        question=head.question,
        problem=problem,
        counts=solved.counts,
        tried=len(solved.archive.units),
        feasible=int(solved.archive.judged.feasible.sum()),
        confirmed=solved.confirmed,
        sentences=sentences,
        more=more,
        charts=optimisation_charts(problem, solved, waves),
        front=front_table(problem, solved),
        front_size=len(solved.front.units),
        ends=ends_table(problem, solved),
        sensitivity=sensitivity_table(problem, solved),
        start=start_table(problem, solved),
        left_out=left_out_table(solved),
        bases=bases,
    )
    write_listed(directory / "report" / "index.html", page)
