"""The search: pymoo's algorithms propose generations and receive their judgements, over distinct candidates.

pymoo's NSGA-II, SMS-EMOA and differential evolution have ask and tell, seeds, and compare candidates that are not
feasible by how far they are from it, so that no objective has to be made up for them. Optuna's constraints are soft,
and it brings SQLAlchemy and Alembic; SciPy's differential evolution has one objective, and calls the function itself.
"""

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np

from tripod_doe.analyses.optimisation.measures import Judged
from tripod_doe.analyses.optimisation.variables import Variables
from tripod_doe.array_types import FloatArray, IntArray

_FEWEST, _MOST = 20, 100  # candidates of a generation
_GENERATIONS = 100  # of a search, where that leaves enough candidates in each: more are better than larger ones
_IDLE = 10  # generations with hardly a new candidate, or with equal ones, after which a search is over
_EQUAL = 1e-4  # spread of the objective of a generation, relative, in which candidates are equal
_REFINED = 0.5  # share of the candidates with which a single objective is refined, or searched as corrected
_STEPPED = 0.15  # the same where variables have levels only
# distances from limits, as parts of them, and last steps of candidates that refine a single objective. Wide steps along
# limits that bend end beyond them; narrow ones go up to the limit, less what rounding takes
_WIDE, _NARROW = (5e-3, 0.01), (1e-5, 2.5e-4)
_NEXT = 0.02  # of a range, with which narrow steps go on where wide ones ended
_ENOUGH = 10  # candidates for each range, and ten more, from which on wide steps leave enough for the narrow ones

FAILED = 10.0
"""Violation of a candidate that cannot be computed: more than limits have."""

WIDEST, NARROWEST = 0.1, 1e-3
"""Step around a candidate at the start of its refinement, and the step that ends it, as parts of a range."""


