"""Moment-independent indices of any sample: PAWN from distribution functions, Borgonovo's delta from densities.

Both see an effect on the distribution as a whole. From few points they never vanish; a factor counts as resolved where
its index exceeds, by its interval, that of a factor that is pure chance.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from pydantic import Field

from tripod_doe.analysis.kinds import makes_kind
from tripod_doe.analysis.sensitivity.method import Answers, Method, apply
from tripod_doe.analysis.sensitivity.outputs import OutputTable
from tripod_doe.analysis.sensitivity.resampling import half_width, random_halves
from tripod_doe.analysis.sensitivity.sample import Sample
from tripod_doe.analysis.sensitivity.settings import SensitivitySettings

__all__ = ["SAMPLED_DESIGNS", "DeltaSettings", "PawnSettings", "borgonovo_delta", "pawn_indices"]

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

_DENSITY_POINTS = 100  # at which densities are compared: SALib's number
_DELTA_POINTS = 4096  # a density from more points is no better known, and each costs a sum over all


class PawnSettings(SensitivitySettings):
    """[analysis.NAME] of kind pawn."""

    resamples: int = Field(20, ge=10, description="random halves for the intervals")
    slices: int = Field(10, ge=2, description="slices of a factor's range, of equally many points")


class DeltaSettings(SensitivitySettings):
    """[analysis.NAME] of kind delta."""

    resamples: int = Field(20, ge=10, description="random halves for the intervals")


def _with_chance(sample: Sample, seed: int) -> FloatArray:
    """Values of the factors, of words their numbers, and of one more that is pure chance, shape (point, factor + 1)."""
    columns = [
        column.astype(float) if column.dtype.kind in "fiu" else np.unique(column, return_inverse=True)[1].astype(float)
        for column in sample.columns.values()
    ]
    return np.stack([*columns, np.random.default_rng(seed).random(sample.rows.size)], axis=1)


def _slices(column: FloatArray, count: int) -> IntArray:
    """Which slice each point is in, -1 for the largest: SALib's slices are open above."""
    step = 1 / count
    edges = np.nanquantile(column, np.arange(0, 1 + step, step)[: count + 1])
    place = np.searchsorted(edges, column, side="right") - 1
    return np.where(place >= count, -1, place)


def _largest_gaps(slices: IntArray, count: int, order: IntArray, last: NDArray[np.bool_]) -> FloatArray:
    """Kolmogorov-Smirnov distance of the output in each slice to that of all points, shape (slice,).

    `order` sorts the output, and `last` marks the last of equal values.
    """
    ordered, size = slices[order], order.size
    gaps = np.full(count, np.nan)
    every = np.arange(1, size + 1) / size
    for at in range(count):
        inside = ordered == at
        if inside.any():
            own = np.cumsum(inside) / inside.sum()
            gaps[at] = np.abs(own - every)[last].max()
    return gaps


def _pawn_of(values: FloatArray, known: FloatArray, count: int) -> FloatArray:
    """Statistics of the gaps over the slices, shape (statistic, factor, component): median, mean, max, min."""
    slices = [_slices(column, count) for column in known.T]
    found = np.empty((4, len(slices), values.shape[1]))
    for component, column in enumerate(values.T):
        order = np.argsort(column, kind="stable")
        last = np.append(np.diff(column[order]) > 0, True)
        for at, each in enumerate(slices):
            gaps = _largest_gaps(each, count, order, last)
            found[:, at, component] = np.nanmedian(gaps), np.nanmean(gaps), np.nanmax(gaps), np.nanmin(gaps)
    return found


def _pawn(sample: Sample, table: OutputTable, components: IntArray, settings: SensitivitySettings) -> Answers:
    count = settings.slices if isinstance(settings, PawnSettings) else PawnSettings().slices
    known, values = _with_chance(sample, settings.seed), table.values[:, components]
    whole = _pawn_of(values, known, count)
    halves = [
        _pawn_of(values[rows], known[rows], count)[:, :-1]
        for rows in random_halves(len(values), settings.resamples, settings.seed)
    ]
    half = half_width(np.stack(halves), settings.confidence)
    return {
        "median": whole[0, :-1], "median_conf": half[0], "mean": whole[1, :-1], "mean_conf": half[1],
        "maximum": whole[2, :-1], "maximum_conf": half[2], "minimum": whole[3, :-1], "chance": whole[0, -1],
    }  # fmt: skip


