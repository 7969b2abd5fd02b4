"""Effect of a factor from a regression on all factors, if no two points differ in this factor alone.

The response is described by a sum of one function per factor; what that leaves, interactions among them, is scatter.
Its size decides how far an effect is known.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from tripod_doe.analyses.encoding import Column, encoded, inputs_of, is_numeric
from tripod_doe.analyses.main_effects.curve_shape import Shape, curve_shapes
from tripod_doe.array_types import FloatArray, IntArray

_SHARED = 0.5  # share of the variance of a factor's column that others may explain: its interval is 1.4 times as wide
_POINTS_PER_COLUMN = 3
# Powers of the factor itself: with two, a rise of 0.97 reads 0.85 (log x over x from 1 to 10). Of 11 courses over the
# logarithm (x, 1/x, log x, |log x|, x^2, bends, steps), intervals of 95 % hold in 31 to 51 % with two, in 78 to 92 %
# with four, and in 95 to 97 % with six.
_OWN_POWERS = (4, 6)  # at least, and if there are enough points
_POWERS = 2  # of other factors
_CLASSES = 10  # most classes of a factor
_FEWEST_CLASSES = 4  # with less there is no course to see
_MEMBERS = 20  # points a class needs: its mean, its slope, and enough to see their scatter
_LEVERAGE = 1e-6  # least part of a point's residual that the fit leaves to it
_SURE = 0.999  # level at which an effect is stated: one false sentence in a thousand
_SMALL = 1e-3  # of the range of a response, below which an effect is not worth a sentence
_INTERVAL = 0.95  # level of the intervals that are printed


@dataclass(frozen=True)
class Separation:
    """Whether the columns of a design separate a factor from the others."""

    separated: bool  # whether they do
    # factors whose columns explain the column of this one, alone or by their product; empty where all do together
    tied_to: tuple[str, ...] = ()
    interaction: bool = False  # whether it is the product of these
    too_few: bool = False  # whether there are fewer points than the question needs


@dataclass(frozen=True)
class Estimate:
    """A number from a regression."""

    # value, half: the number, and the half width of its 95 % interval
    value: float
    half: float
    most: float  # largest size that a 99.9 % interval allows
    sure: bool  # whether it differs from zero at this level, and by more than the numerical error


@dataclass(frozen=True)
class Fit:
    """Result of a regression on all factors for one of them."""

    trend: Estimate  # change of the response over the range of the factor
    # how far the ends of that range lie above its middle on average; zero for two levels, and where there are too few
    # points to separate a square from the interactions of factors that are not quite independent
    bend: Estimate
    # level, mean: means of the factor and of the response in classes of equally many points, at equal values of all
    # other factors; empty where there are not enough points, or where their course depends on interactions
    level: FloatArray
    mean: FloatArray
    error: float  # half width of the 99.9 % interval of a difference of two such means


def _encoded(column: Column) -> FloatArray:
    return encoded({"": column}, inputs_of({"": column}))


def _basis(column: Column, powers: int = _POWERS) -> FloatArray:
    """Columns of one factor, centred: powers of a number that its levels separate; one for each but the first word."""
    basis = _encoded(column)
    if is_numeric(column):
        basis = basis ** np.arange(1, min(powers, np.unique(column).size - 1) + 1)
    return basis - basis.mean(axis=0)


def _own(column: Column, others: int) -> FloatArray:
    """Columns of the factor itself, with as many powers as the points allow in addition to columns of others."""
    return _basis(column, int(np.clip(len(column) // _POINTS_PER_COLUMN - others, *_OWN_POWERS)))


def _others(columns: Mapping[str, Column], factor: str) -> FloatArray:
    """Columns of all factors but one, shape (point, column)."""
    parts = [_basis(column) for name, column in columns.items() if name != factor]
    return np.concatenate(parts, axis=1) if parts else np.empty((len(columns[factor]), 0))


def _products(columns: Mapping[str, Column]) -> FloatArray:
    """Products of any two factors that are numbers, centred, shape (point, pair)."""
    lines = [_encoded(column)[:, 0] for column in columns.values() if is_numeric(column)]
    products = [(one - one.mean()) * (other - other.mean()) for one, other in combinations(lines, 2)]
    if not products:
        return np.empty((len(next(iter(columns.values()))), 0))
    stacked = np.stack(products, axis=1)
    return stacked - stacked.mean(axis=0)


def _explained(column: FloatArray, by: FloatArray) -> float:
    """Share of the variance of a centred column that others explain."""
    rest = column - by @ np.linalg.lstsq(by, column)[0]
    return 1 - float(rest @ rest) / float(column @ column)


def separation(columns: Mapping[str, Column], factor: str) -> Separation:
    """Decide by the columns of a design whether the effect of one factor is separated from the others.

    It cannot where more than half of the variance of one of its powers is explained by the straight lines and squares
    of all the others together, or by the product of two or three of them (an alias, as in designs
    of low resolution); nor where there are fewer than three points per column.

    Args:
        columns: Values of all factors that vary, shape (point,) each.
    """
    by = _others(columns, factor)
    own = _own(columns[factor], by.shape[1])
    others = {name: _basis(column) for name, column in columns.items() if name != factor}
    tied = tuple(name for name, basis in others.items() if _explained(own[:, 0], basis[:, :1]) > _SHARED)
    too_few = len(own) < _POINTS_PER_COLUMN * (own.shape[1] + by.shape[1])
    if tied or too_few or max(_explained(part, by) for part in own.T) > _SHARED:
        return Separation(False, tied, too_few=too_few and not tied)
    return _aliased(columns, factor)


def _aliased(columns: Mapping[str, Column], factor: str) -> Separation:
    """Look for the column of a factor among the products of two and of three others."""
    if not is_numeric(columns[factor]):
        return Separation(True)
    line = _encoded(columns[factor])[:, 0]
    line = line - line.mean()
    numbers = {
        name: _encoded(column)[:, 0] for name, column in columns.items() if name != factor and is_numeric(column)
    }
    centred = {name: column - column.mean() for name, column in numbers.items()}
    for width in (2, 3):
        for names in combinations(centred, width):
            product = np.prod([centred[name] for name in names], axis=0)
            product = product - product.mean()
            size = float(line @ line) * float(product @ product)
            if size > 0 and float(line @ product) ** 2 > _SHARED * size:
                return Separation(False, names, interaction=True)
    return Separation(True)


def fit_factor(columns: Mapping[str, Column], factor: str, response: FloatArray, error: float) -> Fit:
    """Trend and class means of a response over one factor, at equal values of the others.

    Least squares on up to six powers of the factor, and a straight line and a square of each other one; the intervals
    are those of Student's t distribution with the scatter that is left, or with its local size where that makes them
    wider (HC3 of MacKinnon and White 1985: interactions scatter more at the ends of a range). Class means are those of
    straight lines in each class, and their intervals hold for all pairs of classes at once (Bonferroni).

    Args:
        columns: Values of all factors that vary, shape (point,) each, on the scale that is meant: logarithms of a
            factor with a logarithmic scale. `separation` must hold for the factor.
        error: Its numerical error: smaller changes are none.
    """
    others = _others(columns, factor)
    own = _own(columns[factor], others.shape[1])
    error = max(error, _SMALL * float(np.ptp(response)))
    trend = _estimate(2 * (np.arange(1, own.shape[1] + 1) % 2), own, others, response, error)
    beside = np.column_stack([others, _products(columns)])  # of related factors, a product looks like a square
    level, mean, apart = _class_means(columns[factor].astype(float), others, response)
    _, checked, bound = _class_means(columns[factor].astype(float), beside, response)
    courses = {_course(*means) for means in ((mean, apart), (checked, bound)) if means[0].size}
    if not checked.size or len(courses) > 1 or Shape.NONE in courses:
        level, mean, apart = np.empty(0), np.empty(0), 0.0
    bend, own = Estimate(0.0, 0.0, 0.0, False), _own(columns[factor], beside.shape[1])
    if own.shape[1] > 1 and len(response) >= _POINTS_PER_COLUMN * (own.shape[1] + beside.shape[1]):
        bend = _estimate(np.arange(own.shape[1]) % 2, own, beside, response, error)
    return Fit(trend, bend, level, mean, apart)


def _course(mean: FloatArray, error: float) -> Shape:
    """Shape of class means; one direction only where the ends differ, too; changes in between may be errors."""
    shape = Shape(int(curve_shapes(mean[None], error)[0]))
    flat = shape in (Shape.RISING, Shape.FALLING) and abs(float(mean[-1] - mean[0])) <= error
    return Shape.NONE if flat else shape


def _estimate(weight: IntArray, own: FloatArray, others: FloatArray, response: FloatArray, error: float) -> Estimate:
    """A weighted sum of the coefficients of a factor's powers, in a fit with other columns."""
    coefficient, covariances, free = _least_squares(np.column_stack([own, others]), response)
    part = slice(1, own.shape[1] + 1)
    value = float(weight @ coefficient[part])
    deviation = float(np.sqrt((weight @ covariances[:, part, part] @ weight).max()))
    sure, printed = (_quantile((1 + share) / 2, free) for share in (_SURE, _INTERVAL))
    return Estimate(
        value, printed * deviation, abs(value) + sure * deviation, abs(value) > max(sure * deviation, error)
    )


