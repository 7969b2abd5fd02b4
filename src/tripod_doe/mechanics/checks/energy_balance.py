"""The energy balance of a run: change of energy minus work put in plus work lost, at every sample."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.mechanics.assembly import Assembly, State
from tripod_doe.mechanics.forces.inertia import kinetic_energies
from tripod_doe.mechanics.tables import Work

_NOTHING = 1e-6


class Passage:
    """The states of a run with the recorded sums of each: copies, to be checked after the run."""

    def __init__(self, memory: Work, state: State) -> None:
        self.states: list[State] = []
        self._ledgers: list[tuple[float, float, FloatArray]] = []
        self.note(memory, state)

    def note(self, memory: Work, state: State) -> None:
        """Add a state; the ledger must be its own."""
        self.states.append(state.copy())
        self._ledgers.append((float(memory.ledger[0]), float(memory.extremes[0]), memory.balance.copy()))

    @property
    def times(self) -> FloatArray:
        """Times, shape (state,)."""
        return np.array([state.time for state in self.states])

    @property
    def positions(self) -> FloatArray:
        """Positions, shape (state, body, 7)."""
        return np.array([state.positions for state in self.states])

    @property
    def velocities(self) -> FloatArray:
        """Velocities, shape (state, body, 6)."""
        return np.array([state.velocities for state in self.states])

    @property
    def drifts(self) -> FloatArray:
        """Largest residual of a constraint up to each state, shape (state,)."""
        return np.array([drift for _, drift, _ in self._ledgers])

    @property
    def stored(self) -> FloatArray:
        """Stored energies, shape (state,)."""
        return np.array([energy for energy, _, _ in self._ledgers])

    @property
    def work(self) -> FloatArray:
        """Work put in, and lost to each mechanism, up to each state, shape (state, 5)."""
        return np.array([balance for _, _, balance in self._ledgers])


@dataclass(frozen=True)
class EnergyBalance:
    """Energy balance of a run."""

    turned_over: float  # largest of change, work put in and work lost, or a least value
    # times, residuals: of every sample: its time, and change less work put in plus work lost
    times: FloatArray
    residuals: FloatArray

    @classmethod
    def of(cls, assembly: Assembly, passage: Passage, turned_over: float = 0.0) -> EnergyBalance:
        """The balance of a run; the energy turned over is at least the given one."""
        energies, work = passage.stored, passage.work
        kinetic_energies(assembly.tables, passage.positions, passage.velocities, energies)
        change, put_in, lost = energies - energies[0], work[:, 0], work[:, 1:].sum(axis=1)
        # a motion without work is compared with a millionth of its energy
        sizes = [turned_over, _NOTHING * abs(energies[0]), *(np.abs(part).max() for part in (change, put_in, lost))]
        return cls(float(np.max(sizes)), passage.times[1:], (change - put_in + lost)[1:])

    def refined(self, finer: EnergyBalance, factor: float) -> EnergyBalance:
        """Subtract from the residuals the changes by finer steps times a factor, and energy that returns.

        If a power ends within a step, the sum of powers has an error that the motion has not. Energy that a method
        borrows within a contact and returns before the next sample is not lost either.
        """
        missed = self.residuals + factor * (finer.residuals - self.residuals)
        later = np.append(missed[1:], missed[-1:])
        return replace(self, residuals=np.where(np.abs(missed) <= np.abs(later), missed, later))

    def shares(self) -> FloatArray:
        """Residual over the energy turned over at every sample, shape (sample,)."""
        if self.turned_over == 0.0:
            return np.zeros_like(self.residuals)
        shares: FloatArray = np.abs(self.residuals) / self.turned_over
        return shares

    def worst(self) -> float:
        """Largest relative residual, 0 without samples."""
        return float(self.shares().max(initial=0.0))
