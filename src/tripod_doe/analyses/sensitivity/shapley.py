"""Shapley effects of correlated factors from any sample: shares of the variance that add up to one.

The variance that a set of factors explains is V[Y] - E[V[Y | x_u]], and the effect of a factor is what it adds to it,
averaged over all orders in which factors become known (Owen 2014, Song, Nelson and Staum 2016). The conditional
variance at a point is its squared distance from a polynomial through its nearest neighbours in x_u: neighbours as
Broto, Bachoc and Depecker (2020) have them, a local polynomial since they differ a little in x_u, too (Da Veiga, Wahl
and Gamboa 2009).
"""

from itertools import combinations
from math import comb

import numpy as np

from tripod_doe.analyses.bootstrap import bootstrap_weights, half_width
from tripod_doe.analyses.output_table import OutputTable
from tripod_doe.analyses.sensitivity.method import Answers, Method, analysis_of
from tripod_doe.analyses.settings import SensitivitySettings
from tripod_doe.analyses.usable_points import Sample
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.errors import InputError

_MOST_FACTORS = 10  # 1022 sets of factors
_MOST_POINTS = 4096  # more neighbours than these make sets of few factors no better known
_NEIGHBOURS = 32
_MOST_CURVED = 5  # factors whose polynomial has squares and products; with more a plane has to do
_TIE = 1e-6  # of the ranks: by how much points of equal levels are set apart
_LEVERAGE = 1e-6  # least part of a point's distance that the polynomial leaves to it


def _neighbours(space: FloatArray, count: int) -> IntArray:
    """The nearest points of each point, itself first, shape (point, neighbour)."""
    from scipy.spatial import cKDTree

    _, near = cKDTree(space).query(space, k=count)
    own = np.arange(len(space))
    itself = near == own[:, None]  # elsewhere than first, or not at all, where points are equal in these factors
    near[itself] = np.broadcast_to(near[:, :1], near.shape)[itself]
    near[:, 0] = own
    return np.asarray(near)


def _local_variances(space: FloatArray, values: FloatArray) -> FloatArray:
    """Squared distance of each point from a polynomial through its neighbours, itself left out.

    Args:
        space: Points in the factors that are known, shape (point, factor).
        values: Outputs, shape (part, point, component); the variances of the parts add up.

    Returns:
        ndarray, shape (point, component)
    """
    width = space.shape[1]
    curved = width <= _MOST_CURVED
    terms = 1 + width + (width * (width + 1) // 2 if curved else 0)
    near = _neighbours(space, min(max(_NEIGHBOURS, 2 * terms), len(space)))
    offsets = space[near] - space[:, None]
    columns = [np.ones((*near.shape, 1)), offsets]
    if curved:
        one, other = np.triu_indices(width)
        columns.append(offsets[..., one] * offsets[..., other])
    basis, _ = np.linalg.qr(np.concatenate(columns, axis=2))
    own = basis[:, 0]  # (point, term)
    weight = np.einsum("pk,pnk->pn", own, basis)  # of each neighbour in the polynomial at the point
    left = np.maximum(1 - weight[:, :1], _LEVERAGE)
    distances = np.zeros((len(space), values.shape[2]))
    for part in values:
        distances += (part - np.einsum("pn,pnc->pc", weight, part[near])) ** 2 / left
    return distances


def _explained(
    ranks: FloatArray, values: FloatArray, weights: FloatArray
) -> tuple[dict[frozenset[int], FloatArray], FloatArray, FloatArray]:
    """Variance that each set of factors explains, and the whole one, shape (resample, component) each.

    The last is what the polynomials leave though all factors are known, as at a jump, shape (component,).
    """
    width = ranks.shape[1]
    centred = values - values.mean(axis=1, keepdims=True)
    whole = weights @ (centred**2).sum(axis=0) - ((weights @ centred) ** 2).sum(axis=0)
    known = {frozenset[int](): np.zeros_like(whole), frozenset(range(width)): whole}
    left = np.zeros_like(whole)
    for size in range(1, width + 1):
        for members in combinations(range(width), size):
            left = weights @ _local_variances(ranks[:, members], centred)
            known.setdefault(frozenset(members), whole - left)
    return known, whole, left[0]


def _estimate(sample: Sample, table: OutputTable, components: IntArray, settings: SensitivitySettings) -> Answers:
    width = len(sample.tables)
    if width > _MOST_FACTORS:
        raise InputError(f"shapley takes at most {_MOST_FACTORS} factors, not {width}")
    count = min(sample.rows.size, _MOST_POINTS)
    # at a level, each point has neighbours of its own, not all of them the same few
    apart = _TIE * np.random.default_rng(settings.seed).random((count, width))
    ranks, values = sample.ranks[:count] + apart, table.parts(components)[:, :count]
    draws = bootstrap_weights(count, settings.resamples, settings.seed)
    weights = np.concatenate([np.full((1, count), 1 / count), draws])
    known, whole, left = _explained(ranks, values, weights)
    effects = []
    for factor in range(width):
        others = [each for each in range(width) if each != factor]
        added = sum(
            (known[frozenset(before) | {factor}] - known[frozenset(before)]) / (width * comb(width - 1, len(before)))
            for size in range(width)
            for before in combinations(others, size)
        )
        effects.append(added / np.where(whole > 0, whole, np.nan))
    shares = np.stack(effects)
    half = half_width(np.moveaxis(shares[:, 1:], 1, 0), settings.confidence)
    return {"shapley": shares[:, 0], "shapley_conf": half + left / whole[0]}  # whose that is, is not known


METHOD = Method(
    _estimate,
    designs=("latin-hypercube", "rbd-fast"),  # points of a sequence avoid each other, and so do their neighbours
    independent=False,
    ranked="shapley",
    meanings={"shapley": "Shapley effect, share of the variance"},
)

shapley_effects = analysis_of(
    METHOD,
    "shapley",
    "Shapley effects: the share of each factor in the variance of an output, correlated factors included.",
)
