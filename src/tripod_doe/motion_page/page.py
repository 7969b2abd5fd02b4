"""The page that animates a joint: one file with data, script and style, which loads nothing else."""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.joint.contact_outputs import CONTACT_NAMES
from tripod_doe.joint.derived_constants.contact_pressure import ellipse_axes
from tripod_doe.joint.orders import ORDERS
from tripod_doe.joint.outputs import PARTS
from tripod_doe.joint.unit_conversion import point_values
from tripod_doe.joint.values import JointValues
from tripod_doe.model_interface import Outcome, Value
from tripod_doe.motion_page.drawing import joint_drawing
from tripod_doe.motion_page.poses import Poses, poses_of
from tripod_doe.study.simulate import SimulatedPoint, simulate_point

_MOST_BYTES = 1_000_000
"""Largest size of the poses of a revolution, as text."""
_SIZES = (
    "joint_angle",
    "pitch_radius",
    "roller_radius",
    "roller_width",
    "groove_radius",
    "needle_radius",
    "needle_length",
    "bearing_radius",
    "trunnion_radius",
    "bearing_radial_clearance",
    "ring_distance",
    "needle_axial_clearance",
    "torque",
)


@dataclass(frozen=True)
class JointInMotion:
    """A simulated joint that shows itself: in a notebook, or as a file for a browser."""

    page: str  # HTML, complete in itself

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{html.escape(self.page)}" style="width:100%;height:860px;border:0"></iframe>'


def view(against: Mapping[str, Any] | None = None, **parameters: Any) -> JointInMotion:
    """Simulate a point of the joint and move it.

    Args:
        against: Parameters in which a second point differs, which is shown next to it.
        **parameters: As for `simulate`.

    Raises:
        InputError: If a parameter cannot be used, or a point does not finish.
    """
    others = [] if against is None else [{**parameters, **against}]
    return JointInMotion(motion_page(*(viewed_point(**each) for each in (parameters, *others))))


def viewed_point(**parameters: Any) -> SimulatedPoint:
    """Simulate a point of the joint with all that a view of it needs."""
    return simulate_point("joint", CONTACT_NAMES, **parameters)


def motion_page(*points: SimulatedPoint) -> str:
    """The page of one or two points with the outputs of their contacts.

    Raises:
        InputError: If a point did not finish: there is no motion to show.
    """
    data, blocks = [], []
    for which, point in enumerate(points):
        if point.outcome is not Outcome.FINISHED:
            raise InputError(f"there is no motion to show: the point is {point.outcome.label}: {point.detail}")
        outputs = {name: values.data for name, values in point.outputs.items()}
        if not np.isfinite(outputs.get("groove_normal_force", np.nan)).all():
            raise InputError("there is no motion to show: no forces of the grooves are known, as without torque_n_m")
        data.append(motion_data(point.parameters, outputs))
        blocks.append(_block(which, point, _own(point, points)))
    source = files("tripod_doe.motion_page")
    replaced = {
        "@title@": html.escape(" next to ".join(_title(point.parameters) for point in points)),
        "@points@": "".join(blocks),
        '"points"': '"points two"' if len(points) > 1 else '"points"',
        "@data@": json.dumps(data, allow_nan=False).replace("<", "\\u003c"),
        "@style@": source.joinpath("motion.css").read_text(encoding="utf-8"),
        "@script@": "".join(source.joinpath(name).read_text(encoding="utf-8") for name in ("shapes.js", "motion.js")),
    }
    page = source.joinpath("motion.html").read_text(encoding="utf-8")
    for mark, text in replaced.items():
        page = page.replace(mark, text)
    return page


def _own(point: SimulatedPoint, points: Sequence[SimulatedPoint]) -> str:
    """The values in which a point differs from the others; empty for a single point."""
    varied = [
        name
        for name in point.parameters
        if len({str(other.parameters.get(name)) for other in points}) > 1 and point.simulator.parameters[name].unit
    ]
    return ", ".join(f"{name} = {point.parameters[name]}" for name in varied)


