"""How much narrower the scatter of one or two factors must be to keep a limit, from points that were run.

Each point has the weight new density over old density, with a scatter s times as wide about its centre:
w = f(c + (x - c) / s) / (s f(x)) with the density f of the factor; of two factors by the product. A scale is an answer
where the upper end of the interval of the chance to exceed the limit is small enough, at a confidence that holds for
all scatters and pairs together, because the best of many trials looks better than it is.
"""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.encoding import is_numeric
from tripod_doe.analyses.tolerance.chances import Exceeding, density_ratio, points_to_resolve, weighted_chances
from tripod_doe.analyses.usable_points import Sample
from tripod_doe.array_types import FloatArray
from tripod_doe.study.definition.distributions import Scatter, scatter_density
from tripod_doe.study.designs.correlation import correlated_factors

SCALES = np.arange(0.95, 0.075, -0.05)
"""Scales that are tried, from the widest scatter."""
_ENDS = ("low", "value", "high")


def together(confidence: float, ways: int) -> float:
    """The confidence of each of some intervals that all hold with a confidence (Bonferroni)."""
    return 1 - (1 - confidence) / max(ways, 1)


def own_scatter(sample: Sample, name: str) -> Scatter | None:
    """The scatter of a factor, if weights can change it alone; None for levels and for correlated factors.

    Weights of a correlated factor would change the factors that go with it, too.
    """
    if name in correlated_factors(sample.design.correlation, list(sample.tables)):
        return None
    column = sample.columns[name]
    if is_numeric(column) and (column.astype(float) % 1 == 0).all():  # whole numbers have no density
        return None
    return scatter_density(sample.tables[name])


def scaled_weights(sample: Sample, name: str, scales: FloatArray) -> FloatArray:
    """Weights of the points at some scales of the scatter of a factor, shape (scale, point); else NaN."""
    scatter, column = own_scatter(sample, name), np.asarray(sample.columns[name])
    if scatter is None:
        return np.full((scales.size, column.size), np.nan)
    x = np.log(column.astype(float)) if scatter.logarithmic else column.astype(float)
    now = scatter.density(x)
    narrower = [scatter.density(scatter.centre + (x - scatter.centre) / s) / s for s in scales.tolist()]
    return density_ratio(np.stack(narrower), now)


def scale_to_keep(
    sample: Sample, points: Exceeding, wanted: NDArray[np.bool_], keep: float, confidence: float
) -> dict[str, FloatArray]:
    """The largest resolved scales of the scatter of two factors by which a limit is kept, and the chances there.

    Args:
        wanted: Components whose limit is to be kept, shape (component,).
        keep: Share of the joints that must keep the limit.

    Returns:
        scale_to_keep, exceedance_at_scale with its interval : ndarray, shape (factor, factor, component)
            On the diagonal those of single factors. NaN where no scale is resolved to keep the limit.
        scale_excluded : ndarray, shape (factor, factor, component)
            1 where all scales are resolved to break it.
        samples_to_resolve : ndarray, shape (component,)
            Number of points that would resolve one scale; infinite if these points give no estimate, NaN if one is
            resolved.
    """
    weights = [scaled_weights(sample, name, SCALES) for name in sample.tables]
    count = len(weights)
    answers = np.full((4, count, count, wanted.size), np.nan)
    excluded, times = np.zeros((count, count, wanted.size)), np.full(wanted.size, np.inf)
    part, confident = points.of(wanted), together(confidence, count * (count + 1) // 2)
    for first in range(count if wanted.any() else 0):
        for second in range(first + 1):
            both = weights[first] * (weights[second] if second != first else 1.0)
            chances = weighted_chances(both, part)  # shape (scale, component)
            sure = chances.interval(confident)
            kept = sure.high <= 1 - keep
            own = np.stack([np.broadcast_to(SCALES[:, None], kept.shape), *chances.interval(confidence).ends()])
            best = np.where(kept.any(axis=0), own[:, kept.argmax(axis=0), np.arange(kept.shape[1])], np.nan)
            answers[:, first, second, wanted] = answers[:, second, first, wanted] = best
            never = (sure.low > 1 - keep).all(axis=0)
            excluded[first, second, wanted] = excluded[second, first, wanted] = never
            times[wanted] = np.minimum(times[wanted], points_to_resolve(chances, 1 - keep, confident))
    names = ("scale_to_keep", *(_exceedance_name("scale", end) for end in _ENDS))
    count_of_points = sample.design.samples or sample.rows.size
    return dict(zip(names, answers, strict=True)) | {
        "scale_excluded": excluded,
        "samples_to_resolve": np.where(wanted & (times > 1), times * count_of_points, np.nan),
    }


def cheapest_to_keep(
    sample: Sample,
    points: Exceeding,
    wanted: NDArray[np.bool_],
    keep: float,
    confidence: float,
    costs: Mapping[str, float],
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """The cheapest resolved scales of one scatter or two by which a limit is kept, their cost and chance.

    A scale s of a scatter costs 1 / s - 1 times what it costs to halve it.

    Args:
        wanted, keep: As for `scale_to_keep`.
        costs: What it costs to halve each scatter; others stay as they are.

    Returns:
        scales : ndarray, shape (factor, component): 1 where a scatter stays; NaN as in `scale_to_keep`.
        cheapest_cost, exceedance_at_cheapest with its interval : ndarray, shape (component,)
    """
    names = list(sample.tables)
    scales, answers = np.full((len(names), wanted.size), np.nan), np.full((4, wanted.size), np.nan)
    answers[0] = np.inf
    part, places = points.of(wanted), np.flatnonzero(wanted)
    own = [name for name in names if name in costs and places.size]
    sizes = np.array([1.0, *SCALES])
    confident = together(confidence, len(own) * (len(own) + 1) // 2)
    for first, second, size, weights in _ways(sample, own, sizes):
        chances = weighted_chances(weights, part)
        other = sizes if first != second else np.ones(1)
        price = costs[first] * (1 / size - 1) + costs[second] * (1 / other - 1)
        priced = np.where(chances.interval(confident).high <= 1 - keep, price[:, None], np.inf)
        best, ends = priced.argmin(axis=0), chances.interval(confidence).ends()
        for column, at in enumerate(places.tolist()):
            if priced[best[column], column] < answers[0, at]:
                answers[:, at] = priced[best[column], column], *(end[best[column], column] for end in ends)
                scales[:, at] = 1.0
                scales[names.index(first), at] = size
                if first != second:
                    scales[names.index(second), at] = other[best[column]]
    answers[0] = np.where(np.isfinite(answers[0]), answers[0], np.nan)
    keys = ("cheapest_cost", *(_exceedance_name("cheapest", end) for end in _ENDS))
    return scales, dict(zip(keys, answers, strict=True))


def _ways(sample: Sample, own: list[str], sizes: FloatArray) -> Iterator[tuple[str, str, float, FloatArray]]:
    """Yield (factor, factor, scale of the first, weights at all scales of the second); a single factor twice."""
    weights = {
        name: np.concatenate([np.ones((1, sample.rows.size)), scaled_weights(sample, name, sizes[1:])]) for name in own
    }
    pairs = [(first, second) for at, first in enumerate(own) for second in own[:at]]
    for first, second in pairs or [(name, name) for name in own]:
        for size, each in zip(sizes.tolist(), weights[first], strict=True):
            yield first, second, size, np.atleast_2d(each * weights[second] if first != second else each)


def _exceedance_name(way: str, end: str) -> str:
    return f"exceedance_at_{way}" if end == "value" else f"exceedance_at_{way}_{end}"
