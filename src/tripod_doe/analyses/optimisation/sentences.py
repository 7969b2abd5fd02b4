"""Sentences and tables of an optimisation: the answer, its ends, what binds there, and what was left out."""

import re
from collections import Counter
from collections.abc import Sequence

import numpy as np

from tripod_doe.analyses.optimisation.neighbours import places_of
from tripod_doe.analyses.optimisation.pareto_front import binding, front_rows, knee
from tripod_doe.analyses.optimisation.problem import Problem
from tripod_doe.analyses.optimisation.result import Solved, base_values, best_so_far
from tripod_doe.array_types import FloatArray
from tripod_doe.page_parts.main_results import listed, spoken, unit_text
from tripod_doe.quantities import count_of, digits_apart, interval, level, levels_apart, number, with_unit
from tripod_doe.study.failure_summary import Failure

_MOST_ROWS = 40
_LAST = 0.01  # part of the objective that counts as the last per cent
_NUMBER = re.compile(r"-?\d+\.?\d*(e[+-]?\d+)?")

Table = tuple[list[str], list[list[str]]]


def find_in_optimisation(problem: Problem, solved: Solved) -> list[str]:
    """Sentences on the front, the most important first."""
    if not len(solved.front.units):
        return _nothing(problem, solved)
    sentences = _single(problem, solved) if len(problem.objectives) == 1 else _several(problem, solved)
    return [
        *sentences,
        *_improvable(problem, solved),
        *_confirmation(problem, solved),
        *_scatter(problem, solved),
        *_left_out(solved),
    ]


def _unit(problem: Problem, output: str) -> str:
    if output in problem.simulator.outputs:
        return unit_text(problem.simulator.outputs[output].unit)
    if output in problem.request.file.responses:
        return unit_text(problem.request.file.responses[output].unit)
    return unit_text(problem.simulator.parameters[output].unit) if output in problem.simulator.parameters else ""


def _aim(problem: Problem, at: int, value: float, error: float = np.nan) -> str:
    table = list(problem.objectives.values())[at]
    text = interval(value, error) if error > 0 else number(value, 4)
    return with_unit(text, _unit(problem, table.output))


def joint_text(problem: Problem, unit: FloatArray) -> str:
    """The variables of a candidate in words."""
    parts = []
    for name, value in base_values(problem, unit).items():
        own = unit_text(problem.simulator.parameters[name].unit)
        shown = level(float(value)) if isinstance(value, int | float) else str(value)
        parts.append(f"{_spoken(problem, name)} = {with_unit(shown, own)}")
    return ", ".join(parts)


def _spoken(problem: Problem, name: str) -> str:
    return name if problem.request.file.optimisation.function else spoken(name)


def _single(problem: Problem, solved: Solved) -> list[str]:
    """The answer of a single objective, how sure it is, and what the last per cent cost."""
    (name, table), judged = next(iter(problem.objectives.items())), solved.front.judged
    value, error = float(judged.objectives[0, 0]), float(judged.objective_errors[0, 0])
    extreme = "smallest" if table.goal == "minimise" else "largest"
    where = joint_text(problem, solved.front.units[0])
    of = count_of(len(solved.archive.judged.reasons), "candidate")
    if equal := _all_equal(problem, solved):
        return equal
    sentences = [f"The {extreme} {name} of {of} is {_aim(problem, 0, value, error)}, at {where}."]
    sentences += _against_start(problem, solved, 0)
    touched = binding(solved.front.units[0], judged.violations[0], problem.variables, list(problem.constraints))
    if touched:
        sentences.append(f"Binding: {listed(touched)}.")
    if np.isfinite(solved.polished):
        has = [bool(variable.levels) for variable in problem.variables.chosen]
        ways = [f"by {number(100 * solved.polished, 2)} % of its range"] * (not all(has)) + ["to its next value"] * any(
            has
        )
        sentences.append(
            f"No change of a single variable {', or '.join(ways)} improves the candidate on which the search ended."
        )
    if len(solved.ended) > 1:
        best = min(solved.ended)
        same = sum(value - best <= _LAST * abs(best) for value in solved.ended)
        sentences.append(
            f"{same} of {len(solved.ended)} searches from other places came within 1 % of the best of them."
        )
    course = best_so_far(solved.archive, float(problem.signs[0]))
    final = course[-1]
    near = np.flatnonzero(np.abs(course - final) <= _LAST * abs(final))
    if near.size and problem.confirm == problem.model:  # else the answer is not the last value of the search
        first, all_ = int(near[0]) + 1, len(course)
        sentences.append(
            f"The search came within 1 % of its last value after {first:,} of {all_:,} candidates; "
            f"the last per cent cost {all_ - first:,}."
        )
    return sentences


