"""A scale drawing of a study's joint, for its report, and the command that animates one of its points."""

import json
import shlex
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr
from markupsafe import Markup
from numpy.typing import NDArray

from tripod_doe.errors import InputError
from tripod_doe.model_interface import Value
from tripod_doe.model_interface.parameter import is_set
from tripod_doe.motion_page.drawing import joint_drawing
from tripod_doe.page_parts.main_results import factor_names, study_tables
from tripod_doe.study.definition.simulators import load_simulator


def drawn_joint(cube: xr.Dataset) -> tuple[Markup, str, str] | None:
    """The drawing of the first point, its caption, and the command that animates the point; None without a drawing."""
    head = study_tables(cube).get("study", {})
    if not head or head.get("function") or head.get("scene", "joint") != "joint":
        return None
    fixed = json.loads(str(cube.attrs.get("fixed_parameters", "{}")))
    columns = {name: cube[name].values.ravel() for name in factor_names(cube)}
    first = {name: column[:1].item() for name, column in columns.items()}
    if not (drawing := drawing_of({**fixed, **first})):
        return None
    changed = ({**fixed, **first, name: _farthest(column)} for name, column in columns.items())
    same = all(drawing_of(values) == drawing for values in changed)
    of = ", ".join(f"{name} = {_word(value)}" for name, value in first.items())
    caption = "All points have these sizes." if same else f"The first point: {of}."
    words = [word for name, value in first.items() for word in ("--select", f"{name}={_word(value)}")]
    command = shlex.join(["tripod-doe", "view", "DIR", *words, "--output", "joint.html"])
    return drawing, caption, command


def drawing_of(given: Mapping[str, Any]) -> Markup:
    """The drawing of a point with the given values; empty if a value is impossible for a joint."""
    simulator = load_simulator()
    own = {name: value for name, value in given.items() if name in simulator.parameters and is_set(value)}
    try:
        known: dict[str, Value] = {name: simulator.parameters[name].check(value) for name, value in own.items()}
    except InputError:
        return Markup("")
    return Markup(joint_drawing(simulator.effective(known)))


def _farthest(column: NDArray[Any]) -> Any:
    """The value farthest from the first value; for words, any other value."""
    values = column.tolist()
    if column.dtype.kind in "fiu":
        return values[np.abs(column - column[0]).argmax()]
    return next((value for value in values if value != values[0]), values[0])


def _word(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)
