"""From a number of an analysis to the points behind it: a view of the cube that the analysis was made from."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.errors import InputError
from tripod_doe.service.explorer.axes import choices, coordinate_axes
from tripod_doe.service.explorer.view import View

_JOINED = re.compile(r" \+ |:")  # of pairs of mechanisms and of interactions


def cell_coordinates(result: xr.Dataset, variable: str, cell: int) -> dict[str, Any]:
    """The values of all coordinates at one cell of a variable, cells counted in its own order.

    Raises
    ------
    InputError
        If there is no such variable or cell.
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
    """The view that shows the points from which a number was made.

    Parameters
    ----------
    cube
        The cube that the analysis has read.
    result
        Its result.
    variable, cell
        Which number.

    Returns
    -------
    View
        Of the output, over the factors or mechanisms that the number is about, at the values along the dimensions that
        cube and result share; for a quantile the points beyond it.
    """
    at, axes = cell_coordinates(result, variable, cell), coordinate_axes(cube)
    named = [name for value in at.values() if isinstance(value, str) for name in _JOINED.split(value) if name in axes]
    named = list(dict.fromkeys(named))
    select = tuple(
        f"{name}={_text(value)}"
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
    """Method and setting of a timed run, which stand beside its number."""
    if "run" not in at or "setting_kind" not in result:
        return {}
    run = result.sel(run=at["run"]) if "run" in result.indexes else result.isel(run=int(at["run"]))
    return {"method": run["run_method"].item(), run["setting_kind"].item(): run["setting"].item()}


def _output(cube: xr.Dataset, result: xr.Dataset, at: Mapping[str, Any]) -> str:
    """The output that a number is about; the first one that the cube shows where the analysis names none of it."""
    known = [choice.name for choice in choices(cube)]
    told = str(result.attrs.get("outputs", "")).split(", ")
    wanted = [at.get("output"), *told, *(name for name in known if name == result.attrs.get("output"))]
    return next((str(name) for name in wanted if name in known), "")


def _text(value: object) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)


def cube_behind(result: xr.Dataset, at: Mapping[str, Any], steps: list[str]) -> str:
    """The step of a workflow whose cube holds the points behind a cell; the first where the analysis does not tell."""
    for name, dim in (("scene", "run"), ("case_scene", "case")):
        if dim in at and name in result and result[name].dims == (dim,):
            which = int(np.flatnonzero(result[dim].values == at[dim])[0]) if dim in result.coords else int(at[dim])
            if (step := str(result[name].values[which])) in steps:
                return step
    return steps[0] if steps else ""


def points_of_claim(text: str) -> list[tuple[str, list[int]]]:
    """Steps with numbers of their points, from what a claim tells: ``cases 0 2; ablation``."""
    parts = [part.split() for part in text.split(";") if part.strip()]
    return [(step, [int(number) for number in numbers]) for step, *numbers in parts]
