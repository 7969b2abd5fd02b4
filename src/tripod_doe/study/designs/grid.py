"""Designs of listed levels: grids, lists of points, and one factor at a time."""

import math
from collections.abc import Mapping

import numpy as np

from tripod_doe.errors import InputError
from tripod_doe.model_interface import check_parameters
from tripod_doe.study.definition.factors import Factor
from tripod_doe.study.designs.design_interface import (
    Column,
    Family,
    Made,
    Request,
    axis_levels,
    column_of,
    crossed,
    levels_of,
)


def _grid(request: Request) -> Made:
    """All combinations of the levels."""
    return Made(crossed([{name: levels} for name, levels in grid_levels(request.factors).items()]))


def grid_levels(factors: Mapping[str, Factor]) -> dict[str, Column]:
    """The levels of a grid along each of its dimensions; InputError if a factor has the same level twice."""
    levels = {name: axis_levels(factor) for name, factor in factors.items()}
    for name, values in levels.items():
        if len(set(values.tolist())) < len(values):
            raise InputError(f"[factors.{name}]: the same value occurs twice; a grid needs different values")
    return levels


def _zip(request: Request) -> Made:
    """The first levels of all factors together, then the second ones, and so on."""
    columns = {name: levels_of(factor) for name, factor in request.factors.items()}
    lengths = {name: len(column) for name, column in columns.items()}
    if len(set(lengths.values())) > 1:
        each = ", ".join(f"{name} has {length}" for name, length in lengths.items())
        raise InputError(f"zip needs as many values for every factor, but {each}")
    return Made(columns)


def _one_at_a_time(request: Request) -> Made:
    """The base point, then each factor through its values with all others as at the base point.

    The base point has the values that the study file gives in [base], and defaults for the others.
    """
    study, factors = request.study, request.factors
    given = {name: value for name, value in study.file.base.items() if name in factors}
    effective = study.simulator.effective({**study.base, **check_parameters(study.simulator.parameters, given)})
    home = {name: effective[name] for name in factors}
    rows, varied = [home], ["base"]
    for name, factor in factors.items():
        if home[name] is None:
            raise InputError(f"[factors.{name}]: it has no default value; give one in [base]")
        for value in levels_of(factor):
            rows.append({**home, name: value})
            varied.append(name)
    columns = {name: column_of(factor, (row[name] for row in rows)) for name, factor in factors.items()}
    defaults = ", ".join(f"{name} = {value}" for name, value in home.items() if name not in given)
    note = f"the base point has default values: {defaults}; set them in [base] for another"
    return Made(columns, {"varied": np.array(varied, dtype=object)}, (note,) if defaults else ())


def _lengths(request: Request) -> list[int]:
    return [len(factor.values or ()) for factor in request.factors.values()]


GRID: dict[str, Family] = {
    "grid": Family(_grid, lambda request: math.prod(_lengths(request))),
    "zip": Family(_zip, lambda request: max(_lengths(request), default=0)),
    "one-at-a-time": Family(_one_at_a_time, lambda request: 1 + sum(_lengths(request))),
}
"""Designs of listed levels by kind."""
