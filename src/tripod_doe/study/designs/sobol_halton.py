"""Sobol' and Halton sequences of scipy.stats.qmc."""

import warnings
from collections.abc import Mapping

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.study.definition.study_file_schema import DesignTable, FactorTable
from tripod_doe.study.designs.sampling import sampled, samples_of

_LONGEST = 1 << 30  # points of a Sobol' sequence


def _sobol(table: DesignTable, tables: Mapping[str, FactorTable]) -> FloatArray:
    from scipy.stats import qmc

    if (count := samples_of(table)) > _LONGEST:
        raise InputError(f"samples = {count:,}: a Sobol' sequence has {_LONGEST:,} points")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "The balance properties")  # a number that is no power of two is the user's
        return np.asarray(qmc.Sobol(len(tables), scramble=table.scramble, rng=table.seed).random(count))


def _halton(table: DesignTable, tables: Mapping[str, FactorTable]) -> FloatArray:
    from scipy.stats import qmc

    return np.asarray(qmc.Halton(len(tables), scramble=table.scramble, rng=table.seed).random(samples_of(table)))


SEQUENCES = {"sobol": sampled(_sobol), "halton": sampled(_halton)}
"""The sequences by kind."""
