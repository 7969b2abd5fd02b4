"""Random scatter of the orders of a motion that is not periodic: rattling, vibration, or a transient."""

from __future__ import annotations

import numpy as np

from tripod_doe.array_types import ComplexArray, FloatArray
from tripod_doe.joint.orders import ORDERS

_IDLE = np.array([7, 8, 10, 11])
"""High orders that the three trunnions cannot excite: their amplitude is noise, which affects all orders equally."""

_MOST_ALIKE, _TINY = 0.9, 1e-300
"""Largest correlation of neighbouring parts that counts: above it, the motion is still growing."""

_FEW = 4
"""Fewest revolutions that show whether the first ones differ."""


def mean_and_chance(parts: ComplexArray, *others: ComplexArray) -> tuple[ComplexArray, FloatArray]:
    """Mean orders of revolutions that scatter, and twice the standard deviation of the amplitude of each mean.

    Two effects make a third of a revolution differ from the mean: the skews of its trunnion, equally in every
    revolution, and noise. Consecutive parts are correlated: with the correlation r of neighbours, n parts equal n (1 -
    r) / (1 + r) independent ones, as in a first-order autoregressive process. r is estimated from all orders together.
    Noise moves a complex order in any direction, its amplitude by half of that variance.

    Args:
        parts: Complex orders of revolutions that follow each other, whole ones or every third by itself, shape
            (revolution, 1 or 3, order). With one revolution, the effect of skews on its thirds is unknown, and idle
            orders (`_IDLE`) bound the scatter.
        others: Orders of other revolutions, with means of their own, for a better estimate of the scatter.
    """
    groups, places = (parts, *others), parts.shape[1]
    revolutions = sum(map(len, groups))
    by_place = sum((group - group.mean((0, 1))).sum(0) for group in groups) / revolutions if revolutions > 1 else 0.0
    apart = [(group - group.mean((0, 1)) - by_place).reshape(-1, group.shape[2]) for group in groups]
    squares = sum((np.abs(group) ** 2).sum(0) for group in apart)
    neighbours = sum(float((group[1:] * group[:-1].conj()).real.sum()) for group in apart)
    alike = min(max(neighbours / max(float(np.sum(squares)), _TINY), 0.0), _MOST_ALIKE)
    free = places * revolutions - len(groups) - (places - 1 if revolutions > 1 else 0)
    variance = squares / free * (1 + alike) / (1 - alike) * np.where(ORDERS > 0, 0.5, 1.0)
    if revolutions == 1:
        variance = np.minimum(variance, 1.5 * (np.abs(parts.mean((0, 1))[_IDLE]) ** 2).mean())
    return parts.mean((0, 1)), 2 * np.sqrt(variance / (places * len(parts)))


def swung_in(orders: ComplexArray) -> int:
    """Number of first revolutions, up to half of all, in which the transient from the start still matters.

    Marginal standard error rule: dropping them minimises the variance of the rest over their number. Source:
    K. P. White, An effective truncation heuristic for bias reduction in simulation output, Simulation 69 (1997) 323.

    Args:
        orders: Complex orders of revolutions that follow each other, each over the error that it may have, shape
            (revolution, order).
    """
    count = len(orders)
    if count < _FEW:
        return 0
    left = [orders[dropped:] for dropped in range(count // 2 + 1)]
    return int(np.argmin([kept.var(axis=0).sum() / len(kept) for kept in left]))
