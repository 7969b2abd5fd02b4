"""Whitened differences of measured and predicted orders, with nuisance parameters solved for and projected out.

A residual is the difference of two complex amplitudes over its standard deviation, along the measured one and across
it. Nuisances of a record are the angle of its marker and, if it is not known, the sign of the force; nuisances of all
records are errors of the model that they share, and the scale of the force sensor, with what is known of them before.
For each prediction the nuisances take their best values (variable projection, Golub and Pereyra 1973).
"""

from copy import copy
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from tripod_doe.array_types import ComplexArray, FloatArray, IntArray

_LEAST_CHANGE = 1e-3  # of the largest, below which a shared error is none
_TINY = 1e-12  # added where a column has no information
_ROUNDS = 3  # of Gauss-Newton on the angles, which start at most some degrees off


@dataclass(frozen=True)
class Rows:
    """Measured orders, one row an order of a record."""

    record: IntArray  # number of the record, shape (row,)
    order: IntArray  # rotating order, shape (row,)
    measured: ComplexArray  # complex amplitudes, shape (row,)
    # along, across: standard deviations of a measured amplitude along itself and at right angles to it, shape (row,);
    # across is infinite where only the real part counts
    along: FloatArray
    across: FloatArray
    # errors of the model, N, see `ModelError`: in this row alone, with any phase and more across, shape (2, row); and
    # changes of the prediction by errors that records share, shape (row, nuisance) each
    own_error: FloatArray
    shared: ComplexArray
    turning: FloatArray
    free_phase: NDArray[np.bool_]  # whether the angle of the marker is not known, shape (record,)
    free_sign: NDArray[np.bool_]  # whether the sign of the force is not known, shape (record,)
    scale_error: float = 0.0  # relative deviation of the force sensor's scale
    one_sign: bool = False  # whether signs that are not known are the same, as of one sensor

    @property
    def records(self) -> int:
        """Number of records."""
        return self.free_phase.size

    def with_errors_times(self, factor: FloatArray) -> Self:
        """The same orders with other errors of the model, by factors: with any phase, and more across, (2, row)."""
        shared, turning = factor[0][:, None] * self.shared, factor[1][:, None] * self.turning
        return replace(self, own_error=factor * self.own_error, shared=shared, turning=turning)


@dataclass(frozen=True)
class Compared:
    """Residuals of a prediction at the best values of the nuisances."""

    residual: FloatArray  # whitened; rows, then shared nuisances with their sign reversed, then priors
    aligned: ComplexArray  # the prediction as the record would show it, shape (row,)
    turn: ComplexArray  # by which predictions are multiplied for that, shape (row,)
    chi2: FloatArray  # sum of squares of each record, shape (record,)
    nuisances: FloatArray  # orthonormal basis of what nuisances can do to the residuals, shape (residual, nuisance)


