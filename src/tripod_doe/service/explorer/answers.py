"""Answers of workers to questions of the cube explorer: the choices, a figure, one point."""

import json
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.errors import InputError, near_match
from tripod_doe.model_interface import Outcome
from tripod_doe.motion_page.page import motion_page, viewed_point
from tripod_doe.number_text import duration, level_or_word, number, with_unit
from tripod_doe.page_parts.main_results import factor_names, study_tables
from tripod_doe.page_parts.tables import failed_points
from tripod_doe.page_parts.words import unit_text
from tripod_doe.reports.joint_drawing import drawing_of
from tripod_doe.service.explorer.axes import choices, coordinate_axes, design_of, drawn_view, full_view
from tripod_doe.service.explorer.controls import controls, view_title
from tripod_doe.service.explorer.exports import (
    point_values,
    query_command,
    query_python,
    simulate_command,
    study_of_view,
)
from tripod_doe.service.explorer.figures.elements import NUMBER, blank_reasons, is_failed, label_of, shown
from tripod_doe.service.explorer.figures.point import point_figures
from tripod_doe.service.explorer.open_cubes import opened
from tripod_doe.service.explorer.slices import (
    colour_range,
    draw,
    number_of,
    numbered,
    point_of,
    seen,
    shown_cells,
    values_of,
)
from tripod_doe.service.explorer.view import View, selected_text
from tripod_doe.study.cube.file_checks import analysis_files
from tripod_doe.study.definition.simulators import SCENES, load_simulator
from tripod_doe.study.query.query import records, without_rounding

Items = Sequence[Sequence[str]]
"""A view as in its address: names and texts."""

_MOST_ROWS = 500


def explore(path: str, items: Items, place: str, minus_name: str = "") -> Any:
    """Changes that a view of a result directory allows, and the same view as a command and as Python.

    Args:
        minus_name: Name of the run that is subtracted.

    Returns:
        The view filled in, variables, axes, copies.
    """
    asked = View.from_items((name, text) for name, text in items)
    with _cube(path, asked) as cube:
        return _explored(cube, full_view(cube, asked), path, place, minus_name)


def _explored(cube: xr.Dataset, view: View, path: str, place: str, minus_name: str) -> dict[str, Any]:
    source = f"/analysis/{view.analysis}.nc" if view.analysis else ""
    return {
        "view": asdict(view),
        "address": view.address,
        "data_items": view.data_items,
        "title": view_title(cube, view, minus_name),
        "meaning": str(cube[view.variable].attrs.get("long_name", "")),
        "variables": [asdict(choice) for choice in choices(cube)],
        "range": colour_range(cube, view),
        "points": bool(design_of(cube)),
        "analyses": list(analysis_files(Path(path))),
        "design": [asdict(axis) for axis in coordinate_axes(cube).values() if axis.of_design and axis.name != "point"],
        "copies": {
            "Command line": query_command(place + source, view),
            "Python": query_python(place + source, view),
            "Study (TOML)": study_of_view(cube, view, seen(cube, view)),
        },
        **controls(cube, view),
    }


def figure(path: str, items: Items, other: str | None) -> bytes:
    """A view of a result directory as the JSON of a figure for Plotly; `other` is the directory that is subtracted."""
    asked = View.from_items((name, text) for name, text in items)
    with _cube(path, asked) as cube, _cube(other, asked) if other else nullcontext() as subtracted:
        view = drawn_view(cube, asked)
        drawn = draw(cube, view, subtracted if view.minus else None)
    return json.dumps(drawn, allow_nan=False).encode()


def _cube(path: str, view: View) -> AbstractContextManager[xr.Dataset]:
    """The cube of a directory, or the result of one of its analyses."""
    if not view.analysis:
        return opened(path)
    known = analysis_files(Path(path))
    if view.analysis not in known:
        raise InputError(f"analysis = {view.analysis!r}: not in this run; it has {', '.join(known) or 'none'}")
    return opened(str(known[view.analysis]))


def numbers(path: str, items: Items, other: str | None = None) -> Any:
    """The cells of a view as texts, at most 500: ``heads``, ``rows`` with the point first, whether a ``difference``."""
    asked = View.from_items((name, text) for name, text in items)
    with _cube(path, asked) as cube, _cube(other, asked) if other else nullcontext() as subtracted:
        return _table(cube, drawn_view(cube, asked), subtracted)


def _table(cube: xr.Dataset, view: View, other: xr.Dataset | None) -> dict[str, Any]:
    if view.minus:
        cells = shown_cells(cube, view, other)
        kept = shown(cells).notnull() | (cells["outcome"] != Outcome.FINISHED)  # the condition drops the others
        columns = records(cells, view.variable)
        columns = {name: column[kept.values.ravel()] for name, column in columns.items()}
    else:
        cells = numbered(cube, view.variable)
        columns = records(cells, view.variable, view.select, where=view.where or None)
    points = columns.pop(NUMBER, None)
    columns.pop("point", None)
    first = {name: column[:_MOST_ROWS].tolist() for name, column in without_rounding(columns).items()}
    counted = points[:_MOST_ROWS].tolist() if points is not None else range(len(next(iter(first.values()))))
    texts = [[_word(value) for value in column] for column in first.values()]
    return {
        "heads": [label_of(cube[name]) if name != "outcome" else "outcome" for name in first],
        "rows": [list(row) for row in zip(counted, *texts, strict=True)],
        "numbered": points is not None,
        "difference": bool(view.minus),
        "count": next(iter(columns.values())).size,
    }