def _quantile(share: float, free: int) -> float:
    """Quantile of Student's distribution."""
    from scipy.special import stdtrit  # imported where a fit is made: every study would wait for it

    return float(stdtrit(free, share))


def _least_squares(columns: FloatArray, response: FloatArray) -> tuple[FloatArray, FloatArray, int]:
    """Coefficients of a constant and of centred columns, two estimates of their covariance, and the freedom left."""
    design = np.column_stack([np.ones(len(response)), columns])
    left, size, right = np.linalg.svd(design, full_matrices=False)
    kept = size > size[0] * max(design.shape) * np.finfo(float).eps  # columns that repeat others add nothing
    left, scaled = left[:, kept], right[kept].T / size[kept]
    coefficient = scaled @ (left.T @ response)
    free = len(response) - int(kept.sum())
    rest = response - design @ coefficient
    inverse = scaled @ scaled.T
    leverage = (left**2).sum(axis=1)
    local = (rest / np.maximum(1 - leverage, _LEVERAGE)) ** 2
    covariances = [float(rest @ rest) / free * inverse, inverse @ (design.T * local) @ design @ inverse]
    return coefficient, np.stack(covariances), free


def _class_means(values: FloatArray, others: FloatArray, response: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Mean level and mean response of classes of equally many points, and the error of a difference of two means."""
    classes = min(_CLASSES, (len(values) - others.shape[1]) // _MEMBERS)
    edges = np.quantile(values, np.linspace(0, 1, max(classes, 1) + 1))
    member = np.searchsorted(np.unique(edges[1:-1]), values, side="right")
    count = np.bincount(member)
    if count.size < _FEWEST_CLASSES or count.min() < _MEMBERS // 2:
        return np.empty(0), np.empty(0), 0.0
    level = np.bincount(member, values) / count
    inside = np.eye(count.size)[member]
    first = inside[:, 1:] - count[1:] / count.sum()  # centred, besides the constant
    lines = inside * (values - level[member])[:, None]
    coefficient, covariances, free = _least_squares(np.column_stack([first, lines, others]), response)
    steps, own = coefficient[1 : count.size], np.zeros((2, count.size, count.size))
    own[:, 1:, 1:] = covariances[:, 1 : count.size, 1 : count.size]  # each class against the first
    variance = own.diagonal(axis1=1, axis2=2)
    apart = float((variance[:, :, None] + variance[:, None, :] - 2 * own).max())
    pairs = count.size * (count.size - 1) / 2
    error = _quantile(1 - (1 - _SURE) / 2 / pairs, free) * float(np.sqrt(max(apart, 0.0)))
    mean = coefficient[0] + np.concatenate([[0.0], steps]) - float(steps @ count[1:]) / count.sum()
    return level, mean, error