def population_of(evaluations: int, given: int | None) -> int:
    """Number of candidates of a generation."""
    return min(given or max(_FEWEST, min(_MOST, evaluations // _GENERATIONS)), max(evaluations, 4))


class Search:
    """A search with one objective or several.

    Args:
        signs: 1 for an objective to minimise, -1 for one to maximise.
        constraints: Number of constraints.
        first: The first generation on the unit cube, shape (candidate, variable).
    """

    def __init__(self, variables: Variables, signs: FloatArray, constraints: int, first: FloatArray, seed: int) -> None:
        from pymoo.core.problem import Problem
        from pymoo.core.termination import NoTermination

        self._variables, self._signs = variables, signs
        count = len(variables.chosen)
        self._problem = Problem(n_var=count, n_obj=len(signs), n_ieq_constr=constraints + 1, xl=0.0, xu=1.0)
        self._algorithm = _algorithm(len(signs), first, variables)
        self._algorithm.setup(self._problem, termination=NoTermination(), seed=seed, verbose=False)
        self._asked: Any = None
        self._worst: FloatArray | None = None
        self._population, self._idle = len(first), 0

    def ask(self) -> FloatArray:
        """The next generation on the unit cube, shape (candidate, variable); empty where nothing new is left."""
        self._asked = self._algorithm.ask()
        if self._asked is None or len(self._asked) == 0:
            return np.empty((0, len(self._variables.chosen)))
        units = self._variables.snapped(np.asarray(self._asked.get("X"), float))
        self._asked.set("X", units)
        return units

    @property
    def is_over(self) -> bool:
        """Whether nothing new comes any more."""
        return self._idle >= _IDLE

    def tell(self, judged: Judged, new: int) -> None:
        """How the candidates of the last generation were judged, in its order, and how many of them were new."""
        from pymoo.core.evaluator import Evaluator
        from pymoo.problems.static import StaticProblem

        aims = judged.objectives * self._signs
        whole = np.asarray(np.isfinite(aims).all(axis=1) & np.isfinite(judged.violations).all(axis=1))
        if whole.any():
            worst = aims[whole].max(axis=0)
            self._worst = worst if self._worst is None else np.maximum(self._worst, worst)
        stand_in = 0.0 if self._worst is None else self._worst
        aims = np.where(whole[:, None], aims, stand_in)  # never compared: feasibility comes first
        violations = np.where(whole[:, None], judged.violations, 0.0)
        unfinished = np.where(whole, -1.0, FAILED + judged.failed)
        limits = np.column_stack([violations, unfinished])
        Evaluator().eval(StaticProblem(self._problem, F=aims, G=limits), self._asked)
        self._algorithm.tell(infills=self._asked)
        alone = aims.shape[1] == 1 and whole.all() and float(np.ptp(aims)) <= _EQUAL * float(np.abs(aims).max())
        self._idle = self._idle + 1 if alone or 10 * new <= self._population else 0


def first_generation(variables: Variables, population: int, seed: int, start: FloatArray | None) -> FloatArray:
    """First candidates of a search: the start, if there is one, and a latin hypercube.

    `scipy.stats.qmc` has the same sequence, but its import costs 0.9 CPU-s, more than the points of a small search.
    """
    rng = np.random.default_rng(seed).spawn(1)[0]
    offsets = rng.uniform(size=(population, len(variables.chosen)))
    places = [rng.permutation(np.arange(1, population + 1)) for _ in variables.chosen]
    units = (np.transpose(places) - offsets) / population
    if start is not None:
        units[0] = start
    return variables.snapped(units)


def leading(aims: FloatArray, judged: Judged, count: int) -> IntArray:
    """Candidates from which a search continues: the nearest to feasible, among these the least dominated.

    Args:
        aims: Objectives to minimise, shape (candidate, objective).
    """
    from moocore import pareto_rank

    far = np.maximum(judged.violations, 0).sum(axis=1)
    able = np.flatnonzero(np.isfinite(far) & np.isfinite(aims).all(axis=1))
    rank = pareto_rank(aims[able]) if able.size else able
    return np.asarray(able[np.lexsort((rank, far[able]))][:count])


def _algorithm(objectives: int, first: FloatArray, variables: Variables) -> Any:
    """Differential evolution for one objective, NSGA-II for two, SMS-EMOA for more."""
    from pymoo.core.repair import Repair

    population = len(first)

    class Snap(Repair):  # type: ignore[misc]
        """Candidates on the middles of their levels, so that equal ones are known as such."""

        def _do(self, problem: Any, X: Any, **options: Any) -> Any:
            return variables.snapped(np.asarray(X, float))

    if objectives == 1:
        from pymoo.algorithms.soo.nonconvex.de import DE

        return DE(pop_size=population, sampling=first, variant="DE/best/1/bin", CR=0.9, repair=Snap())
    if objectives == 2:
        from pymoo.algorithms.moo.nsga2 import NSGA2

        return NSGA2(pop_size=population, sampling=first, repair=Snap())
    from pymoo.algorithms.moo.sms import SMSEMOA

    return SMSEMOA(pop_size=population, sampling=first, repair=Snap())


def steps_around(variables: Variables, unit: FloatArray, step: float) -> list[tuple[int, FloatArray]]:
    """Candidates one step of one variable away, down and up: the number of the variable, and where it leads.

    Args:
        unit: The candidate, on the unit cube.
        step: Part of a range; levels go to their neighbours.
    """
    moves = []
    for at, variable in enumerate(variables.chosen):
        width = 1 / len(variable.levels) if variable.levels else step
        for sign in (-1, 1):
            moved = unit.copy()
            moved[at] += sign * width
            if variable.levels and not 0 < moved[at] < 1:
                continue
            moved[at] = min(max(moved[at], 0.0), 1.0)
            if moved[at] != unit[at]:
                moves.append((at, moved))
    return moves


def refine(
    variables: Variables,
    best: FloatArray,
    radius: float,
    judge: Callable[[FloatArray], tuple[float, FloatArray]],
    left: int,
) -> None:
    """Try candidates around the best one that change all ranges at once, levels held: they follow limits that bend.

    COBYQA of SciPy (Ragonneau 2022) models the objective and the limits by quadratics of the candidates before. With
    enough candidates it begins with wide steps, up to one that cannot be computed, which spoils these models; narrow
    ones begin at the best that hardly breaks a limit.

    Args:
        best: Where it starts, on the unit cube.
        radius: Of the first candidates about it, as part of a range.
        judge: The objective to minimise and the violations of a candidate, about 1 in size; what it raises ends this.
        left: Number of candidates that may still be tried.
    """
    from scipy.optimize import Bounds, NonlinearConstraint, minimize

    ranges = np.flatnonzero([not variable.levels for variable in variables.chosen])
    if not ranges.size:
        return
    last: tuple[bytes, tuple[float, FloatArray]] = (b"", (np.nan, np.empty(0)))
    value, is_wide = np.inf, radius >= WIDEST and left >= _ENOUGH * (ranges.size + 1)

    def asked(place: FloatArray) -> tuple[float, FloatArray]:
        nonlocal last, value, best
        unit = best.copy()
        unit[ranges] = np.clip(place, 0, 1)
        if last[0] != unit.tobytes():
            last = unit.tobytes(), judge(unit)
            aim, limits = last[1]
            if is_wide and limits[-1] >= FAILED:
                raise StopIteration
            if (limits <= _WIDE[0]).all() and aim < value:
                value, best = aim, unit
        return last[1]

    for margin, final in (_WIDE, _NARROW)[not is_wide :]:
        with suppress(StopIteration):
            minimize(
                lambda place: asked(place)[0],
                best[ranges],
                method="COBYQA",
                bounds=Bounds(0, 1),
                constraints=NonlinearConstraint(lambda place: asked(place)[1], -np.inf, -margin),
                options={"initial_tr_radius": radius, "final_tr_radius": final},
            )
        radius, is_wide = _NEXT, False


def last_share(variables: Variables, objectives: int, is_corrected: bool) -> float:
    """Share of the candidates left that are kept: of one objective, to refine it, or to search it as corrected.

    The front of several has candidates on both sides of a limit; of one, all are drawn to where it was.
    """
    if objectives > 1:
        return 0.0
    has_ranges = any(not variable.levels for variable in variables.chosen)
    return _REFINED if is_corrected or has_ranges else _STEPPED