def _all_equal(problem: Problem, solved: Solved) -> list[str]:
    """The sentence where several candidates are feasible, and none differs from another in any objective."""
    judged = solved.archive.judged
    own = judged.objectives[judged.feasible]
    if len(own) < 2 or np.ptp(own, axis=0).any():
        return []
    values = [f"{name} {_aim(problem, at, float(own[0, at]))}" for at, name in enumerate(problem.objectives)]
    return [f"The variables change no objective: all {len(own):,} feasible candidates have {listed(values)}."]


def _against_start(problem: Problem, solved: Solved, at: int) -> list[str]:
    """An objective at the start and on the front."""
    name = list(problem.objectives)[at]
    start = float(solved.start.objectives[0, at])
    if not np.isfinite(start):
        return [f"The joint where the search starts has no {name}: {solved.start.reasons[0]}."]
    values = solved.front.judged.objectives[:, at]
    best = float(values[np.argmin(values * problem.signs[at])])
    keeps = "" if solved.start.feasible[0] else f", where the limits are not kept ({solved.start.reasons[0]})"
    if solved.start.feasible[0] and best == start:
        return [f"No candidate is better in {name} than the start, with {_aim(problem, at, start)}."]
    change = f" ({_change(100 * (best / start - 1))} %)" if start > 0 and best != start else ""
    return [
        f"Where the search starts, {name} is {_aim(problem, at, start)}{keeps}; "
        f"the best is {_aim(problem, at, best)}{change}."
    ]


def _several(problem: Problem, solved: Solved) -> list[str]:
    """The front of several objectives: its ends and its knee."""
    front = solved.front
    aims = front.judged.objectives * problem.signs
    names = list(problem.objectives)
    if equal := _all_equal(problem, solved):
        return equal
    if len(aims) == 1:
        values = [f"{name} {_aim(problem, k, float(front.judged.objectives[0, k]))}" for k, name in enumerate(names)]
        which = "feasible" if solved.archive.judged.feasible.sum() == 1 else "best in every objective"
        only = f"One candidate is {which}: {listed(values)}, at {joint_text(problem, front.units[0])}."
        return [only, *(line for at in range(len(names)) for line in _against_start(problem, solved, at))]
    ends = []
    for at, name in enumerate(names):
        row = int(aims[:, at].argmin())
        others = [
            f"{other} {_aim(problem, k, float(front.judged.objectives[row, k]))}"
            for k, other in enumerate(names)
            if k != at
        ]
        value = _aim(problem, at, float(front.judged.objectives[row, at]))
        ends.append(f"{name} {value} with {listed(others)}")
    count = count_of(len(aims), "candidate")
    sentences = [f"The front has {count}: at its ends {'; '.join(ends)}."]
    middle = knee(aims)
    values = [f"{name} {_aim(problem, k, float(front.judged.objectives[middle, k]))}" for k, name in enumerate(names)]
    sentences.append(
        f"Candidate {middle} is the knee, with the best worst objective over the front: {listed(values)}, at "
        f"{joint_text(problem, front.units[middle])}."
    )
    for at in range(len(names)):
        sentences += _against_start(problem, solved, at)
    return sentences


def _confirmation(problem: Problem, solved: Solved) -> list[str]:
    """Difference between the confirmed front and the search."""
    if not solved.confirmed:
        return []
    own, searched = solved.front.judged.objectives, solved.searched.objectives
    by = f"by {problem.confirm}" if problem.confirm != problem.model else ""
    sample = "on another sample of the scatter" if problem.scatter.factors else ""
    how = " ".join(filter(None, [by, sample]))
    apart = np.abs(own - searched)
    texts = [
        f"{name} by at most {_aim(problem, at, float(apart[:, at].max()))}"
        for at, name in enumerate(problem.objectives)
        if np.isfinite(apart[:, at]).any() and apart[:, at].any()
    ]
    moved = f"; on the front it differs from the search in {listed(texts)}" if texts else ", and nothing changes"
    were = "was" if solved.confirmed == 1 else "were"
    return [f"{count_of(solved.confirmed, 'candidate')} {were} judged once more {how}{moved}."]


def _scatter(problem: Problem, solved: Solved) -> list[str]:
    if not problem.scatter.factors:
        return []
    share = f"{100 * problem.request.file.optimisation.quantile:g} %"
    names = listed([_spoken(problem, name) for name in problem.scatter.factors])
    table = problem.request.file.search
    count = table.confirm_samples if solved.confirmed else table.samples
    return [
        f"Objectives and limits hold for {share} of the joints with the scatter of {names}, by a sample of "
        f"{count_of(count, 'joint')}."
    ]


