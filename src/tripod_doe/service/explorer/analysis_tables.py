"""Results of analyses for a page: sentences, tables of numbers, and a view of the points behind each number."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.analyses.kinds import kind_of
from tripod_doe.analyses.registry import findings_of, table_of
from tripod_doe.errors import InputError
from tripod_doe.number_text import number, value_with_ends, with_unit
from tripod_doe.page_parts.main_outputs import differ
from tripod_doe.page_parts.words import spoken, unit_text
from tripod_doe.service.explorer.axes import choices, coordinate_axes
from tripod_doe.service.explorer.figures.elements import label_of
from tripod_doe.service.explorer.open_cubes import opened
from tripod_doe.service.explorer.view import View, selected_text
from tripod_doe.study.cube.lazy_dataset import read_dataset

_MOST_ROWS = 200
_SIDE_NUMBERS = ("_conf", "_low", "_high", "_error", "_flag")  # endings of numbers shown next to another, or not at all
_OF_METHOD = ("samples", "resolved", "samples_needed")  # describe the method of the analysis, not the joint

_LIKE_OUTPUT = (
    *("mean", "std", "quantile", "distribution", "limit", "effect", "coefficient", "mu", "mu_star", "sigma"),
    *("error_rms", "error_largest"),
)
"""Names, or ends of names, of numbers in the unit of the output."""


def results(paths: Mapping[str, str], order: int | None) -> Any:
    """Results of analyses by name, at one order of the thrust.

    Returns:
        For each result: ``name``, ``kind``, ``findings``, its ``orders``, its ``text`` table (heads, rows, points
        of each row) if its kind has one, and ``tables`` of its numbers.
    """
    return [_result(name, read_dataset(Path(path)), order) for name, path in paths.items()]


def _result(name: str, result: xr.Dataset, order: int | None) -> dict[str, Any]:
    orders = result["order"].values.tolist() if "order" in result.coords and result["order"].dims else []
    chosen = order if order in orders else 3 if 3 in orders else next(iter(orders), None)
    text = table_of(result)
    claims = [points_of_claim(str(points)) for points in result["points"].values] if "claim" in result.dims else []
    return {
        "name": name,
        "kind": kind_of(result),
        "findings": findings_of(name, result),
        "orders": orders,
        "order": chosen,
        "text": None if text is None else {"heads": text[0], "rows": text[1], "points": claims},
        "tables": [] if claims else list(_tables(result, chosen)),
    }


def _tables(result: xr.Dataset, order: int | None) -> Iterator[dict[str, Any]]:
    """One table per set of dimensions, the variables side by side."""
    groups: dict[tuple[str, ...], list[str]] = {}
    for name, variable in result.data_vars.items():
        about_method = str(name) in _OF_METHOD or "samples" in variable.dims
        if variable.dtype.kind == "f" and variable.dims and not about_method and not str(name).endswith(_SIDE_NUMBERS):
            groups.setdefault(tuple(map(str, variable.dims)), []).append(str(name))
    for dims, names in groups.items():
        rows = [dim for dim in dims if dim != "order"]
        if all(dim in result.coords for dim in rows):
            repeated = _repeated(result[names], rows)
            kept = np.ones([result.sizes[dim] for dim in rows], bool)
            for at, dim in repeated:
                kept.swapaxes(1, rows.index(dim))[at, 1:] = False
            shown = np.flatnonzero(kept)
            yield {
                "heads": [label_of(result[dim]) for dim in rows] + [label_of(result[name]) for name in names],
                "meanings": [""] * len(rows) + [str(result[name].attrs.get("long_name", "")) for name in names],
                "rows": [_row(result, dims, names, at, order, repeated) for at in shown[:_MOST_ROWS].tolist()],
                "count": shown.size,
                "labels": len(rows),
            }


def _repeated(numbers: xr.Dataset, dims: Sequence[str]) -> set[tuple[int, str]]:
    """Outputs, by number, with dimensions that only their neighbours in the table have: their numbers repeat there."""
    others = [dim for dim in dims[1:] if dims[0] == "output" and numbers.sizes[dim] > 1]
    outputs = range(numbers.sizes.get("output", 0))
    return {(at, dim) for dim in others for at in outputs if not differ(numbers.isel(output=at), dim)}


def _row(
    result: xr.Dataset,
    dims: Sequence[str],
    names: Sequence[str],
    row: int,
    order: int | None,
    repeated: set[tuple[int, str]],
) -> dict[str, Any]:
    sizes = {dim: result.sizes[dim] for dim in dims}
    along = [dim for dim in dims if dim != "order"]
    at = dict(zip(along, map(int, np.unravel_index(row, [sizes[dim] for dim in along] or [1])), strict=False))
    if "order" in sizes:
        at["order"] = result["order"].values.tolist().index(order)
    cell = int(np.ravel_multi_index([at[dim] for dim in dims], list(sizes.values())))
    own = at.get("output", 0)
    labels = ["all" if (own, dim) in repeated else _label(result[dim].isel({dim: at[dim]})) for dim in along]
    return {"labels": labels, "cells": [(name, cell, _number(result, name, at)) for name in names]}


def _output_unit(result: xr.Dataset, name: str, at: Mapping[str, int]) -> str:
    """The unit of the output that a number is of, where its variable has none; empty where it is of no output."""
    own = [key for key in _LIKE_OUTPUT if f"_{name}".endswith(f"_{key}") and "units" not in result[name].attrs]
    units = json.loads(str(result.attrs.get("output_units", "{}")))
    if not own or not units:
        return ""
    output = name.removesuffix(f"_{own[0]}") if name not in own else next(iter(units))
    if "output" in at:
        output = str(result["output"].values[at["output"]])
    return unit_text(units.get(output, "1"))


def _label(coordinate: xr.DataArray) -> str:
    value = coordinate.item()
    if isinstance(value, str):
        return " + ".join(spoken(part) for part in value.split(" + ")).replace(":", " and ")
    return with_unit(number(float(value), 6), unit_text(str(coordinate.attrs.get("units", "1"))))


def _number(result: xr.Dataset, name: str, at: Mapping[str, int]) -> str:
    """A number with its error, if known, and with the unit of its output; a dash for a missing number."""
    errors = {
        ending: float(result[name + ending].isel({dim: at[str(dim)] for dim in result[name + ending].dims}))
        for ending in ("_conf", "_error", "_low", "_high")
        if name + ending in result
    }
    value = float(result[name].isel(at))
    if not np.isfinite(value):
        return "\N{EN DASH}"
    unit = _output_unit(result, name, at)
    for ending in ("_conf", "_error"):
        if np.isfinite(errors.get(ending, np.nan)):
            return with_unit(f"{number(value)} \N{PLUS-MINUS SIGN} {number(errors[ending])}", unit)
    if {"_low", "_high"} <= errors.keys() and np.isfinite(errors["_low"] + errors["_high"]):
        return value_with_ends(value, errors["_low"], errors["_high"], unit)
    return with_unit(number(value), unit)


def behind(result: str, cubes: Mapping[str, str], variable: str, cell: int) -> Any:
    """The view of the points behind a number of an analysis.

    Args:
        result: File of the result.
        cubes: Result directories of the studies that the analysis has read, by step; a single study has one entry,
            with an empty name.

    Returns:
        ``step`` and ``items`` of the address of the view.
    """
    data = read_dataset(Path(result))
    if not cubes:
        raise InputError("the points behind this number are not results of a study of this run")
    step = cube_behind(data, cell_coordinates(data, variable, cell), list(cubes))
    with opened(cubes[step]) as cube:
        return {"step": step, "items": view_behind(cube, data, variable, cell).items()}


_JOINED = re.compile(r" \+ |:")  # in names of pairs of mechanisms and of interactions


def cell_coordinates(result: xr.Dataset, variable: str, cell: int) -> dict[str, Any]:
    """The values of all coordinates at one cell of a variable; cells are counted in the order of its dimensions.

    Raises:
        InputError: If there is no such variable or cell.
    """
    if variable not in result.data_vars:
        raise InputError(f"variable = {variable!r}: not in this analysis")
    array = result[variable]
    if not 0 <= cell < array.size:
        raise InputError(f"cell = {cell}: {variable} has cells 0 to {array.size - 1}")
    at = dict(zip(array.dims, (int(place) for place in np.unravel_index(cell, array.shape)), strict=True))
    inside = set(array.dims)
    return {
        str(name): labels.isel({dim: at[dim] for dim in labels.dims}).item()
        for name, labels in result.coords.items()
        if set(labels.dims) <= inside
    }


def view_behind(cube: xr.Dataset, result: xr.Dataset, variable: str, cell: int) -> View:
    """The view that shows the points from which a number was computed.

    Returns:
        It shows the output over the number's factors or mechanisms, at its place along the dimensions that cube and
        result share; for a quantile, the points beyond it.
    """
    at, axes = cell_coordinates(result, variable, cell), coordinate_axes(cube)
    named = [name for value in at.values() if isinstance(value, str) for name in _JOINED.split(value) if name in axes]
    named = list(dict.fromkeys(named))
    select = tuple(
        f"{name}={selected_text(value)}"
        for name, value in (at | _of_run(result, at)).items()
        if name in axes and name not in named
    )
    output = _output(cube, result, at)
    view = View(output, select=select)
    if (share := at.get("probability", at.get("share"))) is not None:
        beyond = "<=" if share < 0.5 else ">="
        number = float(result[variable].values.ravel()[cell])
        view = View(output, "points", select=select, where=f"{output} {beyond} {number:.12g}")
    return view if not named else View(output, "points", named[0], next(iter(named[1:]), ""), select)


def _of_run(result: xr.Dataset, at: Mapping[str, Any]) -> dict[str, Any]:
    """Method and setting of a timed run, which are shown next to its number."""
    if "run" not in at or "setting_kind" not in result:
        return {}
    run = result.sel(run=at["run"]) if "run" in result.indexes else result.isel(run=int(at["run"]))
    return {"method": run["run_method"].item(), run["setting_kind"].item(): run["setting"].item()}


def _output(cube: xr.Dataset, result: xr.Dataset, at: Mapping[str, Any]) -> str:
    """The output that a number describes; the cube's first one if the analysis names no output of this cube."""
    known = [choice.name for choice in choices(cube)]
    declared = str(result.attrs.get("outputs", "")).split(", ")
    wanted = [at.get("output"), *declared, *(name for name in known if name == result.attrs.get("output"))]
    return next((str(name) for name in wanted if name in known), "")


def cube_behind(result: xr.Dataset, at: Mapping[str, Any], steps: list[str]) -> str:
    """The workflow step whose cube holds the points behind a cell; the first step if the analysis names none."""
    for name, dim in (("scene", "run"), ("case_scene", "case")):
        if dim in at and name in result and result[name].dims == (dim,):
            which = int(np.flatnonzero(result[dim].values == at[dim])[0]) if dim in result.coords else int(at[dim])
            if (step := str(result[name].values[which])) in steps:
                return step
    return steps[0] if steps else ""


def points_of_claim(text: str) -> list[tuple[str, list[int]]]:
    """Steps with the numbers of their points, from the text of a claim: ``cases 0 2; ablation``."""
    parts = [part.split() for part in text.split(";") if part.strip()]
    return [(step, [int(number) for number in numbers]) for step, *numbers in parts]
