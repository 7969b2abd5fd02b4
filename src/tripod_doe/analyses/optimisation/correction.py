"""Correction of one model by another: a Gaussian process of their difference, from few candidates."""

import warnings
from dataclasses import replace

import numpy as np

from tripod_doe.analyses.optimisation.front import Archive
from tripod_doe.analyses.optimisation.measures import Judged
from tripod_doe.array_types import FloatArray, IntArray

_FEWEST = 4  # candidates from which on the difference is a process, and not its mean


def corrected(archive: Archive, rows: IntArray, fine: Judged) -> Judged:
    """All candidates of a search as the better model would judge them.

    Args:
        rows: Those that the better model judged, too.
        fine: Its judgement, in the order of `rows`.

    Returns:
        Of candidates that were judged its own judgement, of the others that of the search with the predicted
        difference; reasons follow from the corrected violations.
    """
    own = archive.judged
    objectives = _shifted(archive.units, own.objectives, rows, fine.objectives)
    violations = _shifted(archive.units, own.violations, rows, fine.violations)
    reasons = list(own.reasons)
    for at in range(len(reasons)):
        broken = not np.isfinite(own.objectives[at]).all()
        if not broken:
            reasons[at] = (
                "" if (violations[at] <= 0).all() else own.reasons[at] or "a limit, as the correction predicts"
            )
    for at, row in enumerate(rows.tolist()):
        reasons[row] = fine.reasons[at]
    return replace(own, objectives=objectives, violations=violations, reasons=reasons)


def _shifted(units: FloatArray, values: FloatArray, rows: IntArray, fine: FloatArray) -> FloatArray:
    """Values of the search with the difference that the better model makes, shape (candidate, quantity)."""
    moved = values.copy()
    for at in range(values.shape[1]):
        difference = fine[:, at] - values[rows, at]
        known = np.isfinite(difference)
        if not known.any():
            continue
        moved[:, at] += _predicted(units[rows[known]], difference[known], units)
        moved[rows[known], at] = fine[known, at]
    return moved


def _predicted(places: FloatArray, difference: FloatArray, units: FloatArray) -> FloatArray:
    """The difference at all candidates, shape (candidate,)."""
    spread = float(np.ptp(difference))
    if len(difference) < _FEWEST or spread == 0:
        return np.full(len(units), difference.mean())
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, WhiteKernel

    kernel = RBF(1.0, (0.1, 10.0)) + WhiteKernel(1e-3, (1e-6, 1.0))
    process = GaussianProcessRegressor(kernel, normalize_y=True, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a length at its bound: the difference is even, or rough
        process.fit(places, difference)
    predicted = process.predict(units)
    # not further than the differences that were seen
    return np.asarray(np.clip(predicted, difference.min() - spread, difference.max() + spread))
