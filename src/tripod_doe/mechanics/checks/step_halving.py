"""The numerical error of a run, from a second run in half the steps or with a tenth of the tolerance.

A run of few steps is repeated completely and compared at its samples: this costs milliseconds, and coarse runs are the
least reliable. A longer run is repeated in windows only, each from a state of the run: they are a sample, and
the sum of their differences represents the run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.mechanics.assembly import Assembly, State
from tripod_doe.mechanics.checks.energy_balance import EnergyBalance, Passage
from tripod_doe.mechanics.integrators.method_interface import Method
from tripod_doe.mechanics.integrators.monitor import Settings, begin_watch
from tripod_doe.mechanics.tables import EVALUATIONS, Work
from tripod_doe.model_interface import Outcome

_TENTH = 0.1


@dataclass(frozen=True)
class PathLengths:
    """Path lengths of a motion, to which differences are related."""

    duration: float  # duration of the motion
    # slip, travel, spun: longest slip path of a sphere, longest way of a body along an axis, and largest turn of a body
    # about one. Turns are multiplied by the length speed_scale / rotation_scale of the scene.
    slip: float
    travel: float
    spun: float


@dataclass(frozen=True)
class RepeatedStretch:
    """A stretch of a run that was repeated in finer steps."""

    begin: float  # when it began
    # apart, turned: largest distance between each body's places at the states of the stretch, and between its
    # attitudes, as a length; shape (body,)
    apart: FloatArray
    turned: FloatArray
    ways: PathLengths  # slip, travel and turn of the finer motion
    balance: EnergyBalance  # energy balance of the finer motion
    evaluations: int  # force evaluations of the finer motion
    outcome: Outcome  # how it ended; other fields hold up to its end


@dataclass(frozen=True)
class Difference:
    """The largest difference to half steps, relative to a path: its size, its body, its time."""

    size: float  # difference over the slip path, or over the travel if nothing slips
    body: int  # number of the body
    begin: float  # start of the stretch with the largest part
    way: str  # the reference path


def error_over_difference(order: int, controlled: bool) -> float:
    """Error over the difference to half steps at this order, or to a tenth of the tolerance (proportional errors)."""
    return 1 / (1 - (_TENTH if controlled else 0.5**order))


def repeat_finer(
    assembly: Assembly, method: Method, states: Sequence[State], count: int, settings: Settings, controlled: bool
) -> RepeatedStretch:
    """Repeat a stretch in finer steps from its first state, and compare their states.

    Args:
        states: The stretch; the first is where it begins.
        count: Steps that were taken from each state to the next.
        controlled: Whether the method chose its steps by its tolerance. If the method cannot reach a tenth of it, ten
            times the tolerance is compared; if the equations of a half step do not converge, a third of the step.
    """
    tolerance = settings.tolerance
    for factor, each in ((_TENTH, 2), (1 / _TENTH, 3)):
        numerics = settings._replace(tolerance=factor * tolerance) if controlled else settings
        again = _follow(assembly, method, states, each * count, numerics)
        if again.outcome == Outcome.FINISHED:
            break
    return again


def _follow(
    assembly: Assembly, method: Method, states: Sequence[State], count: int, settings: Settings
) -> RepeatedStretch:
    """Run from the first of the states through the times of the others."""
    state, memory = states[0].copy(), assembly.work()
    clock, begin, status = np.array([state.time, 0.0, 0.0]), state.time, int(Outcome.FINISHED)
    begin_watch(assembly.tables, memory, state.positions, state.velocities, begin)
    passage = Passage(memory, state)
    for other in states[1:]:
        with np.errstate(all="ignore"):
            status = method.integrate(
                assembly.tables, memory, state.positions, state.velocities, clock, other.time, count, settings
            )
        state.time = float(clock[0])
        if status != Outcome.FINISHED:
            break
        passage.note(memory, state)
    places, passed = passage.positions, passage.states
    others = np.array([other.positions for other in states[: len(passed)]])
    return RepeatedStretch(
        begin,
        np.sqrt(((places[:, :, :3] - others[:, :, :3]) ** 2).sum(axis=2)).max(axis=0),
        _lever(assembly) * _turns_between(places, others).max(axis=0),
        path_lengths(assembly, passed, memory),
        EnergyBalance.of(assembly, passage),
        int(memory.counters[EVALUATIONS]),
        Outcome(int(status)),
    )


def path_lengths(assembly: Assembly, states: Sequence[State], memory: Work) -> PathLengths:
    """Path lengths of a motion from its states and recorded slip paths."""
    if len(states) < 2:
        return PathLengths(0.0, 0.0, 0.0, 0.0)
    places = np.array([state.positions[:, :3] for state in states])
    rates = np.array([state.velocities[:, 3:] for state in states])
    durations = np.diff([state.time for state in states])
    return PathLengths(
        float(durations.sum()),
        float(memory.paths[:, 1].max(initial=0.0)),
        float(np.abs(np.diff(places, axis=0)).sum(axis=0).max()),
        _lever(assembly) * float(np.tensordot(durations, np.abs(rates[1:]), 1).max()),
    )


def difference(assembly: Assembly, pieces: Sequence[RepeatedStretch], whole: PathLengths) -> Difference:
    """Sum the differences between a run and its repeated pieces, and find the body with the largest sum.

    The reference is the path in the pieces, at least their share of the path of the whole run: else the end of a slip
    would make any difference large.
    """
    part = sum(piece.ways.duration for piece in pieces) / whole.duration
    slip, travel, spun = (
        max(sum(getattr(piece.ways, name) for piece in pieces), part * getattr(whole, name))
        for name in ("slip", "travel", "spun")
    )
    least = 1e-9 * assembly.scene.length_scale
    by_length, by_turn = (max(slip if slip > 0 else other, least) for other in (travel, spun))
    shares = np.array([np.maximum(piece.apart / by_length, piece.turned / by_turn) for piece in pieces])
    body = int(shares.sum(axis=0).argmax())
    most = pieces[int(shares[:, body].argmax())]
    return Difference(float(shares[:, body].sum()), body, most.begin, "slip path" if slip > 0 else "travel")


def _lever(assembly: Assembly) -> float:
    return assembly.scene.speed_scale / assembly.scene.rotation_scale


def _turns_between(positions: FloatArray, others: FloatArray) -> FloatArray:
    """Angle between two near attitudes of every body, from the chord of their quaternions; rad, shape (state, body)."""
    sign = np.where((positions[..., 3:] * others[..., 3:]).sum(axis=-1, keepdims=True) < 0, -1.0, 1.0)
    angles: FloatArray = 2 * np.sqrt(((positions[..., 3:] - sign * others[..., 3:]) ** 2).sum(axis=-1))
    return angles
