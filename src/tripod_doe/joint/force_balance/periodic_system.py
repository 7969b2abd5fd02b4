"""A linear system around the revolution: samples act on later samples, periodically.

Every sample has nine equations for the changes of its nine unknowns. Six numbers y (tilts and spins of the rollers)
follow from them and act on later samples by h = y_(-2) / 2 - 2 y_(-1). So each sample is solved alone, with its
sensitivity to h; a recursion dy_j = c_j + C_j dh_j around the revolution remains. It is evaluated in stretches of a few
samples; the coupling of stretches is solved with pivots from neighbours, since recursions may grow in either direction.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.mechanics.arithmetic.simd_lanes import clear
from tripod_doe.mechanics.compilation.by_reference import ByReference
from tripod_doe.mechanics.compilation.kernels import inner_kernel

_STRETCH = 8


@dataclass(frozen=True, eq=False)
class LinearLap(ByReference):
    """The system, its solution, and memory for it."""

    # of each sample: derivatives for its unknowns (two of each roller, three loads), residual of each equation, and
    # derivatives for h, (sample, 9, 16)
    equations: FloatArray
    # by how much y differs from what the unknowns say, and derivatives of that for unknowns of the same roller (two,
    # and its load) and for its h, (sample, 6, 6)
    follows: FloatArray
    # changes, steps: solutions: changes of the unknowns, (sample, 9, 7), and of y, (sample, 6, 7), in their first
    # columns; after that come the answers to a change of h
    changes: FloatArray
    steps: FloatArray
    # across, past, following: y one and two samples ago in thirteen recursions, (12, 13), what acts of them, and the
    # next one, (6, 13)
    across: FloatArray
    past: FloatArray
    following: FloatArray
    # pair, links, starts, lap: equations of two neighbouring stretches, (24, 37), those that are solved, (stretch, 12,
    # 25), y before each stretch, (stretch, 12), and the last system, (12, 13)
    pair: FloatArray
    links: FloatArray
    starts: FloatArray
    lap: FloatArray

    @classmethod
    def for_samples(cls, samples: int) -> LinearLap:
        """Memory for a number of samples per revolution."""
        stretches = -(-samples // _STRETCH)
        return cls(
            np.zeros((samples, 9, 16)),
            np.zeros((samples, 6, 6)),
            np.zeros((samples, 9, 7)),
            np.zeros((samples, 6, 7)),
            np.zeros((12, 13)),
            np.zeros((6, 13)),
            np.zeros((6, 13)),
            np.zeros((24, 37)),
            np.zeros((stretches, 12, 25)),
            np.zeros((stretches, 12)),
            np.zeros((12, 13)),
        )


@inner_kernel
def _eliminate(matrix, count, columns):
    """Solve for `count` unknowns in place: the first columns are the system, others of them right-hand sides.

    With more rows than unknowns, the surplus rows become equations without these unknowns.
    """
    rows = matrix.shape[0]
    for i in range(count):
        pivot = i
        for row in range(i + 1, rows):
            if abs(matrix[row, i]) > abs(matrix[pivot, i]):
                pivot = row
        if pivot != i:
            for column in range(i, columns):
                matrix[i, column], matrix[pivot, column] = matrix[pivot, column], matrix[i, column]
        factor = 1.0 / matrix[i, i]
        for column in range(i + 1, columns):
            matrix[i, column] *= factor
        for row in range(i + 1, rows):
            weight = matrix[row, i]
            if weight != 0.0:
                for column in range(i + 1, columns):
                    matrix[row, column] -= weight * matrix[i, column]
    for i in range(count - 2, -1, -1):
        for row in range(i + 1, count):
            weight = matrix[i, row]
            for column in range(count, columns):
                matrix[i, column] -= weight * matrix[row, column]


@inner_kernel
def solve_samples(lap, first, last, linked):
    """Solve each sample alone, and for linked samples the sensitivity to h.

    Args:
        lap: The system, which is in `equations` and `follows`; solutions go into `changes` and `steps`.
        first, last: The samples, without the last one.
        linked: Whether samples act on later ones; if not, the solution is complete, at two thirds of the cost.
    """
    solutions = 7 if linked else 1
    for j in range(first, last):
        matrix, follows, changes, steps = lap.equations[j], lap.follows[j], lap.changes[j], lap.steps[j]
        _eliminate(matrix, 9, 9 + solutions)
        for row in range(9):
            for column in range(solutions):
                changes[row, column] = -matrix[row, 9 + column]
        for row in range(6):
            k = row // 2
            for column in range(solutions):
                steps[row, column] = follows[row, 1] * changes[2 * k, column]
                steps[row, column] += follows[row, 2] * changes[2 * k + 1, column]
                steps[row, column] += follows[row, 3] * changes[6 + k, column]
            steps[row, 0] += follows[row, 0]
            if solutions > 1:
                steps[row, 1 + 2 * k] += follows[row, 4]
                steps[row, 2 + 2 * k] += follows[row, 5]


@inner_kernel
def _cross_stretch(stretch, lap):
    """Write y at the end of a stretch as a linear function of y before it, into `lap.across`."""
    across, past, following = lap.across, lap.past, lap.following
    clear(across)
    for row in range(12):
        across[row, row] = 1.0
    for j in range(stretch * _STRETCH, min((stretch + 1) * _STRETCH, lap.steps.shape[0])):
        clear(following)
        for row in range(6):
            following[row, 12] = lap.steps[j, row, 0]
            for column in range(13):
                past[row, column] = 0.5 * across[6 + row, column] - 2.0 * across[row, column]
        for row in range(6):
            for d in range(6):
                weight = lap.steps[j, row, 1 + d]
                for column in range(13):
                    following[row, column] += weight * past[d, column]
        for row in range(6):
            for column in range(13):
                across[6 + row, column], across[row, column] = across[row, column], following[row, column]


@inner_kernel
def _fit_stretches(lap):
    """Solve for y before every stretch so that all stretches join."""
    pair, across, links, starts, stretches = lap.pair, lap.across, lap.links, lap.starts, lap.starts.shape[0]
    for stretch in range(stretches):
        _cross_stretch(stretch, lap)
        if stretch == 0:
            for row in range(12):
                for column in range(12):
                    pair[row, column], pair[row, 12 + column] = 1.0 if row == column else 0.0, -across[row, column]
                pair[row, 36] = across[row, 12]
            continue
        # columns: y before this stretch, before the first one, before the next one, right-hand side
        for row in range(12):
            for column in range(12):
                pair[12 + row, column], pair[12 + row, 12 + column] = -across[row, column], 0.0
                pair[row, 24 + column], pair[12 + row, 24 + column] = 0.0, 1.0 if row == column else 0.0
            pair[12 + row, 36] = across[row, 12]
        _eliminate(pair, starts.shape[1], pair.shape[1])
        for row in range(12):
            for column in range(25):
                links[stretch, row, column] = pair[row, 12 + column]
            for column in range(12):
                pair[row, column], pair[row, 12 + column] = pair[12 + row, 24 + column], pair[12 + row, 12 + column]
            pair[row, 36] = pair[12 + row, 36]
    for row in range(12):
        for column in range(12):
            lap.lap[row, column] = pair[row, column] + pair[row, 12 + column]
        lap.lap[row, 12] = pair[row, 36]
    _eliminate(lap.lap, starts.shape[1], lap.lap.shape[1])
    for row in range(12):
        starts[0, row] = lap.lap[row, 12]
    for stretch in range(stretches - 1, 0, -1):
        following = 0 if stretch == stretches - 1 else stretch + 1
        for row in range(12):
            total = links[stretch, row, 24]
            for column in range(12):
                total -= links[stretch, row, column] * starts[0, column]
                total -= links[stretch, row, 12 + column] * starts[following, column]
            starts[stretch, row] = total


@inner_kernel
def _follow(lap):
    """Work out the changes of all samples, into the first columns of `changes` and `steps`."""
    across = lap.across
    for j in range(lap.steps.shape[0]):
        if j % _STRETCH == 0:
            for row in range(12):
                across[row, 0] = lap.starts[j // _STRETCH, row]
        changes, steps = lap.changes[j], lap.steps[j]
        for d in range(6):
            past = 0.5 * across[6 + d, 0] - 2.0 * across[d, 0]
            for row in range(9):
                changes[row, 0] += changes[row, 1 + d] * past
            for row in range(6):
                steps[row, 0] += steps[row, 1 + d] * past
        for row in range(6):
            across[6 + row, 0], across[row, 0] = across[row, 0], steps[row, 0]


@inner_kernel
def link_samples(lap):
    """Couple the samples around the revolution, from their separate solutions and sensitivities.

    Args:
        lap: The system.
    """
    _fit_stretches(lap)
    _follow(lap)
