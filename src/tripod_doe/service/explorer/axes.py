"""Variables of a cube, the coordinates along their dimensions, and a first view."""

import math
from dataclasses import dataclass, replace

import xarray as xr

from tripod_doe.errors import InputError, near_match
from tripod_doe.model_interface import Outcome
from tripod_doe.page_parts.main_results import factor_names
from tripod_doe.service.explorer.figures.elements import label_of
from tripod_doe.service.explorer.view import OF_POINTS, View, selected_text
from tripod_doe.study.cube.dataset import COST_VARIABLES, RECORD_ROLE
from tripod_doe.typed_numbers import typed_number

_MANY_LEVELS = 8  # of both factors; with more levels a map is clearer than lines
_PREFERRED = ("thrust_amplitude", "axial_drift_mm", "axial_force_n")
_DENSE = 40  # values of an output's dimension above which it is a curve
_MOST_LISTED = 200  # points that can be chosen from a list
_FIRST = {"order": 3, "statistic": "mean"}
"""Where a new view starts along dimensions of outputs; other dimensions start at their first value."""


@dataclass(frozen=True)
class Axis:
    """A coordinate that a view can show along an axis, or fix at one value."""

    # name, label: its name in the cube and on the page
    name: str
    label: str
    dim: str  # its dimension: the same name, or ``point`` in a list of points
    texts: tuple[str, ...]  # its values as selections take them; empty for a sampled factor
    # low, high: its ends, if numeric
    low: float | None
    high: float | None
    of_design: bool  # whether it is a factor of the study; False for a dimension of an output
    numeric: bool  # whether its values are numbers


@dataclass(frozen=True)
class Choice:
    """A variable that can be shown, with its group and its meaning."""

    name: str
    label: str
    group: str
    meaning: str
    formula: str = ""  # of a variable that is computed from others


def design_of(cube: xr.Dataset) -> tuple[str, ...]:
    """Dimensions of the design; empty for a Dataset without points, such as the result of an analysis."""
    return tuple(map(str, cube["outcome"].dims)) if "outcome" in cube else ()


def coordinate_axes(cube: xr.Dataset) -> dict[str, Axis]:
    """All coordinates with values: the dimensions, and the factors of a list of points."""
    design = design_of(cube)
    factors = factor_names(cube) if design else []
    names = [*factors, *(str(dim) for dim in cube.dims if dim not in factors and cube[dim].dims)]
    return {name: _axis(cube, name, name in factors or name in design) for name in names}


def _axis(cube: xr.Dataset, name: str, of_design: bool) -> Axis:
    labels = cube[name]
    dim = str(labels.dims[0]) if labels.dims else name
    numeric = labels.dtype.kind in "fiub"
    counted = dim != name or (name == "point" and labels.size > _MOST_LISTED)
    texts = () if counted else tuple(selected_text(value) for value in labels.values.tolist())
    low, high = (float(labels.values.min()), float(labels.values.max())) if numeric and labels.size else (None, None)
    return Axis(name, label_of(labels), dim, texts, low, high, of_design, numeric)


def choices(cube: xr.Dataset) -> list[Choice]:
    """Variables of numbers in groups: results first, then the record of the runs and their costs."""
    offered = []
    for name, variable in cube.data_vars.items():
        if variable.dtype.kind not in "fiub" or name == "outcome" or "flag_values" in variable.attrs:
            continue
        record = variable.attrs.get("role") == RECORD_ROLE
        group = "Cost" if name in COST_VARIABLES else "Record of the run" if record else "Results"
        meaning, formula = (str(variable.attrs.get(text, "")) for text in ("long_name", "formula"))
        offered.append(Choice(str(name), label_of(variable), group, meaning, formula))
    return sorted(offered, key=lambda choice: ("Results", "Record of the run", "Cost").index(choice.group))


def variable_axes(cube: xr.Dataset, variable: str) -> list[Axis]:
    """The coordinates along the dimensions of a variable."""
    return [axis for axis in coordinate_axes(cube).values() if axis.dim in cube[variable].dims]


def full_view(cube: xr.Dataset, view: View) -> View:
    """Fill in what a view leaves open: the variable, the kind of view, and a value along each dimension not shown.

    Raises:
        InputError: If it names what this cube does not have.
    """
    known = [choice.name for choice in choices(cube)]
    if not known:
        raise InputError("this cube holds no numbers to show")
    preferred = next((name for name in _PREFERRED if name in known), known[0])
    variable = view.variable or preferred
    if variable not in known:
        raise InputError(f"variable = {variable!r}: not in this cube{near_match(variable, known)}")
    axes = {axis.name: axis for axis in variable_axes(cube, variable)}
    if not axes:
        return replace(view, variable=variable, kind="points", x="", by="", select=())
    x, by = (name if name in axes else "" for name in (view.x, view.by))  # others belong to another variable
    view = replace(view, variable=variable, x=x, by=by)
    view = _with_kind(view, axes)
    listed = view.kind in OF_POINTS  # there a level of an axis is a range of points
    own = set() if listed else {view.x, view.by}
    kept = tuple(text for text in view.select if _stays(*text.partition("=")[::2], axes, own))
    shown = {axes[name].dim for name in (view.x, view.by) if name} | (set(design_of(cube)) if listed else set())
    fixed = {text.partition("=")[0] for text in kept}
    still = [axis for axis in axes.values() if axis.name == axis.dim not in shown and axis.name not in fixed]
    kept += tuple(f"{axis.name}={_start_value(cube, axis)}" for axis in still)
    return replace(view, select=kept, minus=view.minus if _can_subtract(cube, view, kept) else "")


