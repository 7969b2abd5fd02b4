"""The multifidelity design: independent samples, the first ones run by every model, the later ones by cheap ones only.

Samples are nested: sample n has the same factors in every model that runs it. All are drawn from one stream of random
numbers, so that more samples keep the earlier ones, and they are independent, as the variances of the estimators
assume. With `indices` a sample is a block of d + 2 points for Sobol' indices.
"""

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.model_interface import Value
from tripod_doe.study.definition.factors import Factor
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file_schema import DesignTable, FactorTable
from tripod_doe.study.designs.correlation import correlated, correlation_matrix
from tripod_doe.study.designs.design_interface import SAMPLED_BYTES, Family, Made, Request, column_of, factor_groups
from tripod_doe.study.designs.saltelli import first_order_blocks
from tripod_doe.study.designs.sampling import INDEPENDENT, distributed

SAMPLE = "sample"
"""Label of the points: the sample that each belongs to, the same in all models."""

_USUAL_PILOT = 24
_USUAL_MOST, _USUAL_SHARE = 200_000, 10  # points of all models together, or multiples of the truth's
_FEWEST = 16  # samples below which intervals miss their confidence


def random_factors(table: DesignTable, tables: dict[str, FactorTable]) -> dict[str, FactorTable]:
    """The factors that a design samples: all, but for a multifidelity design the one that names the model."""
    if table.kind != "multifidelity":
        return tables
    return {name: factor for name, factor in tables.items() if name != table.fidelity}


def pilot_samples(table: DesignTable) -> int:
    """Samples that all models run before the split is known.

    Raises:
        InputError: If the number of samples of the most expensive model is missing or too small.
    """
    samples = table.samples or 0
    if samples < _FEWEST:
        given = "needs samples =" if table.samples is None else f"samples = {samples}: it needs"
        raise InputError(f"a multifidelity design {given} the samples of its most expensive model, at least {_FEWEST}")
    return min(samples, table.pilot or _USUAL_PILOT)


def split_of(table: DesignTable, models: tuple[Value, ...]) -> dict[Value, int]:
    """Samples of each model, the truth last; the pilot's samples before the split.

    Raises:
        InputError: If the split names no model of the study, or gives the truth other samples than the design.
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


def most_samples(table: DesignTable, models: int, block: int) -> int:
    """Samples of all models together that a split from the pilot may have.

    Args:
        models: Number of models.

    Raises:
        InputError: If the truth and the pilot already have more.
    """
    least = (table.samples or 0) + (models - 1) * pilot_samples(table)
    most = table.most_points or max(_USUAL_MOST, _USUAL_SHARE * (table.samples or 0) * block, least * block)
    if least * block > most:
        raise InputError(
            f"most_points = {most:,}: samples = {table.samples:,} and the pilot have {least * block:,} points already"
        )
    return most // block


def most_points(study: Study) -> int:
    """Largest possible number of points after the split, from counts alone; 0 if no pilot determines the split."""
    table = study.file.design
    if table.kind != "multifidelity" or table.split:
        return 0
    block = _block(table, len(factor_groups(random_factors(table, study.file.factors))))
    return most_samples(table, len(study.factors[table.fidelity].values or ()), block) * block


def _unit_sample(table: DesignTable, tables: dict[str, FactorTable], count: int) -> FloatArray:
    """Points of the samples on the unit cube, shape (point, factor)."""
    rng = np.random.default_rng(table.seed)
    if table.indices:
        if table.correlation:
            raise InputError(f"correlation: {INDEPENDENT}; set indices = false")
        return first_order_blocks(rng.random((count, 2 * len(tables))), tables)
    unit = rng.random((count, len(tables)))
    if not table.correlation:
        return unit
    return correlated(unit, correlation_matrix(table.correlation, list(tables)), keep_strata=False)


def _make(request: Request) -> Made:
    """The samples of each model, from the truth to the cheapest."""
    table, models = request.table, _models(request)
    split = split_of(table, models)
    tables = random_factors(table, request.tables)
    if not tables:
        raise InputError(f"a multifidelity design varies factors besides {table.fidelity}; add [factors.PARAMETER]")
    most = max(split.values())
    unit = _unit_sample(table, tables, most)
    columns = distributed(unit, {name: request.factors[name] for name in tables})
    length = len(unit) // most
    ends = [length * split[model] for model in reversed(models)]
    columns = {name: np.concatenate([column[:end] for end in ends]) for name, column in columns.items()}
    columns[table.fidelity] = np.repeat(column_of(request.factors[table.fidelity], reversed(models)), ends)
    labels = {SAMPLE: np.concatenate([np.arange(end) // length for end in ends])}
    return Made({name: columns[name] for name in request.factors}, labels, (_note(table, split, length),))


def _note(table: DesignTable, split: dict[Value, int], length: int) -> str:
    """The samples of each model in words."""
    of = f" of {length} points" if length > 1 else ""
    if not table.split:
        pilot, most = next(iter(split.values())), most_samples(table, len(split), length) * length
        return f"pilot: the first {pilot} samples{of} in every model; then at most {most:,} points in all"
    return f"samples{of}: " + ", ".join(f"{count:,} of {model}" for model, count in reversed(split.items()))


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


MULTIFIDELITY = {
    "multifidelity": Family(_make, _count, _block, uncorrelated="", grouped=True, value_bytes=SAMPLED_BYTES)
}
"""The multifidelity design by its kind."""
