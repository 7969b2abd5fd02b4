"""The states after every step of a run, taken out of the memory of its kernels whenever that is full.

A sample ends a step of a method with step control: samples as close as steps would cut every second step short. So
quantities that are needed at all times are read at the method's own steps.
"""

from __future__ import annotations

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.mechanics.assembly import State
from tripod_doe.mechanics.tables import TRACED, Work

States = tuple[FloatArray, FloatArray, FloatArray]
"""Times, positions and velocities, shapes (state,), (state, body, 7), (state, body, 6)."""


class Trace:
    """All states of a run, the first of them included.

    Args:
        memory: Memory of the run; without memory for a trace there are no states.
        state: Where it starts.
    """

    def __init__(self, memory: Work, state: State) -> None:
        self._memory, self._bodies = memory, len(state.positions)
        self._rows = [np.hstack([state.time, state.positions.ravel(), state.velocities.ravel()])[None]]

    def take(self) -> None:
        """Empty the memory."""
        counters = self._memory.counters
        self._rows.append(self._memory.trace[: counters[TRACED]].copy())
        counters[TRACED] = 0

    def states(self) -> States:
        """All states so far."""
        rows = np.concatenate(self._rows)
        times, positions, velocities = np.split(rows, [1, 1 + 7 * self._bodies], axis=1)
        return times[:, 0], positions.reshape(-1, self._bodies, 7), velocities.reshape(-1, self._bodies, 6)
