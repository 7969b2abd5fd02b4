"""RBD-FAST: first-order indices from Fourier series over any sample of independent factors.

Indices are equal to SALib's to rounding, for all outputs at once.
"""

import numpy as np
import xarray as xr

from tripod_doe.analyses.bootstrap import half_width, random_halves
from tripod_doe.analyses.kinds import makes_kind
from tripod_doe.analyses.output_table import OutputTable
from tripod_doe.analyses.sensitivity.method import Answers, Method, apply
from tripod_doe.analyses.settings import SensitivitySettings
from tripod_doe.analyses.usable_points import SAMPLED_DESIGNS, Sample
from tripod_doe.array_types import FloatArray, IntArray

_RBD_HARMONICS = 10  # of the ordered output that count as the factor's, as in SALib


def _rbd_fast(sample: Sample, table: OutputTable, components: IntArray, settings: SensitivitySettings) -> Answers:
    parts, count = table.parts(components), sample.rows.size
    orders = [np.argsort(column, kind="quicksort") for column in sample.ranks.T]
    halves = []
    for half in random_halves(count, settings.resamples, settings.seed):
        mask, place = np.zeros(count, bool), np.empty(count, np.int64)
        mask[half] = True
        place[half] = np.arange(half.size)
        halves.append(_ordered_indices(parts[:, half], [place[order[mask[order]]] for order in orders]))
    index = _ordered_indices(parts, orders)
    return {"S1": index, "S1_conf": half_width(np.stack(halves), settings.confidence)}


def _ordered_indices(parts: FloatArray, orders: list[IntArray]) -> FloatArray:
    """First-order indices of the factors by which points are ordered, bias removed (Tissot and Prieur 2012).

    The points go up along a factor by every second one and down by the others, so that the output is periodic
    (Plischke 2010); its first harmonics are the factor's. Their power is taken by products with cosines and sines, that
    of all harmonics as the variance (Parseval). Shape (factor, component).
    """
    count = parts.shape[1]
    turns = 2 * np.pi / count * np.arange(count)[:, None] * np.arange(1, _RBD_HARMONICS + 1)
    waves = np.concatenate([np.cos(turns), np.sin(turns)], axis=1)
    centred = parts - parts.mean(axis=1, keepdims=True)
    own, placed = np.empty((len(orders), parts.shape[2])), np.empty_like(waves)
    for factor, order in enumerate(orders):
        placed[np.concatenate([order[::2], order[1::2][::-1]])] = waves
        own[factor] = 2 / count**2 * ((placed.T @ centred) ** 2).sum(axis=(0, 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        index = own / (centred**2).mean(axis=1).sum(axis=0)
    share = 2 * _RBD_HARMONICS / count
    return index - share / (1 - share) * (1 - index)


METHOD = Method(_rbd_fast, designs=SAMPLED_DESIGNS, ranked="S1", meanings={"S1": "first-order Sobol' index"})


@makes_kind("rbd-fast")
def rbd_fast_indices(cube: xr.Dataset, settings: SensitivitySettings | None = None) -> xr.Dataset:
    """First-order Sobol' indices by RBD-FAST (Tarantola, Gatelli and Mara 2006).

    Args:
        cube: Cube of an rbd-fast, latin-hypercube, sobol or halton design of independent factors.

    Returns:
        S1, S1_conf (factor, and the dimensions of the output); see `method.apply`.

    Raises:
        InputError: If the cube is of another design or its factors are correlated, or too few points are left.
    """
    return apply(METHOD, cube, settings or SensitivitySettings())
