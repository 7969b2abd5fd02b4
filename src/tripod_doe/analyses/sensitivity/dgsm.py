"""Derivative-based measures from finite differences, for all outputs at once.

vi equals SALib's, which differentiates over the range of a factor instead of its quantile and states the interval of
the mean squared derivative, not of the measure itself.
"""

import numpy as np
import xarray as xr

from tripod_doe.analyses.bootstrap import bootstrap_weights, half_width
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.output_table import OutputTable
from tripod_doe.analyses.sensitivity.method import Answers, Method, apply
from tripod_doe.analyses.sensitivity.morris import values_in_blocks
from tripod_doe.analyses.settings import Precision, SensitivitySettings
from tripod_doe.analyses.usable_points import Sample
from tripod_doe.array_types import IntArray

_STILL = 1e-9  # of the steepest slope, up to which there is none


class DgsmSettings(SensitivitySettings):
    """[analysis.NAME] of kind dgsm."""

    precision: Precision = 0.1


def _dgsm(sample: Sample, table: OutputTable, components: IntArray, settings: SensitivitySettings) -> Answers:
    values = values_in_blocks(sample, table, components)
    unit = sample.unit.reshape(sample.blocks, sample.block, -1)
    weights = bootstrap_weights(sample.blocks, settings.resamples, settings.seed)
    weights = np.concatenate([np.full((1, sample.blocks), 1 / sample.blocks), weights])
    base = values[:, 0] - values[:, 0].mean(axis=0)
    variance = weights @ base**2 - (weights @ base) ** 2
    squares, flat = [], np.zeros(components.size, bool)
    for at in range(len(sample.tables)):
        change = table.changes(values[:, 1 + at] - values[:, 0])
        slope = change / (unit[:, 1 + at, at] - unit[:, 0, at])[:, None]
        squares.append(weights @ slope**2)
        still = np.abs(slope) <= _STILL * np.abs(slope).max(axis=0)
        flat |= (still.mean(axis=0) > 0.5) & ~still.all(axis=0)  # but for few blocks: they met a jump
    squared = np.stack(squares)  # (factor, resample, component)
    with np.errstate(invalid="ignore", divide="ignore"):
        measure = squared / (np.pi**2 * np.where(variance > 0, variance, np.nan))
    half = half_width(np.moveaxis(measure[:, 1:], 1, 0), settings.confidence)
    # all bounds together are at least one (Poincare's inequality), unless the output jumps between the steps
    seen = np.where(((measure[:, 0] + half).sum(axis=0) >= 1) & ~flat, 1.0, np.nan)
    return {
        "vi": squared[:, 0],
        "vi_conf": half_width(np.moveaxis(squared[:, 1:], 1, 0), settings.confidence),
        "dgsm": measure[:, 0] * seen,
        "dgsm_conf": half * seen,
        "size": np.sqrt(squared[:, 0]),
    }


METHOD = Method(
    _dgsm,
    designs=("finite-differences",),
    ranked="dgsm",
    meanings={
        "dgsm": "upper bound of the total Sobol' index from derivatives",
        "vi": "mean squared derivative over the quantile of the factor",
    },
    pure=False,
)


@makes_kind("dgsm")
def derivative_measures(cube: xr.Dataset, settings: DgsmSettings | None = None) -> xr.Dataset:
    """Derivative-based measures: vi = E[(dY / du)^2] over the quantile u of a factor, and dgsm = vi / (pi^2 V[Y]).

    A total Sobol' index is at most dgsm (Sobol' and Kucherenko 2009); over quantiles this holds for any distribution.

    Returns:
        vi, vi_conf, dgsm, dgsm_conf (factor, and the dimensions of the output); see `method.apply`. dgsm is NaN where
        an output jumps: its derivatives explain less than its variance, or vanish but for a few blocks.

    Raises:
        InputError: If the cube is of another design, or too few complete blocks are left.
    """
    return apply(METHOD, cube, settings or DgsmSettings())
