"""Saltelli's blocks (2002) for Sobol' indices: a sample A, A with some factors of a sample B, B with some of A, B."""

from collections.abc import Mapping

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.study.definition.study_file_schema import DesignTable, FactorTable
from tripod_doe.study.designs.design_interface import factor_groups
from tripod_doe.study.designs.sampling import INDEPENDENT, salib_problem, sampled, samples_of


def _saltelli(table: DesignTable, tables: Mapping[str, FactorTable]) -> FloatArray:
    from SALib.sample import sobol

    count = samples_of(table)
    if count & (count - 1):
        raise InputError(
            f"samples = {count}: a saltelli design needs a power of 2, for instance {1 << count.bit_length()}"
        )
    points = sobol.sample(salib_problem(tables), count, calc_second_order=table.second_order, seed=table.seed)
    return np.asarray(points)


def first_order_blocks(pairs: FloatArray, tables: Mapping[str, FactorTable]) -> FloatArray:
    """Blocks A, A with each factor or group of B, B, of samples that are not a sequence, as SALib orders them.

    Args:
        pairs: A and B side by side, shape (sample, 2 factor).

    Returns:
        ndarray, shape (sample (groups + 2), factor)
    """
    names, none = list(tables), np.zeros(len(tables), bool)
    groups = [np.isin(names, members) for members in factor_groups(tables).values()]
    from_b = np.stack([none, *groups, ~none])  # (point of a block, factor)
    a, b = pairs[:, None, : len(names)], pairs[:, None, len(names) :]
    return np.where(from_b, b, a).reshape(-1, len(names))


SALTELLI = {
    "saltelli": sampled(
        _saltelli,
        INDEPENDENT,
        points=lambda table, width: 2 * width + 2 if table.second_order else width + 2,
        grouped=True,
    )
}
"""Saltelli's design by its kind."""
