"""Multifidelity estimates of mean, variance and Sobol' indices of the truth (Peherstorfer and others 2016, Qian 2018).

Each quantity is a mean of a statistic q over samples. With nested samples Z_1 (truth) in Z_2 in ... the estimate is

    q_1(Z_1) + sum_k a_k (q_k(Z_k) - q_k(Z_k-1)),    a_k = cov(q_1, q_k) / var(q_k).

A coefficient or a centre that knew the samples which it is applied to would bias the estimate. So the samples of the
truth are divided into folds: those of a fold get coefficients and centres from the other folds. Means and variances are
then unbiased for given numbers of samples. The centre c of the truth's squared deviations is an estimate by all models:
that by the truth alone would scatter more than the rest. As E (y - c)^2 = var y + var c, var c is subtracted. An
index is a quotient, whose bias goes with one over the samples.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tripod_doe.array_types import FloatArray, IntArray

FOLDS = 10
"""Parts of the truth's samples, each with coefficients from the others."""


class Estimate(NamedTuple):
    """A number with its uncertainty, and the uncertainty by the truth alone."""

    value: float  # the estimate
    variance: float  # of the estimate
    freedom: float  # degrees of freedom of that variance (Welch and Satterthwaite)
    alone: float  # variance of the statistic over one sample of the truth: over n samples it would be a part n of it


@dataclass(frozen=True)
class Estimates:
    """Estimates for one component of an output; the indices one a factor, none without their points."""

    mean: Estimate
    variance: Estimate
    first: tuple[Estimate, ...]
    total: tuple[Estimate, ...]


def folds_of(count: int) -> IntArray:
    """The fold of each sample of the truth; samples are independent, so any division is as good as another."""
    return np.arange(count) % min(FOLDS, count)


def moments(values: FloatArray) -> FloatArray:
    """Products of a sample's values from which the statistics about any centre follow, shape (product, sample).

    Args:
        values: Shape (sample, point): one point, or those of a block a, ab_1 .. ab_d, b.
    """
    if values.shape[1] == 1:
        return np.stack([values[:, 0], values[:, 0] ** 2])
    a, b, mixed = values[:, 0], values[:, -1], values[:, 1:-1].T
    change = mixed - a
    return np.concatenate([[(a + b) / 2, (a**2 + b**2) / 2], b * change, change, change**2 / 2])


def statistics(products: FloatArray, centre: float) -> FloatArray:
    """Value, squared deviation, and the parts of first-order and total indices, shape (statistic, ...).

    Linear in the products, so their means give the means. Estimators: Saltelli and others (2010), Jansen (1999).
    """
    value, square = products[:2]
    both, change, total = products[2:].reshape(3, -1, *products.shape[1:])
    deviation = square - 2 * centre * value + centre**2
    return np.concatenate([[value, deviation], both - centre * change, total])


