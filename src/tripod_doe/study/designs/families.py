"""All kinds of designs by name, and products of them.

To add a kind, write its `Family` in the module that it belongs to, and name the kind among those of study files.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from tripod_doe.errors import InputError, near_match
from tripod_doe.study.definition.factors import Factor
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import DesignTable
from tripod_doe.study.designs.ablation import ABLATION
from tripod_doe.study.designs.coded import CODED
from tripod_doe.study.designs.columns import Columns, CrossedColumns
from tripod_doe.study.designs.listed import LISTED, crossed
from tripod_doe.study.designs.multifidelity import MULTIFIDELITY
from tripod_doe.study.designs.request import Family, Made, Request
from tripod_doe.study.designs.sampled import SAMPLED


def _part(study: Study, design: DesignTable, factors: Mapping[str, Factor]) -> Request:
    """What one design is asked for: the factors that it names, or all."""
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
    """The points of one design: that of the study, or a part of a product.

    Raises
    ------
    InputError
        If the design lacks what it needs, or is given what it cannot use.
    """
    return FAMILIES[design.kind].make(checked_request(study, design, factors))


def checked_request(study: Study, design: DesignTable, factors: Mapping[str, Factor]) -> Request:
    """What one design is asked for, when it can use all that it is given.

    Raises
    ------
    InputError
        If it is given what it cannot use.
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
    """Number of points of one design before constraints; 0 where only making them tells, or refuses them."""
    try:
        return FAMILIES[design.kind].count(_part(study, design, factors))
    except InputError:
        return 0


def _product(request: Request) -> Made:
    """Every point of the first sub-design with every point of the next."""
    study, factors = request.study, request.factors
    names, tables = study.file.design.of, study.file.designs
    if len(names) < 2:
        raise InputError("a product needs of = at least two sub-designs")
    parts: dict[str, Columns] = {}
    notes: list[str] = []
    taken: dict[str, str] = {}
    for name in names:
        if name not in tables:
            raise InputError(f"of: no sub-design [design.{name}]{near_match(name, tables)}")
        if tables[name].factors is None and tables[name].kind != "ablation":
            raise InputError(f"[design.{name}]: give the factors that it varies")
        if tables[name].kind == "product":
            raise InputError(f"[design.{name}]: a product of products is not supported; list all parts in of")
        if tables[name].kind == "multifidelity":
            raise InputError(f"[design.{name}]: a multifidelity design stands alone: its pilot decides its points")
        made = make_part(study, tables[name], factors)
        notes += [f"part {name}: {note}" for note in made.notes]
        for factor in made.columns.names:
            if factor in taken:
                raise InputError(f"{factor} is varied by [design.{taken[factor]}] and by [design.{name}]")
            taken[factor] = name
        parts[name] = made.columns
    left = [name for name in factors if name not in taken]
    if left:
        raise InputError(f"{', '.join(left)} belongs to no sub-design; add it to the factors of one")
    labels = crossed({f"{name}_row": np.arange(part.count) for name, part in parts.items()})
    return Made(CrossedColumns([*parts.values()], tuple(factors)), labels, tuple(notes))


def _product_count(request: Request) -> int:
    tables = request.study.file.designs
    parts = (tables[name] for name in request.table.of if name in tables)
    return math.prod(count_part(request.study, part, request.factors) or 1 for part in parts if part.kind != "product")


PRODUCT = {"product": Family(_product, _product_count, value_bytes=lambda table: 0)}

FAMILIES: dict[str, Family] = LISTED | SAMPLED | MULTIFIDELITY | CODED | ABLATION | PRODUCT
"""All kinds of designs by the names that study files use."""
