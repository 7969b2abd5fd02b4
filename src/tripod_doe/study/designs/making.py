"""From a study to its points: all are known before the first one runs, and the same study gives the same ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import InputError
from tripod_doe.study.definition.study import Study
from tripod_doe.study.definition.study_file import DesignTable
from tripod_doe.study.designs.columns import ChosenColumns, Column
from tripod_doe.study.designs.families import FAMILIES, checked_request, count_part, make_part
from tripod_doe.study.designs.listed import crossed, grid_levels
from tripod_doe.study.designs.multifidelity import most_points
from tripod_doe.study.designs.points import Points
from tripod_doe.study.expressions import Expression
from tripod_doe.study.memory import POINT_BYTES, refuse_too_many_points

_CHUNK = 1_000_000
"""Points whose factors are held at once to check constraints."""


def point_count(study: Study) -> int:
    """Number of points of a study before constraints; 0 where only making them tells (a table), or refuses them."""
    return count_part(study, study.file.design, study.factors)


def point_bytes(study: Study) -> int:
    """Bytes of memory that a point of a study takes while the study is planned and run, its results left out."""
    design = study.file.design
    return POINT_BYTES + len(study.factors) * FAMILIES[design.kind].value_bytes(design)


def make_points(study: Study) -> Points:
    """All points of a study, in the order of its cube.

    Raises
    ------
    InputError
        If the design lacks what it needs, has more points than fit into memory, excludes every point, or gives points
        outputs of different lengths.
    """
    design = study.file.design
    try:
        count = max(point_count(study), most := most_points(study))
        study.folder.refuse_many(count, "points", "; set most_points in [design]" if most else "")
        refuse_too_many_points(count, point_bytes(study))
        points = _grid(study) if design.kind == "grid" else _list(study, design)
        study.simulator.check_lengths(_length_values(study, points), study.keep)
        allowed = _allowed(points, design.constraints)
    except InputError as error:
        raise study.fail("[design]", error) from error
    if not allowed.any():
        raise study.fail("[design]", "constraints exclude every point; relax them")
    if points.is_grid or allowed.all():
        return replace(points, allowed=allowed, has_excluded=not allowed.all())
    if FAMILIES[design.kind].block(design, len(points.factors.names)) > 1:
        raise study.fail("[design]", f"a {design.kind} design cannot leave points out; choose ranges instead")
    rows = np.flatnonzero(allowed)
    return replace(
        points,
        factors=ChosenColumns(points.factors, rows),
        shape=rows.shape,
        allowed=allowed[rows],
        labels=ChosenColumns(points.labels, rows),
    )


def _grid(study: Study) -> Points:
    """The cells of a grid."""
    levels = grid_levels(checked_request(study, study.file.design, study.factors).factors)
    shape = tuple(column.size for column in levels.values())
    return Points(crossed(levels), shape, tuple(levels), np.ones(math.prod(shape), bool), levels)


def _list(study: Study, design: DesignTable) -> Points:
    """The points of any other design."""
    made = make_part(study, design, study.factors)
    count = made.columns.count or 1
    return Points(made.columns, (count,), ("point",), np.ones(count, bool), labels=made.labels, notes=made.notes)


def _length_values(study: Study, points: Points) -> dict[str, Column]:
    """All values of those factors that set the length of an output."""
    names = study.simulator.length_parameters.intersection(points.factors.names)
    columns = points.levels or (points.columns if names else {})
    return {name: np.unique(columns[name]) for name in names}


def _allowed(points: Points, constraints: Sequence[str]) -> NDArray[np.bool_]:
    """Points that meet all constraints, shape (point,)."""
    allowed = points.allowed.copy()
    for text in constraints:
        meets = Expression(text, points.factors.names)
        for start in range(0, points.count, _CHUNK):
            rows = slice(start, start + _CHUNK)
            allowed[rows] &= meets(points.at(rows))
    return allowed