def _classes(column: FloatArray) -> list[IntArray]:
    """Points in classes of equally many, as Plischke, Borgonovo and Smith (2013) number them."""
    count = column.size
    exponent = 2.0 / (7.0 + np.tanh((1500.0 - count) / 500.0))
    number = int(np.round(min(int(np.ceil(count**exponent)), 48)))
    order = np.argsort(column, kind="stable")
    edges = np.linspace(0, count, number + 1)
    return [order[int(np.floor(low)) : int(np.floor(high))] for low, high in pairwise(edges)]


def _density(values: FloatArray, at: FloatArray) -> FloatArray:
    """Kernel density of numbers, with Silverman's width as scipy has it."""
    count = values.size
    width = values.std(ddof=1) * (count * 3 / 4) ** -0.2
    scaled = (at[:, None] - values) / width
    density: FloatArray = np.exp(-0.5 * scaled**2).sum(axis=1) / (count * width * np.sqrt(2 * np.pi))
    return density


def _delta_of(values: FloatArray, known: FloatArray) -> FloatArray:
    """Half the mean distance of the density in a class to that of all points, shape (factor, component)."""
    classes = [_classes(column) for column in known.T]
    found = np.zeros((len(classes), values.shape[1]))
    for component, column in enumerate(values.T):
        at = np.linspace(column.min(), column.max(), _DENSITY_POINTS)
        whole = _density(column, at)
        for factor, groups in enumerate(classes):
            for rows in groups:
                inside = column[rows]
                if rows.size > 1 and np.ptp(inside) > 0:
                    gap = np.trapezoid(np.abs(whole - _density(inside, at)), at)
                    found[factor, component] += rows.size / (2 * column.size) * gap
    return found


def _delta(sample: Sample, table: OutputTable, components: IntArray, settings: SensitivitySettings) -> Answers:
    rows = np.arange(min(sample.rows.size, _DELTA_POINTS))
    known, values = _with_chance(sample, settings.seed)[rows], table.values[rows][:, components]
    whole = _delta_of(values, known)
    halves = [
        _delta_of(values[half], known[half]) for half in random_halves(rows.size, settings.resamples, settings.seed)
    ]
    return {
        "delta": whole[:-1],
        "delta_conf": half_width(np.stack(halves)[:, :-1], settings.confidence),
        "chance": whole[-1],
    }


SAMPLED_DESIGNS = ("latin-hypercube", "sobol", "halton", "rbd-fast")
"""Designs whose points each stand alone and follow the distributions of the factors."""

PAWN = Method(
    _pawn,
    designs=SAMPLED_DESIGNS,
    ranked="median",
    meanings={
        "median": "PAWN index, median over slices", "mean": "PAWN index, mean over slices",
        "maximum": "PAWN index, largest of the slices", "minimum": "PAWN index, smallest of the slices",
        "chance": "index of a factor that is pure chance",
    },
    dims={"chance": ()},
    threshold="chance",
    independent=False,
)  # fmt: skip

DELTA = Method(
    _delta,
    designs=SAMPLED_DESIGNS,
    ranked="delta",
    meanings={"delta": "Borgonovo's delta", "chance": "index of a factor that is pure chance"},
    dims={"chance": ()},
    threshold="chance",
    independent=False,
)


@makes_kind("pawn")
def pawn_indices(cube: xr.Dataset, settings: PawnSettings | None = None) -> xr.Dataset:
    """PAWN indices: how far the distribution of an output moves where a factor is held within a slice of its range.

    Kolmogorov-Smirnov distances, equal to SALib's (Pianosi and Wagener 2018).

    Parameters
    ----------
    cube
        Cube of a sampled design; its factors may be correlated.
    settings
        Which outputs, how many slices, and the level of the intervals.

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
    return apply(PAWN, cube, settings or PawnSettings())


@makes_kind("delta")
def borgonovo_delta(cube: xr.Dataset, settings: DeltaSettings | None = None) -> xr.Dataset:
    """Borgonovo's delta: half the mean area between the density of an output and that with a factor known.

    The estimator of Plischke, Borgonovo and Smith (2013) as SALib has it, without its correction by resampling; from
    the first 4096 points, since its cost grows with their square.

    Parameters
    ----------
    cube
        Cube of a sampled design; its factors may be correlated.
    settings
        Which outputs, and the level of the intervals.

    Returns
    -------
    xarray.Dataset
        delta, delta_conf (factor, and the dimensions of the output), and chance, the delta of a factor without effect;
        see `method.apply`.

    Raises
    ------
    InputError
        If the cube is of another design, or too few points are left.
    """
    return apply(DELTA, cube, settings or DeltaSettings())