def _coefficients(truth: FloatArray, cheap: FloatArray) -> FloatArray:
    """Control-variate coefficient of each statistic, shape (statistic,), 0 where the cheap one does not vary."""
    one, other = truth - truth.mean(axis=1, keepdims=True), cheap - cheap.mean(axis=1, keepdims=True)
    power = (other**2).mean(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        coefficients: FloatArray = np.where(power > 0, (one * other).mean(axis=1) / power, 0.0)
    return coefficients


def shares_of(counts: list[int]) -> FloatArray:
    """Weight of the mean of each stratum in q_k(Z_k) - q_k(Z_k-1), shape (model, stratum).

    Stratum l holds the samples of Z_l that are not in Z_l-1.
    """
    sizes = np.diff([0, *counts])
    shares = np.zeros((len(counts), len(counts)))
    for k in range(1, len(counts)):
        shares[k, : k + 1] = sizes[: k + 1] / counts[k]
        shares[k, :k] -= sizes[:k] / counts[k - 1]
    return shares


def estimate(values: list[FloatArray]) -> Estimates:
    """Estimates of one component of an output.

    Args:
        values: Of the truth and of each cheaper model, shape (sample, point); every model has the samples of those
            before it.
    """
    counts = [len(each) for each in values]
    shift = [float(each[: counts[0]].mean()) for each in values]  # for accuracy: no result depends on it
    products = [moments(each - middle) for each, middle in zip(values, shift, strict=True)]
    shares, fold = shares_of(counts), folds_of(counts[0])
    known = [each[:, : counts[0]] for each in products]
    ends = [0, *counts]
    strata = [
        [each[:, start:stop].mean(axis=1) for start, stop in pairwise(ends) if stop <= count]
        for each, count in zip(products, counts, strict=True)
    ]
    width = statistics(known[0][:, :1], 0.0).shape[0]
    covariances = [_covariance([each[0, a:b] for each in products[at:]]) for at, (a, b) in enumerate(pairwise(ends))]
    middles = [float(each[0].mean()) for each in products[1:]]
    answer, coefficients = np.zeros(width), np.zeros((len(values), width, counts[0]))
    doubt = 0.0  # variance of the centre, averaged over the folds
    for number in range(fold.max() + 1):
        own, rest = fold == number, fold != number
        centre, scatter = _centre([each[0, rest] for each in known], strata, covariances, shares, counts)
        centres = [centre, *middles]
        truth = statistics(known[0][:, rest], centre)
        part = statistics(known[0][:, own].mean(axis=1), centre)
        part[1] -= scatter
        doubt += scatter * own.mean()
        for k in range(1, len(values)):
            coefficient = _coefficients(truth, statistics(known[k][:, rest], centres[k]))
            coefficients[k][:, own] = coefficient[:, None]
            means = [known[k][:, own].mean(axis=1), *strata[k][1:]]
            about = [statistics(mean, centres[k]) for mean in means]
            part += coefficient * sum(share * each for share, each in zip(shares[k], about, strict=False))
        answer += part * own.mean()
    centres = [float(answer[0]), *middles]
    influences = _influences(products, coefficients, shares, counts, centres)
    alone = statistics(known[0], centres[0])
    mean = _with_variance(answer[0], influences, alone, 0)
    variance = _with_variance(answer[1], influences, alone, 1)
    variance = variance._replace(variance=variance.variance + 2 * doubt**2)  # of the squared error of the centre
    factors = (width - 2) // 2
    indices = [_quotient(answer, influences, alone, 2 + at) for at in range(2 * factors)]
    mean = mean._replace(value=mean.value + shift[0])
    return Estimates(mean, variance, tuple(indices[:factors]), tuple(indices[factors:]))


def _covariance(values: list[FloatArray]) -> FloatArray:
    """Covariances of models over the same samples, shape (model, model); 0 of a single sample, which bounds none."""
    return np.atleast_2d(np.cov(values)) if values[0].size > 1 else np.zeros((len(values), len(values)))


def _centre(
    rest: list[FloatArray],
    strata: list[list[FloatArray]],
    covariances: list[FloatArray],
    shares: FloatArray,
    counts: list[int],
) -> tuple[float, float]:
    """The mean of the truth by all models, and the variance of this estimate.

    Args:
        rest: Values of each model at the truth's samples that may be used, shape (sample,).
        strata, covariances: Means of each model's products in each stratum; covariances of the values of the models
            that a stratum holds.
        shares, counts: See `shares_of`.
    """
    values = np.stack(rest)
    left = values[1:] - values[1:].mean(axis=1, keepdims=True)
    power = (left**2).sum(axis=1)
    weights = np.divide(left @ values[0], power, out=np.zeros_like(power), where=power > 0)
    used = np.concatenate([[1.0], weights * shares[1:, 0]])
    centre = float(used @ values.mean(axis=1))
    scatter = float((used @ values).var(ddof=1) / values.shape[1])
    for stratum, size in enumerate(np.diff(counts), 1):
        used = weights[stratum - 1 :] * shares[stratum:, stratum]
        centre += float(used @ [strata[k][stratum][0] for k in range(stratum, len(counts))])
        scatter += float(used @ covariances[stratum] @ used) / max(int(size), 1)
    return centre, scatter


def _influences(
    products: list[FloatArray], coefficients: FloatArray, shares: FloatArray, counts: list[int], centres: list[float]
) -> list[FloatArray]:
    """What each sample adds to the estimates, by stratum, shape (statistic, sample): an estimate is a sum of means."""
    influences = []
    ends = [0, *counts]
    for stratum, (start, stop) in enumerate(pairwise(ends)):
        total = statistics(products[0], centres[0]) if stratum == 0 else 0.0
        for k in range(max(stratum, 1), len(products)):
            own = coefficients[k] if stratum == 0 else coefficients[k].mean(axis=1, keepdims=True)
            total = total + own * shares[k, stratum] * statistics(products[k][:, start:stop], centres[k])
        influences.append(np.asarray(total))
    return influences


def _spread(parts: list[FloatArray]) -> tuple[float, float]:
    """Variance of a sum of means over strata, and its degrees of freedom."""
    kept = [part for part in parts if part.size > 1]
    variances = np.array([part.var(ddof=1) / part.size for part in kept])
    whole = float(variances.sum())
    weights = (variances**2 / [part.size - 1 for part in kept]).sum()
    return whole, float(whole**2 / weights) if weights > 0 else np.inf


def _with_variance(value: float, influences: list[FloatArray], alone: FloatArray, at: int) -> Estimate:
    return Estimate(float(value), *_spread([part[at] for part in influences]), float(alone[at].var(ddof=1)))


def _quotient(answer: FloatArray, influences: list[FloatArray], alone: FloatArray, at: int) -> Estimate:
    """An index: its part of the variance over the variance, with the scatter of both."""
    if answer[1] <= 0:
        return Estimate(np.nan, np.nan, np.inf, np.nan)
    index = answer[at] / answer[1]

    def scatter(part: FloatArray) -> FloatArray:
        return (part[at] - index * part[1]) / answer[1]

    return Estimate(float(index), *_spread([scatter(part) for part in influences]), float(scatter(alone).var(ddof=1)))
