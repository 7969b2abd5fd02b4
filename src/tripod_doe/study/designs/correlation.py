"""Correlated factors: samples of independent factors are given rank correlations by a Gaussian copula.

Latin hypercubes keep their strata: their values are re-ordered by the ranks of the copula's, as Iman and Conover (1982)
do; sequences keep their points when they grow, since each point is transformed alone.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError, near_match

Correlation = Sequence[Sequence[str | float]] | Mapping[str, Mapping[str, float]]

_INSIDE = 1e-12  # keeps the ends of the unit interval off the infinite tails
_ROUNDING = 1e-9


def correlation_matrix(given: Correlation, names: list[str]) -> FloatArray:
    """Rank correlations as a matrix, shape (factor, factor).

    Args:
        given: Triples [factor, factor, correlation], a table of tables, or the whole matrix in the order of the
            factors.

    Raises:
        InputError: If a factor is unknown, or a number is no correlation.
    """
    matrix = np.eye(len(names))
    if isinstance(given, Mapping):
        triples = [(one, other, value) for one, row in given.items() for other, value in row.items()]
    elif all(not isinstance(item, str) for row in given for item in row):
        return _whole(given, len(names))
    else:
        triples = [_triple(row) for row in given]
    for one, other, value in triples:
        for name in (one, other):
            if name not in names:
                raise InputError(f"correlation: {name!r} is no factor of this design{near_match(name, names)}")
        if one == other or not -1 < value < 1:
            raise InputError(f"correlation: {one}, {other}: {value:g} must lie between -1 and 1, of two factors")
        matrix[names.index(one), names.index(other)] = matrix[names.index(other), names.index(one)] = value
    return matrix


def correlated_factors(given: Correlation, names: list[str]) -> list[str]:
    """Names of the factors that are correlated with another one; arguments as of `correlation_matrix`."""
    matrix = correlation_matrix(given, names) if given else np.eye(len(names))
    return [name for name, row in zip(names, matrix, strict=True) if np.count_nonzero(row) > 1]


def _triple(row: Sequence[str | float]) -> tuple[str, str, float]:
    if len(row) != 3 or not isinstance(row[0], str) or not isinstance(row[1], str) or isinstance(row[2], str):
        raise InputError(f"correlation: {list(row)}: give [factor, factor, rank correlation]")
    return row[0], row[1], float(row[2])


def _whole(given: Sequence[Sequence[str | float]], width: int) -> FloatArray:
    if len(given) != width or any(len(row) != width for row in given):
        raise InputError(f"correlation: a matrix needs {width} rows of {width} numbers, one for each factor")
    matrix = np.array(given, float)
    beside = matrix[~np.eye(width, dtype=bool)]
    regular = np.allclose(matrix, matrix.T, atol=_ROUNDING) and np.allclose(np.diag(matrix), 1)
    if not regular or (np.abs(beside) >= 1).any():
        raise InputError("correlation: the matrix must be symmetric, 1 on its diagonal and between -1 and 1 elsewhere")
    return matrix


def rank_correlation(normal: FloatArray) -> FloatArray:
    """Spearman's rank correlations of normal factors with these correlations (Pearson 1907)."""
    return np.asarray(6 / np.pi * np.arcsin(normal / 2))


def correlated(unit: FloatArray, ranks: FloatArray, keep_strata: bool) -> FloatArray:
    """Independent points of the unit cube, correlated.

    Args:
        unit: Points, shape (point, factor).
        ranks: Spearman's rank correlations of the factors, shape (factor, factor).
        keep_strata: Whether the values of each factor are kept and only reordered.

    Raises:
        InputError: If no factors can have these correlations together.
    """
    from scipy.stats import norm, rankdata  # slow to import, and most studies correlate nothing

    normal = 2 * np.sin(np.pi * ranks / 6)  # as `rank_correlation`
    np.fill_diagonal(normal, 1.0)
    if np.linalg.eigvalsh(normal).min() <= _ROUNDING:
        raise InputError("correlation: no factors can have these correlations together; make some of them smaller")
    scores = norm.ppf(np.clip(unit, _INSIDE, 1 - _INSIDE))
    if keep_strata:  # first remove the random correlations of the sample
        scores = scores @ np.linalg.inv(np.linalg.cholesky(np.corrcoef(scores, rowvar=False))).T
    scores = scores @ np.linalg.cholesky(normal).T
    if not keep_strata:
        return np.asarray(norm.cdf(scores), float)
    order = rankdata(scores, method="ordinal", axis=0).astype(int) - 1
    return np.asarray(np.take_along_axis(np.sort(unit, axis=0), order, axis=0), float)
