"""The energy balance of a run: change of energy against work put in and lost, at every sample."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tripod_doe.mechanics.assembly import Assembly, State
from tripod_doe.mechanics.motion import kinetic_energy
from tripod_doe.mechanics.tables import Work

__all__ = ["EnergyBalance"]

_NOTHING = 1e-6


@dataclass
class EnergyBalance:
    """What gathers at the samples of a run.

    Attributes
    ----------
    initial
        Energy at the start.
    turned_over
        Largest of change, work put in and work lost so far, or a least value to start with.
    residuals
        Time, and change less work put in plus work lost.
    """

    initial: float
    turned_over: float = 0.0
    residuals: list[tuple[float, float]] = field(default_factory=list)

    @classmethod
    def begun(cls, assembly: Assembly, memory: Work, state: State, turned_over: float = 0.0) -> EnergyBalance:
        """The balance of a run that starts from a state; the ledger must be that of the state."""
        initial = _energy(assembly, memory, state)
        # a motion that turns nothing over is held to a millionth of what it has
        return cls(initial, max(turned_over, _NOTHING * abs(initial)))

    def note(self, assembly: Assembly, memory: Work, state: State) -> None:
        """Add a sample; the ledger must be that of the state."""
        change = _energy(assembly, memory, state) - self.initial
        put_in, lost = float(memory.balance[0]), float(memory.balance[1:].sum())
        self.turned_over = max(self.turned_over, abs(change), abs(put_in), abs(lost))
        self.residuals.append((state.time, change - put_in + lost))

    def refined(self, finer: EnergyBalance, factor: float) -> EnergyBalance:
        """Take what finer steps of the same motion change, times a factor, from what is missed, and what comes back.

        Where a power breaks off within a step, the sum of powers misses energy that the motion does not. What a method
        borrows within a contact and gives back before the next sample is not lost either.
        """
        pairs = zip(self.residuals, finer.residuals, strict=True)
        missed = [coarse + factor * (fine - coarse) for (_, coarse), (_, fine) in pairs]
        lasting = [min(now, then, key=abs) for now, then in zip(missed, [*missed[1:], missed[-1]], strict=True)]
        times = (time for time, _ in self.residuals)
        return EnergyBalance(self.initial, self.turned_over, list(zip(times, lasting, strict=True)))

    def missed(self) -> list[tuple[float, float]]:
        """Time of every sample, and its residual's share of the energy that the whole run turned over."""
        if self.turned_over == 0.0:
            return [(time, 0.0) for time, _ in self.residuals]
        return [(time, abs(residual) / self.turned_over) for time, residual in self.residuals]

    def worst(self) -> float:
        """Largest share that is missed, 0 without samples."""
        return float(np.max([share for _, share in self.missed()], initial=0.0))


def _energy(assembly: Assembly, memory: Work, state: State) -> float:
    """Kinetic and stored energy."""
    return float(kinetic_energy(assembly.tables, state.positions, state.velocities) + memory.ledger[0])
