"""How far the nominal value of one factor must move so that a limit is kept, from the points that are there.

Each point counts by how much more often it would occur if the factor scattered about another value,
w = f(x - d) / f(x) with the density f of the factor. What would then lie where no point can be counts as beyond the
limit.
"""

from __future__ import annotations

import numpy as np

from tripod_doe.analyses.sample import Sample
from tripod_doe.analyses.tolerance.keeping import FEWEST
from tripod_doe.array_types import FloatArray
from tripod_doe.study.definition.distributions import Scatter, scatter_density

_STEPS = np.arange(0.05, 3.025, 0.05)  # shifts that are tried, in standard deviations, to both sides
_WIDTH, _PLACES = 12.0, 6001  # of the range over which a density is integrated, in standard deviations


def shift_to_keep(sample: Sample, values: FloatArray, limit: FloatArray, keep: float) -> FloatArray:
    """The smallest shift of the centre of a factor by which a limit is kept, shape (factor, component), in its unit.

    NaN without a limit, where it is kept already, where no shift that the points resolve keeps it, and for factors of
    listed values.

    Args:
        values: Shape (point, component).
        keep: Share of the joints that must keep the limit.
    """
    above = (values > limit).astype(float)
    answers = np.full((len(sample.tables), limit.size), np.nan)
    wanted = np.flatnonzero(np.isfinite(limit) & (above.mean(axis=0) > 1 - keep))
    if not wanted.size:
        return answers
    for at, (name, table) in enumerate(sample.tables.items()):
        scatter = scatter_density(table)
        if scatter is None:
            continue
        column = np.asarray(sample.columns[name], float)
        x = np.log(column) if scatter.logarithmic else column
        steps = np.stack([_STEPS, -_STEPS], axis=1).ravel() * x.std()  # the smallest first
        answers[at, wanted] = _smallest(scatter, x, steps, above[:, wanted], keep)
        if scatter.logarithmic:
            answers[at] = np.exp(scatter.centre + answers[at]) - np.exp(scatter.centre)
    return answers


def _smallest(scatter: Scatter, x: FloatArray, steps: FloatArray, above: FloatArray, keep: float) -> FloatArray:
    """The first of some shifts by which enough joints keep their limits, shape (component,); NaN where none does."""
    now, answers = scatter.density(x), np.full(above.shape[1], np.nan)
    places = scatter.centre + x.std() * np.linspace(-_WIDTH, _WIDTH, _PLACES)
    possible = scatter.density(places) > 0
    for step in steps.tolist():
        weights = scatter.density(x - step) / now
        total = weights.sum()
        if total <= 0 or total**2 / (weights**2).sum() < FEWEST:
            continue
        covered = min(float(np.trapezoid(scatter.density(places - step) * possible, places)), 1.0)
        share = covered * (weights @ above) / total + 1 - covered
        answers = np.where(np.isnan(answers) & (share <= 1 - keep), step, answers)
    return answers
