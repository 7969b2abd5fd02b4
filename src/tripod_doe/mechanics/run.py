"""One run of a scene: integrate, sample and check it. A run ends in an outcome, never in a silent wrong number.

Outcome of a run, and the reasons for the limits
-------------------------------------------------------
energy
    Change of energy against work put in and lost. An explicit step beyond the friction limit chatters: the power mu f
    |v| at its sampled velocities is not the work it does. A bouncing ball returns too low by the missing energy.
slip reversals
    A slip that reverses from step to step is chatter: the direction of friction is unknown on that part of the slip
    path. Rolling also reverses its slip, but over almost no path.
halved step
    The run, or windows of it, is run again with half the step (or a tenth of the tolerance): `step_halving`. The error
    that follows from the difference by the method's order must stay within `Limits.error` of the slip path (of the
    travel where nothing slips). If the whole run agrees in half steps, the energy balance is extrapolated to ever
    smaller steps, and includes only energy that does not return: a sum of powers is coarse if a power ends within a
    step, and a method may borrow energy within a contact.
penetration, drift, runaway, budget, step floor
    Bounds on the state and on the work.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.mechanics.arithmetic.simd_lanes import WIDTH
from tripod_doe.mechanics.assembly import Assembly, State
from tripod_doe.mechanics.checks.energy_balance import EnergyBalance, Passage
from tripod_doe.mechanics.checks.step_halving import (
    PathLengths,
    RepeatedStretch,
    difference,
    error_over_difference,
    path_lengths,
    repeat_finer,
)
from tripod_doe.mechanics.forces.bearing import bearing_compression
from tripod_doe.mechanics.forces.sphere_contact import largest_penetration
from tripod_doe.mechanics.integrators.method_interface import Method
from tripod_doe.mechanics.integrators.monitor import RUNAWAY, TRACE_FULL, Settings, begin_watch
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.tables import EVALUATIONS, FACTORISATIONS, STEPS, Work
from tripod_doe.mechanics.trace import States, Trace
from tripod_doe.model_interface import Outcome
from tripod_doe.number_text import number

_TRACED = 1000
"""Steps after which a trace is emptied: the pause costs a few steps."""

_ROUNDING = 1e-9
"""Share of a stretch that sums of its steps may leave at its end."""


@dataclass(frozen=True)
class Limits:
    """Bounds within which a run counts as finished."""

    # energy residual over the work lost and the energy turned over. Heights have this relative error, and the hidden
    # error of the sum of powers: hence below 1/20, the largest error of any result.
    energy: float = 0.04
    turned_over: float = 0.0  # least energy that counts as turned over
    # slip path in steps that reversed the slip, for the sphere that did it most, over the longest slip path; slip below
    # a hundredth of the transition velocity is rolling, whichever way it points
    reversals: float = 0.05
    # numerical error over the slip path. The drift of a skewed needle, or the push of a tilted roller along its groove,
    # may be a third of the slip: hence below a third of 1/20, the largest error of any result.
    error: float = 0.015
    # penetration over the largest radius of the body's spheres (over the scene's length if they are points), or of
    # a bearing's needles; every sphere and slice is checked, at the samples
    penetration: float = 0.05
    drift: float = 1e-4  # residual of a constraint over the scene's length
    few: int = 500  # steps up to which the whole run is run again; longer ones by windows
    # windows, share: windows that are run again, and their share of the run: they cost twice this share. 0 windows: no
    # check.
    windows: int = 4
    share: float = 0.04


@dataclass(frozen=True)
class Run:
    """The result of a run: outcome, states, checked quantities, counted work."""

    assembly: Assembly  # what was run
    # outcome, detail: how it ended, and for a failure: reason, time and body
    outcome: Outcome
    detail: str
    # times, positions, velocities: samples, shapes (sample,), (sample, body, 7), (sample, body, 6), from the start on;
    # or the states after all steps, if requested
    times: FloatArray
    positions: FloatArray
    velocities: FloatArray
    work: FloatArray  # time integrals of the power put in and of that lost by sliding, spinning, rolling and damping
    # energy_residual, reversals, disagreement, penetration, drift: the quantities that `Limits` bounds, NaN if unknown;
    # `disagreement` is the difference to half steps, from which the error follows
    energy_residual: float
    reversals: float
    disagreement: float
    penetration: float
    drift: float
    # steps, force_evaluations, solves, check_evaluations: counted work: steps, evaluations of all forces,
    # factorisations of a linear system; evaluations of the checks
    steps: int
    force_evaluations: int
    solves: int
    check_evaluations: int
    followed: float  # time that was simulated, up to the end or the failure


def method_named(name: str) -> Method:
    """Find a method of the registry; InputError if the name is unknown."""
    if name not in METHODS:
        raise InputError(f"method {name!r}: unknown{near_match(name, METHODS)}")
    return METHODS[name]


@dataclass
class _Checks:
    """The first failure of a run and its deepest penetration, collected check by check."""

    failure: tuple[Outcome, str] | None = None
    penetration: float = 0.0

    def fail(self, outcome: Outcome, detail: str) -> None:
        """Keep the first failure."""
        if self.failure is None:
            self.failure = (outcome, detail)


def run(
    assembly: Assembly,
    method: str,
    duration: float,
    *,
    step: float | None = None,
    samples: int = 1,
    settings: Settings | None = None,
    limits: Limits | None = None,
    start: State | None = None,
    every_step: bool = False,
) -> Run:
    """Simulate a scene from its start, or from another state.

    Args:
        method: Name of a method of the registry.
        step: Step of a method without step control; it is shortened to divide the time between samples.
        samples: Number of equal parts of the duration, each of which ends in a sample.
        limits: Bounds within which it counts as finished.
        start: State to go on from, at its own time; the start of the scene unless given.
        every_step: Whether to return the states after all steps in place of samples. A method that controls its steps
            cuts them at samples, which are few then: they serve the energy balance alone.

    Raises:
        InputError: If the method is unknown or needs a step, the duration is not positive, or the start violates a
            constraint.
    """
    chosen = method_named(method)
    if not (0 < duration < math.inf and samples >= 1):
        given = f"duration = {duration}, samples = {samples}"
        raise InputError(f"{given}: a run needs a positive duration and at least one sample")
    settings, limits = settings or Settings(), limits or Limits()
    equal_steps = not (chosen.controlled and settings.controlled)
    if equal_steps and not (step is not None and step > 0):
        raise InputError(f"method {method}: needs a step")
    each = duration / samples
    count = samples * (max(math.ceil(each / step * (1 - 1e-9)), 1) if equal_steps and step else 1000)
    motion = _begin(assembly, start, limits, _TRACED if every_step else 0)
    memory, passage = motion.memory, motion.passage
    stretches, stopped = _follow(motion, chosen, duration, count, samples, settings, limits)
    states = motion.trace.states() if every_step else (passage.times, passage.positions, passage.velocities)
    checks = _inspect(assembly, states, passage, limits)
    whole, again = memory.counters[STEPS] <= limits.few, []
    if stopped is not None:
        checks.fail(stopped, _stopped(assembly, memory, stopped, motion.state.time))
    elif stretches:
        pieces = [(passage.states, count // samples)] if whole else stretches
        again = [repeat_finer(assembly, chosen, states, steps, settings, not equal_steps) for states, steps in pieces]
    ways = path_lengths(assembly, passage.states if again else (), memory)
    balance = EnergyBalance.of(assembly, passage, limits.turned_over)
    excess = error_over_difference(chosen.order, not equal_steps)
    disagreement = _disagreement(assembly, again, ways, excess, limits, checks)
    if whole and disagreement * excess <= limits.error:
        refined = balance.refined(again[0].balance, error_over_difference(1, not equal_steps))
        balance = min(balance, refined, key=EnergyBalance.worst)
    energy = _energy_balance(limits, checks, balance)
    reversals = _reversals(assembly, memory, limits, motion.state.time, checks)
    outcome, detail = checks.failure or (Outcome.FINISHED, "")
    return Run(
        assembly,
        outcome,
        detail,
        *states,
        memory.balance.copy(),
        energy,
        reversals,
        disagreement,
        checks.penetration,
        float(memory.extremes[0]),
        int(memory.counters[STEPS]),
        int(memory.counters[EVALUATIONS]),
        int(memory.counters[FACTORISATIONS]),
        sum(piece.evaluations for piece in again),
        motion.state.time - motion.begin,
    )


@dataclass(frozen=True)
class _Motion:
    """A running scene: its state, the memory of its kernels, and its samples and trace since the time `begin`."""

    assembly: Assembly
    memory: Work
    state: State
    passage: Passage
    trace: Trace
    begin: float


def _begin(assembly: Assembly, start: State | None, limits: Limits, traced: int) -> _Motion:
    """Begin at a state, or at the start of the scene, which is checked."""
    state, memory = start.copy() if start else assembly.initial_state(), assembly.work(traced)
    begin_watch(assembly.tables, memory, state.positions, state.velocities, state.time)
    if start is None:
        _check_start(assembly, memory, state, limits)
    return _Motion(assembly, memory, state, Passage(memory, state), Trace(memory, state), state.time)


def _follow(
    motion: _Motion, method: Method, duration: float, count: int, samples: int, settings: Settings, limits: Limits
) -> tuple[list[tuple[list[State], int]], Outcome | None]:
    """Integrate and sample; states at both ends of the windows that are run again, with their steps, and a failure."""
    stops, windows = _stops(count, samples, limits)
    stretches: list[tuple[list[State], int]] = []
    state, memory, done = motion.state, motion.memory, 0
    clock = np.array([motion.begin, 0.0, 0.0])
    with np.errstate(all="ignore"):
        for stop, is_sample in stops:
            before = state.copy() if (done, stop) in windows else None
            end = motion.begin + duration * stop / count
            status = _advance(motion, method, clock, end, stop - done, settings)
            state.time = float(clock[0])
            if status != Outcome.FINISHED:
                return stretches, Outcome(int(status))
            if before is not None:
                stretches.append(([before, state.copy()], stop - done))
            done = stop
            if is_sample:
                motion.passage.note(memory, state)
    return stretches, None


def _advance(motion: _Motion, method: Method, clock: FloatArray, end: float, steps: int, settings: Settings) -> int:
    """Integrate up to a time in a number of steps, or in steps that the method chooses; pauses empty the trace."""
    state, memory, begin = motion.state, motion.memory, float(clock[0])
    last, status = int(memory.counters[STEPS]) + steps, TRACE_FULL
    while status == TRACE_FULL and end - clock[0] > _ROUNDING * (end - begin):
        left = max(last - int(memory.counters[STEPS]), 1)
        tables, positions, velocities = motion.assembly.tables, state.positions, state.velocities
        status = int(method.integrate(tables, memory, positions, velocities, clock, end, left, settings))
        motion.trace.take()
    return int(Outcome.FINISHED) if status == TRACE_FULL else status


def _stops(count: int, samples: int, limits: Limits) -> tuple[list[tuple[int, bool]], set[tuple[int, int]]]:
    """Numbers of steps after which the loop pauses (for a sample or not), and the windows that are run again."""
    sampled = {round(count * k / samples) for k in range(1, samples + 1)} - {0}
    number = min(limits.windows, max(int(count * limits.share), 1)) if limits.windows else 0
    length = max(int(count * limits.share / max(number, 1)), 1)
    windows = set()
    for k in range(number):
        begin = min(int(count * (k + 0.5) / number), count - length)
        end = min([begin + length, *(s for s in sampled if s > begin)])
        windows.add((begin, end))
    edges = sampled | {edge for window in windows for edge in window} - {0}
    return [(edge, edge in sampled) for edge in sorted(edges)], windows


def _check_start(assembly: Assembly, memory: Work, state: State, limits: Limits) -> None:
    """Refuse a scene whose start violates a constraint: the first step would throw its bodies apart."""
    rows, jacobian, speeds = assembly.tables.rows, memory.jacobian, state.velocities
    rates = memory.phi_t + np.einsum("kd,kd->k", jacobian[:, :6], speeds[rows["body_a"]])
    rates += np.einsum("kd,kd->k", jacobian[:, 6:], speeds[rows["body_b"]])
    scene = assembly.scene
    for what, sizes, unit in (("apart", memory.phi, scene.length_scale), ("moving apart", rates, scene.speed_scale)):
        wrong = np.flatnonzero(~(np.abs(sizes) <= limits.drift * unit))
        if wrong.size:
            row = rows[wrong[0]]
            a, b = assembly.names[int(row["body_a"])], assembly.names[int(row["body_b"])]
            raise InputError(
                f"bodies {a} and {b} start {what} by {number(abs(sizes[wrong[0]]))} and violate their constraint; "
                "give them positions and velocities that satisfy it"
            )


def _stopped(assembly: Assembly, memory: Work, outcome: Outcome, time: float) -> str:
    body = assembly.names[int(memory.failure[0])]
    size = float(memory.failure[1])
    left = not size <= RUNAWAY
    reason = {
        Outcome.DIVERGED: "the motion grew beyond all bounds" if left else "the iteration of a step did not converge",
        Outcome.STEP_LIMIT: f"the step size fell to {number(size)}",
        Outcome.EVALUATION_LIMIT: f"budget used up after {int(memory.counters[EVALUATIONS])} force evaluations",
    }[outcome]
    return f"{reason} at t = {time:.6g}, body {body}"


def _contact_sizes(assembly: Assembly) -> FloatArray:
    """Reference length of each contact's penetration: its body's largest sphere radius, or the scene's length."""
    tables = assembly.tables
    radii = np.zeros(tables.bodies.size)
    np.maximum.at(radii, tables.contacts["body_a"], tables.contacts["radius"])
    sizes: FloatArray = np.where(radii > 0, radii, assembly.scene.length_scale)[tables.contacts["body_a"]]
    return sizes


