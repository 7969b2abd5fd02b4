"""All kinds of designs by name, and products of them.

To add a kind, write its `Family` in the module of its term, and add the kind to `DesignKind` of study files.
"""

import math
from collections.abc import Mapping

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError, near_match
from tripod_doe.study.definition.factors import Factor
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file_schema import DesignTable, FactorTable
from tripod_doe.study.designs.ablation import ABLATION
from tripod_doe.study.designs.design_interface import Column, Family, Made, Request, crossed
from tripod_doe.study.designs.factorial import FACTORIAL
from tripod_doe.study.designs.fast import FAST
from tripod_doe.study.designs.grid import GRID
from tripod_doe.study.designs.latin_hypercube import LATIN_HYPERCUBE
from tripod_doe.study.designs.morris import MORRIS
from tripod_doe.study.designs.multifidelity import MULTIFIDELITY
from tripod_doe.study.designs.saltelli import SALTELLI
from tripod_doe.study.designs.sobol_halton import SEQUENCES
from tripod_doe.study.designs.table import TABLE


def _part(study: Study, design: DesignTable, factors: Mapping[str, Factor]) -> Request:
    """The request of one design: with the factors that it names, or all."""
    if design.factors is not None and design.kind != "product":
        unknown = [name for name in design.factors if name not in factors]
        if unknown:
            raise InputError(f"factors: {unknown[0]!r} is not among [factors]{near_match(unknown[0], factors)}")
        factors = {name: factors[name] for name in design.factors}
    elif design.kind == "ablation":
        factors = {name: factors[name] for name in study.switches}
    if not factors and design.kind != "table":
        raise InputError("the study has no factors; add [factors.PARAMETER] with values")
    return Request(study, design, factors)


def make_part(study: Study, design: DesignTable, factors: Mapping[str, Factor]) -> Made:
    """The points of one design, of the study or a part of a product.

    Raises:
        InputError: If a setting is missing, or the design cannot use it.
    """
    return FAMILIES[design.kind].make(checked_request(study, design, factors))


def checked_request(study: Study, design: DesignTable, factors: Mapping[str, Factor]) -> Request:
    """The request of one design, checked against its kind.

    Raises:
        InputError: If correlations or groups are set and the design cannot use them.
    """
    request, family = _part(study, design, factors), FAMILIES[design.kind]
    if design.correlation and family.uncorrelated:
        raise InputError(f"correlation: a {design.kind} design takes independent factors: {family.uncorrelated}")
    grouped = [name for name, factor in request.factors.items() if factor.table.group]
    if grouped and not family.grouped and design.kind != "product":
        *able, last = [kind for kind, other in FAMILIES.items() if other.grouped]
        used = f"{', '.join(able)} and {last}"
        raise InputError(f"[factors.{grouped[0]}]: group is used by {used} designs, not by {design.kind}")
    return request


def count_part(study: Study, design: DesignTable, factors: Mapping[str, Factor]) -> int:
    """Number of points of one design before constraints; 0 if they must be made to count them, or are refused."""
    try:
        return FAMILIES[design.kind].count(_part(study, design, factors))
    except InputError:
        return 0


def _product(request: Request) -> Made:
    """Every point of the first sub-design with every point of the next."""
    study, factors = request.study, request.factors
    names, tables = study.file.design.of, study.file.designs
    parts: list[Mapping[str, Column]] = []
    rows: list[Mapping[str, Column]] = []
    notes: list[str] = []
    taken: dict[str, str] = {}
    for name in names:
        if tables[name].factors is None and tables[name].kind not in ("ablation", "table"):
            raise InputError(f"[design.{name}]: give the factors that it varies")
        if tables[name].kind == "product":
            raise InputError(f"[design.{name}]: a product of products is not supported; list all parts in of")
        if tables[name].kind == "multifidelity":
            raise InputError(f"[design.{name}]: a multifidelity design stands alone: its pilot decides its points")
        own_columns = tables[name].kind == "table" and tables[name].factors is None
        made = make_part(study, tables[name], {} if own_columns else factors)
        notes += [f"part {name}: {note}" for note in made.notes]
        for factor in made.columns:
            if factor in taken:
                raise InputError(f"{factor} is varied by [design.{taken[factor]}] and by [design.{name}]")
            taken[factor] = name
        parts.append(made.columns)
        rows.append({f"{name}_row": np.arange(len(next(iter(made.columns.values()))))})
    left = [name for name in factors if name not in taken]
    if left:
        raise InputError(f"{', '.join(left)} belongs to no sub-design; add it to the factors of one")
    columns = crossed(parts)
    return Made({name: columns[name] for name in [*factors, *columns]}, crossed(rows), tuple(notes))


def _product_count(request: Request) -> int:
    tables = request.study.file.designs
    parts = (tables[name] for name in request.table.of)
    return math.prod(count_part(request.study, part, request.factors) or 1 for part in parts if part.kind != "product")


PRODUCT = {"product": Family(_product, _product_count)}

FAMILIES: dict[str, Family] = (
    GRID
    | TABLE
    | SEQUENCES
    | LATIN_HYPERCUBE
    | SALTELLI
    | MORRIS
    | FAST
    | MULTIFIDELITY
    | FACTORIAL
    | ABLATION
    | PRODUCT
)
"""All kinds of designs by the names that study files use."""


def unit_sample(table: DesignTable, tables: Mapping[str, FactorTable]) -> FloatArray:
    """The points of a sampled design on the unit cube before the factors are correlated, shape (point, factor).

    Args:
        tables: Its factors by name, as the study file describes them.

    Raises:
        InputError: If the design is not sampled, or its number of samples is missing or not allowed.
    """
    if (sample := FAMILIES[table.kind].sample) is None:
        raise InputError(f"a {table.kind} design is not sampled")
    return sample(table, tables)