def _stays(name: str, wanted: str, axes: dict[str, Axis], own: set[str]) -> bool:
    """Whether a selection is one of this view: not the level at which a dimension stood before it became an axis."""
    return name in axes and not (name in own and wanted in axes[name].texts)


def drawn_view(cube: xr.Dataset, asked: View) -> View:
    """Fill in a view as `full_view` does, and refuse coordinates and levels that no variable of this cube has.

    Drops coordinates of other variables: the page keeps them while the user changes the variable.

    Raises:
        InputError: If it names what this cube does not have.
    """
    _refuse_unknown(cube, asked)
    view = full_view(cube, asked)
    if asked.minus_level and not view.minus and (name := asked.minus_level[0]) in (view.x, view.by):
        raise InputError(
            f"minus = {asked.minus!r}: {name} is an axis of this figure; show it by another axis, or leave minus out"
        )
    return view


def _refuse_unknown(cube: xr.Dataset, view: View) -> None:
    known = coordinate_axes(cube)
    level = view.minus_level
    named = [("x", view.x), ("by", view.by), ("minus", level[0] if level else "")]
    for key, name in [*named, *(("select", text.partition("=")[0]) for text in view.select)]:
        if name and name not in known:
            raise InputError(f"{key} = {name[:100]!r}: not a coordinate of this cube{near_match(name, known)}")
    if level and known[level[0]].numeric and not _is_number(level[1]):
        raise InputError(f"minus = {view.minus[:100]!r}: a number is needed behind {level[0]}=")
    if view.minus and not design_of(cube):
        raise InputError(f"minus = {view.minus[:100]!r}: an analysis has no points to subtract; leave it out")


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(typed_number(text))
    except ValueError:
        return False


def _can_subtract(cube: xr.Dataset, view: View, select: tuple[str, ...]) -> bool:
    """Whether a view subtracts another run, or a level of a coordinate that it fixes."""
    level = view.minus_level
    return bool(design_of(cube)) and (level is None or any(text.startswith(f"{level[0]}=") for text in select))


def _start_value(cube: xr.Dataset, axis: Axis) -> str:
    """Where a view starts along an axis: the value with most finished points, or the usual choice in the field."""
    wanted = str(_FIRST.get(axis.name, ""))
    if not axis.of_design or not axis.texts:
        return wanted if wanted in axis.texts else next(iter(axis.texts), "0")
    done = (cube["outcome"] == Outcome.FINISHED).sum([dim for dim in cube["outcome"].dims if dim != axis.dim])
    return axis.texts[int(done.values.argmax())]


def _with_kind(view: View, axes: dict[str, Axis]) -> View:
    """The view with a kind that suits its variable, and dimensions for this kind."""
    own = [axis for axis in axes.values() if axis.dim == axis.name and axis.name != "point"]
    design = [axis for axis in axes.values() if axis.of_design and axis.name != "point"]
    listed = "point" in axes
    if view.kind in ("parallel", "matrix") and design:
        return replace(view, x="", by="")
    of_points = listed and view.x not in [axis.name for axis in own]
    kind = view.kind or ("points" if of_points else _usual_figure(own))
    if (kind in OF_POINTS and not design) or (kind == "map" and len(own) < 2):
        kind = "lines"
    kind = "points" if kind == "lines" and not own else kind
    below = [axis.name for axis in sorted(design if kind == "points" else own, key=_rank)]
    x = view.x if view.x in below else next((name for name in below if name != view.by), below[0])
    if kind == "points":
        return replace(view, kind=kind, x=x)
    others = [name for name in below if name != x] + ["point"] * (listed and kind == "lines")
    by = others[-1 if listed else 0] if others else ""
    by = "" if kind == "lines" and view.x else by  # then an empty `by` is a choice, too
    return replace(view, kind=kind, x=x, by=view.by if view.by in others else by)


def _rank(axis: Axis) -> int:
    """Order in which axes are chosen: dense dimensions first, then factors, then axes of words."""
    dense = axis.numeric and not axis.of_design and len(axis.texts) > _DENSE
    return 0 if dense else 1 if axis.numeric else 2


def _usual_figure(own: list[Axis]) -> str:
    """Lines or a map over the dimensions of a variable, by those of the design and dense ones if there are any."""
    over = [axis for axis in own if axis.of_design or _rank(axis) == 0] or own
    if any(_rank(axis) == 0 for axis in over):
        return "lines"
    long = [axis for axis in over if axis.numeric and len(axis.texts) >= _MANY_LEVELS]
    return "map" if len(long) >= 2 else "lines"
