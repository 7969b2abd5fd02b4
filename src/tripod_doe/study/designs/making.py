"""From a study to its points: all are known before the first one runs, and the same study gives the same ones."""

from __future__ import annotations

import numpy as np

from tripod_doe.errors import InputError
from tripod_doe.study.definition import Study
from tripod_doe.study.designs.families import FAMILIES, count_part, make_part
from tripod_doe.study.designs.points import Points
from tripod_doe.study.expressions import Expression
from tripod_doe.study.size import refuse_too_many_points

__all__ = ["make_points", "point_count"]


def point_count(study: Study) -> int:
    """Number of points of a study before constraints; 0 where only making them tells (a table), or refuses them."""
    return count_part(study, study.file.design, study.factors)


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
        refuse_too_many_points(point_count(study), len(study.factors))
        made = make_part(study, design, study.factors)
        columns, labels, names = made.columns, made.labels, list(made.columns)
        count = len(columns[names[0]]) if names else 1
        allowed = np.ones(count, bool)
        for text in design.constraints:
            allowed &= Expression(text, names)(columns)
        study.simulator.check_lengths(columns, study.keep)
    except InputError as error:
        raise study.fail("[design]", error) from error
    if not allowed.any():
        raise study.fail("[design]", "constraints exclude every point; relax them")
    if design.kind == "grid":
        levels = tuple(len(factor.values or ()) for factor in study.factors.values())
        return Points(columns, levels, tuple(names), allowed)
    if not allowed.all():
        if FAMILIES[design.kind].block(design, len(names)) > 1:
            raise study.fail("[design]", f"a {design.kind} design cannot leave points out; choose ranges instead")
        columns = {name: column[allowed] for name, column in columns.items()}
        labels = {name: column[allowed] for name, column in labels.items()}
        allowed = allowed[allowed]
    return Points(columns, (allowed.size,), ("point",), allowed, labels, made.notes)
