"""Correction of one model by another: a Gaussian process of their difference, from few candidates."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from tripod_doe.analyses.optimisation.measures import Judged
from tripod_doe.analyses.optimisation.pareto_front import Archive
from tripod_doe.array_types import FloatArray, IntArray

_FEWEST = 4  # candidates from which on the difference is a process, and not its mean

# candidates on the unit cube -> the difference and its standard error, shape (candidate,) each
_Difference = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


@dataclass(frozen=True)
class Correction:
    """What a better model changes in the judgement of a search.

    Args:
        rows: Candidates of an archive that the better model judged, too.
        fine: Its judgement, in the order of `rows`.
        objectives, violations: The difference that it makes, one of each objective and constraint.
    """

    rows: IntArray
    fine: Judged
    objectives: list[_Difference]
    violations: list[_Difference]

    @classmethod
    def of(cls, archive: Archive, rows: IntArray, fine: Judged) -> Correction:
        """Learn the difference from the candidates that both models judged."""
        own, places = archive.judged.take(rows), archive.units[rows]
        both = ((fine.objectives, own.objectives), (fine.violations, own.violations))
        learned = [[_learned(places, change) for change in (better - coarse).T] for better, coarse in both]
        return cls(rows, fine, *learned)

    def __call__(self, archive: Archive) -> Judged:
        """All candidates of the archive, and of what was added to it, as the better model would judge them."""
        return self.at(np.arange(len(archive.units)), archive.units, archive.judged)

    def at(self, rows: IntArray, units: FloatArray, own: Judged) -> Judged:
        """Some candidates as the better model would judge them.

        Args:
            rows: Their rows in the archive.
            units: On the unit cube, shape (candidate, variable).
            own: As the search judges them.

        Returns:
            Of candidates that the confirming model judged, its judgement; of the others the judgement of the search
            with the predicted difference, and for violations its standard error too: judging one in vain costs more
            than a limit that is not quite used up. Reasons follow from the corrected violations.
        """
        objectives, _ = _shifted(units, own.objectives, self.objectives)
        violations = np.sum(_shifted(units, own.violations, self.violations), axis=0)
        reasons = list(own.reasons)
        for at in np.flatnonzero(np.isfinite(own.objectives).all(axis=1)).tolist():
            is_kept = (violations[at] <= 0).all()
            reasons[at] = "" if is_kept else own.reasons[at] or "a limit, as the correction predicts"
        places = {row: at for at, row in enumerate(self.rows.tolist())}
        for at, row in enumerate(rows.tolist()):
            if row in places:
                _take_known(objectives[at], self.fine.objectives[places[row]])
                _take_known(violations[at], self.fine.violations[places[row]])
                reasons[at] = self.fine.reasons[places[row]]
        return replace(own, objectives=objectives, violations=violations, reasons=reasons)


def _take_known(values: FloatArray, better: FloatArray) -> None:
    """Put in what the better model says where it says something."""
    np.copyto(values, better, where=np.isfinite(better))


def _shifted(units: FloatArray, values: FloatArray, differences: list[_Difference]) -> tuple[FloatArray, FloatArray]:
    """Values of the search with the differences, and the standard errors of these, shape (candidate, quantity) each."""
    if not differences:
        return values.copy(), np.zeros_like(values)
    means, errors = zip(*(each(units) for each in differences), strict=True)
    return values + np.stack(means, axis=1), np.stack(errors, axis=1)


def _learned(places: FloatArray, difference: FloatArray) -> _Difference:
    """The difference at any candidates, from those at which it is known; nothing where it is known at none.

    Args:
        places: Candidates on the unit cube, shape (candidate, variable).
        difference: Shape (candidate,); NaN where it is not known.
    """
    known = np.isfinite(difference)
    places, difference = places[known], difference[known]
    spread = float(np.ptp(difference)) if known.any() else 0.0
    if len(difference) < _FEWEST or spread == 0:
        mean = float(difference.mean()) if known.any() else 0.0
        return lambda units: (np.full(len(units), mean), np.full(len(units), spread))
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, WhiteKernel

    kernel = RBF(1.0, (0.1, 10.0)) + WhiteKernel(1e-3, (1e-6, 1.0))
    process = GaussianProcessRegressor(kernel, normalize_y=True, random_state=0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a length at its bound: the difference is even, or rough
        process.fit(places, difference)
    low, high = difference.min() - spread, difference.max() + spread  # not further than the differences that were seen

    def predicted(units: FloatArray) -> tuple[FloatArray, FloatArray]:
        mean, error = process.predict(units, return_std=True)
        return np.clip(mean, low, high), np.minimum(error, spread)

    return predicted
