"""Latin hypercubes of scipy.stats.qmc."""

from collections.abc import Mapping

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.study.definition.study_file_schema import DesignTable, FactorTable
from tripod_doe.study.designs.sampling import sampled, samples_of


def _latin_hypercube(table: DesignTable, tables: Mapping[str, FactorTable]) -> FloatArray:
    from scipy.stats import qmc

    return np.asarray(qmc.LatinHypercube(len(tables), rng=table.seed).random(samples_of(table)))


LATIN_HYPERCUBE = {"latin-hypercube": sampled(_latin_hypercube)}
"""The latin hypercube by its kind."""
