"""All points of a study, in the order of its cube: known before the first one runs, and the same for the same study."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.errors import InputError
from tripod_doe.study.definition.study import Study
from tripod_doe.study.designs.design_interface import Column, crossed
from tripod_doe.study.designs.grid import grid_levels
from tripod_doe.study.designs.multifidelity import most_points
from tripod_doe.study.designs.registry import FAMILIES, checked_request, count_part, make_part
from tripod_doe.study.expressions import Expression
from tripod_doe.study.memory import refuse_too_many_points

_POINT_BYTES = 40  # fingerprint, order, constraint and stored result of a point
_CORRELATED_BYTES = 32  # of a value besides, while factors are correlated

Rows = NDArray[np.integer[Any]] | slice


@dataclass(frozen=True)
class Points:
    """All points of a study."""

    columns: Mapping[str, Column]  # values of the factors at all points, each of shape (point,)
    shape: tuple[int, ...]  # lengths of the cube's dimensions: one a factor for a grid, else the number of points
    dims: tuple[str, ...]  # names of these dimensions
    # whether a point meets the constraints, shape (point,); only a grid keeps cells that do not
    allowed: NDArray[np.bool_]
    # of a grid the values of the factors along each dimension; none for a list of points
    levels: Mapping[str, Column] = field(default_factory=dict)
    # further coordinates along ``point``, for instance which row of a sub-design a point belongs to
    labels: Mapping[str, Column] = field(default_factory=dict)
    # notes on the design for the user, for instance which effects are confounded
    notes: tuple[str, ...] = ()
    # values of parameters that a pilot chose for each point, each of shape (point,); they are not factors
    chosen: dict[str, Column] = field(default_factory=dict)
    # error_estimate, accuracy_met: estimated relative errors of such a choice by quantity, and whether they meet the
    # accuracy that was asked for (1, 0, or -1 if unknown), each of shape (point,)
    error_estimate: dict[str, Column] = field(default_factory=dict)
    accuracy_met: Column | None = None
    has_excluded: bool = False  # whether a constraint leaves out any point of the whole design

    @property
    def count(self) -> int:
        """Number of points, excluded cells of a grid included."""
        return int(self.allowed.size)

    @property
    def is_grid(self) -> bool:
        """Whether the cube has a dimension for each factor."""
        return self.dims != ("point",)

    @property
    def setting_names(self) -> list[str]:
        """Names of all parameters that differ between points: factors, and chosen parameters."""
        return list(dict.fromkeys([*self.columns, *self.chosen]))

    def at(self, rows: Rows) -> dict[str, Column]:
        """All parameters that differ between points, at some points, each of shape (rows,)."""
        return {name: column[rows] for name, column in (*self.columns.items(), *self.chosen.items())}

    def settings_of(self, row: int) -> dict[str, Any]:
        """The varied values of one point, as plain numbers and words."""
        return {name: column.tolist()[0] for name, column in self.at(np.array([row % self.count])).items()}

    def part(self, start: int, stop: int) -> Points:
        """Some consecutive points, as a list."""
        return self.chosen_rows(slice(start, stop))

    def chosen_rows(self, rows: Rows) -> Points:
        """Some points, as a list."""
        allowed = self.allowed[rows]
        return replace(
            self,
            columns={name: column[rows] for name, column in self.columns.items()},
            shape=(allowed.size,),
            dims=("point",),
            allowed=allowed,
            levels={},
            labels={name: column[rows] for name, column in self.labels.items()},
            chosen={name: column[rows] for name, column in self.chosen.items()},
            error_estimate={name: column[rows] for name, column in self.error_estimate.items()},
            accuracy_met=None if self.accuracy_met is None else self.accuracy_met[rows],
        )


def point_count(study: Study) -> int:
    """Number of points of a study before constraints; 0 if counting must make them (a table), or refuses them."""
    return count_part(study, study.file.design, study.factors)


def point_bytes(study: Study) -> int:
    """Bytes of memory that a point of a study takes while the study is planned and run, its results left out."""
    design = study.file.design
    value = FAMILIES[design.kind].value_bytes + (_CORRELATED_BYTES if design.correlation else 0)
    return _POINT_BYTES + len(study.factors) * value


def make_points(study: Study) -> Points:
    """All points of a study, in the order of its cube.

    Raises:
        InputError: If a setting of the design is missing, or the points need more memory than is free, are all
            excluded, or have outputs of different lengths.
    """
    design = study.file.design
    try:
        count = max(point_count(study), most := most_points(study))
        study.folder.refuse_many(count, "points", "; set most_points in [design]" if most else "")
        refuse_too_many_points(count, point_bytes(study))
        points = _grid(study) if design.kind == "grid" else _list(study)
        study.simulator.check_lengths(_length_values(study, points), study.stored)
        allowed = _allowed(points, design.constraints)
    except InputError as error:
        raise study.fail("[design]", error) from error
    _refuse_missing(study, points.columns)
    if not allowed.any():
        raise study.fail("[design]", "constraints exclude every point; relax them")
    if points.is_grid or allowed.all():
        return replace(points, allowed=allowed, has_excluded=not allowed.all())
    if FAMILIES[design.kind].block(design, len(points.columns)) > 1:
        raise study.fail("[design]", f"a {design.kind} design cannot leave points out; choose ranges instead")
    rows = np.flatnonzero(allowed)
    return replace(
        points,
        columns={name: column[rows] for name, column in points.columns.items()},
        shape=rows.shape,
        allowed=allowed[rows],
        labels={name: column[rows] for name, column in points.labels.items()},
    )


def _grid(study: Study) -> Points:
    """The cells of a grid."""
    levels = grid_levels(checked_request(study, study.file.design, study.factors).factors)
    shape = tuple(column.size for column in levels.values())
    columns = crossed([{name: column} for name, column in levels.items()])
    return Points(columns, shape, tuple(levels), np.ones(math.prod(shape), bool), levels)


def _list(study: Study) -> Points:
    """The points of any other design."""
    made = make_part(study, study.file.design, study.factors)
    count = len(next(iter(made.columns.values()), (None,)))
    return Points(made.columns, (count,), ("point",), np.ones(count, bool), labels=made.labels, notes=made.notes)


def _length_values(study: Study, points: Points) -> dict[str, Column]:
    """All values of those factors that set the length of an output."""
    names = study.simulator.length_parameters.intersection(points.columns)
    columns = points.levels or points.columns
    return {name: np.unique(columns[name]) for name in names}


def _refuse_missing(study: Study, columns: Collection[str]) -> None:
    """Refuse a study that leaves an argument of its function without a value."""
    known = {*study.base, *columns, *(study.auto_model.parameters if study.auto_model else ())}
    arguments = [
        name for name, each in study.simulator.parameters.items() if each.kind == "argument" and each.default is None
    ]
    if missing := [name for name in arguments if name not in known]:
        raise study.fail(
            "[base]", f"{study.simulator.name} needs {', '.join(missing)}: set each as a base value or as a factor"
        )


def _allowed(points: Points, constraints: Sequence[str]) -> NDArray[np.bool_]:
    """Points that meet all constraints, shape (point,)."""
    allowed = points.allowed
    for text in constraints:
        allowed = allowed & Expression(text, points.columns)(points.columns)
    return allowed