def deepest_penetration(assembly: Assembly, positions: FloatArray, velocities: FloatArray) -> float:
    """The largest penetration of any contact in some states of a scene, in its unit of length.

    Args:
        positions, velocities: Shapes (state, body, 7) and (state, body, 6).
    """
    return max(float(deepest) for deepest, *_ in _penetrations(assembly, positions, velocities))


def _penetrations(assembly: Assembly, positions: FloatArray, velocities: FloatArray) -> tuple[Any, Any]:
    """What `largest_penetration` and `bearing_compression` give for some states."""
    tables, states = assembly.tables, (np.ascontiguousarray(positions), np.ascontiguousarray(velocities))
    return (
        largest_penetration(tables.contacts, _contact_sizes(assembly), states[0]),
        bearing_compression(tables.bearings, *states),
    )


def _inspect(assembly: Assembly, states: States, passage: Passage, limits: Limits) -> _Checks:
    """Penetration in all states, and drift up to the samples."""
    checks, (times, positions, velocities) = _Checks(), states
    for deepest, share, depth, body, state in _penetrations(assembly, positions[1:], velocities[1:]):
        checks.penetration = max(checks.penetration, float(deepest))
        if share > limits.penetration:
            at = f"at t = {times[1 + state]:.6g}, body {assembly.names[int(body)]}"
            checks.fail(Outcome.INACCURATE, f"a penetration of {number(depth)} is outside the contact law {at}")
    drifts = passage.drifts[1:]
    drifted = np.flatnonzero(~(drifts <= limits.drift * assembly.scene.length_scale))
    if drifted.size:
        at = f"at t = {passage.states[1 + drifted[0]].time:.6g}"
        checks.fail(Outcome.INACCURATE, f"constraints have drifted by {number(drifts[drifted[0]])} {at}")
    return checks


