"""Changes that a study tries on points that failed, as [run] retry lists them, checked before anything runs.

Changes add up in the order of the list until the point finishes. A new model takes its own method, step and tolerance,
a new method its own step and tolerance, unless the same change sets them: a step chosen for one method says nothing
about another. `execution.retry` runs them.
"""

import itertools
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tripod_doe.errors import InputError, near_match
from tripod_doe.model_interface import Outcome, Parameter, Simulator, Value, check_parameters

SMALLER_STEP = "smaller-step"
"""The change that halves the step or tolerance, given or chosen by the run."""

_STEPS = ("step_s", "relative_tolerance")
_FOLLOWERS = {"model": ("method", *_STEPS), "method": _STEPS}
_MOST_TRIED = 1_000  # kinds of points on which a change is tried before it runs
_NEVER_RETRIED = (Outcome.FINISHED, Outcome.NOT_APPLICABLE)


@dataclass(frozen=True)
class Change:
    """One change of the parameters of a point that failed."""

    values: Mapping[str, Value]  # parameters to set; empty for a smaller step

    @property
    def label(self) -> str:
        """The change in words."""
        settings = (
            f"{name} = {value:g}" if isinstance(value, float) else f"{name} = {value}"
            for name, value in self.values.items()
        )
        return ", ".join(settings) or SMALLER_STEP


@dataclass(frozen=True)
class RetryPlan:
    """The changes of a study, and the outcomes without retry."""

    changes: tuple[Change, ...] = ()  # in the order in which they are tried
    accepted: frozenset[int] = frozenset(_NEVER_RETRIED)  # outcomes that are not retried


NO_RETRIES = RetryPlan()
"""The plan of a study without retries."""


def check_retries(
    simulator: Simulator,
    base: Mapping[str, Value],
    factors: Mapping[str, Sequence[Value]],
    keep: Collection[str],
    entries: Sequence[str | Mapping[str, Any]],
    expected: Collection[str],
    unknown: Collection[str] = (),
) -> RetryPlan:
    """Check the retries of a study before anything runs.

    Args:
        simulator, base, keep: The simulator, the values that all points share, and the outputs to keep.
        factors: Values of each factor; empty if it is sampled.
        entries: The changes as the study file gives them.
        expected: Outcomes besides finished that do not count as failures.
        unknown: Parameters whose values follow only from the points.

    Raises:
        InputError: If a change is unknown, cannot run, or changes no point.
    """
    changes = tuple(_change(simulator, entry) for entry in entries)
    for name in dict.fromkeys(name for change in changes for name in change.values):
        _refuse_another_point(simulator.parameters[name], name in factors)
    touched = {name for change in changes for name in change.values}
    unsure = {name for name, levels in factors.items() if not levels} | set(unknown)
    trials = [_Trial(change, bool(unsure & change.values.keys())) for change in changes]
    points = _kinds_of_points(base, factors, touched)
    for values in itertools.islice(points, _MOST_TRIED):
        if all(trial.differs and trial.runs for trial in trials):
            break
        for trial in trials:
            values = trial.on(simulator, values, factors, keep)
    if next(points, None) is None:  # all were tried
        for trial in trials:
            trial.refuse_in_vain()
    accepted = {*_NEVER_RETRIED, *(outcome for outcome in Outcome if outcome.label in expected)}
    return RetryPlan(changes, frozenset(int(outcome) for outcome in accepted))


