"""PAWN: how far the distribution function of an output moves when a factor is known to lie in a slice of its range.

Indices equal SALib's, which calls scipy's test with its p-value for each slice, factor and output: with 8 outputs
and the same intervals 5, 101 and 76 s in place of 0.4, 1.1 and 10 s at 1,024, 8,192 and 65,536 points.

From few points an index never vanishes, and its bias is larger than its scatter: intervals by resampling, said to hold
in 95 %, held in 38 to 98 %. So it has none. A factor counts as resolved where its index exceeds the index of 19 factors
without effect, drawn at random, which by chance one in twenty does (a Monte Carlo test, Besag and Diggle 1977).
"""

import math

import numpy as np
from pydantic import Field

from tripod_doe.analyses.encoding import as_numbers
from tripod_doe.analyses.output_table import OutputTable
from tripod_doe.analyses.sensitivity.method import Answers, Method, analysis_of
from tripod_doe.analyses.settings import IntervalSettings
from tripod_doe.analyses.usable_points import SAMPLED_DESIGNS, Sample
from tripod_doe.array_types import FloatArray, IntArray


class ChanceSettings(IntervalSettings):
    """Settings of an analysis that compares its indices with factors that are pure chance."""

    confidence: float = Field(0.95, gt=0, lt=1, description="chance that a factor without effect is not resolved")
    seed: int = Field(0, ge=0, description="seed of the factors that are pure chance")


class PawnSettings(ChanceSettings):
    """[analysis.NAME] of kind pawn."""

    slices: int = Field(10, ge=2, le=1000, description="slices of a factor's range, of equally many points")


def with_chance(sample: Sample, settings: ChanceSettings) -> tuple[FloatArray, int]:
    """Values of the factors and of more that are pure chance, shape (point, column), and the number of factors.

    The largest index of n columns without effect exceeds one more in n / (n + 1) of all cases, the confidence.
    """
    columns = [as_numbers(column) for column in sample.columns.values()]
    count = max(math.ceil(1 / (1 - settings.confidence) - 1e-9) - 1, 1)
    chance = np.random.default_rng(settings.seed).random((sample.rows.size, count))
    return np.concatenate([np.stack(columns, axis=1), chance], axis=1), len(columns)


def _slices(column: FloatArray, count: int) -> list[IntArray]:
    """Points of each slice that has any; as in SALib, slices are open above, so the largest value is in none.

    A largest value of several points is a level, and a slice.
    """
    step = 1 / count
    edges = np.nanquantile(column, np.arange(0, 1 + step, step)[: count + 1])
    place = np.searchsorted(edges, column, side="right") - 1
    return [rows for number in range(count + 1) if (rows := np.flatnonzero(place == number)).size > (number == count)]


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


def _estimate(sample: Sample, table: OutputTable, components: IntArray, settings: PawnSettings) -> Answers:
    factors, own = with_chance(sample, settings)
    indices = _indices(table.values[:, components], factors, settings.slices)
    statistics = dict(zip(("median", "mean", "maximum", "minimum"), indices[:, :own], strict=True))
    return {**statistics, "chance": indices[0, own:].max(axis=0)}


METHOD = Method(
    _estimate,
    designs=SAMPLED_DESIGNS,
    ranked="median",
    meanings={
        "median": "PAWN index, median over slices",
        "mean": "PAWN index, mean over slices",
        "maximum": "PAWN index, largest of the slices",
        "minimum": "PAWN index, smallest of the slices",
        "chance": "largest index of factors that are pure chance",
    },
    dims={"chance": ()},
    threshold="chance",
    independent=False,
)

pawn_indices = analysis_of(METHOD, "pawn", "PAWN indices (Pianosi and Wagener 2018).", PawnSettings)
