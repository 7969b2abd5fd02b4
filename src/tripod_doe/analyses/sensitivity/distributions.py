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

from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.outputs import OutputTable
from tripod_doe.analyses.resampling import half_width, random_halves
from tripod_doe.analyses.sample import Sample
from tripod_doe.analyses.sensitivity.method import Answers, Method, apply
from tripod_doe.analyses.settings import SensitivitySettings
from tripod_doe.array_types import FloatArray, IntArray

_DENSITY_POINTS = 100  # at which densities are compared: SALib's number
_DELTA_POINTS = 4096  # a density from more points is no better known, and each costs a sum over all


class PawnSettings(SensitivitySettings):
    """[analysis.NAME] of kind pawn."""

    resamples: int = Field(20, ge=10, description="random halves for the intervals")
    slices: int = Field(10, ge=2, le=1000, description="slices of a factor's range, of equally many points")


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


def _slices(column: FloatArray, count: int) -> NDArray[np.int16]:
    """Which slice each point is in, -1 for the largest: SALib's slices are open above."""
    step = 1 / count
    edges = np.nanquantile(column, np.arange(0, 1 + step, step)[: count + 1])
    place = np.searchsorted(edges, column, side="right") - 1
    return np.where(place >= count, -1, place).astype(np.int16)  # of few bits: sorted in linear time


def _equal_values(ordered: FloatArray) -> tuple[IntArray, IntArray]:
    """Places of the first and of the last of the values that equal each of some ordered ones, shape (point,) each."""
    first = np.flatnonzero(np.append(True, np.diff(ordered) > 0))
    many = np.diff(np.append(first, ordered.size))
    return np.repeat(first, many), np.repeat(first + many - 1, many)


def _largest_gaps(
    slices: NDArray[np.int16], count: int, order: IntArray, equal: tuple[IntArray, IntArray]
) -> FloatArray:
    """Kolmogorov-Smirnov distance of the output in each slice to that of all points, shape (slice,).

    `order` sorts the output, and `equal` has the first and last place of the values that equal each. The distance is
    largest at or just before a value of the slice.
    """
    outside, *sizes = np.bincount(slices + 1, minlength=count + 1)
    places = np.argsort(slices[order], kind="stable")[outside:]  # slice by slice, each in order
    members = np.repeat(sizes, sizes)
    starts = np.cumsum(sizes) - sizes
    first, last = (each[places] for each in equal)
    up_to, below = _counts(np.repeat(np.arange(count), sizes) * order.size + last, np.repeat(starts, sizes))
    gap = np.maximum(np.abs(up_to / members - (last + 1) / order.size), np.abs(below / members - first / order.size))
    filled = np.asarray(sizes) > 0
    gaps = np.full(count, np.nan)
    gaps[filled] = np.maximum.reduceat(gap, starts[filled])
    return gaps


def _counts(keys: IntArray, starts: IntArray) -> tuple[IntArray, IntArray]:
    """How many of a slice's ordered values are up to each, and how many are below it."""
    if (np.diff(keys) > 0).all():
        below = np.arange(keys.size) - starts
        return below + 1, below
    return np.searchsorted(keys, keys, side="right") - starts, np.searchsorted(keys, keys, side="left") - starts


def _pawn_of(values: FloatArray, known: FloatArray, count: int) -> FloatArray:
    """Statistics of the gaps over the slices, shape (statistic, factor, component): median, mean, max, min."""
    slices = [_slices(column, count) for column in known.T]
    found = np.empty((4, len(slices), values.shape[1]))
    for component, column in enumerate(values.T):
        order = np.argsort(column, kind="stable")
        equal = _equal_values(column[order])
        for at, each in enumerate(slices):
            gaps = _largest_gaps(each, count, order, equal)
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
        "median": whole[0, :-1],
        "median_conf": half[0],
        "mean": whole[1, :-1],
        "mean_conf": half[1],
        "maximum": whole[2, :-1],
        "maximum_conf": half[2],
        "minimum": whole[3, :-1],
        "chance": whole[0, -1],
    }


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
