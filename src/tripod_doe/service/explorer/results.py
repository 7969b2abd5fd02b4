"""Results of analyses for a page: what was found in sentences, and tables in which each number leads to its points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.analyses.kinds import kind_of
from tripod_doe.analyses.registry import findings_of, table_of
from tripod_doe.errors import InputError
from tripod_doe.quantities import number, with_unit
from tripod_doe.report.responses import spoken, unit_text
from tripod_doe.service.explorer.behind import cell_coordinates, cube_behind, points_of_claim, view_behind
from tripod_doe.service.explorer.figures.parts import label_of
from tripod_doe.service.explorer.open_cubes import opened
from tripod_doe.study.cube.lazy_dataset import read_dataset

_MOST_ROWS = 200
_BESIDE = ("_conf", "_low", "_high", "_error", "_flag")  # endings of what is told beside a number, or not at all
_OF_METHOD = ("samples", "resolved", "samples_needed")  # about the method of the analysis, not about the joint


def results(paths: Mapping[str, str], order: int | None) -> Any:
    """Results of analyses by name, at one order of the thrust.

    Returns
    -------
    dict
        For each: ``name``, ``kind``, ``findings``, the ``orders`` that it has, its ``text`` table (heads, rows, points
        of each row) where its kind has one, and ``tables`` of its numbers.
    """
    return [_told(name, read_dataset(Path(path)), order) for name, path in paths.items()]


def _told(name: str, result: xr.Dataset, order: int | None) -> dict[str, Any]:
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
        if variable.dtype.kind == "f" and variable.dims and not about_method and not str(name).endswith(_BESIDE):
            groups.setdefault(tuple(map(str, variable.dims)), []).append(str(name))
    for dims, names in groups.items():
        rows = [dim for dim in dims if dim != "order"]
        count = int(np.prod([result.sizes[dim] for dim in rows]))
        if all(dim in result.coords for dim in rows):
            yield {
                "heads": [label_of(result[dim]) for dim in rows] + [label_of(result[name]) for name in names],
                "meanings": [""] * len(rows) + [str(result[name].attrs.get("long_name", "")) for name in names],
                "rows": [_row(result, dims, names, at, order) for at in range(min(count, _MOST_ROWS))],
                "count": count,
                "labels": len(rows),
            }


def _row(result: xr.Dataset, dims: Sequence[str], names: Sequence[str], row: int, order: int | None) -> dict[str, Any]:
    sizes = {dim: result.sizes[dim] for dim in dims}
    along = [dim for dim in dims if dim != "order"]
    at = dict(zip(along, map(int, np.unravel_index(row, [sizes[dim] for dim in along] or [1])), strict=False))
    if "order" in sizes:
        at["order"] = result["order"].values.tolist().index(order)
    cell = int(np.ravel_multi_index([at[dim] for dim in dims], list(sizes.values())))
    labels = [_label(result[dim].isel({dim: at[dim]})) for dim in along]
    return {"labels": labels, "cells": [(name, cell, _number(result, name, at)) for name in names]}


def _label(coordinate: xr.DataArray) -> str:
    value = coordinate.item()
    if isinstance(value, str):
        return " + ".join(spoken(part) for part in value.split(" + ")).replace(":", " and ")
    return with_unit(number(float(value), 6), unit_text(str(coordinate.attrs.get("units", "1"))))


def _number(result: xr.Dataset, name: str, at: Mapping[str, int]) -> str:
    """A number with what is known of its error; a dash where there is none."""
    found = {
        ending: float(result[name + ending].isel({dim: at[str(dim)] for dim in result[name + ending].dims}))
        for ending in ("_conf", "_error", "_low", "_high")
        if name + ending in result
    }
    value = float(result[name].isel(at))
    if not np.isfinite(value):
        return "\N{EN DASH}"
    for ending in ("_conf", "_error"):
        if np.isfinite(found.get(ending, np.nan)):
            return f"{number(value)} \N{PLUS-MINUS SIGN} {number(found[ending])}"
    if {"_low", "_high"} <= found.keys() and np.isfinite(found["_low"] + found["_high"]):
        low, high = number(found["_low"]), number(found["_high"])
        return f"{number(value)} ({low} to {high})" if low != high else number(value)
    return number(value)


def behind(result: str, cubes: Mapping[str, str], variable: str, cell: int) -> Any:
    """The view of the points behind a number of an analysis.

    Parameters
    ----------
    result
        File of the result.
    cubes
        Result directories of the studies that it has read, by the names of their steps; of a study its own, without
        a name.
    variable, cell
        Which number.

    Returns
    -------
    dict
        ``step`` and ``items`` of the address of the view.
    """
    data = read_dataset(Path(result))
    if not cubes:
        raise InputError("the points behind this number are not results of a study of this run")
    step = cube_behind(data, cell_coordinates(data, variable, cell), list(cubes))
    with opened(cubes[step]) as cube:
        return {"step": step, "items": view_behind(cube, data, variable, cell).items()}
