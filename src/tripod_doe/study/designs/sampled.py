"""Sampled designs: points on the unit cube by scipy.stats.qmc and SALib, then the distributions of the factors.

Points are made when they are asked for. Latin hypercubes, Morris' trajectories and correlated samples are held in
memory: each of their points follows from all others, or from those before. All sequences and blocks are prefix-stable:
more samples keep the points that were there. A latin hypercube is not: its strata are those of its number of samples.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.study.definition.factors import Factor
from tripod_doe.study.definition.study_file import DesignTable, FactorTable
from tripod_doe.study.designs.columns import Column, Columns, Rows, row_numbers
from tripod_doe.study.designs.correlation import correlated, correlation_matrix
from tripod_doe.study.designs.distributions import is_unbounded, quantile
from tripod_doe.study.designs.method_samples import CurveSample, DifferenceSample
from tripod_doe.study.designs.request import Family, Made, Request, factor_groups, held
from tripod_doe.study.designs.unit_samples import HaltonSample, HeldSample, SaltelliSample, SobolSample, UnitSample

Sampler = Callable[[DesignTable, Mapping[str, FactorTable]], UnitSample]

CURVE_HARMONICS = 4
"""Harmonics M of a factor's frequency that FAST counts as its own; a curve needs more than 4 M^2 samples."""

_CHUNK = 100_000  # points that are looked at together
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


def _latin_hypercube(table: DesignTable, tables: Mapping[str, FactorTable]) -> UnitSample:
    from scipy.stats import qmc

    optimisation = "random-cd" if table.optimised else None  # centred discrepancy, by exchanging coordinates
    engine = qmc.LatinHypercube(len(tables), optimization=optimisation, rng=table.seed)
    return HeldSample(engine.random(_samples(table)))


def _sobol(table: DesignTable, tables: Mapping[str, FactorTable]) -> UnitSample:
    from scipy.stats import qmc

    return SobolSample(qmc.Sobol(len(tables), scramble=table.scramble, rng=table.seed), _samples(table))


def _halton(table: DesignTable, tables: Mapping[str, FactorTable]) -> UnitSample:
    from scipy.stats import qmc

    return HaltonSample(qmc.Halton(len(tables), scramble=table.scramble, rng=table.seed), _samples(table))