_LABELS = {
    "scene": "The joint in motion. Space: play; left and right: step; up, down, plus, minus: zoom; 1 to 6: views; "
    "drag: turn",
    "ring": "The needles of each trunnion unrolled: angle from the loaded side, place along the trunnion, colour by "
    "load",
    "plot": "Thrust over the rotation angle with its parts; click or drag to move in time",
    "orders": "Amplitudes of the orders of the thrust, and the value of each at the time shown",
}
"""Text alternatives of the pictures."""


def _block(which: int, point: SimulatedPoint, name: str) -> str:
    """The canvases of one point, which the script paints, and its drawing."""
    focus = {"scene": ' tabindex="0"'}
    scene, ring, plot, orders = (
        f'<canvas class="{kind}" id="{kind}-{which}" role="img" aria-label="{text}"{focus.get(kind, "")}></canvas>'
        for kind, text in _LABELS.items()
    )
    head = f"<h2>{html.escape(name)}</h2>" if name else ""
    given = {name: value for name, value in point.parameters.items() if _differs(point, name, value)}
    stated = html.escape(", ".join(f"{name} = {value}" for name, value in given.items()) or "all at their defaults")
    return (
        f'<section>{head}<div class="stage">{scene}{ring}</div><div class="stage"><div class="curves">{plot}'
        f'<div class="cursor" id="cursor-{which}"></div></div>{orders}</div><p class="numbers" id="numbers-{which}" '
        f'aria-live="off"></p><details><summary>Drawing to scale</summary>{joint_drawing(point.parameters)}</details>'
        f'<p class="small">Parameters: {stated}.</p></section>'
    )


def _title(parameters: Mapping[str, Value]) -> str:
    angle, torque, speed = (float(parameters[n] or 0) for n in ("joint_angle_deg", "torque_n_m", "speed_rpm"))
    return f"Tripod joint, {angle:g} deg, {torque:g} N m, {speed:g} rpm ({parameters['model']})"


def _differs(point: SimulatedPoint, name: str, value: Value) -> bool:
    parameter = point.simulator.parameters[name]
    return parameter.default is not None and value != parameter.default and name != "model"


def motion_data(parameters: Mapping[str, Value], outputs: Mapping[str, Any]) -> dict[str, Any]:
    """Data of the script: sizes in mm, and arrays of a revolution as base64 of little-endian 32-bit floats.

    Samples are left out evenly until the text of all arrays is at most a megabyte.
    """
    values = point_values(parameters).point(0)
    poses = poses_of(parameters, outputs)
    arrays = _arrays(poses, outputs)
    floats = sum(array[0].size for array in arrays.values())
    every = max(1, int(np.ceil(poses.phi.size * floats * 4 * 4 / 3 / _MOST_BYTES)))
    return {
        "sizes": {name: float(getattr(values, name)) for name in _SIZES} | _patch(values),
        "needles": int(values.needle_count),
        "orders": [round(float(a), 4) for a in np.asarray(outputs["thrust_amplitude"])],
        "phases": [round(float(p), 5) for p in np.radians(outputs["thrust_phase_deg"])],
        "parts": list(PARTS),
        "count": len(poses.phi[::every]),
        "arrays": {name: _text(array[::every]) for name, array in arrays.items()},
    }


def _patch(values: JointValues[float]) -> dict[str, float]:
    """Semi-axes of a groove's contact ellipse at 1 N in mm: they grow with the cube root of the force."""
    across, along = ellipse_axes(values, np.ones(1))
    return {"patch_across": float(across[0]), "patch_along": float(along[0])}


def _arrays(poses: Poses, outputs: Mapping[str, Any]) -> dict[str, FloatArray]:
    """All arrays by name, the sample first."""
    named = {
        name: getattr(poses, name)
        for name in (
            *("phi", "spider", "trunnions", "rollers", "axes", "contacts"),
            *("normal", "friction", "slip", "direction", "pressure"),
        )
    }
    amplitude, phase = (np.asarray(outputs[f"thrust_part_{what}"]) for what in ("amplitude", "phase_deg"))
    waves = np.cos(ORDERS * poses.phi[:, None, None] + np.radians(phase)) * amplitude
    return named | {"needle": poses.needles, "thrust": poses.thrust, "part": waves.sum(axis=-1)}


def _text(array: FloatArray) -> str:
    return base64.b64encode(np.ascontiguousarray(array, "<f4").tobytes()).decode()
