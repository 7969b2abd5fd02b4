"""Sentences on an optimisation: the answer, its ends, what binds there, and what was left out."""

import numpy as np

from tripod_doe.analyses.optimisation.candidate_text import (
    NEAR_LEVEL,
    aim_text,
    binding,
    change_text,
    counted_reasons,
    digits_of_columns,
    front_places,
    joint_text,
    objective_change,
    objective_is_level,
    spoken_name,
    step_text,
)
from tripod_doe.analyses.optimisation.pareto_front import knee
from tripod_doe.analyses.optimisation.problem import Problem
from tripod_doe.analyses.optimisation.result import Solved, best_so_far
from tripod_doe.array_types import FloatArray
from tripod_doe.number_text import count_of, level_or_word, number, with_unit
from tripod_doe.page_parts.words import listed, unit_text

_LAST = 0.01  # part of the objective that counts as the last per cent


def find_in_optimisation(problem: Problem, solved: Solved) -> list[str]:
    """Sentences on the front, the most important first."""
    if not len(solved.front.units):
        return _nothing(problem, solved)
    sentences = _single(problem, solved) if len(problem.objectives) == 1 else _several(problem, solved)
    return [
        *sentences,
        *_improvable(problem, solved),
        *_confirmation(problem, solved),
        *_moved_start(problem),
        *_scatter(problem, solved),
        *_left_out(solved),
    ]


def _single(problem: Problem, solved: Solved) -> list[str]:
    """The answer of a single objective, how sure it is, and what the last per cent cost."""
    (name, table), judged = next(iter(problem.objectives.items())), solved.front.judged
    value, error = float(judged.objectives[0, 0]), float(judged.objective_errors[0, 0])
    extreme = "smallest" if table.goal == "minimise" else "largest"
    where = joint_text(problem, solved.front.units[0])
    of = count_of(len(solved.archive.judged.reasons), "candidate")
    if equal := _all_equal(problem, solved):
        return equal
    sentences = [f"The {extreme} {name} of {of} is {aim_text(problem, 0, value, error)}, at {where}."]
    sentences += _against_start(problem, solved, 0)
    touched = binding(problem, solved.front.units[0], judged.violations[0])
    if touched:
        sentences.append(f"Binding: {listed(touched)}.")
    course = best_so_far(solved.archive, float(problem.signs[0]))
    sentences += _at_rest(problem, solved, of, course)
    if len(solved.ended) > 1:
        best = min(solved.ended)
        reach, words, _ = _nearness(problem, best)
        same = sum(value - best <= reach for value in solved.ended)
        sentences.append(
            f"{same} of {len(solved.ended)} searches from other starts came within {words} of the best of them."
        )
    final = course[-1]
    reach, words, last = _nearness(problem, final)
    near = np.flatnonzero(np.abs(course - final) <= reach)
    if near.size and np.isfinite(solved.polished):  # else its last value is no sign that it has come to rest
        first, all_ = int(near[0]) + 1, len(course)
        sentences.append(
            f"The search came within {words} of its last value after {first:,} of {all_:,} candidates; "
            f"the last {last} took {all_ - first:,} more."
        )
    return sentences


def _at_rest(problem: Problem, solved: Solved, of: str, course: FloatArray) -> list[str]:
    """Whether steps around the best candidate of a single objective improve it, or how much the last ones did.

    Args:
        course: The best objective after each candidate.
    """
    levels = [bool(variable.levels) for variable in problem.variables.chosen]
    if problem.confirm != problem.model:
        return [
            f"Not all small steps around the best candidate were computed with {problem.confirm}: a better joint "
            "may exist nearby."
        ]
    if not np.isfinite(solved.polished):
        return [
            f"The search used its {of} before small steps around the best one stopped improving it: "
            f"{_last_gain(problem, course)}. Raise evaluations in [search]."
        ]
    ways = [f"by {number(100 * solved.polished, 2)} % of its range"] * (not all(levels))
    ways += ["to its next value"] * any(levels)
    rest = f"No change of a single variable {', or '.join(ways)} improves the candidate on which the search ended"
    together = ", nor did changes of several ranges at once, along limits that bind (COBYQA)"
    return [f"{rest}{together * (levels.count(False) > 1)}."]


