"""Sampled designs: points on the unit cube by SciPy or SALib, correlated, then given the distributions of the factors.

Each method is a module that makes its points with `sampled`. Sequences and blocks are prefix-stable: more samples keep
the earlier points. A latin hypercube is not: its strata follow from the number of samples.
"""

from collections.abc import Mapping
from typing import Any

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.study.definition.distributions import has_levels, is_unbounded, quantile
from tripod_doe.study.definition.factors import Factor
from tripod_doe.study.definition.study_file_schema import DesignTable, FactorTable
from tripod_doe.study.designs.correlation import correlated, correlation_matrix
from tripod_doe.study.designs.design_interface import (
    SAMPLED_BYTES,
    Block,
    Column,
    Family,
    Made,
    Request,
    Sampler,
    factor_groups,
    one_point,
)

INDEPENDENT = "its indices divide the variance among independent factors"
"""The reason why factors of designs for variance-based indices cannot be correlated."""


def salib_problem(tables: Mapping[str, FactorTable]) -> dict[str, Any]:
    """SALib's description of factors on the unit cube; distributions are applied by `quantile`."""
    problem = {"num_vars": len(tables), "names": list(tables), "bounds": [[0.0, 1.0]] * len(tables)}
    if any(table.group for table in tables.values()):
        problem["groups"] = [table.group or name for name, table in tables.items()]
    return problem


def samples_of(table: DesignTable) -> int:
    """Number of samples of a design; InputError if it is missing."""
    if table.samples is None:
        raise InputError(f"a {table.kind} design needs samples, for instance samples = 256")
    return table.samples


def sampled(
    sample: Sampler,
    uncorrelated: str = "",
    points: Block = one_point,
    block: Block | None = None,
    grouped: bool = False,
    bounded: bool = False,
    continuous: bool = False,
) -> Family:
    """A sampled design.

    Args:
        uncorrelated, grouped: See `Family`.
        block: See `Family`; the points of a sample if omitted.
        bounded: Whether distributions with infinite tails are refused.
        continuous: Whether factors with levels are refused.
    """

    def make(request: Request) -> Made:
        """Sample, correlate, and apply the distributions."""
        table, factors = request.table, request.factors
        unbounded = [name for name, factor in factors.items() if is_unbounded(factor)]
        if bounded and unbounded:
            raise InputError(
                f"[factors.{unbounded[0]}]: {table.kind} needs bounded factors; use a truncated-normal distribution"
            )
        if unbounded and not table.scramble:
            raise InputError(
                f"[factors.{unbounded[0]}]: a sequence that is not scrambled begins at the lower end of all factors, "
                "which a normal distribution has not; leave out scramble, or use a truncated-normal distribution"
            )
        if continuous and (levelled := [name for name, factor in factors.items() if has_levels(factor)]):
            raise InputError(
                f"[factors.{levelled[0]}]: {table.kind} needs continuous factors, and this one has levels; use a "
                "saltelli or morris design"
            )
        unit = sample(table, request.tables)
        if table.correlation:
            ranks = correlation_matrix(table.correlation, list(factors))
            unit = correlated(unit, ranks, keep_strata=table.kind == "latin-hypercube")
        return Made(distributed(unit, factors))

    def count(request: Request) -> int:
        return (request.table.samples or 0) * points(request.table, len(factor_groups(request.tables)))

    return Family(make, count, block or points, uncorrelated, grouped, sample, SAMPLED_BYTES)


def distributed(unit: FloatArray, factors: Mapping[str, Factor]) -> dict[str, Column]:
    """Values of the factors, by their distributions, at points on the unit cube of shape (point, factor)."""
    return {name: quantile(factor, unit[:, at]) for at, (name, factor) in enumerate(factors.items())}
