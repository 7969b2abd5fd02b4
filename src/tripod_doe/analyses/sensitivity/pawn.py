"""PAWN: how far the distribution function of an output moves when a factor is known to lie in a slice of its range.

Indices equal SALib's, which calls scipy's test with its p-value for each slice, factor and output: with 8 outputs
and the same intervals 5, 101 and 76 s in place of 0.4, 1.1 and 10 s at 1,024, 8,192 and 65,536 points.
From few points an index never vanishes; a factor counts as resolved where its index exceeds, by its interval, the index
of a factor that is pure chance.
"""

from __future__ import annotations

import numpy as np
import xarray as xr
from pydantic import Field

from tripod_doe.analyses.encoding import as_numbers
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.outputs import OutputTable
from tripod_doe.analyses.resampling import half_width, random_halves
from tripod_doe.analyses.sample import SAMPLED_DESIGNS, Sample
from tripod_doe.analyses.sensitivity.method import Answers, Method, apply
from tripod_doe.analyses.settings import SensitivitySettings
from tripod_doe.array_types import FloatArray, IntArray


class PawnSettings(SensitivitySettings):
    """[analysis.NAME] of kind pawn."""

    resamples: int = Field(20, ge=10, description="random halves for the intervals")
    slices: int = Field(10, ge=2, le=1000, description="slices of a factor's range, of equally many points")


def with_chance(sample: Sample, seed: int) -> FloatArray:
    """Values of the factors and of one more that is pure chance, shape (point, factor + 1)."""
    columns = [as_numbers(column) for column in sample.columns.values()]
    return np.stack([*columns, np.random.default_rng(seed).random(sample.rows.size)], axis=1)


def _slices(column: FloatArray, count: int) -> list[IntArray]:
    """Points of each slice that has any; as in SALib, slices are open above, so the largest value is in none."""
    step = 1 / count
    edges = np.nanquantile(column, np.arange(0, 1 + step, step)[: count + 1])
    place = np.searchsorted(edges, column, side="right") - 1
    return [rows for number in range(count) if (rows := np.flatnonzero(place == number)).size]


def _indices(values: FloatArray, factors: FloatArray, count: int) -> FloatArray:
    """Statistics of Kolmogorov-Smirnov distances over the slices: median, mean, max, min.

    Shape (statistic, factor, component).
    """
    slices = [_slices(column, count) for column in factors.T]
    indices = np.empty((4, len(slices), values.shape[1]))
    for component, column in enumerate(values.T):
        ordered = np.sort(column)
        whole = np.searchsorted(ordered, ordered, side="right") / ordered.size
        for factor, parts in enumerate(slices):
            shares = [np.searchsorted(np.sort(column[rows]), ordered, side="right") / rows.size for rows in parts]
            gaps = [np.abs(share - whole).max() for share in shares]
            indices[:, factor, component] = np.median(gaps), np.mean(gaps), np.max(gaps), np.min(gaps)
    return indices


def _estimate(sample: Sample, table: OutputTable, components: IntArray, settings: SensitivitySettings) -> Answers:
    count = settings.slices if isinstance(settings, PawnSettings) else PawnSettings().slices
    factors, values = with_chance(sample, settings.seed), table.values[:, components]
    whole = _indices(values, factors, count)
    halves = [
        _indices(values[rows], factors[rows], count)[:, :-1]
        for rows in random_halves(len(values), settings.resamples, settings.seed)
    ]
    half = half_width(np.stack(halves), settings.confidence)
    return {
        "median": whole[0, :-1],
        "median_conf": half[0],
        "mean": whole[1, :-1],
        "mean_conf": half[1],
        "maximum": whole[2, :-1],
        "maximum_conf": half[2],
        "minimum": whole[3, :-1],
        "chance": whole[0, -1],
    }


METHOD = Method(
    _estimate,
    designs=SAMPLED_DESIGNS,
    ranked="median",
    meanings={
        "median": "PAWN index, median over slices",
        "mean": "PAWN index, mean over slices",
        "maximum": "PAWN index, largest of the slices",
        "minimum": "PAWN index, smallest of the slices",
        "chance": "index of a factor that is pure chance",
    },
    dims={"chance": ()},
    threshold="chance",
    independent=False,
)


@makes_kind("pawn")
def pawn_indices(cube: xr.Dataset, settings: PawnSettings | None = None) -> xr.Dataset:
    """PAWN indices (Pianosi and Wagener 2018).

    Parameters
    ----------
    cube
        Cube of a sampled design; its factors may be correlated.
    settings
        Outputs, number of slices, and level of the intervals.

    Returns
    -------
    xarray.Dataset
        median, mean, maximum with intervals, minimum (factor, and the dimensions of the output), and chance, the median
        of a factor without effect; see `method.apply`.

    Raises
    ------
    InputError
        If the cube is of another design, or too few points are left.
    """
    return apply(METHOD, cube, settings or PawnSettings())
