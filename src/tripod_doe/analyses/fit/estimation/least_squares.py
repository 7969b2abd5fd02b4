"""Bounded least squares from several starting points, with few evaluations of an expensive model.

SciPy's trust-region reflective method does the steps. Derivatives are differences at the start of a descent, and are
corrected by every further evaluation (Broyden 1965, for sparse derivatives Schubert 1970): a step then costs one point
a record in place of one a record and unknown. Where such a descent ends, differences are taken again, and it goes on
from there until they change nothing.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.fit.estimation.misfit import Compared, Misfit
from tripod_doe.analyses.fit.estimation.unknowns import Layout
from tripod_doe.array_types import ComplexArray, FloatArray

Predict = Callable[[FloatArray], ComplexArray]
"""Orders (trial, row) from places (trial, scalar); NaN in all rows of a record whose point failed."""

_STEP = 0.01  # of a range, for differences: above the noise of a solved balance, below its curvature
_SMALLEST_STEP = 1e-5  # in places, from which on an evaluation corrects derivatives
_ROUNDS = 4  # descents from new differences
_GAIN = 0.02  # of chi squared: a descent that gains less has arrived; a 95 % interval ends at 3.84
_FTOL, _XTOL, _GTOL, _EVALUATIONS = 3e-4, 1e-5, 1e-15, 25  # a gradient of zero gives SciPy no step
_APART = 0.5  # from zero to the lower bounds: SciPy's first step is as long as its variables are large
_SAME = 0.02  # places nearer than this are one minimum


@dataclass(frozen=True)
class Descent:
    """The end of a descent."""

    place: FloatArray  # shape (scalar,)
    prediction: ComplexArray  # shape (row,)
    slope: ComplexArray  # derivatives of the prediction by the places, shape (row, scalar)
    cost: float  # chi squared; with a robust loss the sum of losses


class Problem:
    """Predictions of a model compared with measured orders.

    Args:
        loss: Largest chi squared of a record that counts in full; the loss of a larger one grows with its root (Huber),
            so that a bad record does not pull the fit. Infinite for least squares.
    """

    def __init__(self, layout: Layout, misfit: Misfit, predict: Predict, loss: float = np.inf) -> None:
        self.layout, self.misfit, self.predict, self.loss = layout, misfit, predict, loss
        rows = misfit.rows
        self._record = np.concatenate([rows.record, rows.record])
        self._touched = layout.touched[rows.record]

    def cost(self, prediction: ComplexArray, place: FloatArray) -> float:
        """Chi squared of a prediction, or the sum of losses; infinite where a point failed."""
        return self._cost_of(self.compare(prediction, place)) if self.is_whole(prediction) else np.inf

    def _cost_of(self, compared: Compared) -> float:
        rest = compared.residual[self._record.size :]
        return float(self._losses(compared.chi2)[0].sum() + rest @ rest)

    def is_whole(self, prediction: ComplexArray) -> bool:
        """Whether all records that count have an answer."""
        return bool(np.isfinite(prediction[self.misfit.used[self.misfit.rows.record]]).all())

    def compare(self, prediction: ComplexArray, place: FloatArray) -> Compared:
        """See `Misfit.compare`; rows without an answer count for nothing."""
        return self.misfit.compare(prediction, place)

    def _losses(self, chi2: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Loss of each record, and its derivative by chi squared."""
        far = chi2 > self.loss
        root = np.sqrt(np.where(far, chi2, 1.0))
        edge = np.sqrt(self.loss) if far.any() else 0.0
        return np.where(far, 2 * edge * root - edge**2, chi2), np.where(far, edge / root, 1.0)

    def scipy_loss(self, squares: FloatArray) -> FloatArray:
        """Losses in the form of `scipy.optimize.least_squares`, record by record."""
        rho = np.stack([squares, np.ones_like(squares), np.zeros_like(squares)])
        own = squares[: self._record.size]
        chi2 = np.bincount(self._record, own, self.misfit.rows.records).astype(float)
        loss, slope = self._losses(chi2)
        rho[0, : own.size] *= (loss / np.where(chi2 > 0, chi2, 1))[self._record]
        rho[1, : own.size] = slope[self._record]
        return rho

    def slopes(self, place: FloatArray, prediction: ComplexArray) -> ComplexArray:
        """Derivatives of the prediction by differences, shape (row, scalar); zero where no neighbour has an answer.

        All scalars of an unknown take their step together, since each touches records of its own.
        """
        owner, count = self.layout.owner, len(self.layout.unknowns)
        step = np.where(place > 0.5, -_STEP, _STEP)
        trials = place + step * (owner == np.arange(count)[:, None])
        answers = self.predict(trials)
        failed = np.array([not self.is_whole(answer) for answer in answers])
        if failed.any():
            back = self.predict(place - step * (owner == np.flatnonzero(failed)[:, None]))
            answers[failed] = np.where(np.isfinite(answers[failed]), answers[failed], 2 * prediction - back)
        change = np.nan_to_num((answers - prediction)[owner].T)  # (row, scalar)
        return np.asarray(np.where(self._touched, change, 0.0) / step, complex)

    def corrected(self, slope: ComplexArray, step: FloatArray, change: ComplexArray) -> ComplexArray:
        """Derivatives that explain what a step changed, otherwise as they were."""
        own = np.where(self._touched, step, 0.0)
        length = (own**2).sum(axis=1)
        there = length > _SMALLEST_STEP**2
        missed = np.where(there, change - slope @ step, 0.0)
        scaled = np.where(there, missed / np.where(there, length, 1.0), 0.0)
        return np.asarray(slope + np.nan_to_num(scaled)[:, None] * own, complex)

    def begin(self, place: FloatArray) -> Descent | None:
        """The state at some places, without derivatives; None where a point fails."""
        prediction = self.predict(place[None])[0]
        cost = self.cost(prediction, place)
        if not np.isfinite(cost):
            return None
        return Descent(place, prediction, np.zeros((prediction.size, place.size), complex), cost)

    def descend(self, start: Descent) -> Descent:
        """Go down from a state to the nearest minimum, with new differences until they gain nothing more."""
        free, here = np.ones(self.layout.count, bool), start
        for _ in range(_ROUNDS):
            here = replace(here, slope=self.slopes(here.place, here.prediction))
            before, here = here, self.slide(here, free)
            if before.cost - here.cost < _GAIN * max(1.0, here.cost / max(self.misfit.data, 1)):
                break
        return here

    def slide(self, start: Descent, free: NDArray[np.bool_], ftol: float = _FTOL) -> Descent:
        """Go down from a state with its derivatives, which evaluations correct; scalars that are not free stay."""
        from scipy.optimize import least_squares

        if not free.any():
            return start
        here = start
        first = self.compare(start.prediction, start.place)
        inside = _APART + np.clip(start.place[free], 1e-9, 1 - 1e-9)
        seen: dict[bytes, tuple[ComplexArray, Compared | None]] = {inside.tobytes(): (start.prediction, first)}

        def whole(part: FloatArray) -> FloatArray:
            place = start.place.copy()
            place[free] = part - _APART
            return place

        def residual(part: FloatArray) -> FloatArray:
            if (key := part.tobytes()) not in seen:
                place = whole(part)
                prediction = self.predict(place[None])[0]
                seen[key] = prediction, self.compare(prediction, place) if self.is_whole(prediction) else None
            compared = seen[key][1]
            return np.full(first.residual.size, np.nan) if compared is None else compared.residual

        def jacobian(part: FloatArray) -> FloatArray:
            nonlocal here
            place, (prediction, compared) = whole(part), seen[part.tobytes()]
            assert compared is not None  # a step to where points fail is not taken
            slope = self.corrected(here.slope, place - here.place, prediction - here.prediction)
            here = Descent(place, prediction, slope, self._cost_of(compared))
            return self.misfit.jacobian(compared, slope)[:, free]

        least_squares(
            residual,
            inside,
            jacobian,
            bounds=(_APART, _APART + 1),
            loss=self.scipy_loss if np.isfinite(self.loss) else "linear",
            ftol=ftol,
            xtol=_XTOL,
            gtol=_GTOL,
            max_nfev=_EVALUATIONS,
        )
        return here if here.cost <= start.cost else start

    def minima(self, starts: int, seed: int) -> list[Descent]:
        """Descend from the best of many places; the minima by growing cost."""
        from scipy.stats import qmc

        width = self.layout.count
        many = 2 ** int(np.ceil(np.log2(4 * starts)))
        places = np.vstack([np.full(width, 0.5), qmc.Sobol(width, seed=seed).random(many)])
        answers = self.predict(places)
        costs = np.array([self.cost(answer, place) for answer, place in zip(answers, places, strict=True)])
        order = [at for at in np.argsort(costs) if np.isfinite(costs[at])][:starts]
        zero = np.zeros((answers.shape[1], width), complex)
        return distinct([self.descend(Descent(places[at], answers[at], zero, float(costs[at]))) for at in order])


def distinct(descents: list[Descent]) -> list[Descent]:
    """Minima by growing cost, each place once."""
    kept: list[Descent] = []
    for each in sorted(descents, key=lambda descent: descent.cost):
        if not any(is_same(each, other) for other in kept):
            kept.append(each)
    return kept


def is_same(one: Descent, other: Descent) -> bool:
    """Whether both are one minimum."""
    return bool(np.abs(one.place - other.place).max() <= _SAME)
