"""Candidates of an optimisation in words: joints, objectives, steps and reasons, as sentences and tables have them."""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tripod_doe.analyses.optimisation.measures import limit_scale
from tripod_doe.analyses.optimisation.pareto_front import places_of
from tripod_doe.analyses.optimisation.problem import Problem
from tripod_doe.analyses.optimisation.result import Solved, base_values
from tripod_doe.array_types import FloatArray
from tripod_doe.number_text import digits_apart, interval, level_or_word, levels_apart, number, with_unit
from tripod_doe.page_parts.words import spoken, unit_text, with_brackets

NEAR_LEVEL = 0.1
"""dB from which on a level is near another one, about as much as 1 %."""

_NEAR = 0.01  # of a range, or of a limit: from here on it binds
_AT = 1e-6  # of a range: a bound itself, and not only near it
_DIGITS, _MOST_DIGITS = 4, 13  # of an objective; with more, two values are alike
_NUMBER = re.compile(r"-?\d+\.?\d*(e[+-]?\d+)?")


def unit_of(problem: Problem, output: str) -> str:
    """The unit of an output, a response or a parameter, as it is written."""
    if output in problem.simulator.outputs:
        return unit_text(problem.simulator.outputs[output].unit)
    if output in problem.request.file.responses:
        return unit_text(problem.request.file.responses[output].unit)
    return unit_text(problem.simulator.parameters[output].unit) if output in problem.simulator.parameters else ""


def aim_text(problem: Problem, at: int, value: float, error: float = np.nan, digits: int = _DIGITS) -> str:
    """A value of an objective with its error and unit."""
    table = list(problem.objectives.values())[at]
    text = interval(value, error) if error > 0 else number(value, digits)
    return with_unit(text, unit_of(problem, table.output))


def digits_of_columns(values: FloatArray) -> list[int]:
    """Digits by which the smallest and the largest value of each column differ and one more, at least four."""
    known = [column[np.isfinite(column)] for column in values.T]
    apart = [digits_apart(float(own.min()), float(own.max())) + 1 if own.size else 0 for own in known]
    return [_DIGITS if digits > _MOST_DIGITS else max(_DIGITS, digits) for digits in apart]


def joint_text(problem: Problem, unit: FloatArray) -> str:
    """The variables of a candidate in words."""
    return values_text(problem, base_values(problem, unit))


def values_text(problem: Problem, values: Mapping[str, Any]) -> str:
    """Values of parameters in words: ``pitch radius = 26.5 mm, roller radius = 17 mm``."""
    parts = []
    for name, value in values.items():
        own = unit_text(problem.simulator.parameters[name].unit)
        parts.append(f"{spoken_name(problem, name)} = {with_unit(level_or_word(value), own)}")
    return ", ".join(parts)


def spoken_name(problem: Problem, name: str) -> str:
    """The name of a variable in words; an argument of a function keeps its name."""
    return name if problem.request.file.optimisation.function else spoken(name)


def step_text(problem: Problem, solved: Solved, neighbour: int) -> str:
    """A step of one variable: ``pitch radius = 26.5 mm in place of 26.2 mm``."""
    own = solved.around
    assert own is not None
    name = problem.variables.chosen[int(own.variable[neighbour])].name
    unit = unit_text(problem.simulator.parameters[name].unit)
    ends = (own.units[neighbour], solved.front.units[own.centres[own.centre[neighbour]]])
    values = [base_values(problem, each)[name] for each in ends]
    words = [str(value) for value in values] if isinstance(values[0], str) else levels_apart(values)
    new, old = (with_unit(word, unit) for word in words)
    return f"{spoken_name(problem, name)} = {new} in place of {old}"


def change_text(value: float) -> str:
    """A change with its sign; a dash where it is not known."""
    if not np.isfinite(value):
        return "-"
    return f"{'+' if value > 0 else ''}{number(float(value), 3)}"


def front_places(problem: Problem, solved: Solved) -> dict[str, int]:
    """The ends and the knee of the front, by what they are."""
    return places_of(solved.front.judged.objectives * problem.signs, list(problem.objectives))


def binding(problem: Problem, unit: FloatArray, violation: FloatArray) -> list[str]:
    """The bounds and limits that a candidate touches, in words.

    Args:
        violation: Of its constraints, relative to their limits, shape (constraint,).
    """
    texts = []
    for value, variable in zip(unit.tolist(), problem.variables.chosen, strict=True):
        if variable.levels and not all(isinstance(level, int | float) for level in variable.levels):
            continue
        edge = 0.5 / len(variable.levels) if variable.levels else _NEAR
        name = spoken_name(problem, variable.name)
        at = "at" if variable.levels or min(value, 1 - value) < _AT else f"within {100 * _NEAR:g} % of its range of"
        if value <= edge:
            texts.append(f"{name} {at} its lower bound")
        elif value >= 1 - edge:
            texts.append(f"{name} {at} its upper bound")
    return texts + touched_limits(problem, violation)


def touched_limits(problem: Problem, violation: FloatArray) -> list[str]:
    """The limits that a candidate touches, in words; of a level in dB by decibels, as a part of it means nothing."""
    texts = []
    for (name, table), far in zip(problem.constraints.items(), violation.tolist(), strict=True):
        near, words = _NEAR, f"{100 * _NEAR:g} %"
        if is_level(problem, table.output):
            far, near, words = far * limit_scale(table), NEAR_LEVEL, f"{NEAR_LEVEL:g} dB"
        if far > -near:
            texts.append(f"{name} {'at' if far > -near / 10 else f'within {words} of'} its limit")
    return texts


def counted_reasons(reasons: Sequence[str]) -> list[tuple[str, int]]:
    """Reasons with their counts, the most frequent first; those that differ in numbers only are one."""
    counts: Counter[str] = Counter()
    first: dict[str, str] = {}
    for reason in filter(None, reasons):
        kind = _NUMBER.sub("0", reason)
        counts[kind] += 1
        first.setdefault(kind, reason)
    return [(first[kind], count) for kind, count in counts.most_common()]


def is_level(problem: Problem, output: str) -> bool:
    """Whether a quantity is a level in dB: its zero is a reference, so that a part of it means nothing."""
    return unit_of(problem, output).startswith("dB")


def objective_is_level(problem: Problem, at: int) -> bool:
    """Whether an objective is a level in dB."""
    return is_level(problem, list(problem.objectives.values())[at].output)


def head_texts(problem: Problem, names: Mapping[str, str]) -> list[str]:
    """Heads of columns with units.

    Args:
        names: The output of each.
    """
    return [with_brackets(name, unit_of(problem, output)) for name, output in names.items()]


def judged_outputs(problem: Problem) -> dict[str, str]:
    """The output of each objective and constraint, by its name."""
    aims = {name: table.output for name, table in problem.objectives.items()}
    return aims | {name: table.output for name, table in problem.constraints.items()}


def objective_change(problem: Problem, at: int, change: float) -> str:
    """A change of an objective in its unit: ``-3.2 dB``."""
    return with_unit(change_text(change), unit_of(problem, list(problem.objectives.values())[at].output))
