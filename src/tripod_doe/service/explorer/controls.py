"""Controls of a view: one per dimension, and a range for each factor of a list of points."""

from dataclasses import asdict
from typing import Any

import numpy as np
import xarray as xr

from tripod_doe.page_parts.words import unit_text
from tripod_doe.quantities import capital
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
    values = dict(text.split("=", 1) for text in view.select)
    kinds = (["lines"] if own else []) + (["map"] if len(own) > 1 else []) + (list(OF_POINTS) if factors else [])
    shown = {axis.dim for axis in axes if axis.name in (view.x, view.by)}
    listed = view.kind in OF_POINTS or view.by == "point"
    if view.kind in OF_POINTS:
        shown |= set(design_of(cube))
    beside = own + [axis for axis in axes if axis.name == "point"] if view.kind == "lines" else own
    ranges = [axis for axis in factors if axis.numeric and listed]
    return {
        "kinds": kinds,
        "below": [asdict(axis) for axis in (factors if view.kind == "points" else own)] if view.x else [],
        "beside": [asdict(axis) for axis in (dict.fromkeys(factors + own) if view.kind == "points" else beside)],
        "still": [
            (asdict(axis), values.get(axis.name, ""))
            for axis in axes
            if axis.name == axis.dim not in shown and not (listed and axis in ranges)
        ],
        "words": [
            (asdict(axis) | {"texts": _words(cube, axis, values)}, values.get(axis.name, ""))
            for axis in axes
            if (listed and axis in factors and not axis.numeric and axis.dim in shown)
            or (view.kind in OF_POINTS and axis.name == "point" in values)
        ],
        "levels": [
            (asdict(axis), [text for text in axis.texts if text != values.get(axis.name)])
            for axis in axes
            if axis.of_design and axis.name == axis.dim not in shown and len(axis.texts) > 1 and not listed
        ],
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
