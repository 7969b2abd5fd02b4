"""The multifidelity design: independent samples, the first ones run by every model, the later ones by cheap ones only.

Samples are nested: sample n has the same factors in every model that runs it. They are drawn one after the other from
one stream of random numbers, so that more samples keep those that were there, and they are independent, as the
variances of their analysis ask for. With `indices` a sample is a block of d + 2 points for Sobol' indices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tripod_doe.array_types import IntArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.simulator import Value
from tripod_doe.study.definition.factors import Factor
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import DesignTable, FactorTable
from tripod_doe.study.designs.columns import Column, Rows, row_numbers
from tripod_doe.study.designs.correlation import correlated, correlation_matrix
from tripod_doe.study.designs.request import Family, Made, Request, column_of, factor_groups
from tripod_doe.study.designs.sampled import SampledColumns, correlated_bytes, refuse_tails
from tripod_doe.study.designs.unit_samples import HeldSample, RandomSample, SaltelliSample, UnitSample

SAMPLE = "sample"
"""Label of the points: the sample that each belongs to, the same in all models."""

_USUAL_PILOT = 24
_USUAL_MOST, _USUAL_SHARE = 200_000, 10  # points of all models together, or of those of the truth
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


def most_samples(table: DesignTable, models: int, block: int) -> int:
    """Samples of all models together that a split from the pilot may have.

    Parameters
    ----------
    table
        The design.
    models
        Number of models.
    block
        Points of a sample.

    Raises
    ------
    InputError
        If these are fewer than the truth and the pilot have.
    """
    least = (table.samples or 0) + (models - 1) * pilot_samples(table)
    most = table.most_points or max(_USUAL_MOST, _USUAL_SHARE * (table.samples or 0) * block, least * block)
    if least * block > most:
        raise InputError(
            f"most_points = {most:,}: samples = {table.samples:,} and the pilot have {least * block:,} points already"
        )
    return most // block


def most_points(study: Study) -> int:
    """Points that a study may have when its split is known, from counts alone; 0 where there is no split to find."""
    table = study.file.design
    if table.kind != "multifidelity" or table.split:
        return 0
    block = _block(table, len(factor_groups(random_factors(table, study.file.factors))))
    return most_samples(table, len(study.factors[table.fidelity].values or ()), block) * block


@dataclass(frozen=True)
class _Rungs:
    """The models one after the other, the truth first, each with its first samples."""

    models: Column  # the models
    ends: IntArray  # where the points of each end, shape (model,)
    length: int  # points of a sample

    @property
    def count(self) -> int:
        """Number of points."""
        return int(self.ends[-1])

    def at(self, rows: Rows) -> tuple[Column, IntArray]:
        """The model of some points, and their places among the points of its samples."""
        numbers = row_numbers(rows, self.count)
        rungs = np.searchsorted(self.ends, numbers, side="right")
        begins = np.concatenate([[0], self.ends])
        return self.models[rungs], numbers - begins[rungs]


@dataclass(frozen=True)
class _RungColumns:
    """Factors of the points of all models, made when they are asked for."""

    sampled: SampledColumns
    rungs: _Rungs
    fidelity: str
    names: tuple[str, ...]

    @property
    def count(self) -> int:
        """Number of points."""
        return self.rungs.count

    def at(self, rows: Rows) -> dict[str, Column]:
        """Values of the factors at some points."""
        models, places = self.rungs.at(rows)
        found = self.sampled.at(places) | {self.fidelity: models}
        return {name: found[name] for name in self.names}


@dataclass(frozen=True)
class _SampleNumbers:
    """The sample that each point belongs to."""

    rungs: _Rungs
    names: tuple[str, ...] = (SAMPLE,)

    @property
    def count(self) -> int:
        """Number of points."""
        return self.rungs.count

    def at(self, rows: Rows) -> dict[str, Column]:
        """The samples of some points."""
        return {SAMPLE: self.rungs.at(rows)[1] // self.rungs.length}


def _unit_sample(table: DesignTable, tables: dict[str, FactorTable], count: int) -> UnitSample:
    """Points of so many samples on the unit cube."""
    width = len(tables)
    if not table.indices:
        sample = RandomSample(count, width, table.seed)
        if table.correlation:
            ranks = correlation_matrix(table.correlation, list(tables))
            return HeldSample(correlated(sample.at(np.arange(count)), ranks, False))
        return sample
    if table.correlation:
        raise InputError(
            "correlation: Sobol' indices divide the variance among independent factors; set indices = false"
        )
    names, none = list(tables), np.zeros(width, bool)
    mixed = [np.isin(names, members) for members in factor_groups(tables).values()]
    return SaltelliSample([RandomSample(count, 2 * width, table.seed)], np.stack([none, *mixed, ~none]))


def _make(request: Request) -> Made:
    """The samples of each model, the truth's first."""
    table, models = request.table, _models(request)
    split = split_of(table, models)
    tables = random_factors(table, request.tables)
    if not tables:
        raise InputError(f"a multifidelity design varies factors besides {table.fidelity}; add [factors.PARAMETER]")
    factors = {name: request.factors[name] for name in tables}
    most = max(split.values())
    sampled = SampledColumns(_unit_sample(table, tables, most), factors)
    refuse_tails(sampled, factors.values())
    length = sampled.count // most
    ends = length * np.cumsum([split[model] for model in reversed(models)])
    rungs = _Rungs(column_of(request.factors[table.fidelity], reversed(models)), ends, length)
    told = ", ".join(f"{count:,} of {model}" for model, count in reversed(split.items()))
    of = f" of {length} points" if length > 1 else ""
    note = f"samples{of}: {told}"
    if not table.split:
        most = most_samples(table, len(models), length) * length
        note = f"pilot: the first {split[models[-1]]} samples{of} in every model; then at most {most:,} points in all"
    columns = _RungColumns(sampled, rungs, table.fidelity, tuple(request.factors))
    return Made(columns, _SampleNumbers(rungs), (note,))


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
    "multifidelity": Family(_make, _count, _block, uncorrelated="", grouped=True, value_bytes=correlated_bytes)
}
"""The multifidelity design by its kind."""
