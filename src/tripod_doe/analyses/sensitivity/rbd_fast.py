"""RBD-FAST: first-order indices from Fourier series over any sample of independent factors.

Indices are equal to SALib's to rounding, for all outputs at once.
"""

from collections.abc import Sequence

import numpy as np

from tripod_doe.analyses.bootstrap import half_width, random_halves
from tripod_doe.analyses.output_table import OutputTable
from tripod_doe.analyses.sensitivity.method import Answers, Method, analysis_of
from tripod_doe.analyses.settings import SensitivitySettings
from tripod_doe.analyses.usable_points import SAMPLED_DESIGNS, Sample
from tripod_doe.array_types import FloatArray, IntArray

_RBD_HARMONICS = 10  # of the ordered output that count as the factor's, as in SALib
_MOST_LEVELS = (
    2 * _RBD_HARMONICS + 1
)  # of a factor whose index comes from the means at its levels: harmonics miss jumps

FEWEST = 60
"""Points that it needs: halves of fewer are hardly more than the numbers that describe a factor."""


def _rbd_fast(sample: Sample, table: OutputTable, components: IntArray, settings: SensitivitySettings) -> Answers:
    parts, count = table.parts(components), sample.rows.size
    columns = sample.ranks.T
    halves = [
        _indices(parts[:, half], [column[half] for column in columns])[0]
        for half in random_halves(count, settings.resamples, settings.seed)
    ]
    index, beyond = _indices(parts, columns)
    # the harmonics beyond those of a course with jumps fall with their squares: as much again as the next ones
    return {"S1": index, "S1_conf": half_width(np.stack(halves), settings.confidence) + 2 * beyond}


def _indices(parts: FloatArray, columns: Sequence[FloatArray] | FloatArray) -> tuple[FloatArray, FloatArray]:
    """First-order indices of the factors, bias removed (Tissot and Prieur 2012), and what the next harmonics would add.

    Args:
        parts: Shape (part, point, component).
        columns: Ranks of each factor, shape (point,).

    Returns:
        Two arrays of shape (factor, component).
    """
    count = parts.shape[1]
    centred = parts - parts.mean(axis=1, keepdims=True)
    whole = (centred**2).mean(axis=1).sum(axis=0)
    index, beyond = np.empty((len(columns), parts.shape[2])), np.zeros((len(columns), parts.shape[2]))
    for factor, column in enumerate(columns):
        levels, at = np.unique(column, return_inverse=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            if levels.size <= _MOST_LEVELS:
                means = (np.eye(levels.size)[at].T @ centred) / np.bincount(at)[:, None]
                own, share = (means[:, at] ** 2).mean(axis=1).sum(axis=0) / whole, (levels.size - 1) / (count - 1)
            else:
                share = 2 * _RBD_HARMONICS / count
                power = _power(centred, np.argsort(column, kind="quicksort")) / whole
                own, more = power[:_RBD_HARMONICS].sum(axis=0), power[_RBD_HARMONICS:].sum(axis=0)
                if share < 0.5:  # in 40 points and fewer, as in half of few, no harmonics are left that show chance
                    by_chance = share / (1 - 2 * share) * (1 - own - more)
                    beyond[factor] = np.maximum(more - by_chance, 0) / (1 - share)
        index[factor] = own - share / (1 - share) * (1 - own)
    return index, beyond


def _power(centred: FloatArray, order: IntArray) -> FloatArray:
    """Power of the harmonics of an output over a factor by which its points are ordered, shape (harmonic, component).

    The points go up along a factor by every second one and down by the others, so that the output is periodic (Plischke
    2010). Power is taken by products with cosines and sines; all harmonics together have the variance (Parseval).
    """
    count = centred.shape[1]
    turns = 2 * np.pi / count * np.arange(count)[:, None] * np.arange(1, 2 * _RBD_HARMONICS + 1)
    placed = centred[:, np.concatenate([order[::2], order[1::2][::-1]])]
    return np.asarray(
        sum(2 / count**2 * ((wave.T @ placed) ** 2).sum(axis=0) for wave in (np.cos(turns), np.sin(turns)))
    )


METHOD = Method(
    _rbd_fast, designs=SAMPLED_DESIGNS, ranked="S1", meanings={"S1": "first-order Sobol' index"}, fewest=FEWEST
)

rbd_fast_indices = analysis_of(
    METHOD, "rbd-fast", "First-order Sobol' indices by RBD-FAST (Tarantola, Gatelli and Mara 2006)."
)