@dataclass
class _Trial:
    """A change, tried on kinds of points one after the other."""

    change: Change
    differs: bool  # whether it changes a point, or may change one that is not known
    runs: bool = False  # whether a point can run with it
    reason: InputError | None = None  # why the first one cannot

    def on(
        self, simulator: Simulator, old: dict[str, Value], factors: Mapping[str, Sequence[Value]], keep: Collection[str]
    ) -> dict[str, Value]:
        """The values of a kind of point after the change."""
        new = changed_values(simulator, old, self.change, {})
        if new is None:
            new = old
        elif not self.differs:
            self.differs = simulator.effective(new) != simulator.effective(old)
        if not self.runs:
            others = {name: levels for name, levels in factors.items() if name not in new}
            try:
                simulator.check({name: value for name, value in new.items() if value is not None}, others, keep)
                self.runs = True
            except InputError as error:
                self.reason = self.reason or error
        return new

    def refuse_in_vain(self) -> None:
        """Refuse (InputError) a change that changes no point, or with which none can run."""
        where = f"retry: {self.change.label}"
        if not self.differs:
            reason = "it makes no difference" if self.change.values else "no point has a step or a tolerance"
            raise InputError(f"{where}: {reason}; remove it")
        if not self.runs:
            raise InputError(f"{where}: {self.reason}") from self.reason


def _change(simulator: Simulator, entry: str | Mapping[str, Any]) -> Change:
    if isinstance(entry, str):
        if entry != SMALLER_STEP:
            raise InputError(
                f'retry: {entry!r}: write "{SMALLER_STEP}" or a table, for instance {{ model = "rollers" }}'
                + near_match(entry, [SMALLER_STEP])
            )
        return Change({})
    if not entry:
        raise InputError("retry: {}: an empty table changes nothing; give a parameter and its value")
    try:
        return Change(check_parameters(simulator.parameters, entry))
    except InputError as error:
        raise InputError(f"retry: {error}") from error


def _refuse_another_point(parameter: Parameter, is_factor: bool) -> None:
    """Refuse (InputError) changes that make another point of it, whose answer would be stored for this one."""
    if is_factor:
        raise InputError(f"retry: {parameter.name}: this study varies it, so a changed point would be another one")
    if parameter.kind != "argument" and parameter.group != "numerics":
        raise InputError(
            f"retry: {parameter.name}: only model, method and numerics may change, else the joint is another"
        )


def _kinds_of_points(
    base: Mapping[str, Value], factors: Mapping[str, Sequence[Value]], touched: Collection[str]
) -> Iterator[dict[str, Value]]:
    """Values for every combination of levels that a change may apply to, first those of factors with few levels."""
    varied = {
        name: levels
        for name, levels in factors.items()
        if levels and (name in touched or name in _FOLLOWERS or name in _STEPS)
    }
    varied = dict(sorted(varied.items(), key=lambda item: -len(item[1])))
    for values in itertools.product(*varied.values()):
        yield {**base, **dict(zip(varied, values, strict=True))}


def changed_values(
    simulator: Simulator, values: Mapping[str, Value], change: Change, settled: Mapping[str, float]
) -> dict[str, Value] | None:
    """The values of a point after a change; None without a step or tolerance to halve.

    `settled` are steps and tolerances that its last run chose by itself.
    """
    new, full = dict(values), simulator.effective(values)
    if change.values:
        for cause, followers in _FOLLOWERS.items():
            if change.values.get(cause, full.get(cause)) != full.get(cause):
                own = [name for name in followers if _is_numerics(simulator, name)]
                new |= {name: simulator.parameters[name].default for name in own}
        return {**new, **change.values}
    usual = simulator.methods(full).get(str(full.get("method")), {})
    for name in _STEPS:
        value = full.get(name) or settled.get(name) or usual.get(name)
        if value is not None:
            half = float(value) / 2
            return None if half < simulator.parameters[name].low else new | {name: half}
    return None


def _is_numerics(simulator: Simulator, name: str) -> bool:
    parameter = simulator.parameters.get(name)
    return parameter is not None and parameter.group == "numerics"


def changed_parameters(simulator: Simulator, retry: RetryPlan) -> tuple[str, ...]:
    """Names of the parameters that retries may change, in the order of the simulator."""
    touched = {name for change in retry.changes for name in change.values}
    for cause in touched & _FOLLOWERS.keys():
        touched = touched | {name for name in _FOLLOWERS[cause] if _is_numerics(simulator, name)}
    if any(not change.values for change in retry.changes):
        touched = touched | set(_STEPS)
    return tuple(name for name in simulator.parameters if name in touched)
