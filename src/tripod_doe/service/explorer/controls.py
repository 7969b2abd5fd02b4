"""Controls of a view: one per dimension, and a range for each factor of a list of points."""

from dataclasses import asdict
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.number_text import capital
from tripod_doe.page_parts.words import unit_text
from tripod_doe.service.explorer.axes import Axis, design_of, variable_axes
from tripod_doe.service.explorer.figures.elements import label_of
from tripod_doe.service.explorer.view import OF_POINTS, View


def controls(cube: xr.Dataset, view: View) -> dict[str, Any]:
    """The controls of a view that is filled in.

    Returns:
        ``kinds`` of views that suit the variable; axes that can be ``below`` and ``beside``; ``still``, the axes at a
        fixed value, with their values; their ``levels`` that can be subtracted; and for lists of points ``words`` of
        factors with the chosen one, and ``ranges`` of factors with both ends as texts: empty for all, or an open end.
    """
    axes = variable_axes(cube, view.variable)
    own = [axis for axis in axes if axis.name == axis.dim and axis.name != "point"]
    factors = [axis for axis in axes if axis.of_design and axis.name != "point"]
    points = [axis for axis in axes if axis.name == "point"]
    offered = {"points": (factors, list(dict.fromkeys(factors + own))), "lines": (own, own + points)}
    below, beside = offered.get(view.kind, (own, own))
    return {
        "kinds": ["lines"] * bool(own) + ["map"] * (len(own) > 1) + list(OF_POINTS) * bool(factors),
        "below": [asdict(axis) for axis in below] if view.x else [],
        "beside": [asdict(axis) for axis in beside],
        **_selections(cube, view, axes),
    }


def _selections(cube: xr.Dataset, view: View, axes: list[Axis]) -> dict[str, Any]:
    """The controls that select values: ``still``, ``words``, ``levels`` and ``ranges``, see `controls`."""
    values = dict(text.split("=", 1) for text in view.select)
    of_points = view.kind in OF_POINTS
    listed = of_points or view.by == "point"
    shown = {axis.dim for axis in axes if axis.name in (view.x, view.by)}
    shown |= set(design_of(cube)) if of_points else set()
    still = [axis for axis in axes if axis.name == axis.dim not in shown]
    factors = [axis for axis in axes if axis.of_design and axis.name != "point"] if listed else []
    ranges = [axis for axis in factors if axis.numeric]
    words = [
        axis
        for axis in axes
        if (axis in factors and not axis.numeric and axis.dim in shown)
        or (of_points and axis.name == "point" in values)
    ]
    leveled = [axis for axis in still if axis.of_design and len(axis.texts) > 1 and not listed]
    return {
        "still": [(asdict(axis), values.get(axis.name, "")) for axis in still if axis not in ranges],
        "words": [(asdict(axis) | {"texts": _words(cube, axis, values)}, values.get(axis.name, "")) for axis in words],
        "levels": [(asdict(axis), [text for text in axis.texts if text != values.get(axis.name)]) for axis in leveled],
        "ranges": [(asdict(axis), *_ends(values.get(axis.name, ""))) for axis in ranges],
    }


def _words(cube: xr.Dataset, axis: Axis, values: dict[str, str]) -> list[str]:
    """Words of a factor; of the points only the chosen one, as they may be many."""
    return [values[axis.name]] if axis.name == "point" else np.unique(cube[axis.name].astype(str)).tolist()


def _ends(wanted: str) -> tuple[str, str]:
    low, colon, high = wanted.partition(":")
    return (low, high) if colon else (wanted, wanted)


def view_title(cube: xr.Dataset, view: View, minus_name: str = "") -> str:
    """Title of a view: ``thrust amplitude (N), order 3, over joint angle``.

    Args:
        minus_name: Name of the run that is subtracted.
    """
    parts = [label_of(cube[view.variable])]
    parts += [_selection_text(cube, *text.partition("=")[::2]) for text in view.select]
    title = ", ".join(parts)
    over = [label_of(cube[name]).partition(" (")[0] for name in (view.x, view.by) if name]
    title = capital(f"{title}, over {' and '.join(over)}" if over else title)
    level = view.minus_level
    less = (
        f"the value at {_selection_text(cube, *level)}" if level else f"the value of {minus_name}" if view.minus else ""
    )
    return f"{title}, less {less}" if less else title


def _selection_text(cube: xr.Dataset, name: str, wanted: str) -> str:
    """A selection in words: ``torque 50 N m``."""
    known = name in cube.variables
    unit = unit_text(str(cube[name].attrs.get("units", "1"))) if known else ""
    words = label_of(cube[name]).partition(" (")[0] if known else name
    low, _, high = wanted.partition(":")
    ends = f"up to {high}" if high and not low else wanted.replace(":", " to ") if high else low
    more = " or more" * wanted.endswith(":")
    return f"{words} {ends} {unit}".rstrip() + more
