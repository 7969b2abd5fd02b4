"""One run of a scene: integrate, sample, and let the run check itself; it ends in an outcome, never in a silent number.

What decides an outcome, and where the limits come from
-------------------------------------------------------
energy
    Change of energy against work put in and lost. An explicit step beyond the friction limit chatters: the power mu f
    |v| at its sampled velocities is not the work it does.
slip reversals
    A slip that reverses from step to step is chatter, not motion.
halved step
    Short windows along the way are run again from the same state with half the step (or a tenth of the tolerance). They
    are a sample of the run: the differences of a body's places and turns, summed over all windows, must stay within
    `Limits.disagreement` of their slip paths in sum (of their travel where nothing slips). A first-order method's error
    is twice the difference.
penetration, drift, runaway, budget, step floor
    Bounds on the state and on the work.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import InputError, near_match
from tripod_doe.mechanics.assembly import Assembly, State
from tripod_doe.mechanics.bearing import bearing_compression
from tripod_doe.mechanics.contact import largest_penetration
from tripod_doe.mechanics.integrators.contract import Method
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.lanes import WIDTH
from tripod_doe.mechanics.monitor import RUNAWAY, Settings, begin_watch
from tripod_doe.mechanics.motion import evaluate, kinetic_energy
from tripod_doe.mechanics.tables import Work
from tripod_doe.results import Outcome

__all__ = ["Limits", "Run", "method_named", "run"]

FloatArray = NDArray[np.float64]
_NOTHING = 1e-6


@dataclass(frozen=True)
class Limits:
    """What a run may show and still be called finished.

    Attributes
    ----------
    energy
        Energy residual over the work lost and the energy turned over.
    turned_over
        Energy that counts as turned over even where a motion turns over less.
    reversals
        Share of the steps in which a sphere's slip reversed, for the sphere that did it most; slip below a hundredth of
        the transition velocity is rolling, whichever way it points.
    disagreement
        Difference to the halved step over the slip path: one per cent stands for an error of two of it at first order.
        Turns count by the length that speed_scale is at rotation_scale.
    penetration
        Penetration over the largest radius of the body's spheres (over the scene's length if they are points), or over
        that of a bearing's needles; every sphere and slice is looked at, at the samples.
    drift
        Residual of a constraint over the scene's length.
    windows, share
        Windows that are run again, and their share of the run: their price is twice this.
    """

    energy: float = 0.05
    turned_over: float = 0.0
    reversals: float = 0.05
    disagreement: float = 0.01
    penetration: float = 0.05
    drift: float = 1e-4
    windows: int = 4
    share: float = 0.04


@dataclass(frozen=True)
class Run:
    """What became of a run.

    Attributes
    ----------
    assembly
        What was run.
    outcome, detail
        How it ended, and if not well then why, when and at which body.
    times, positions, velocities
        Samples, shapes (sample,), (sample, body, 7), (sample, body, 6), from the start on.
    work
        Time integrals of the power put in and of that lost by sliding, spinning, rolling and damping.
    energy_residual, reversals, disagreement, penetration, drift
        The quantities that `Limits` bounds; NaN where they were not found.
    steps, force_evaluations, solves, check_evaluations
        Counted work: steps, evaluations of all forces, factorisations of a linear system; evaluations of the checks.
    followed
        Time that was simulated, up to the end or the failure.
    """

    assembly: Assembly
    outcome: Outcome
    detail: str
    times: FloatArray
    positions: FloatArray
    velocities: FloatArray
    work: FloatArray
    energy_residual: float
    reversals: float
    disagreement: float
    penetration: float
    drift: float
    steps: int
    force_evaluations: int
    solves: int
    check_evaluations: int
    followed: float


def method_named(name: str) -> Method:
    """Find a method of the registry.

    Raises
    ------
    InputError
        If there is none of this name.
    """
    if name not in METHODS:
        raise InputError(f"method {name!r}: unknown{near_match(name, METHODS)}")
    return METHODS[name]


class _Window(NamedTuple):
    """How far a window and its halved steps led apart.

    Lengths, and turns times the scene's lever, shape (body,); slip path, travel and spin that they are measured by.
    """

    begin: float
    apart: FloatArray
    turned: FloatArray
    path: float
    travel: float
    spun: float


@dataclass
class _Checks:
    """Findings that gather while a run goes on."""

    failure: tuple[Outcome, str] | None = None
    penetration: float = 0.0
    evaluations: int = 0
    initial_energy: float = 0.0
    turned_over: float = 0.0
    sizes: FloatArray = field(default_factory=lambda: np.zeros(0))
    windows: list[_Window] = field(default_factory=list)
    residuals: list[tuple[float, float]] = field(default_factory=list)

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
) -> Run:
    """Simulate a scene from its start, or from another state.

    Parameters
    ----------
    assembly
        The scene.
    method
        Name of a method of the registry.
    duration
        Simulated time.
    step
        Step of a method without step control; it is shortened to divide the time between samples.
    samples
        Number of equal parts of the duration, each of which ends in a sample.
    settings
        Numerics.
    limits
        What may be called finished.
    start
        State to go on from, at its own time; that of the scene unless given.

    Raises
    ------
    InputError
        If the method is unknown or needs a step, the duration is not positive, or the start violates a constraint.
    """
    chosen = method_named(method)
    if not (0 < duration < math.inf and samples >= 1):
        raise InputError(f"duration = {duration}, samples = {samples}: a run needs some time and at least one sample")
    settings = settings or Settings()
    limits = limits or Limits()
    steps_wanted = not (chosen.controlled and settings.controlled)
    if steps_wanted and not (step is not None and step > 0):
        raise InputError(f"method {method}: needs a step")
    each = duration / samples
    count = samples * (max(math.ceil(each / step * (1 - 1e-9)), 1) if steps_wanted and step else 1000)
    stops, windows = _stops(count, samples, limits)
    state, memory = start.copy() if start else assembly.initial_state(), assembly.work()
    begin, clock, checks = state.time, np.array([state.time, 0.0, 0.0]), _Checks()
    begin_watch(assembly.tables, memory, state.positions, state.velocities, begin)
    if start is None:
        _check_start(assembly, memory, state, limits)
    checks.initial_energy, checks.turned_over = _energy(assembly, memory, state), limits.turned_over
    checks.sizes = _contact_sizes(assembly)
    times, positions, velocities = [begin], [state.positions.copy()], [state.velocities.copy()]
    done = 0
    for stop, is_sample in stops:
        before = state.copy() if (done, stop) in windows else None
        end = begin + duration * stop / count
        with np.errstate(all="ignore"):
            status = chosen.integrate(
                assembly.tables, memory, state.positions, state.velocities, clock, end, stop - done, settings
            )
        state.time = float(clock[0])
        if status != Outcome.FINISHED:
            checks.fail(Outcome(int(status)), _stopped(assembly, memory, Outcome(int(status)), state.time))
            break
        if before is not None:
            _compare(assembly, chosen, before, state, memory, stop - done, settings, checks)
        done = stop
        if is_sample:
            _inspect(assembly, memory, state, limits, checks)
            times.append(state.time)
            positions.append(state.positions.copy())
            velocities.append(state.velocities.copy())
    disagreement = _halved_steps(assembly, limits, checks)
    energy = _energy_balance(limits, checks)
    reversals = _reversals(assembly, memory, limits, state.time, checks)
    outcome, detail = checks.failure or (Outcome.FINISHED, "")
    return Run(
        assembly, outcome, detail, np.array(times), np.array(positions), np.array(velocities), memory.balance.copy(),
        energy, reversals, disagreement, checks.penetration, float(memory.extremes[0]),
        int(memory.counters[3]), int(memory.counters[0]), int(memory.counters[2]), checks.evaluations,
        state.time - begin,
    )  # fmt: skip


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
    """Refuse a scene that starts off its constraints: the first step would throw its bodies somewhere else."""
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
                f"bodies {a} and {b} start {what} by {abs(sizes[wrong[0]]):.3g} against their constraint; "
                "give them positions and velocities that obey it"
            )


def _energy(assembly: Assembly, memory: Work, state: State) -> float:
    """Kinetic and stored energy; the ledger must be that of the state."""
    return float(kinetic_energy(assembly.tables, state.positions, state.velocities) + memory.ledger[0])


def _stopped(assembly: Assembly, memory: Work, outcome: Outcome, time: float) -> str:
    body = assembly.names[int(memory.failure[0])]
    size = float(memory.failure[1])
    left = not size <= RUNAWAY
    reason = {
        Outcome.DIVERGED: "the motion left all bounds" if left else "the iteration of a step did not converge",
        Outcome.STEP_LIMIT: f"the step fell to {size:.3g}",
        Outcome.EVALUATION_LIMIT: f"{int(memory.counters[0])} force evaluations are used up",
    }[outcome]
    return f"{reason} at t = {time:.6g}, body {body}"


def _contact_sizes(assembly: Assembly) -> FloatArray:
    """Length that the penetrations of each contact are small against: its body's largest sphere, or the scene's."""
    tables = assembly.tables
    radii = np.zeros(tables.bodies.size)
    np.maximum.at(radii, tables.contacts["body_a"], tables.contacts["radius"])
    sizes: FloatArray = np.where(radii > 0, radii, assembly.scene.length_scale)[tables.contacts["body_a"]]
    return sizes


def _inspect(assembly: Assembly, memory: Work, state: State, limits: Limits, checks: _Checks) -> None:
    """Energy, penetration and drift at a sample."""
    change = _energy(assembly, memory, state) - checks.initial_energy
    put_in, lost = float(memory.balance[0]), float(memory.balance[1:].sum())
    # a motion that turns nothing over is held to a millionth of what it has
    held = _NOTHING * abs(checks.initial_energy)
    checks.turned_over = max(checks.turned_over, abs(change), abs(put_in), abs(lost), held)
    checks.residuals.append((state.time, change - put_in + lost))
    at, tables = f"at t = {state.time:.6g}", assembly.tables
    for deepest, share, depth, body in (
        largest_penetration(tables.contacts, checks.sizes, state.positions),
        bearing_compression(tables.bearings, state.positions, state.velocities),
    ):
        checks.penetration = max(checks.penetration, float(deepest))
        if share > limits.penetration:
            text = f"a penetration of {depth:.3g} is outside the contact law {at}, body {assembly.names[int(body)]}"
            checks.fail(Outcome.INACCURATE, text)
    if not memory.extremes[0] <= limits.drift * assembly.scene.length_scale:
        checks.fail(Outcome.INACCURATE, f"constraints have drifted by {memory.extremes[0]:.3g} {at}")


def _energy_balance(limits: Limits, checks: _Checks) -> float:
    """Largest energy residual of all samples, over the energy that the whole run turned over."""
    if not checks.residuals or checks.turned_over == 0.0:
        return 0.0
    shares = np.abs([residual for _, residual in checks.residuals]) / checks.turned_over
    wrong = np.flatnonzero(~(shares <= limits.energy))
    if wrong.size:
        time, share = checks.residuals[wrong[0]][0], 100 * shares[wrong[0]]
        checks.fail(
            Outcome.INACCURATE, f"the energy balance misses {share:.3g} % of the energy turned over at t = {time:.6g}"
        )
    return float(shares.max())


def _compare(
    assembly: Assembly, method: Method, before: State, after: State, memory: Work, count: int,
    settings: Settings, checks: _Checks,
) -> None:  # fmt: skip
    """Run a window again with half the step, or a tenth of the tolerance, and compare where it leads."""
    probe, again, clock = assembly.work(), before.copy(), np.array([before.time, 0.0, 0.0])
    fine = settings._replace(tolerance=0.1 * settings.tolerance)
    with np.errstate(all="ignore"):
        status = method.integrate(
            assembly.tables, probe, again.positions, again.velocities, clock, after.time, 2 * count, fine
        )
    checks.evaluations += int(probe.counters[0])
    at = f"at t = {before.time:.6g}"
    if status != Outcome.FINISHED:
        checks.fail(Outcome.INACCURATE, f"half the step fails {at}: {Outcome(int(status)).label}")
        return
    evaluate(assembly.tables, probe, before.positions, before.velocities, before.time, 0.0)
    slips = [np.sqrt((slip**2).sum(axis=1)).max(initial=0.0) for slip in (probe.slip, memory.slip)]
    duration, lever = after.time - before.time, assembly.scene.speed_scale / assembly.scene.rotation_scale
    checks.windows.append(
        _Window(
            before.time,
            np.sqrt(((again.positions[:, :3] - after.positions[:, :3]) ** 2).sum(axis=1)),
            lever * _turns_between(again.positions, after.positions),
            float(np.mean(slips)) * duration,
            float(np.abs(after.positions[:, :3] - before.positions[:, :3]).max()),
            lever * float(np.abs(after.velocities[:, 3:]).max()) * duration,
        )
    )


def _halved_steps(assembly: Assembly, limits: Limits, checks: _Checks) -> float:
    """What all windows are apart from their halved steps, over their slip paths: the body that it is largest for."""
    if not checks.windows:
        return math.nan
    path, travel, spun = (sum(getattr(w, name) for w in checks.windows) for name in ("path", "travel", "spun"))
    least = 1e-9 * assembly.scene.length_scale
    by_length, by_turn = (max(path if path > 0 else other, least) for other in (travel, spun))
    shares = np.array([np.maximum(w.apart / by_length, w.turned / by_turn) for w in checks.windows])
    total = shares.sum(axis=0)
    disagreement = float(total.max())
    if not disagreement <= limits.disagreement:
        body = int(total.argmax())
        time, way = checks.windows[int(shares[:, body].argmax())].begin, "slip path" if path > 0 else "travel"
        text = f"half the step leads {100 * disagreement:.3g} % of the {way} elsewhere, most at t = {time:.6g}"
        checks.fail(Outcome.INACCURATE, f"{text}, body {assembly.names[body]}")
    return disagreement


def _turns_between(positions: FloatArray, others: FloatArray) -> FloatArray:
    """Angle between two near attitudes of every body, from the chord of their quaternions; rad, shape (body,)."""
    sign = np.where((positions[:, 3:] * others[:, 3:]).sum(axis=1, keepdims=True) < 0, -1.0, 1.0)
    angles: FloatArray = 2 * np.sqrt(((positions[:, 3:] - sign * others[:, 3:]) ** 2).sum(axis=1))
    return angles


def _reversals(assembly: Assembly, memory: Work, limits: Limits, time: float, checks: _Checks) -> float:
    """Largest share of steps in which one sphere's slip reversed."""
    if memory.reversals.size == 0:
        return 0.0
    reversed_, moving = (memory.reversals[:, kind].ravel() for kind in range(2))
    shares = reversed_ / np.maximum(moving, 1)
    shares[reversed_ < 8] = 0.0  # a few reversals are motion
    worst = int(shares.argmax())
    if shares[worst] > limits.reversals:
        contacts = assembly.tables.contacts
        owner = contacts["body_a"][np.searchsorted(contacts["first"], worst // WIDTH, side="right") - 1]
        text = f"slip reverses in {100 * shares[worst]:.3g} % of the steps up to t = {time:.6g}"
        checks.fail(Outcome.INACCURATE, f"{text}, body {assembly.names[int(owner)]}")
    return float(shares[worst])
