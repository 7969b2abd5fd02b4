"""Price of an optimisation before anything runs: its points, and the time of a few points."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Self

from tripod_doe.analyses.optimisation.optimisation_file import SearchTable, load_optimisation
from tripod_doe.analyses.optimisation.problem import Problem, make_problem
from tripod_doe.analyses.optimisation.search import first_generation, last_share, population_of
from tripod_doe.number_text import duration, number, text_range
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.plan import RECORDED, plan
from tripod_doe.workflow.point_batches import TABLE, write_table

_TIMED = 64  # candidates from which the timed points are taken
# CPU seconds besides the points, by `benchmarks/search_cost.py`: imports, cube and page, a generation, a point in it
_START_SECONDS, _GENERATION_SECONDS, _POINT_SECONDS = 3.3, 0.017, 0.5e-3
_LOW, _HIGH = 0.7, 1.5  # range of this time, as factors, between machines


@dataclass(frozen=True)
class PlannedPart:
    """Points of an optimisation by one model, or its work besides them."""

    what: str  # the search, its confirmation, or the work besides the points
    candidates: int  # at most; 0 of the work besides the points
    points: int  # at most: points of all candidates
    cpu_hours: tuple[float, float, float] | None = None  # low, likely and high; None where not known
    timed: int = 0  # timed points; if 0, recorded prices are used
    cube_bytes: int = 0  # of the points in a cube; 0 where not known
    at_once: int = 0  # points that workers can share, those of one candidate; 0 where any number

    def scaled(self, what: str, candidates: int) -> Self:
        """The share of some of its candidates."""
        share = candidates / self.candidates
        low, likely, high = (share * hours for hours in self.cpu_hours or (0.0, 0.0, 0.0))
        return replace(
            self,
            what=what,
            candidates=candidates,
            points=round(share * self.points),
            cpu_hours=(low, likely, high) if self.cpu_hours else None,
            cube_bytes=round(share * self.cube_bytes),
        )

    def shared_by(self, workers: int) -> int:
        """Number of workers that are at work on it."""
        return min(workers, self.at_once or workers) if self.candidates else 1

    def describe(self) -> str:
        """The part in a line."""
        facts = [f"{self.candidates:,} candidates", f"{self.points:,} points"] if self.candidates else []
        facts += ["one candidate at a time"] * bool(self.at_once)
        if self.cpu_hours:
            low, likely, high = (duration(3600 * hours, 2) for hours in self.cpu_hours)
            facts.append(f"CPU time {likely} ({text_range(low, high)})")
        return f"{self.what:<24} {', '.join(facts)}"


def plan_optimisation(
    file: str | Path, timing: bool = True, untrusted: bool = False, recorded: bool = True
) -> list[PlannedPart]:
    """Count the points of an optimisation and time a few of them; nothing is written.

    Where points have a price, the last part is the work besides them, which one process does.

    Args:
        file: The optimisation file.
        timing: Whether to time points, in a process of its own.
        untrusted: For a file from a stranger: refuse functions, and files outside of its folder.
        recorded: Whether recorded prices are used where nothing is timed.

    Raises:
        InputError: If the file cannot be used.
    """
    problem = make_problem(load_optimisation(file, untrusted))
    table = problem.request.file.search
    sampled = bool(problem.scatter.factors)
    joints = table.samples if sampled else 1
    by = f" by {problem.model}" if problem.model else ""
    how = timing, recorded
    search = _part(problem, f"search{by}", table.evaluations, joints, problem.model, how)
    parts = [*_refined(problem, search, by), search.scaled(f"steps around the best{by}", _steps(problem))]
    if sampled or problem.confirm != problem.model:
        most = table.confirmed + 1  # and the start
        by = f" by {problem.confirm}" if problem.confirm else ""
        joints = table.confirm_samples if sampled else 1
        parts.append(_part(problem, f"confirm{by}", most, joints, problem.confirm, how))
    if any(how):
        parts.append(_overhead(table, parts))
    return parts


def _steps(problem: Problem) -> int:
    """Number of candidates one step away from the ends and the knee of a front, at most."""
    objectives = len(problem.signs)
    return (objectives + (objectives > 1)) * 2 * len(problem.variables.chosen)


def _refined(problem: Problem, whole: PlannedPart, by: str) -> list[PlannedPart]:
    """The search, and the part of its candidates with which a single objective is refined, one after the other."""
    has_ranges = any(not variable.levels for variable in problem.variables.chosen)
    share = last_share(problem.variables, len(problem.signs), problem.is_corrected) if has_ranges else 0.0
    last = round(share * whole.candidates)
    if not last:
        return [whole]
    own = whole.points // whole.candidates
    return [
        whole.scaled(f"search{by}", whole.candidates - last),
        replace(whole.scaled(f"refinement{by}", last), timed=0, at_once=own),
    ]


def _overhead(table: SearchTable, parts: Sequence[PlannedPart]) -> PlannedPart:
    """The work of one process besides the points: its start, each generation or refined candidate, and each point."""
    points, population = sum(part.points for part in parts), population_of(table.evaluations, table.population)
    batches = sum(part.candidates / (1 if part.at_once else population) for part in parts)
    seconds = _START_SECONDS + _GENERATION_SECONDS * batches + _POINT_SECONDS * points
    likely = seconds / 3600
    return PlannedPart("the search itself", 0, 0, (_LOW * likely, likely, _HIGH * likely))


def _part(problem: Problem, what: str, candidates: int, joints: int, model: str, how: tuple[bool, bool]) -> PlannedPart:
    points = candidates * joints * problem.operating.count
    if not any(how):
        return PlannedPart(what, candidates, points)
    count = min(_TIMED, candidates)
    units = first_generation(problem.variables, count, 0, None)
    units = units[[not reason for reason in problem.misfits(units)]]
    if not len(units):
        return PlannedPart(what, candidates, points)
    columns = problem.columns(units, {name: column[:8] for name, column in problem.search_sample.items()}, model)
    with TemporaryDirectory(prefix="tripod-doe-") as folder:
        rows = zip(*(column.tolist() for column in columns.values()), strict=True)
        write_table(Path(folder) / TABLE, columns, rows)
        few = plan(_study(problem, Path(folder)), *how)
    hours, share = None, points / max(few.unique, 1)
    if few.cpu_hours:
        hours = (few.cpu_hours[0] * share, few.cpu_hours[1] * share, few.cpu_hours[2] * share)
    return PlannedPart(what, candidates, points, hours, few.timed, round((few.cube_bytes or 0) * share))


def _study(problem: Problem, folder: Path) -> Study:
    """The study of some points, as the timing process can read it: from `folder` alone, unless it has a function."""
    request = problem.request
    if request.file.optimisation.function:
        return problem.study(request.origin, folder, str(folder / TABLE))
    study = problem.study(request.origin, folder, TABLE)
    return parse_study(study.text, study.origin, StudyFolder(folder, request.folder.trusted))


def parts_text(parts: list[PlannedPart], workers: int) -> str:
    """The parts in lines, with the wall time of all."""
    lines = [part.describe() for part in parts]
    hours = {part: part.cpu_hours[1] for part in parts if part.cpu_hours}
    if any(part.candidates for part in hours):
        shared = sum(value / part.shared_by(workers) for part, value in hours.items())
        wall = duration(3600 * shared, 2)
        lines.append(f"{'wall time':<24} {wall} on {number(workers)} workers")
        if not any(part.timed for part in parts):
            lines.append(f"prices are {RECORDED}")
    return "\n".join(lines)