def _left_out(solved: Solved) -> list[str]:
    judged = solved.archive.judged
    broken = int((~np.isfinite(judged.objectives).all(axis=1)).sum())
    beyond = int((~judged.feasible).sum()) - broken
    total = len(judged.reasons)
    parts = []
    if beyond:
        parts.append(f"{beyond:,} {'does' if beyond == 1 else 'do'} not keep all limits")
    if broken:
        parts.append(f"{broken:,} cannot be built, did not finish or lack a value")
    return [f"Of {total:,} candidates {listed(parts)}."] if parts else []


def _nothing(problem: Problem, solved: Solved) -> list[str]:
    """The sentence where no candidate is feasible."""
    judged = solved.archive.judged
    if judged.feasible.any():
        return [
            f"No candidate that was judged once more is feasible; in the search {int(judged.feasible.sum()):,} of "
            f"{len(judged.reasons):,} were. Set tighter limits in the search, or confirm more candidates."
        ]
    sentences = [f"None of {count_of(len(judged.reasons), 'candidate')} is feasible."]
    if problem.constraints and np.isfinite(judged.violations).any():
        able = np.flatnonzero(np.isfinite(judged.violations).all(axis=1))
        total = np.maximum(judged.violations[able], 0).sum(axis=1)
        nearest = int(able[np.argmin(total)])
        sentences.append(
            f"The nearest one is {joint_text(problem, solved.archive.units[nearest])}, where {judged.reasons[nearest]}."
        )
    (reason, count), *_ = _reasons(judged.reasons)
    sentences.append(f"The most frequent reason, for {count:,} of them, in the numbers of the first: {reason}.")
    return sentences


def _reasons(reasons: Sequence[str]) -> list[tuple[str, int]]:
    """Reasons with their counts, the most frequent first; those that differ in numbers only are one."""
    counts: Counter[str] = Counter()
    first: dict[str, str] = {}
    for reason in filter(None, reasons):
        kind = _NUMBER.sub("0", reason)
        counts[kind] += 1
        first.setdefault(kind, reason)
    return [(first[kind], count) for kind, count in counts.most_common()]


def shown_rows(count: int) -> list[int]:
    """The candidates of a front that a page lists: all of few, else some from end to end."""
    if count <= _MOST_ROWS:
        return list(range(count))
    return [int(row) for row in np.unique(np.linspace(0, count - 1, _MOST_ROWS).round())]


def front_table(problem: Problem, solved: Solved) -> Table:
    """The candidates of the front: variables, objectives and constraints with their errors."""
    front = solved.front
    heads = ["candidate", *problem.objectives, *problem.constraints, *problem.variables.names]
    judged = front.judged
    apart = _digits(judged.objectives)
    table = []
    for row in shown_rows(len(front.units)):
        cells = [str(row)]
        for at, (value, error) in enumerate(zip(judged.objectives[row], judged.objective_errors[row], strict=True)):
            cells.append(interval(float(value), float(error)) if error > 0 else number(float(value), apart[at]))
        cells += [number(float(value), 4) for value in judged.constraints[row]]
        cells += [
            level(float(v)) if isinstance(v, int | float) else str(v)
            for v in base_values(problem, front.units[row]).values()
        ]
        table.append(cells)
    return heads, table


def _digits(values: FloatArray) -> list[int]:
    """Digits by which the smallest and the largest value of each column differ, at least four."""
    if not len(values):
        return [4] * values.shape[1]
    return [max(4, min(6, digits_apart(float(column.min()), float(column.max())) + 1)) for column in values.T]


def ends_table(problem: Problem, solved: Solved) -> Table:
    """Active limits and bounds at the ends and the knee of the front."""
    front = solved.front
    if not len(front.units):
        return [], []
    table = []
    for what, row in _places(problem, solved).items():
        touched = binding(front.units[row], front.judged.violations[row], problem.variables, list(problem.constraints))
        table.append([what, str(row), joint_text(problem, front.units[row]), listed(touched) or "nothing"])
    return ["where", "candidate", "joint", "binds"], table


def _places(problem: Problem, solved: Solved) -> dict[str, int]:
    return places_of(solved.front.judged.objectives * problem.signs, list(problem.objectives))


