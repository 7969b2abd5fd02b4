"""How large the errors of the model are in the records of one joint, over what is on record for similar points.

What is on record is a median over other joints. The errors of one joint may be a few times smaller or larger, and its
own records say so, as a fit leaves them over: a factor on all errors of the model is estimated by restricted maximum
likelihood (Patterson and Thompson 1971), with what the record says of it as a prior. How well the records determine it
gives the degrees of freedom of Student's distribution for the intervals (Satterthwaite 1946).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.fit.identifiability import covariance_of
from tripod_doe.analyses.fit.least_squares import Descent
from tripod_doe.analyses.fit.misfit import Misfit, Rows
from tripod_doe.array_types import FloatArray

_SPREAD = 0.7
"""Deviation of the logarithm of the factor before. Of the 163 points of the record beside `needles`, each by the ten
most like it, errors of `kinetostatic` scatter as normal ones whose deviations scatter by this (quartiles 0.64, upper
tenth 0.64, upper twentieth 0.74)."""

_LEAST, _MOST = np.log(0.02), np.log(50.0)
_STEP = 0.3  # of the logarithm, for the curvature of the likelihood and the change of variances
_FEWEST = 3.0  # degrees of freedom: fewer would come from a curvature that is hardly known


@dataclass(frozen=True)
class ErrorSize:
    """Size of the model's errors in the records of a fit."""

    factor: float = 1.0  # on the errors of the model on record
    freedom: float = np.inf  # degrees of freedom with which it is known, of the unknown that it matters to the most


def estimate_error_size(
    rows: Rows, used: NDArray[np.bool_], prior: tuple[FloatArray, FloatArray], best: Descent
) -> ErrorSize:
    """Estimate the factor at a minimum.

    Args:
        rows: Measured orders with the errors on record.
        used, prior: See `Misfit`.
        best: The minimum, with its derivatives.
    """
    from scipy.optimize import minimize_scalar

    if not (rows.own_error.any() or rows.shared.any()):
        return ErrorSize()

    def misfit(size: float) -> Misfit:
        return Misfit(rows.with_errors_times(float(np.exp(size))), used, prior)

    def cost(size: float) -> float:
        return misfit(size).restricted_cost(best.prediction, best.place, best.slope) + (size / _SPREAD) ** 2

    def variances(size: float) -> FloatArray:
        own = misfit(size)
        return np.diag(covariance_of(own.jacobian(own.compare(best.prediction, best.place), best.slope)))

    found = minimize_scalar(cost, bounds=(_LEAST, _MOST), method="bounded", options={"xatol": 0.02})
    size = float(found.x)
    curvature = (cost(size - _STEP) - 2 * float(found.fun) + cost(size + _STEP)) / _STEP**2
    variance = 2 / max(curvature, 2 / _SPREAD**2)
    change = np.log(variances(size + _STEP) / variances(size - _STEP)) / (2 * _STEP)
    freedom = 2 / max(float((change**2).max()) * variance, 1e-9)
    return ErrorSize(float(np.exp(size)), max(freedom, _FEWEST))
