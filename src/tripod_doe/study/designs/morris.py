"""Designs of single steps by SALib: Morris' trajectories (1991), and finite differences for derivatives."""

from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.study.definition.study_file_schema import DesignTable, FactorTable
from tripod_doe.study.designs.sampling import salib_problem, sampled, samples_of

_STEPS = "each of its steps changes one factor, independently of the others"


def _morris(table: DesignTable, tables: Mapping[str, FactorTable]) -> FloatArray:
    groups = tuple(factor.group for factor in tables.values())
    return _trajectories(samples_of(table), table.levels or 4, table.seed, tuple(tables), groups)


@lru_cache(maxsize=1)  # a study makes them, and then its analysis: 60 us a point
def _trajectories(
    count: int, levels: int, seed: int, names: tuple[str, ...], groups: tuple[str | None, ...]
) -> FloatArray:
    """The points of Morris' trajectories, shape (point, factor), read-only."""
    from SALib.sample import morris

    tables = {name: FactorTable(group=group) for name, group in zip(names, groups, strict=True)}
    points: FloatArray = morris.sample(salib_problem(tables), count, num_levels=levels, seed=seed)
    points.flags.writeable = False
    return points


def _finite_differences(table: DesignTable, tables: Mapping[str, FactorTable]) -> FloatArray:
    from SALib.sample import finite_diff

    return np.asarray(finite_diff.sample(salib_problem(tables), samples_of(table)))


MORRIS = {
    "morris": sampled(_morris, _STEPS, points=lambda table, width: width + 1, grouped=True, bounded=True),
    "finite-differences": sampled(
        _finite_differences, _STEPS, points=lambda table, width: width + 1, bounded=True, continuous=True
    ),
}
"""Designs of single steps by kind."""
