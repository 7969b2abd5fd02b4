"""Sampled designs: points on the unit cube by scipy.stats.qmc and SALib, then the distributions of the factors.

All sequences and blocks are prefix-stable: more samples keep the points that were there. A latin hypercube is not, as
its strata are those of its number of samples.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import InputError
from tripod_doe.study.designs.correlation import correlated, correlation_matrix
from tripod_doe.study.designs.request import Family, Made, Request, factor_groups
from tripod_doe.study.distributions import is_unbounded, quantile
from tripod_doe.study.file import DesignTable, FactorTable

__all__ = ["CURVE_HARMONICS", "SAMPLED", "salib_problem", "unit_sample"]

FloatArray = NDArray[np.float64]
Sampler = Callable[[DesignTable, Mapping[str, FactorTable]], Any]

CURVE_HARMONICS = 4
"""Harmonics M of a factor's frequency that FAST counts as its own; a curve needs more than 4 M^2 samples."""

_INDICES = "its indices divide the variance among independent factors"


def salib_problem(tables: Mapping[str, FactorTable]) -> dict[str, Any]:
    """SALib's description of factors on the unit cube; distributions are applied by `quantile`."""
    problem = {"num_vars": len(tables), "names": list(tables), "bounds": [[0.0, 1.0]] * len(tables)}
    if any(table.group for table in tables.values()):
        problem["groups"] = [table.group or name for name, table in tables.items()]
    return problem


def _samples(table: DesignTable) -> int:
    if table.samples is None:
        raise InputError(f"a {table.kind} design needs samples")
    return table.samples


def _latin_hypercube(table: DesignTable, tables: Mapping[str, FactorTable]) -> Any:
    from scipy.stats import qmc

    optimisation = "random-cd" if table.optimised else None  # centred discrepancy, by exchanging coordinates
    return qmc.LatinHypercube(len(tables), optimization=optimisation, rng=table.seed).random(_samples(table))


def _sobol(table: DesignTable, tables: Mapping[str, FactorTable]) -> Any:
    from scipy.stats import qmc

    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*power of 2.*")  # any count is allowed here
        return qmc.Sobol(len(tables), scramble=table.scramble, rng=table.seed).random(_samples(table))


def _halton(table: DesignTable, tables: Mapping[str, FactorTable]) -> Any:
    from scipy.stats import qmc

    return qmc.Halton(len(tables), scramble=table.scramble, rng=table.seed).random(_samples(table))


def _saltelli(table: DesignTable, tables: Mapping[str, FactorTable]) -> Any:
    from SALib.sample import sobol

    count = _samples(table)
    if count & (count - 1):
        raise InputError(
            f"samples = {count}: a saltelli design needs a power of 2, for instance {1 << count.bit_length()}"
        )
    parts, problem = table.scramblings, salib_problem(tables)
    if parts & (parts - 1) or parts >= count:
        raise InputError(f"scramblings = {parts}: it must be a power of 2 below samples = {count}")
    seeds = [table.seed] if parts == 1 else np.random.default_rng(table.seed).integers(2**31, size=parts).tolist()
    sequences = [
        sobol.sample(problem, count // parts, calc_second_order=table.second_order, seed=seed) for seed in seeds
    ]
    blocks = np.stack([sequence.reshape(count // parts, -1, len(tables)) for sequence in sequences], axis=1)
    return blocks.reshape(-1, len(tables))  # one block of each scrambling after the other, so that a part has all


def _morris(table: DesignTable, tables: Mapping[str, FactorTable]) -> Any:
    from SALib.sample import morris

    return morris.sample(salib_problem(tables), _samples(table), num_levels=table.levels or 4, seed=table.seed)


def _fast(table: DesignTable, tables: Mapping[str, FactorTable]) -> Any:
    from SALib.sample import fast_sampler

    least = 4 * CURVE_HARMONICS**2 + 1
    if _samples(table) < least:
        raise InputError(f"samples = {table.samples}: a fast design needs at least {least} on each curve")
    return fast_sampler.sample(salib_problem(tables), _samples(table), M=CURVE_HARMONICS, seed=table.seed)


def _rbd_fast(table: DesignTable, tables: Mapping[str, FactorTable]) -> Any:
    from SALib.sample import latin

    return latin.sample(salib_problem(tables), _samples(table), seed=table.seed)


def _finite_differences(table: DesignTable, tables: Mapping[str, FactorTable]) -> Any:
    from SALib.sample import finite_diff

    return finite_diff.sample(salib_problem(tables), _samples(table))


_SAMPLERS: dict[str, Sampler] = {
    "latin-hypercube": _latin_hypercube,
    "sobol": _sobol,
    "halton": _halton,
    "saltelli": _saltelli,
    "morris": _morris,
    "fast": _fast,
    "rbd-fast": _rbd_fast,
    "finite-differences": _finite_differences,
}


def unit_sample(table: DesignTable, tables: Mapping[str, FactorTable]) -> FloatArray:
    """The points of a sampled design on the unit cube, shape (point, factor), before the factors are correlated.

    Parameters
    ----------
    table
        The design.
    tables
        Its factors by name, as the study file describes them.

    Raises
    ------
    InputError
        If the number of samples is missing, or not one that the design can have.
    """
    return np.asarray(_SAMPLERS[table.kind](table, tables), float)


def _make(request: Request) -> Made:
    """Sample, correlate, and apply the distributions."""
    table, factors = request.table, request.factors
    unbounded = [name for name, factor in factors.items() if is_unbounded(factor)]
    if table.kind in ("morris", "finite-differences") and unbounded:
        raise InputError(
            f"[factors.{unbounded[0]}]: {table.kind} needs bounded factors; use a truncated-normal distribution"
        )
    unit = unit_sample(table, request.tables)
    if table.correlation:
        unit = correlated(unit, correlation_matrix(table.correlation, list(factors)), table.kind == "latin-hypercube")
    return Made({name: quantile(factor, unit[:, at]) for at, (name, factor) in enumerate(factors.items())})


def _plain(uncorrelated: str = "") -> Family:
    return Family(_make, lambda request: request.table.samples or 0, uncorrelated=uncorrelated)


def _in_blocks(block: Callable[[DesignTable, int], int], grouped: bool = True, uncorrelated: str = _INDICES) -> Family:
    """Samples that come in blocks: one more point a factor or group, or a whole curve."""

    def count(request: Request) -> int:
        return (request.table.samples or 0) * block(request.table, len(factor_groups(request.tables)))

    return Family(_make, count, block, uncorrelated, grouped)


SAMPLED: dict[str, Family] = {
    "latin-hypercube": _plain(),
    "sobol": _plain(),
    "halton": _plain(),
    "saltelli": _in_blocks(lambda table, width: 2 * width + 2 if table.second_order else width + 2),
    "morris": _in_blocks(
        lambda table, width: width + 1, uncorrelated="each of its steps changes one factor, whatever the others are"
    ),
    "fast": Family(
        _make,
        lambda request: (request.table.samples or 0) * len(request.factors),
        lambda table, width: table.samples or 1,
        _INDICES,
    ),
    "rbd-fast": _plain(_INDICES),
    "finite-differences": _in_blocks(
        lambda table, width: width + 1,
        grouped=False,
        uncorrelated="each of its steps changes one factor, whatever the others are",
    ),
}
"""The sampled designs by kind."""
