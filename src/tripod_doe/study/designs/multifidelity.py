"""The multifidelity design: independent samples, the first ones run by every model, the later ones by cheap ones only.

Samples are nested: sample n has the same factors in every model that runs it. They are drawn one after the other from
one stream of random numbers, so that more samples keep those that were there, and they are independent, as the
variances of their analysis ask for. With `indices` a sample is a block of d + 2 points for Sobol' indices.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import InputError, near_match
from tripod_doe.simulator import Value
from tripod_doe.study.definition import Factor
from tripod_doe.study.designs.correlation import correlated, correlation_matrix
from tripod_doe.study.designs.request import Family, Made, Request, column_of, factor_groups, held
from tripod_doe.study.distributions import quantile
from tripod_doe.study.file import DesignTable, FactorTable

__all__ = ["MULTIFIDELITY", "SAMPLE", "pilot_samples", "random_factors", "split_of"]

SAMPLE = "sample"
"""Label of the points: the sample that each belongs to, the same in all models."""

_USUAL_PILOT = 24
_FEWEST = 16  # samples below which intervals do not hold what they say


def random_factors(table: DesignTable, tables: dict[str, FactorTable]) -> dict[str, FactorTable]:
    """The factors that a design samples: all, but for a multifidelity design the one that names the model."""
    if table.kind != "multifidelity":
        return tables
    return {name: factor for name, factor in tables.items() if name != table.fidelity}


def pilot_samples(table: DesignTable) -> int:
    """Samples that all models run before the split is known.

    Raises
    ------
    InputError
        If the design does not say how many samples of the dearest model it has, or they are too few.
    """
    samples = table.samples or 0
    if samples < _FEWEST:
        told = "needs samples =" if table.samples is None else f"samples = {samples}: it needs"
        raise InputError(f"a multifidelity design {told} the samples of its dearest model, at least {_FEWEST}")
    return min(samples, table.pilot or _USUAL_PILOT)


def split_of(table: DesignTable, models: tuple[Value, ...]) -> dict[Value, int]:
    """Samples of each model, the truth last; those of the pilot where there is no split yet.

    Raises
    ------
    InputError
        If the split names no model of the study, or gives the truth other samples than the design.
    """
    pilot = pilot_samples(table)
    words = {str(model): model for model in models}
    if len(words) < 2:
        raise InputError(f"fidelity: {table.fidelity} takes one value only; several models need several")
    for word in [*table.split, *table.prices]:
        if word not in words:
            raise InputError(f"split, prices: {word!r} is no value of {table.fidelity}{near_match(word, words)}")
    if not table.split:
        return dict.fromkeys(models, pilot)
    truth = str(models[-1])
    if table.split.get(truth) != table.samples:
        raise InputError(f"split: {truth}, the last model, has samples = {table.samples}")
    return {model: table.split.get(word, 0) for word, model in words.items()}


def _unit_blocks(table: DesignTable, tables: dict[str, FactorTable], count: int) -> NDArray[np.float64]:
    """Samples on the unit cube, shape (sample, point of the sample, factor)."""
    width = len(tables)
    random = np.random.default_rng(table.seed)
    if not table.indices:
        unit = random.random((count, width))
        if table.correlation:
            unit = correlated(unit, correlation_matrix(table.correlation, list(tables)), False)
        return unit[:, None]
    if table.correlation:
        raise InputError(
            "correlation: Sobol' indices divide the variance among independent factors; set indices = false"
        )
    first, last = random.random((count, 2, width)).transpose(1, 0, 2)
    names = list(tables)
    mixed = []
    for members in factor_groups(tables).values():
        each = first.copy()
        columns = [names.index(name) for name in members]
        each[:, columns] = last[:, columns]
        mixed.append(each)
    return np.stack([first, *mixed, last], axis=1)


def _make(request: Request) -> Made:
    """The samples of each model, the truth's first."""
    table, models = request.table, _models(request)
    split = split_of(table, models)
    tables = random_factors(table, request.tables)
    if not tables:
        raise InputError(f"a multifidelity design varies factors besides {table.fidelity}; add [factors.PARAMETER]")
    blocks = _unit_blocks(table, tables, max(split.values()))
    length = blocks.shape[1]
    samples = np.concatenate([np.arange(split[model]) for model in reversed(models)])
    points = blocks[samples].reshape(-1, len(tables))
    columns = {name: quantile(request.factors[name], points[:, at]) for at, name in enumerate(tables)}
    counts = [split[model] * length for model in reversed(models)]
    columns[table.fidelity] = np.repeat(column_of(request.factors[table.fidelity], reversed(models)), counts)
    told = ", ".join(f"{count:,} of {model}" for model, count in reversed(split.items()))
    of = f" of {length} points" if length > 1 else ""
    note = f"samples{of}: {told}" if table.split else f"pilot: the first {split[models[-1]]} samples{of} in every model"
    return held({name: columns[name] for name in request.factors}, {SAMPLE: np.repeat(samples, length)}, (note,))


def _models(request: Request) -> tuple[Value, ...]:
    factor: Factor | None = request.factors.get(request.table.fidelity)
    if factor is None or factor.values is None:
        raise InputError(f"[factors.{request.table.fidelity}]: give values, the truth last")
    return factor.values


def _block(table: DesignTable, width: int) -> int:
    return width + 2 if table.indices else 1


def _count(request: Request) -> int:
    width = len(factor_groups(random_factors(request.table, request.tables)))
    return sum(split_of(request.table, _models(request)).values()) * _block(request.table, width)


MULTIFIDELITY = {"multifidelity": Family(_make, _count, _block, uncorrelated="", grouped=True)}
"""The multifidelity design by its kind."""