def _saltelli(table: DesignTable, tables: Mapping[str, FactorTable]) -> UnitSample:
    from scipy.stats import qmc

    count = _samples(table)
    if count & (count - 1):
        raise InputError(
            f"samples = {count}: a saltelli design needs a power of 2, for instance {1 << count.bit_length()}"
        )
    parts, width = table.scramblings, len(tables)
    if parts & (parts - 1) or parts >= count:
        raise InputError(f"scramblings = {parts}: it must be a power of 2 below samples = {count}")
    seeds = [table.seed] if parts == 1 else np.random.default_rng(table.seed).integers(2**31, size=parts).tolist()
    names = list(tables)
    groups = [np.isin(names, members) for members in factor_groups(tables).values()]
    mixed = [*groups, *(~group for group in groups)] if table.second_order else groups
    none = np.zeros(width, bool)
    pairs = [SobolSample(qmc.Sobol(2 * width, seed=seed), count // parts) for seed in seeds]  # `seed` as SALib does
    return SaltelliSample(pairs, np.stack([none, *mixed, ~none]))  # a part of the blocks has some of every scrambling


def _morris(table: DesignTable, tables: Mapping[str, FactorTable]) -> UnitSample:
    groups = tuple(factor.group for factor in tables.values())
    return HeldSample(_trajectories(_samples(table), table.levels or 4, table.seed, tuple(tables), groups))


@lru_cache(maxsize=1)  # a study makes them, and then its analysis: 60 us a point
def _trajectories(
    count: int, levels: int, seed: int, names: tuple[str, ...], groups: tuple[str | None, ...]
) -> FloatArray:
    """The points of Morris' trajectories, shape (point, factor); not to be changed."""
    from SALib.sample import morris

    tables = {name: FactorTable(group=group) for name, group in zip(names, groups, strict=True)}
    points: FloatArray = morris.sample(salib_problem(tables), count, num_levels=levels, seed=seed)
    points.flags.writeable = False
    return points


def _fast(table: DesignTable, tables: Mapping[str, FactorTable]) -> UnitSample:
    least = 4 * CURVE_HARMONICS**2 + 1
    if _samples(table) < least:
        raise InputError(f"samples = {table.samples}: a fast design needs at least {least} on each curve")
    return CurveSample(len(tables), _samples(table), CURVE_HARMONICS, table.seed)


def _rbd_fast(table: DesignTable, tables: Mapping[str, FactorTable]) -> UnitSample:
    from SALib.sample import latin

    return HeldSample(latin.sample(salib_problem(tables), _samples(table), seed=table.seed))


def _finite_differences(table: DesignTable, tables: Mapping[str, FactorTable]) -> UnitSample:
    return DifferenceSample(len(tables), _samples(table))


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


def unit_sample(table: DesignTable, tables: Mapping[str, FactorTable]) -> UnitSample:
    """The points of a sampled design on the unit cube before the factors are correlated.

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
    return _SAMPLERS[table.kind](table, tables)


@dataclass(frozen=True)
class SampledColumns:
    """Factors with the distributions of theirs that points on the unit cube stand for."""

    sample: UnitSample  # the points on the unit cube
    factors: Mapping[str, Factor]  # the factors by name

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the factors."""
        return tuple(self.factors)

    @property
    def count(self) -> int:
        """Number of points."""
        return self.sample.count

    def at(self, rows: Rows) -> dict[str, Column]:
        """Values of the factors at some points."""
        unit = self.sample.at(row_numbers(rows, self.count))
        return {name: quantile(factor, unit[:, at]) for at, (name, factor) in enumerate(self.factors.items())}


def _make(request: Request) -> Made:
    """Sample, correlate, and apply the distributions."""
    table, factors = request.table, request.factors
    unbounded = [name for name, factor in factors.items() if is_unbounded(factor)]
    if table.kind in ("morris", "finite-differences") and unbounded:
        raise InputError(
            f"[factors.{unbounded[0]}]: {table.kind} needs bounded factors; use a truncated-normal distribution"
        )
    sample = unit_sample(table, request.tables)
    if table.correlation:
        ranks, keep_strata = correlation_matrix(table.correlation, list(factors)), table.kind == "latin-hypercube"
        sample = HeldSample(correlated(sample.at(np.arange(sample.count)), ranks, keep_strata))
    columns = SampledColumns(sample, factors)
    if SAMPLED[table.kind].value_bytes(table):
        return held(columns.at(slice(None)))
    refuse_tails(columns, factors.values())
    return Made(columns)


def refuse_tails(columns: Columns, factors: Iterable[Factor]) -> None:
    """Refuse (InputError) factors that cannot be sampled, before any point runs, where points are not held in memory.

    One point tells, unless a distribution has a tail that some points may reach.
    """
    looked_at = columns.count if any(map(is_unbounded, factors)) else 1
    for start in range(0, looked_at, _CHUNK):
        columns.at(slice(start, min(start + _CHUNK, looked_at)))


_HELD_BYTES, _CORRELATED_BYTES = 64, 96
"""Of a value that is held, with what is needed besides while samples are made."""


def _held_bytes(table: DesignTable) -> int:
    return _CORRELATED_BYTES if table.correlation else _HELD_BYTES


def correlated_bytes(table: DesignTable) -> int:
    """Bytes that a value takes of samples of which any point can be made alone, as long as factors are independent."""
    return _CORRELATED_BYTES if table.correlation else 0


def _samples_of(request: Request) -> int:
    return request.table.samples or 0


def _in_blocks(
    block: Callable[[DesignTable, int], int],
    grouped: bool = True,
    uncorrelated: str = _INDICES,
    value_bytes: Callable[[DesignTable], int] = correlated_bytes,
) -> Family:
    """Samples that come in blocks: one more point a factor or group, or a whole curve."""

    def count(request: Request) -> int:
        return _samples_of(request) * block(request.table, len(factor_groups(request.tables)))

    return Family(_make, count, block, uncorrelated, grouped, value_bytes)


SAMPLED: dict[str, Family] = {
    "latin-hypercube": Family(_make, _samples_of, uncorrelated="", value_bytes=_held_bytes),
    "sobol": Family(_make, _samples_of, uncorrelated="", value_bytes=correlated_bytes),
    "halton": Family(_make, _samples_of, uncorrelated="", value_bytes=correlated_bytes),
    "saltelli": _in_blocks(lambda table, width: 2 * width + 2 if table.second_order else width + 2),
    "morris": _in_blocks(
        lambda table, width: width + 1,
        uncorrelated="each of its steps changes one factor, whatever the others are",
        value_bytes=_held_bytes,
    ),
    "fast": Family(
        _make,
        lambda request: _samples_of(request) * len(request.factors),
        lambda table, width: table.samples or 1,
        _INDICES,
        value_bytes=correlated_bytes,
    ),
    "rbd-fast": Family(_make, _samples_of, uncorrelated=_INDICES, value_bytes=_held_bytes),
    "finite-differences": _in_blocks(
        lambda table, width: width + 1,
        grouped=False,
        uncorrelated="each of its steps changes one factor, whatever the others are",
    ),
}
"""The sampled designs by kind."""