class Misfit:
    """Residuals of predictions, and their derivatives.

    Args:
        used: Which records count, shape (record,).
        prior: Expected places of the scalars and their deviations, shape (scalar,) each.
    """

    def __init__(self, rows: Rows, used: NDArray[np.bool_], prior: tuple[FloatArray, FloatArray]) -> None:
        self.rows, self.used = rows, used
        self._mean, self._std = prior
        size = np.abs(rows.measured)
        self._unit = np.where(size > 0, rows.measured / np.where(size > 0, size, 1), 1.0 + 0j)
        counts = used[rows.record]
        along = np.hypot(rows.along, rows.own_error[0])
        across = np.hypot(np.hypot(rows.across, rows.own_error[0]), rows.own_error[1])
        deviations = np.stack([along, across])
        self._weights = np.where(counts, 1 / deviations, 0.0).ravel()
        self._size = size
        self._changes, self._turning = _independent(rows.shared), _independent(rows.turning)
        self.data = int((self._weights > 0).sum())
        self._angles = np.flatnonzero(rows.free_phase & used)
        column = np.full(rows.records, -1)
        column[self._angles] = np.arange(self._angles.size)
        turned = np.flatnonzero(column[rows.record] >= 0)
        self._turned = turned, column[rows.record][turned]  # rows with a free angle, and the column of each
        third = np.where(rows.order == 3, np.inf, size)
        one_sign = rows.one_sign and rows.free_sign.any()
        self._signs: list[tuple[float, ...]] = [(1.0,), (-1.0,)] if one_sign else [(1.0, -1.0)]
        self._by = np.array(
            [max(np.flatnonzero(rows.record == r), key=lambda at: third[at]) for r in range(rows.records)]
        )

    def of_each_sign(self) -> list[Self]:
        """The same with each sign alone, where records share one that is not known."""
        parts = [copy(self) for _ in self._signs]
        for part, own in zip(parts, self._signs, strict=True):
            part._signs = [own]
        return parts

    @property
    def free(self) -> int:
        """Degrees of freedom that nuisances without prior take."""
        return int(self._angles.size)

    @property
    def expected(self) -> int:
        """Number of scalars of which something is known before: each counts like a measured value."""
        return int(np.isfinite(self._std).sum())

    @property
    def _nuisances(self) -> int:
        """Shared nuisances: two factors of each error with any phase, one of others, and the sensor's scale."""
        return 2 * int(self._changes.shape[1]) + int(self._turning.shape[1]) + bool(self.rows.scale_error)

    def _shared_columns(self, turn: ComplexArray) -> FloatArray:
        """Changes of the whitened prediction by shared nuisances of deviation 1, shape (residual, nuisance)."""
        aligned = turn[:, None] * self._changes
        turned = 1j * self._unit[:, None] * self._turning
        scale = (self.rows.scale_error * self._size * self._unit)[:, None]
        return self._whitened(np.hstack([aligned, 1j * aligned, turned, scale][: 4 if self.rows.scale_error else 3]))

    def _whitened(self, values: ComplexArray) -> FloatArray:
        """Complex differences (row, ...) as whitened numbers, shape (2 rows, ...)."""
        turned = (values.T * np.conj(self._unit)).T
        parts = np.concatenate([turned.real, turned.imag])
        return np.asarray((parts.T * self._weights).T, float)

    def compare(self, prediction: ComplexArray, place: FloatArray) -> Compared:
        """Residuals of a prediction (row,) made at some places (scalar,), with the sign that fits best."""
        tried = [self._compare(prediction, place, each) for each in self._signs]
        return min(tried, key=lambda each: float(each.residual @ each.residual))

    def _compare(self, prediction: ComplexArray, place: FloatArray, signs: tuple[float, ...]) -> Compared:
        rows = self.rows
        sign, angle = self._begin(prediction, signs)
        beta, free = np.zeros(self._nuisances), self._angles.size
        for rounds_left in range(_ROUNDS if free else 1, -1, -1):
            turn = sign[rows.record] * np.exp(1j * rows.order * angle[rows.record])
            shared = self._shared_columns(turn)
            data = self._whitened(rows.measured - turn * prediction) - shared @ beta
            if not rounds_left:
                break
            basis, triangle = _orthonormal(self._columns(turn * prediction, shared))
            step = solve_triangular(triangle, basis.T @ np.concatenate([data, -beta]), check_finite=False)
            angle[self._angles] += step[:free]
            beta = beta + step[free:]
        known = np.isfinite(self._std)
        prior = ((place - self._mean) / self._std)[known]
        basis = np.vstack([basis, np.zeros((prior.size, basis.shape[1]))])
        squares = data[: rows.record.size] ** 2 + data[rows.record.size :] ** 2
        chi2 = np.bincount(rows.record, squares, rows.records).astype(float)
        aligned = turn * prediction
        return Compared(np.concatenate([data, -beta, prior]), aligned, turn, chi2, basis)

    def jacobian(self, compared: Compared, slope: ComplexArray) -> FloatArray:
        """Derivatives of the residuals by the scalars, nuisances projected out, shape (residual, scalar).

        Args:
            slope: Its derivatives, shape (row, scalar).
        """
        data = -self._whitened((compared.turn * slope.T).T)
        known = np.flatnonzero(np.isfinite(self._std))
        prior = np.zeros((known.size, slope.shape[1]))
        prior[np.arange(known.size), known] = 1 / self._std[known]
        full = np.vstack([data, np.zeros((self._nuisances, slope.shape[1])), prior])
        return np.asarray(full - compared.nuisances @ (compared.nuisances.T @ full), float)

    def restricted_cost(self, prediction: ComplexArray, place: FloatArray, slope: ComplexArray) -> float:
        """Minus twice the logarithm of the restricted likelihood of the deviations, at the nearest minimum.

        What scalars and free angles can explain says nothing about the deviations (Patterson and Thompson 1971).
        Scalars take the places that are best for these deviations, by the derivatives.
        """
        compared = self.compare(prediction, place)
        jacobian = self.jacobian(compared, slope)
        left = compared.residual - jacobian @ np.linalg.lstsq(jacobian, compared.residual, rcond=None)[0]
        nuisances = np.linalg.qr(self._columns(compared.aligned, self._shared_columns(compared.turn)), "r")
        volume = sum(
            2 * np.log(np.abs(np.diag(triangle)) + _TINY).sum() for triangle in (nuisances, np.linalg.qr(jacobian, "r"))
        )
        return float(left @ left + volume - 2 * np.log(self._weights[self._weights > 0]).sum())

    def _columns(self, aligned: ComplexArray, shared: FloatArray) -> FloatArray:
        """Derivatives of the residuals without priors, sign reversed, by free angles and shared nuisances."""
        turned = np.zeros((aligned.size, self._angles.size), complex)
        turned[self._turned] = (1j * self.rows.order * aligned)[self._turned[0]]
        columns = np.hstack([self._whitened(turned), shared])
        return np.vstack([columns, np.eye(columns.shape[1])[self._angles.size :]])

    def _begin(self, prediction: ComplexArray, signs: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
        """Signs and angles of the records, from the best of all alignments of one order of each record.

        Where the sign of a record is not known, it is the best one of `signs`.
        A record is aligned by its third order, which is fitted in most cases, else by its largest one; k turns of
        360/k deg fit an order k alike.
        """
        rows, by = self.rows, self._by
        record, least = rows.record, np.full(rows.records, np.inf)
        sign, angle = np.ones(rows.records), np.zeros(rows.records)
        order = rows.order[by]
        for tried in signs if rows.free_sign.any() else (1.0,):
            own_sign = np.where(rows.free_sign, tried, 1.0)
            first = np.angle(rows.measured[by] * np.conj(own_sign * prediction[by])) / order
            for turn in range(int(order[rows.free_phase].max(initial=1))):
                own = np.where(rows.free_phase, first + 2 * np.pi * turn / order, 0.0)
                away = rows.measured - own_sign[record] * np.exp(1j * rows.order * own[record]) * prediction
                part = self._whitened(away) ** 2
                squares = np.bincount(record, part[: record.size] + part[record.size :], rows.records)
                better = (squares < least) & (turn < np.where(rows.free_phase, order, 1))
                sign, angle, least = (
                    np.where(better, new, old) for new, old in ((own_sign, sign), (own, angle), (squares, least))
                )
        return sign, angle


def _independent(shared: Any) -> Any:
    """The fewest changes that have the same covariance: no more than rows."""
    size, directions = np.linalg.eigh(shared @ shared.conj().T)
    kept = size > _LEAST_CHANGE**2 * size.max(initial=0.0)
    return directions[:, kept] * np.sqrt(size[kept])


def _orthonormal(columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Orthonormal columns and the upper triangle by which they give these columns.

    By the Cholesky factor of their products: with a little on its diagonal, columns without information have one, too.
    """
    products = columns.T @ columns
    products[np.diag_indices_from(products)] += _TINY * products.diagonal().max(initial=1.0)
    triangle = np.asarray(np.linalg.cholesky(products).T, float)
    return np.asarray(solve_triangular(triangle, columns.T, trans="T", check_finite=False).T, float), triangle
