"""Tables of an optimisation: the front, its ends, the steps from there, the start, and what was left out."""

import numpy as np

from tripod_doe.analyses.optimisation.candidate_text import (
    binding,
    change_text,
    counted_reasons,
    digits_of_columns,
    front_places,
    head_texts,
    joint_text,
    judged_outputs,
    spoken_name,
    step_text,
)
from tripod_doe.analyses.optimisation.pareto_front import front_rows
from tripod_doe.analyses.optimisation.problem import Problem
from tripod_doe.analyses.optimisation.result import Solved, base_values
from tripod_doe.number_text import interval, level_or_word, number
from tripod_doe.page_parts.words import listed, unit_text, with_brackets

_MOST_ROWS = 40

Table = tuple[list[str], list[list[str]]]


def shown_rows(count: int) -> list[int]:
    """The candidates of a front that a page lists: all of few, else some from end to end."""
    if count <= _MOST_ROWS:
        return list(range(count))
    return [int(row) for row in np.unique(np.linspace(0, count - 1, _MOST_ROWS).round())]


def front_table(problem: Problem, solved: Solved) -> Table:
    """The candidates of the front: variables, objectives and constraints with their errors."""
    front = solved.front
    heads = ["candidate", *head_texts(problem, judged_outputs(problem)), *_variable_heads(problem)]
    judged = front.judged
    apart = digits_of_columns(judged.objectives)
    table = []
    for row in shown_rows(len(front.units)):
        cells = [str(row)]
        for at, (value, error) in enumerate(zip(judged.objectives[row], judged.objective_errors[row], strict=True)):
            cells.append(interval(float(value), float(error)) if error > 0 else number(float(value), apart[at]))
        cells += [number(float(value), 4) for value in judged.constraints[row]]
        cells += [level_or_word(v) for v in base_values(problem, front.units[row]).values()]
        table.append(cells)
    return heads, table


def ends_table(problem: Problem, solved: Solved) -> Table:
    """Active limits and bounds at the ends and the knee of the front."""
    front = solved.front
    if not len(front.units):
        return [], []
    table = []
    for what, row in front_places(problem, solved).items():
        touched = binding(problem, front.units[row], front.judged.violations[row])
        table.append([what, str(row), joint_text(problem, front.units[row]), listed(touched) or "nothing"])
    return ["where", "candidate", "joint", "binds"], table


def sensitivity_table(problem: Problem, solved: Solved) -> Table:
    """How objectives and limits change by a step of a variable at the ends and the knee, the largest change first."""
    own = solved.around
    if own is None or not own.units.size:
        return [], []
    aims, kept = own.changes("objectives"), own.changes("constraints")
    reasons = own.reasons(solved.front.judged, list(problem.constraints))
    size = np.nan_to_num(np.abs(aims))
    size = size / np.where(size.max(axis=0) > 0, size.max(axis=0), 1.0)
    names = list(problem.objectives)
    rows = []
    for what, row in front_places(problem, solved).items():
        centre = int(np.flatnonzero(own.centres == row)[0])
        aim = what.removeprefix("best ")
        weight = size[:, names.index(aim)] if aim in names else size.max(axis=1)
        mine = np.flatnonzero(own.centre == centre)
        largest = {at: weight[mine][own.variable[mine] == at].max() for at in set(own.variable[mine].tolist())}
        for at in sorted(mine.tolist(), key=lambda k: (-largest[int(own.variable[k])], k)):
            changes = [change_text(value) for value in (*aims[at], *kept[at])]
            rows.append([what, step_text(problem, solved, at), *changes, reasons[at] or "yes"])
    heads = head_texts(problem, judged_outputs(problem))
    return ["where", "step", *heads, "feasible"], rows


def start_table(problem: Problem, solved: Solved) -> Table:
    """The start against the ends and the knee: variables, objectives, constraints."""
    front = solved.front
    if not len(front.units):
        return [], []
    shown = front_places(problem, solved)
    units = [solved.archive.units[0], *(front.units[row] for row in shown.values())]
    rows = []
    bases = [base_values(problem, unit) for unit in units]
    for name, head in zip(problem.variables.names, _variable_heads(problem), strict=True):
        rows.append([head, *(level_or_word(base[name]) for base in bases)])
    values = np.column_stack([front.judged.objectives, front.judged.constraints])[list(shown.values())]
    start = np.column_stack([solved.start.objectives, solved.start.constraints])[:1]
    for head, column in zip(
        head_texts(problem, judged_outputs(problem)), np.concatenate([start, values]).T, strict=True
    ):
        rows.append([head, *(number(float(value), 4) for value in column)])
    state = "feasible" if solved.start.feasible[0] else solved.start.reasons[0]
    rows.append(["state", state, *["feasible"] * len(shown)])
    return ["", "start", *shown], rows


def _variable_heads(problem: Problem) -> list[str]:
    """Heads of all that a candidate sets, in words with units."""
    known = problem.simulator.parameters
    return [with_brackets(spoken_name(problem, name), unit_text(known[name].unit)) for name in problem.variables.names]


def left_out_table(solved: Solved) -> Table:
    """Reasons of the candidates that are not feasible, with their counts."""
    rows = [[reason, f"{count:,}"] for reason, count in counted_reasons(solved.archive.judged.reasons)[:_MOST_ROWS]]
    return ["reason (numbers of the first one)", "candidates"], rows


def dominated_count(problem: Problem, solved: Solved) -> int:
    """Number of feasible candidates that another one dominates."""
    judged = solved.archive.judged
    front = front_rows(judged.objectives * problem.signs, judged.feasible)
    return int(judged.feasible.sum()) - front.size
