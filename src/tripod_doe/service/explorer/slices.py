"""The slice of a cube that a view shows, by the same query as on the command line, and its figure."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.errors import InputError
from tripod_doe.model_interface import Outcome
from tripod_doe.number_text import count_of
from tripod_doe.page_parts.main_results import factor_names
from tripod_doe.page_parts.words import listed
from tripod_doe.phases import is_phase, shorter_way
from tripod_doe.service.explorer.axes import coordinate_axes, design_of
from tripod_doe.service.explorer.figures.elements import (
    IS_DIFFERENCE,
    NUMBER,
    Figure,
    is_failed,
    label_of,
    packed,
    plain,
    shown,
)
from tripod_doe.service.explorer.figures.heat_map import heat_map
from tripod_doe.service.explorer.figures.lines import lines
from tripod_doe.service.explorer.figures.scatter import scatter
from tripod_doe.service.explorer.view import OF_POINTS, View
from tripod_doe.study.query.query import narrowed, query


def numbered(cube: xr.Dataset, variable: str = "") -> xr.Dataset:
    """A cube with the number of each point as a coordinate, with which a mark in a figure leads to its point.

    The result of an analysis has no points: there the cells of the variable are numbered.
    """
    design = design_of(cube) or (tuple(map(str, cube[variable].dims)) if variable else ())
    if not design:
        return cube
    shape = tuple(cube.sizes[dim] for dim in design)
    numbers = np.arange(math.prod(shape), dtype=np.int32).reshape(shape)
    return cube.assign_coords({NUMBER: (design, numbers, {"long_name": "number of the point or cell"})})


def point_of(cube: xr.Dataset, number_of_point: int) -> xr.Dataset:
    """One point of a cube by its number; InputError if the cube has no such point."""
    design = design_of(cube)
    shape = tuple(cube.sizes[dim] for dim in design)
    count = int(np.prod(shape))
    if not design or not 0 <= number_of_point < count:
        raise InputError(f"point = {number_of_point}: this cube has points 0 to {count - 1}")
    at = dict(zip(design, (int(where) for where in np.unravel_index(number_of_point, shape)), strict=True))
    return numbered(cube).isel(at).load()


def values_of(cube: xr.Dataset, point: xr.Dataset) -> str:
    """The factor values of a point as a text, by which `number_of` finds it again."""
    return json.dumps({name: point[name].item() for name in factor_names(cube)}, separators=(",", ":"))


def number_of(cube: xr.Dataset, number_of_point: int, at: str) -> int:
    """The number of the point with these factor values, which moves when the study grows.

    Args:
        number_of_point: Its number when the text was written; stands for itself without a text.
        at: From `values_of`.

    Raises:
        InputError: If no point has these values, or several have, and this number has not.
    """
    if not at:
        return number_of_point
    fits = xr.ones_like(cube["outcome"], dtype=bool)
    try:
        values = dict[str, Any](**json.loads(at))  # no list of pairs, and no empty one
        if not values and factor_names(cube):
            raise ValueError
        for name, value in values.items():
            column = cube[name]
            wanted = float(value) if column.dtype.kind in "fiu" else str(value)
            same = (column if isinstance(wanted, float) else column.astype(str)) == wanted
            fits = fits & (same | column.isnull() if wanted != wanted else same)
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
        raise InputError(f"at = {at[:100]!r}: not the values of a point of this study") from error
    found = np.flatnonzero(fits.transpose(*cube["outcome"].dims).values)
    if number_of_point in found:
        return number_of_point
    if found.size != 1:
        raise InputError(f"at = {at[:100]!r}: {count_of(found.size, 'point')} of this study have these values")
    return int(found[0])


def seen(cube: xr.Dataset, view: View) -> xr.Dataset:
    """The slice that a view shows: its variable, then its error, the outcome and its detail if present.

    Drops dimensions with one value left, except the axes of the view; cells that the condition leaves out are NaN and
    count as finished, so that they stay blank.

    Raises:
        InputError: If a name or the condition is wrong, or no cell is left.
    """
    cube = numbered(cube, view.variable)
    answer = query(cube, view.variable, view.select, where=view.where or None)
    if 0 in answer.sizes.values():
        raise InputError(f"no cell matches: {', '.join(view.select)}")
    cells = narrowed(answer)
    if "selected" in answer and "outcome" in cells and not set(answer["selected"].dims) - set(cells["outcome"].dims):
        cells["outcome"] = cells["outcome"].where(answer["selected"], Outcome.FINISHED).astype(np.int8)
    beside = _aims(cube) if view.kind in ("parallel", "matrix") else []
    for name in (f"{view.variable}_error", "outcome_detail", *beside):
        if name in cube and name != view.variable and set(cube[name].dims) <= set(cube[view.variable].dims):
            axes = [axis.name for axis in coordinate_axes(cube).values() if axis.dim in cube[name].dims]
            cells[name] = query(cube, name, view.selected(axes))[name]
    keep = {dim for name in (view.x, view.by) if name in cube.variables for dim in cube[name].dims}
    keep |= set(design_of(cube)) if view.kind in OF_POINTS else set()
    return cells.squeeze([dim for dim in cells.dims if cells.sizes[dim] == 1 and dim not in keep], drop=True)


def _aims(data: xr.Dataset) -> list[str]:
    """Objectives and constraints of the candidates of an optimisation."""
    return [str(name) for name, each in data.data_vars.items() if each.attrs.get("role") in ("objective", "constraint")]


def draw(cube: xr.Dataset, view: View, other: xr.Dataset | None = None) -> Figure:
    """Draw a filled-in view; with another cube or a level to subtract, draw the difference.

    Raises:
        InputError: If this cube has nothing to draw for the view, with what to change.
    """
    data = shown_cells(cube, view, other)
    limits = None
    if view.kind == "map":
        limits = _limits(view, None if view.minus else colour_range(cube, view))
    return plain(_drawn(data, view, limits)) | {"note": _note(data)}


def shown_cells(cube: xr.Dataset, view: View, other: xr.Dataset | None = None) -> xr.Dataset:
    """The slice of `seen`, minus the same slice of another cube or of the level that the view subtracts."""
    data = seen(cube, view)
    if other is not None:
        less = _seen_of_other(other, view)
        _refuse_unlike(data, less)
        return _difference(data, less)
    if level := view.minus_level:
        less, name = seen(cube, _at_level(view, *level)), level[0]
        if data.sizes.get(name) == less.sizes.get(name) == 1:  # views of single points keep such dimensions
            less = less.assign_coords({name: data[name]})
        return _difference(data, less)
    return data


def _note(data: xr.Dataset) -> str:
    """Count of shown points without a value, with the reasons, and whether a difference leaves out some."""
    parts = [str(data.attrs["left_out"])] if data.attrs.get("left_out") else []
    if "outcome" not in data:
        return ""
    failed, codes = is_failed(data).values, data["outcome"].values
    waiting = int((codes == Outcome.NOT_RUN).sum())
    if failed.any():
        kinds, counts = np.unique(codes[failed], return_counts=True)
        reasons = listed(
            [
                f"{count:,} {Outcome(int(kind)).label.replace('_', ' ')}"
                for kind, count in zip(kinds, counts, strict=True)
            ]
        )
        parts.append(f"{int(failed.sum()):,} of {count_of(codes.size, 'point')} failed: {reasons}.")
    if waiting:
        parts.append(f"{waiting:,} of {count_of(codes.size, 'point')} not computed.")
    return " ".join(parts)


def _at_level(view: View, name: str, level: str) -> View:
    """The same view at another value of a fixed coordinate, without the condition: it chooses cells of the view."""
    kept = [text for text in view.select if text.partition("=")[0] != name]
    return replace(view, select=(*kept, f"{name}={level}"), minus="", where="")


def _seen_of_other(cube: xr.Dataset, view: View) -> xr.Dataset:
    try:
        return seen(cube, replace(view, where=""))
    except InputError as error:
        raise InputError(f"in the run that is subtracted: {error}") from error


def _drawn(data: xr.Dataset, view: View, limits: tuple[float, float] | None) -> Figure:
    if view.kind in ("parallel", "matrix"):
        return parallel_axes(data) | {"matrix": view.kind == "matrix"}
    left = [str(dim) for dim in shown(data).dims]
    if view.kind == "points":
        colour = view.by if view.by in data.variables and view.by != view.x else None
        return scatter(data, view.x, colour) if view.x else {"data": [], "layout": {}}
    along = [name for name in (view.x, view.by) if name]
    if extra := [dim for dim in left if dim not in along]:
        raise InputError(f"{', '.join(extra)}: choose one value for this kind of view, or show it along an axis")
    if view.kind == "map":
        return heat_map(data, view.x, view.by, limits)
    return lines(data, view.x, view.by or None)


def colour_range(cube: xr.Dataset, view: View) -> tuple[float, float] | None:
    """Range of a variable over the whole design, at the view's place along the dimensions of outputs.

    Colours then mean the same in every slice; None if no number is known.
    """
    design = design_of(cube)
    axes = [axis.name for axis in coordinate_axes(cube).values() if axis.dim not in design]
    fixed = view.selected([name for name in axes if name not in (view.x, view.by)])
    values = query(cube, view.variable, fixed)[view.variable].values if axes else cube[view.variable].values
    known = values[np.isfinite(values)]
    return (float(known.min()), float(known.max())) if known.size else None


def _limits(view: View, extremes: tuple[float, float] | None) -> tuple[float, float] | None:
    low, high = extremes or (None, None)
    low, high = low if view.low is None else view.low, high if view.high is None else view.high
    return None if low is None or high is None else (low, high)


def _refuse_unlike(data: xr.Dataset, other: xr.Dataset) -> None:
    """Refuse to subtract another unit, or points of a list that have other values of a factor."""
    first, second = (cells[str(shown(cells).name)] for cells in (data, other))
    if (unit := first.attrs.get("units", "")) != (its := second.attrs.get("units", "")):
        raise InputError(f"minus: {first.name} is in {unit or 'no unit'} here, in {its or 'no unit'} in the other run")
    factors = [
        {str(name) for name, one in cells.coords.items() if one.dims and name not in (*cells.dims, NUMBER)}
        for cells in (data, other)
    ]
    for name in sorted(factors[0] | factors[1]):
        here, there = (cells[name].reset_coords(drop=True) if name in cells else None for cells in (data, other))
        if here is None or there is None or not here.equals(there):
            raise InputError(
                f"minus: the points of the other run differ in {name}: compare the runs by tripod-doe diff"
            )


def _difference(data: xr.Dataset, other: xr.Dataset) -> xr.Dataset:
    """The first slice minus the other, at the coordinates that both have; phases by the shorter way."""
    sizes = dict(data.sizes), dict(other.sizes)
    try:
        data, other = xr.align(data, other, join="inner")
    except ValueError as error:
        raise InputError("minus: what is subtracted has axes of other lengths") from error
    first, second = variable, _ = shown(data), shown(other)
    if not first.size:
        raise InputError("minus: what is subtracted has no point in common: a difference needs equal values along axes")
    if first.dims != second.dims:
        raise InputError("minus: what is subtracted has other dimensions")
    change = first - second
    if is_phase(variable):
        change = shorter_way(change)
    attributes = variable.attrs | {IS_DIFFERENCE: "yes"}
    changed = change.assign_coords(variable.coords).assign_attrs(attributes).rename(variable.name)
    lost = data["outcome"].where(other["outcome"] == Outcome.FINISHED, other["outcome"]).astype(np.int8)
    kept = [name for name in data.data_vars if name in ("outcome_detail",)]
    return (
        xr.Dataset({str(variable.name): changed, "outcome": lost.assign_attrs(data["outcome"].attrs)})
        .assign({name: data[name] for name in kept})
        .assign_attrs(left_out="" if sizes == (dict(data.sizes),) * 2 else "Only values that both have are shown.")
    )


def parallel_axes(data: xr.Dataset) -> Figure:
    """Factors and variable of all points, as ``axes`` side by side, with their ``numbers`` and ``outcome``.

    Between them stand the other objectives and the constraints of candidates.
    """
    variable, design = shown(data), data["outcome"].dims
    factors = [
        name for name in coordinate_axes(data) if name not in ("point", NUMBER) and set(data[name].dims) <= set(design)
    ]
    columns = [data[name].broadcast_like(data["outcome"]) for name in factors]
    aims = [data[name].where(variable.notnull()) for name in _aims(data) if name != variable.name]
    axes = [_parallel_axis(column.transpose(*design)) for column in (*columns, *aims, variable)]
    return {
        "axes": axes,
        "numbers": packed(data[NUMBER].transpose(*design).values.ravel()),
        "outcome": packed(data["outcome"].values.ravel().astype(np.int32)),
    }


def _parallel_axis(column: xr.DataArray) -> dict[str, Any]:
    values = column.values.ravel()
    column_data: dict[str, Any] = {"name": str(column.name), "label": label_of(column)}
    if values.dtype.kind in "fiub":
        return column_data | {"values": packed(values.astype(float))}
    known, which = np.unique(values.astype(str), return_inverse=True)
    return column_data | {"words": known.tolist(), "values": packed(which.astype(float))}