def _last_gain(problem: Problem, course: FloatArray) -> str:
    """How much the last quarter of the candidates improved the best one."""
    last = max(len(course) // 4, 1)
    these = f"the last {last:,}" if last > 1 else "the last one"
    before, final = float(course[-last - 1]) if len(course) > last else np.nan, float(course[-1])
    if not np.isfinite(before):
        return f"the first feasible one is {'among ' * (last > 1)}{these}, so others may be much better"
    if final == before:
        return (
            f"{f'none of {these} is' if last > 1 else f'{these} is not'} better than earlier ones, but a better joint "
            "may exist nearby or elsewhere"
        )
    if objective_is_level(problem, 0) or before * final <= 0:
        change = objective_change(problem, 0, final - before)
    else:
        change = f"{change_text(100 * (final - before) / abs(before))} %"
    return f"{these} changed the best value by {change}, and others may change it by as much or more"


def _nearness(problem: Problem, value: float) -> tuple[float, str, str]:
    """How near to a value of the objective counts as there: in its unit, in words, and in words as a last part."""
    if objective_is_level(problem, 0):
        words = objective_change(problem, 0, NEAR_LEVEL).removeprefix("+")
        return NEAR_LEVEL, words, words
    return _LAST * abs(value), "1 %", "per cent"


def _all_equal(problem: Problem, solved: Solved) -> list[str]:
    """The sentence where several candidates are feasible, and none differs from another in any objective.

    None where some were recomputed: what is equal in the search need not be so by another model or sample.
    """
    judged = solved.archive.judged
    own = judged.objectives[judged.feasible]
    if solved.confirmed or len(own) < 2 or np.ptp(own, axis=0).any():
        return []
    values = [f"{name} {aim_text(problem, at, float(own[0, at]))}" for at, name in enumerate(problem.objectives)]
    return [f"The variables change no objective: all {len(own):,} feasible candidates have {listed(values)}."]


def _against_start(problem: Problem, solved: Solved, at: int) -> list[str]:
    """An objective at the start and on the front."""
    name = list(problem.objectives)[at]
    start = float(solved.start.objectives[0, at])
    if not np.isfinite(start):
        return [f"The joint at the start of the search has no {name}: {solved.start.reasons[0]}."]
    values = solved.front.judged.objectives[:, at]
    row = int(np.argmin(values * problem.signs[at]))
    best = float(values[row])
    errors = float(solved.start.objective_errors[0, at]), float(solved.front.judged.objective_errors[row, at])
    (digits,) = digits_of_columns(np.array([[start], [best]]))
    texts = [  # a value within its error is not stated without it
        aim_text(problem, at, value, error if error > abs(value) else np.nan, digits)
        for value, error in zip((start, best), errors, strict=True)
    ]
    keeps = "" if solved.start.feasible[0] else f", where limits are violated ({solved.start.reasons[0]})"
    if solved.start.feasible[0] and best == start:
        return [f"No candidate is better in {name} than the start, with {texts[0]}."]
    change = ""
    if objective_is_level(problem, at):
        change = f" ({objective_change(problem, at, best - start)})"
    elif start > 0 and best != start and best >= 0 and not errors[0] > start:
        change = f" ({change_text(100 * (best / start - 1))} %)"
    return [f"At the start of the search, {name} is {texts[0]}{keeps}; the best is {texts[1]}{change}."]


def _moved_start(problem: Problem) -> list[str]:
    """The variables that [base] sets to values that they may not take, from which the search cannot start."""
    moved = []
    for each in problem.variables.chosen:
        given = problem.request.file.base.get(each.name)
        if given is None:
            continue
        own = each.values(np.array([each.unit(problem.start[each.name])])).tolist()[0]
        apart = isinstance(given, str) or isinstance(own, str) or not np.isclose(float(given), float(own))
        if apart and given != own:
            unit = unit_text(problem.simulator.parameters[each.name].unit)
            wanted, taken = (with_unit(level_or_word(value), unit) for value in (given, own))
            moved.append(f"{spoken_name(problem, each.name)} = {taken}, not {wanted} as in [base]")
    return [f"The search started at {listed(moved)}, which is no value of the variable."] * bool(moved)


def _several(problem: Problem, solved: Solved) -> list[str]:
    """The front of several objectives: its ends and its knee."""
    front = solved.front
    aims = front.judged.objectives * problem.signs
    names = list(problem.objectives)
    if equal := _all_equal(problem, solved):
        return equal
    if len(aims) == 1:
        values = _objectives_at(problem, solved, 0, digits_of_columns(front.judged.objectives))
        which = f"best in every objective{' of those recomputed' * bool(solved.confirmed)}"
        if not solved.confirmed and solved.archive.judged.feasible.sum() == 1:
            which = "feasible"
        only = f"One candidate is {which}: {listed(values)}, at {joint_text(problem, front.units[0])}."
        return [only, *(line for at in range(len(names)) for line in _against_start(problem, solved, at))]
    digits = digits_of_columns(front.judged.objectives)
    ends = []
    for at in range(len(names)):
        own, *others = _objectives_at(problem, solved, int(aims[:, at].argmin()), digits, first=at)
        ends.append(f"{own} with {listed(others)}")
    count = count_of(len(aims), "candidate")
    sentences = [f"The front has {count}: at its ends {'; '.join(ends)}."]
    middle = knee(aims)
    sentences.append(
        f"Candidate {middle} is the knee, the best compromise by its worst scaled objective: "
        f"{listed(_objectives_at(problem, solved, middle, digits))}, at {joint_text(problem, front.units[middle])}."
    )
    for at in range(len(names)):
        sentences += _against_start(problem, solved, at)
    return sentences


def _objectives_at(problem: Problem, solved: Solved, row: int, digits: list[int], first: int = 0) -> list[str]:
    """The objectives of a candidate of the front with their names, one of them first."""
    values = solved.front.judged.objectives[row].tolist()
    texts = [f"{name} {aim_text(problem, k, values[k], digits=digits[k])}" for k, name in enumerate(problem.objectives)]
    return [texts.pop(first), *texts]


def _confirmation(problem: Problem, solved: Solved) -> list[str]:
    """Difference between the confirmed front and the search."""
    if not solved.confirmed:
        return []
    own, searched = solved.front.judged.objectives, solved.searched.objectives
    by = f"with {problem.confirm}" if problem.confirm != problem.model else ""
    sample = "with another sample of the scatter" if problem.scatter.factors else ""
    how = " ".join(filter(None, [by, sample]))
    apart = np.abs(own - searched)
    texts = [
        f"{name} by at most {aim_text(problem, at, float(apart[:, at].max()))}"
        for at, name in enumerate(problem.objectives)
        if np.isfinite(apart[:, at]).any() and apart[:, at].any()
    ]
    moved = f"; on the front this changes {listed(texts)}" if texts else "; nothing changes"
    were = "was" if solved.confirmed == 1 else "were"
    return [f"{count_of(solved.confirmed, 'candidate')} {were} recomputed {how}{moved}."]


def _scatter(problem: Problem, solved: Solved) -> list[str]:
    if not problem.scatter.factors:
        return []
    share = f"{100 * problem.request.file.optimisation.quantile:g} %"
    names = listed([spoken_name(problem, name) for name in problem.scatter.factors])
    table = problem.request.file.search
    count = table.confirm_samples if solved.confirmed else table.samples
    return [
        f"Objectives and limits hold for {share} of the joints with the scatter of {names}, estimated from "
        f"{count_of(count, 'joint')}."
    ]


def _left_out(solved: Solved) -> list[str]:
    judged = solved.archive.judged
    values = np.column_stack([judged.objectives, judged.violations])
    broken = int((~np.isfinite(values).all(axis=1)).sum())
    beyond = int((~judged.feasible).sum()) - broken
    total = len(judged.reasons)
    parts = []
    if beyond:
        parts.append(f"{beyond:,} {'violates' if beyond == 1 else 'violate'} a limit")
    if broken:
        parts.append(f"{broken:,} cannot be built, did not finish or lack a value")
    return [f"Of {total:,} candidates, {listed(parts)}."] if parts else []


def _nothing(problem: Problem, solved: Solved) -> list[str]:
    """The sentence where no candidate is feasible."""
    judged = solved.archive.judged
    if judged.feasible.any():
        none = (
            f"No recomputed candidate is feasible; in the search {int(judged.feasible.sum()):,} of "
            f"{len(judged.reasons):,} were."
        )
        if solved.nearest is None:
            return [none]
        unit, reason = solved.nearest
        advice = "relax a limit, or widen a range"
        if problem.confirm != problem.model:
            advice = f"search by {problem.confirm} itself, or with more evaluations, before you relax a limit"
        return [none, f"The nearest one is {joint_text(problem, unit)}, where {reason}: {advice}."]
    sentences = [f"None of {count_of(len(judged.reasons), 'candidate')} is feasible."]
    nearest = judged.nearest()
    if nearest is not None:
        sentences.append(
            f"The nearest one is {joint_text(problem, solved.archive.units[nearest])}, where {judged.reasons[nearest]}."
        )
    (reason, count), *_ = counted_reasons(judged.reasons)
    sentences.append(f"The most frequent reason, for {count:,} of them, with the values of the first: {reason}.")
    return sentences


def _improvable(problem: Problem, solved: Solved) -> list[str]:
    """Ends of the front that a step of a single variable would move on: the search has not come to rest there."""
    own = solved.around
    if own is None or len(problem.objectives) == 1:
        return []
    sentences = []
    able = np.array([not reason for reason in own.reasons(solved.front.judged, list(problem.constraints))], bool)
    places = front_places(problem, solved)
    for at, name in enumerate(problem.objectives):
        row = places.get(f"best {name}", 0)
        centre = int(np.flatnonzero(own.centres == row)[0])
        gains = own.changes("objectives")[:, at] * problem.signs[at]
        better = np.flatnonzero((own.centre == centre) & able & (gains < 0))
        if better.size:
            best = int(better[gains[better].argmin()])
            by = f" by {problem.model}" if problem.confirm != problem.model else ""
            value = aim_text(problem, at, float(abs(gains[best])))
            sentences.append(
                f"The search has not converged at the best {name}: {step_text(problem, solved, best)} improves it "
                f"by {value}{by}{' and keeps the limits' * bool(problem.constraints)}; more evaluations may get there."
            )
    return sentences