def _improvable(problem: Problem, solved: Solved) -> list[str]:
    """Ends of the front that a step of a single variable would move on: the search has not come to rest there."""
    own = solved.around
    if own is None or len(problem.objectives) == 1:
        return []
    sentences = []
    able = np.array([not reason for reason in own.reasons(solved.front.judged, list(problem.constraints))], bool)
    places = _places(problem, solved)
    for at, name in enumerate(problem.objectives):
        row = places.get(f"best {name}", 0)
        centre = int(np.flatnonzero(own.centres == row)[0])
        gains = own.changes("objectives")[:, at] * problem.signs[at]
        better = np.flatnonzero((own.centre == centre) & able & (gains < 0))
        if better.size:
            best = int(better[gains[better].argmin()])
            by = f" by {problem.model}" if problem.confirm != problem.model else ""
            value = _aim(problem, at, float(abs(gains[best])))
            sentences.append(
                f"The search has not come to rest at the best {name}: {_step_text(problem, solved, best)} improves it "
                f"by {value}{by}{' and keeps the limits' * bool(problem.constraints)}; more evaluations may get there."
            )
    return sentences


def _step_text(problem: Problem, solved: Solved, neighbour: int) -> str:
    """A step of one variable: ``pitch radius = 26.5 mm in place of 26.2 mm``."""
    own = solved.around
    assert own is not None
    name = problem.variables.chosen[int(own.variable[neighbour])].name
    unit = unit_text(problem.simulator.parameters[name].unit)
    ends = (own.units[neighbour], solved.front.units[own.centres[own.centre[neighbour]]])
    values = [base_values(problem, each)[name] for each in ends]
    words = [str(value) for value in values] if isinstance(values[0], str) else levels_apart(values)
    new, old = (with_unit(word, unit) for word in words)
    return f"{_spoken(problem, name)} = {new} in place of {old}"


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
    for what, row in _places(problem, solved).items():
        centre = int(np.flatnonzero(own.centres == row)[0])
        aim = what.removeprefix("best ")
        weight = size[:, names.index(aim)] if aim in names else size.max(axis=1)
        mine = np.flatnonzero(own.centre == centre)
        largest = {at: weight[mine][own.variable[mine] == at].max() for at in set(own.variable[mine].tolist())}
        for at in sorted(mine.tolist(), key=lambda k: (-largest[int(own.variable[k])], k)):
            changes = [_change(value) for value in (*aims[at], *kept[at])]
            rows.append([what, _step_text(problem, solved, at), *changes, reasons[at] or "yes"])
    outputs = [
        *(table.output for table in problem.objectives.values()),
        *(table.output for table in problem.constraints.values()),
    ]
    units = [_unit(problem, output) for output in outputs]
    heads = [
        f"{name}{f' ({unit})' if unit else ''}"
        for name, unit in zip([*names, *problem.constraints], units, strict=True)
    ]
    return ["where", "step", *heads, "feasible"], rows


def _change(value: float) -> str:
    if not np.isfinite(value):
        return "-"
    return f"{'+' if value > 0 else ''}{number(float(value), 3)}"


def start_table(problem: Problem, solved: Solved) -> Table:
    """The start against the ends and the knee: variables, objectives, constraints."""
    front = solved.front
    if not len(front.units):
        return [], []
    shown = _places(problem, solved)
    units = [solved.archive.units[0], *(front.units[row] for row in shown.values())]
    rows = []
    bases = [base_values(problem, unit) for unit in units]
    for name in problem.variables.names:
        unit = unit_text(problem.simulator.parameters[name].unit)
        cells = [level(float(b[name])) if isinstance(b[name], int | float) else str(b[name]) for b in bases]
        rows.append([f"{_spoken(problem, name)}{f' ({unit})' if unit else ''}", *cells])
    for names, own, start in (
        ({n: t.output for n, t in problem.objectives.items()}, front.judged.objectives, solved.start.objectives),
        ({n: t.output for n, t in problem.constraints.items()}, front.judged.constraints, solved.start.constraints),
    ):
        for at, (name, output) in enumerate(names.items()):
            unit = _unit(problem, output)
            values = [float(start[0, at]), *(float(own[row, at]) for row in shown.values())]
            rows.append([f"{name}{f' ({unit})' if unit else ''}", *(number(value, 4) for value in values)])
    state = "feasible" if solved.start.feasible[0] else solved.start.reasons[0]
    rows.append(["state", state, *["feasible"] * len(shown)])
    return ["", "start", *shown], rows


def left_out_table(solved: Solved, failures: Sequence[Failure]) -> Table:
    """Reasons of the candidates that are not feasible, with their counts."""
    rows = [[reason, f"{count:,}"] for reason, count in _reasons(solved.archive.judged.reasons)[:_MOST_ROWS]]
    return ["reason (numbers of the first one)", "candidates"], rows


def dominated_count(problem: Problem, solved: Solved) -> int:
    """Number of feasible candidates that another one dominates."""
    judged = solved.archive.judged
    front = front_rows(judged.objectives * problem.signs, judged.feasible)
    return int(judged.feasible.sum()) - front.size