def _word(value: Any) -> str:
    return "" if value != value else level_or_word(value)


def failures(path: str) -> Any:
    """Points that failed, at most 500 of them: their numbers, factors, outcomes and reasons."""
    with opened(path) as cube:
        lost = is_failed(cube).values
        rows = [asdict(each) for each in failed_points(cube, _MOST_ROWS, lost)]
        heads = [label_of(cube[name]) for name in factor_names(cube)]
        return {"heads": heads, "rows": rows, "count": int(lost.sum())}


def extremes(path: str, order: int) -> Any:
    """Smallest and largest value of the first result at an order, with the numbers of their points; None if none.

    None also for a result with further dimensions, such as a waveform: a point has many values of it.
    """
    with opened(path) as cube:
        view = full_view(cube, View(kind="points", select=(f"order={order}",) if "order" in cube.coords else ()))
        chosen = [text for text in view.select if text != f"order={order}"]
        values = seen(cube, view)
        drawn = shown(values)
        if chosen or set(drawn.dims) != set(values["outcome"].dims) or not bool(drawn.notnull().any()):
            return None
        numbers, flat = values[NUMBER].transpose(*drawn.dims).values.ravel(), drawn.values.ravel()
        least, largest = int(np.nanargmin(flat)), int(np.nanargmax(flat))
        unit = unit_text(str(drawn.attrs.get("units", "1")))
        return {
            "label": label_of(drawn) + f", order {order}" * bool(view.select),
            **{
                end: {"text": with_unit(number(float(flat[at])), unit), "number": int(numbers[at])}
                for end, at in (("least", least), ("largest", largest))
            },
        }


def point(path: str, number_of_point: int, at: str = "") -> Any:
    """Everything about one point: its factors, its outcome, its scalar results, figures of the other results.

    Args:
        at: Its factor values, as `number_of` takes them.
    """
    with opened(path) as cube:
        return _point(cube, number_of(cube, number_of_point, at))


def _point(cube: xr.Dataset, number_of_point: int) -> dict[str, Any]:
    point = point_of(cube, number_of_point)
    factors = factor_names(cube)
    scalars = [
        name
        for name in point.data_vars
        if point[name].dtype.kind in "fiu" and not point[name].dims and "flag_values" not in point[name].attrs
    ]
    reason = str(blank_reasons(point.expand_dims("point"))[0])
    scene, settings = str(study_tables(cube).get("study", {}).get("scene", "joint")), point_values(cube, point)
    return {
        "scene": scene,
        "price": _price(point),
        "number": number_of_point,
        "at": values_of(cube, point),
        "count": cube["outcome"].size,
        "factors": [{"label": label_of(cube[name]), "name": name, "value": _as_text(point[name])} for name in factors],
        "outcome": Outcome(int(point["outcome"])).label,
        "reason": reason,
        "scalars": [
            {
                "label": label_of(point[name]),
                "value": _as_text(point[name]),
                "meaning": str(point[name].attrs.get("long_name", "")),
            }
            for name in scalars
            if np.isfinite(point[name].item())
        ],
        "parameters": settings,
        "command": simulate_command(cube, point),
        "drawing": drawing_of(settings) if scene == "joint" and not _function(cube) else "",
        "figures": point_figures(point) if not reason else {},
    }


def motion(path: str, number_of_point: int, at: str = "") -> Any:
    """The page that animates one point, which is simulated again to get its contacts."""
    with opened(path) as cube:
        if _function(cube) or study_tables(cube).get("study", {}).get("scene", "joint") != "joint":
            raise InputError("only the scene joint can be seen in motion")
        values = point_values(cube, point_of(cube, number_of(cube, number_of_point, at)))
    return motion_page(viewed_point(**values))


def _function(cube: xr.Dataset) -> bool:
    """Whether a user's function computes the points."""
    return bool(study_tables(cube).get("study", {}).get("function"))


def parameters(scene: str) -> Any:
    """Parameters of a scene with their defaults as texts, empty if the model decides."""
    if scene not in SCENES:
        raise InputError(f"scene = {scene!r}: unknown{near_match(scene, SCENES)}")
    known = load_simulator(scene).parameters.values()
    return [(p.name, "" if p.default is None else selected_text(p.default)) for p in known]


def _price(found: xr.Dataset) -> str:
    """The cost of the point, as the price of a similar point."""
    seconds = float(found["cpu_seconds"]) if "cpu_seconds" in found else np.nan
    return f"This point took {duration(seconds)} of CPU time." if np.isfinite(seconds) else ""


def _as_text(value: xr.DataArray) -> str:
    return with_unit(level_or_word(value.item()), unit_text(str(value.attrs.get("units", "1"))))
