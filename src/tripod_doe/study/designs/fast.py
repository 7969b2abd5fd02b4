"""Extended FAST: a search curve for each factor (Saltelli and others 1999); RBD-FAST: a latin hypercube. By SALib."""

from collections.abc import Mapping

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.study.definition.study_file_schema import DesignTable, FactorTable
from tripod_doe.study.designs.sampling import INDEPENDENT, salib_problem, sampled, samples_of

CURVE_HARMONICS = 4
"""Harmonics M of a factor's frequency that FAST counts as its own; a curve needs more than 4 M^2 samples."""

_DIGITS = 10
"""Sines of processors differ in their last digits; a design has the same points on all of them."""


def _fast(table: DesignTable, tables: Mapping[str, FactorTable]) -> FloatArray:
    from SALib.sample import fast_sampler

    least = 4 * CURVE_HARMONICS**2 + 1
    if samples_of(table) < least:
        raise InputError(f"samples = {table.samples}: a fast design needs at least {least} on each curve")
    made = fast_sampler.sample(salib_problem(tables), table.samples, M=CURVE_HARMONICS, seed=table.seed)
    return np.round(made, _DIGITS)


def _rbd_fast(table: DesignTable, tables: Mapping[str, FactorTable]) -> FloatArray:
    from SALib.sample import latin

    return np.asarray(latin.sample(salib_problem(tables), samples_of(table), seed=table.seed))


FAST = {
    "fast": sampled(
        _fast,
        INDEPENDENT,
        points=lambda table, width: width,
        block=lambda table, width: table.samples or 1,
        continuous=True,  # a step has more harmonics than count, at the frequencies of other factors
    ),
    "rbd-fast": sampled(_rbd_fast, INDEPENDENT),
}
"""FAST and RBD-FAST by kind."""
