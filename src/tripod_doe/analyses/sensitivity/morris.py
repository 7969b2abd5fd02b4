"""Elementary effects from Morris' trajectories and derivatives from finite differences, vectorised over outputs.

Equal to SALib's to rounding, except the interval of the derivative measure: SALib's is that of the mean squared
derivative, ours that of the measure itself.
"""

from __future__ import annotations

import numpy as np
import xarray as xr

from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.outputs import OutputTable
from tripod_doe.analyses.resampling import bootstrap_weights, half_width
from tripod_doe.analyses.sample import Sample
from tripod_doe.analyses.sensitivity.method import Answers, Method, apply
from tripod_doe.analyses.settings import SensitivitySettings
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.study.designs import factor_groups


class MorrisSettings(SensitivitySettings):
    """[analysis.NAME] of kind morris."""

    precision: float = 0.1


class DgsmSettings(SensitivitySettings):
    """[analysis.NAME] of kind dgsm."""

    precision: float = 0.1


def _changes(sample: Sample, table: OutputTable, components: IntArray) -> FloatArray:
    """Values in blocks, shape (block, row, component)."""
    return table.values[:, components].reshape(sample.blocks, sample.block, components.size)


def _wrapped(difference: FloatArray, wraps: bool) -> FloatArray:
    """Differences of phases by the shorter way."""
    return (difference + 180) % 360 - 180 if wraps else difference


def _morris(sample: Sample, table: OutputTable, components: IntArray, settings: SensitivitySettings) -> Answers:
    groups = factor_groups(sample.tables)
    moves = np.diff(sample.unit.reshape(sample.blocks, sample.block, -1), axis=1)
    steps = _wrapped(np.diff(_changes(sample, table, components), axis=1), table.wraps)
    every, names = np.arange(sample.blocks), list(sample.tables)
    effects, single = [], []
    for members in groups.values():
        own = moves[:, :, names.index(members[0])]
        at = np.abs(own).argmax(axis=1)  # the step of the trajectory in which this group changes
        effects.append(steps[every, at] * np.sign(own[every, at])[:, None])
        single.append(len(members) == 1)
    levels = sample.design.levels or 4
    effect = np.stack(effects) / (levels / (2 * (levels - 1)))  # per whole range; (group, trajectory, component)
    alone = np.where(single, 1.0, np.nan)[:, None]  # members of a group may move against each other: no sign
    answers = {
        "mu": effect.mean(axis=1) * alone,
        "mu_star": np.abs(effect).mean(axis=1),
        "sigma": effect.std(axis=1, ddof=1) * alone,
    }
    random = np.random.default_rng(settings.seed)
    half = [half_width(_drawn_means(np.abs(each), random, settings.resamples), settings.confidence) for each in effect]
    return answers | {"mu_star_conf": np.stack(half), "size": answers["mu_star"]}


def _drawn_means(values: FloatArray, random: np.random.Generator, resamples: int) -> FloatArray:
    """Means of resamples, shape (resample, component), with SALib's draws."""
    drawn = random.integers(len(values), size=(resamples, len(values)))
    weights = np.stack([np.bincount(row, minlength=len(values)) for row in drawn]) / len(values)
    return weights @ values


def _dgsm(sample: Sample, table: OutputTable, components: IntArray, settings: SensitivitySettings) -> Answers:
    values = _changes(sample, table, components)
    unit = sample.unit.reshape(sample.blocks, sample.block, -1)
    weights = bootstrap_weights(sample.blocks, settings.resamples, settings.seed)
    weights = np.concatenate([np.full((1, sample.blocks), 1 / sample.blocks), weights])
    base = values[:, 0] - values[:, 0].mean(axis=0)
    variance = weights @ base**2 - (weights @ base) ** 2
    found = []
    for at in range(len(sample.tables)):
        change = _wrapped(values[:, 1 + at] - values[:, 0], table.wraps)
        slope = change / (unit[:, 1 + at, at] - unit[:, 0, at])[:, None]
        found.append(weights @ slope**2)
    squared = np.stack(found)  # (factor, resample, component)
    with np.errstate(invalid="ignore", divide="ignore"):
        measure = squared / (np.pi**2 * np.where(variance > 0, variance, np.nan))
    return {
        "vi": squared[:, 0],
        "vi_conf": half_width(np.moveaxis(squared[:, 1:], 1, 0), settings.confidence),
        "dgsm": measure[:, 0],
        "dgsm_conf": half_width(np.moveaxis(measure[:, 1:], 1, 0), settings.confidence),
        "size": np.sqrt(squared[:, 0]),
    }


MORRIS = Method(
    _morris,
    designs=("morris",),
    ranked="mu_star",
    meanings={
        "mu": "mean elementary effect",
        "mu_star": "mean magnitude of the elementary effects",
        "sigma": "standard deviation of the elementary effects",
    },
    pure=False,
)

DGSM = Method(
    _dgsm,
    designs=("finite-differences",),
    ranked="dgsm",
    meanings={
        "dgsm": "upper bound of the total Sobol' index from derivatives",
        "vi": "mean squared derivative over the quantile of the factor",
    },
    pure=False,
)


@makes_kind("morris")
def morris_effects(cube: xr.Dataset, settings: MorrisSettings | None = None) -> xr.Dataset:
    """Morris' elementary effects: mean mu, mean of magnitudes mu_star with its interval, standard deviation sigma.

    Effects are per whole range of a factor, in the unit of the output; estimators of Campolongo (2007). Of a group of
    factors there is only mu_star.

    Parameters
    ----------
    cube
        Cube of a morris design.
    settings
        Which outputs, and the level of the intervals.

    Returns
    -------
    xarray.Dataset
        mu, mu_star, mu_star_conf, sigma (factor, and the dimensions of the output); see `method.apply`.

    Raises
    ------
    InputError
        If the cube is of another design, or too few complete trajectories are left.
    """
    return apply(MORRIS, cube, settings or MorrisSettings())


@makes_kind("dgsm")
def derivative_measures(cube: xr.Dataset, settings: DgsmSettings | None = None) -> xr.Dataset:
    """Derivative-based measures: vi = E[(dY / du)^2] over the quantile u of a factor, and dgsm = vi / (pi^2 V[Y]).

    A total Sobol' index is at most dgsm (Sobol' and Kucherenko 2009); over quantiles this holds for any distribution.

    Parameters
    ----------
    cube
        Cube of a finite-differences design.
    settings
        Which outputs, and the level of the intervals.

    Returns
    -------
    xarray.Dataset
        vi, vi_conf, dgsm, dgsm_conf (factor, and the dimensions of the output); see `method.apply`.

    Raises
    ------
    InputError
        If the cube is of another design, or too few complete blocks are left.
    """
    return apply(DGSM, cube, settings or DgsmSettings())
