"""By how much the nominal value of one factor must move to keep a limit, with its scatter as it is.

Each point counts by how much more often it would occur if the distribution were moved by d, w = f(x - d) / f(x). The
part of a moved distribution that no point can lie in is not known, and counts as beyond the limit.
"""

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.tolerance.chances import Exceeding, density_ratio, weighted_chances
from tripod_doe.analyses.tolerance.narrower_scatter import own_scatter, together
from tripod_doe.analyses.usable_points import Sample
from tripod_doe.array_types import FloatArray
from tripod_doe.study.definition.distributions import Scatter

_STEPS = np.arange(0.05, 3.025, 0.05)  # shifts that are tried, in standard deviations, to both sides
_WIDTH, _PLACES = 12.0, 6001  # of the range over which a density is integrated, in standard deviations
_FEWEST = 100  # effective points: where fewer count, a share of them says little of the weights that no point has


def shift_to_keep(
    sample: Sample, points: Exceeding, wanted: NDArray[np.bool_], keep: float, confidence: float
) -> dict[str, FloatArray]:
    """The smallest resolved shift of each factor's centre that keeps a limit, and the chance there.

    NaN where no shift is resolved to keep it, and for factors of listed values.

    Args:
        wanted, keep: As for `scale_to_keep`.

    Returns:
        shift_to_keep, exceedance_at_shift with its interval : ndarray, shape (factor, component)
            Shifts in the unit of the factor.
    """
    answers = np.full((4, len(sample.tables), wanted.size), np.nan)
    part, confident = points.of(wanted), together(confidence, 2 * len(sample.tables))
    for at, name in enumerate(sample.tables if wanted.any() else ()):
        scatter = own_scatter(sample, name)
        if scatter is None:
            continue
        column = np.asarray(sample.columns[name], float)
        x = np.log(column) if scatter.logarithmic else column
        answers[:, at, wanted] = _smallest(scatter, x, part, 1 - keep, (confidence, confident))
        if scatter.logarithmic:
            answers[0, at] = np.exp(scatter.centre + answers[0, at]) - np.exp(scatter.centre)
    names = ("shift_to_keep", "exceedance_at_shift_low", "exceedance_at_shift", "exceedance_at_shift_high")
    return dict(zip(names, answers, strict=True))


def _smallest(
    scatter: Scatter, x: FloatArray, points: Exceeding, allowed: float, confidences: tuple[float, float]
) -> FloatArray:
    """The first shift that is resolved to keep the limits, and the chance there, shape (4, component); else NaN.

    Args:
        confidences: Of the interval that is stated, and of the one that decides.
    """
    now, answers = scatter.density(x), np.full((4, points.computed.shape[1]), np.nan)
    places = scatter.centre + x.std() * np.linspace(-_WIDTH, _WIDTH, _PLACES)
    possible = scatter.density(places) > 0
    for step in (np.stack([_STEPS, -_STEPS], axis=1).ravel() * x.std()).tolist():  # the smallest first
        weights = density_ratio(scatter.density(x - step), now)
        total = weights.sum()
        if total <= 0 or total**2 / (weights**2).sum() < _FEWEST:
            continue
        covered = min(float(np.trapezoid(scatter.density(places - step) * possible, places)), 1.0)
        chances = weighted_chances(weights[None], points)
        low, value, high = chances.interval(confidences[0]).ends()
        ends = [low * covered, value * covered + 1 - covered, high * covered + 1 - covered]
        kept = chances.interval(confidences[1]).high[0] * covered + 1 - covered <= allowed
        own = np.stack([np.full(kept.size, step), *(end[0] for end in ends)])
        answers = np.where(np.isnan(answers[0]) & kept, own, answers)
    return answers
