"""How large the errors of the model are in the records of one joint, over what is on record for similar points.

What is on record is typical of other joints. The errors of one joint may be a few times smaller or larger, those of one
order by another factor than those of another, and its own records say so, as a fit leaves them over: a factor on the
errors of each order is estimated by restricted maximum likelihood (Patterson and Thompson 1971), with what the record
says of it as a prior, and another on what phases err by more than amplitudes: errors along and across have different
sizes in one joint. How well the records determine these factors gives the degrees of freedom of Student's
distribution for the intervals (Satterthwaite 1946).
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.fit.estimation.identifiability import known_variances
from tripod_doe.analyses.fit.estimation.least_squares import Descent
from tripod_doe.analyses.fit.estimation.misfit import Misfit, Rows
from tripod_doe.array_types import FloatArray

_SPREAD = 0.7
"""Deviation of the logarithm of a factor before. Of the 163 recorded points with `needles`, each by the ten most like
it, errors of `kinetostatic` scatter as normal ones whose deviations scatter by this (quartiles 0.64, upper
tenth 0.64, upper twentieth 0.74)."""

_ALONE = (2, 3)  # orders whose errors have a factor of their own; all others have one together
_LEAST, _MOST = np.log(0.02), np.log(50.0)
_NEAR = 0.02  # of the logarithm and of the cost: the search for the best sizes ends
_STEP = 0.3  # of the logarithm, for the curvature of the likelihood and the change of variances
_FEWEST = 3.0  # degrees of freedom: fewer would come from a curvature that is hardly known


@dataclass(frozen=True)
class ErrorSize:
    """Size of the model's errors in the records of a fit."""

    factors: Mapping[int, float] = field(default_factory=dict)  # on the errors on record, of each order
    phases: float = 1.0  # on what phases err by more than amplitudes
    freedom: float = np.inf  # degrees of freedom with which they are known, of the unknown that they matter to the most

    def of(self, orders: Iterable[int]) -> FloatArray:
        """Factors of some orders, 1 where none was estimated, and of their phases, shape (2, order)."""
        own = np.array([self.factors.get(int(order), 1.0) for order in orders])
        return np.stack([own, np.full(own.size, self.phases)])


def estimate_error_size(
    rows: Rows, used: NDArray[np.bool_], prior: tuple[FloatArray, FloatArray], best: Descent
) -> ErrorSize:
    """Estimate the factors at a minimum.

    Args:
        rows: Measured orders with the errors on record.
        used, prior: See `Misfit`.
        best: The minimum, with its derivatives.
    """
    from scipy.optimize import minimize

    wrong = (rows.own_error > 0).any(axis=0) | (rows.shared != 0).any(axis=1)
    orders = np.unique(rows.order[wrong & used[rows.record]]).tolist()
    groups = [[order] for order in orders if order in _ALONE]
    groups += [others] if (others := [order for order in orders if order not in _ALONE]) else []
    if not groups:
        return ErrorSize()

    def size_of(sizes: FloatArray) -> ErrorSize:
        factors = np.exp(sizes).tolist()
        by_order = {order: factor for group, factor in zip(groups, factors, strict=False) for order in group}
        return ErrorSize(by_order, *factors[len(groups) :])

    def misfit(sizes: FloatArray) -> Misfit:
        return Misfit(rows.with_errors_times(size_of(sizes).of(rows.order)), used, prior)

    def cost(sizes: FloatArray) -> float:
        return _improbability(misfit(sizes), best, sizes)

    def variances(sizes: FloatArray) -> FloatArray:
        own = misfit(sizes)
        return known_variances(own.jacobian(own.compare(best.prediction, best.place), best.slope))

    aligned = used & ~rows.free_phase  # records whose phases are known
    count = len(groups) + bool(rows.turning[aligned[rows.record]].any())
    steps = _STEP * np.eye(count)
    options = {"xatol": _NEAR, "fatol": _NEAR, "initial_simplex": np.vstack([np.zeros(count), 2 * steps])}
    bounds = [(_LEAST, _MOST)] * count
    sizes = minimize(cost, np.zeros(count), method="Nelder-Mead", bounds=bounds, options=options).x
    change = np.array([np.log(variances(sizes + step) / variances(sizes - step)) for step in steps]) / (2 * _STEP)
    spread = _spread_of_sizes(np.array([[_curvature(cost, sizes, one, other) for one in steps] for other in steps]))
    doubt = np.einsum("ks,kl,ls->s", change, spread, change)  # variance of the logarithm of each scalar's variance
    return replace(size_of(sizes), freedom=max(2 / max(float(doubt.max()), 1e-9), _FEWEST))


def improbability(misfit: Misfit, best: Descent, size: ErrorSize) -> float:
    """Minus twice the logarithm of the restricted likelihood of these sizes, but for a constant.

    Args:
        misfit: With errors of these sizes.
        best: A minimum, with its derivatives.
    """
    groups = {order if order in _ALONE else 0: factor for order, factor in size.factors.items()}
    return _improbability(misfit, best, np.log([*groups.values(), size.phases]))


def _improbability(misfit: Misfit, best: Descent, sizes: FloatArray) -> float:
    restricted = misfit.restricted_cost(best.prediction, best.place, best.slope)
    return restricted + float(((sizes / _SPREAD) ** 2).sum())


def _curvature(cost: Callable[[FloatArray], float], at: FloatArray, one: FloatArray, other: FloatArray) -> float:
    """Second derivative by two steps."""
    corners = cost(at + one + other) - cost(at + one - other) - cost(at - one + other) + cost(at - one - other)
    return corners / (4 * _STEP**2)


def _spread_of_sizes(curvature: FloatArray) -> FloatArray:
    """Covariance of the sizes from the curvature of minus twice the logarithm of their likelihood.

    The prior alone curves it by 2 over its variance; less would come from differences that are no parabola.
    """
    values, directions = np.linalg.eigh(curvature)
    return np.asarray((directions * (2 / np.maximum(values, 2 / _SPREAD**2))) @ directions.T, float)