def _disagreement(
    assembly: Assembly,
    again: Sequence[RepeatedStretch],
    ways: PathLengths,
    excess: float,
    limits: Limits,
    checks: _Checks,
) -> float:
    """Largest relative difference to the repeated run, NaN without one; `excess` is the error over that difference."""
    failed = [piece for piece in again if piece.outcome != Outcome.FINISHED]
    for piece in failed:
        checks.fail(Outcome.INACCURATE, f"half the step fails after t = {piece.begin:.6g}: {piece.outcome.label}")
    if failed or not again:
        return math.nan
    largest = difference(assembly, again, ways)
    if not largest.size * excess <= limits.error:
        text = f"half the step changes the motion by {number(100 * largest.size)} % of the {largest.way}"
        body = assembly.names[largest.body]
        checks.fail(Outcome.INACCURATE, f"{text}, most after t = {largest.begin:.6g}, body {body}")
    return largest.size


def _energy_balance(limits: Limits, checks: _Checks, balance: EnergyBalance) -> float:
    """Largest share of energy that the balance misses."""
    shares = balance.shares()
    missed = np.flatnonzero(~(shares <= limits.energy))
    if missed.size:
        share, time = 100 * shares[missed[0]], balance.times[missed[0]]
        text = f"the energy balance does not account for {number(share)} % of the converted energy at t = {time:.6g}"
        checks.fail(Outcome.INACCURATE, text)
    return balance.worst()


def _reversals(assembly: Assembly, memory: Work, limits: Limits, time: float, checks: _Checks) -> float:
    """Largest share of a sphere's slip path in steps that reversed its slip, over the longest slip path."""
    reversing, paths = (memory.paths[:, kind].ravel() for kind in range(2))
    if not paths.max(initial=0.0) > 0:
        return 0.0
    worst = int(reversing.argmax())
    share = float(reversing[worst] / paths.max())
    if share > limits.reversals:
        contacts = assembly.tables.contacts
        owner = contacts["body_a"][np.searchsorted(contacts["first"], worst // WIDTH, side="right") - 1]
        text = f"slip reverses from step to step over {number(100 * share)} % of its path up to t = {time:.6g}"
        checks.fail(Outcome.INACCURATE, f"{text}, body {assembly.names[int(owner)]}")
    return share
