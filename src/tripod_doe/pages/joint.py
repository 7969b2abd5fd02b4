"""The joint of a study to scale, for its report, and the command that moves one of its points."""

from __future__ import annotations

import json
import shlex
import tomllib
from collections.abc import Mapping
from typing import Any

import xarray as xr
from markupsafe import Markup

from tripod_doe.motion.drawing import joint_drawing
from tripod_doe.report.responses import factor_names
from tripod_doe.simulator import Value
from tripod_doe.study.definition.scenes import load_simulator


def drawn_joint(cube: xr.Dataset) -> tuple[Markup, str, str] | None:
    """The drawing of the first point, what it shows, and the command that moves that point; None for another scene."""
    try:
        study = tomllib.loads(str(cube.attrs.get("study", "")))
    except tomllib.TOMLDecodeError:
        return None
    head = study.get("study", {})
    if not head or head.get("function") or head.get("scene", "joint") != "joint":
        return None
    fixed = json.loads(str(cube.attrs.get("fixed_parameters", "{}")))
    names = factor_names(cube)
    first, last = ({name: _end(cube[name], at) for name in names} for at in (0, -1))
    drawings = [drawing_of({**fixed, **values}) for values in (first, last)]
    of = ", ".join(f"{name} = {_word(value)}" for name, value in first.items())
    caption = "All points have these sizes." if drawings[0] == drawings[1] else f"The first point: {of}."
    words = [word for name, value in first.items() for word in ("--select", f"{name}={_word(value)}")]
    command = shlex.join(["tripod-doe", "view", "DIR", *words, "--output", "joint.html"])
    return drawings[0], caption, command


def drawing_of(given: Mapping[str, Any]) -> Markup:
    """The drawing of a point of the joint by the values that are given."""
    simulator = load_simulator()
    known: dict[str, Value] = {name: value for name, value in given.items() if name in simulator.parameters}
    return Markup(joint_drawing(simulator.effective(known)))


def _end(values: xr.DataArray, at: int) -> Any:
    return values.values.ravel()[at].item()


def _word(value: Any) -> str:
    return f"{value:.12g}" if isinstance(value, float) else str(value)
