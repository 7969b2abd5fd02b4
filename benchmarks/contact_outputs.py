"""Outputs of contacts by each model beside `needles`, at three joints: root mean squares over places and rotation.

    python benchmarks/contact_outputs.py

Differences over the size of the output; of angles in degrees. Those of single needles count by the load of the needle,
since a needle without load lies anywhere in its gaps. The direction of slip counts by the friction force.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.joint.contact_outputs import CONTACT_NAMES, CONTACT_OUTPUTS, NEEDLE_NAMES
from tripod_doe.study.simulate import simulate_point

JOINTS: list[dict[str, Any]] = [
    {
        "pitch_radius_mm": 24,
        "roller_radius_mm": 17,
        "needle_count": 30,
        "needle_pitch_diameter_mm": 19.4,
        "joint_angle_deg": 7,
        "torque_n_m": 120,
        "speed_rpm": 500,
        "initial_skew_1_deg": 0.3,
        "initial_skew_2_deg": -0.2,
        "initial_skew_3_deg": 0.1,
    },
    {"joint_angle_deg": 16, "torque_n_m": -90, "speed_rpm": 1100, "groove_sliding_friction": 0.08},
    {
        "joint_angle_deg": 3.5,
        "torque_n_m": 300,
        "speed_rpm": 250,
        "needle_axial_clearance_mm": 0.05,
        "initial_skew_1_deg": 0.5,
        "initial_skew_2_deg": 0.5,
        "initial_skew_3_deg": -0.5,
    },
]
MODELS = ("rollers", "kinetostatic", "equilibrium")
_TURNING = ("needle_angle_deg", "groove_slip_direction_deg")

Outputs = dict[str, NDArray[np.float64]]


def outputs(model: str, given: dict[str, Any]) -> Outputs:
    """All outputs of contacts that a model has."""
    point = simulate_point("joint", CONTACT_NAMES, model=model, **given)
    return {name: np.asarray(values.data) for name, values in point.outputs.items() if name in CONTACT_NAMES}


def miss(name: str, own: Outputs, truth: Outputs) -> str:
    """How far an output is from the truth; a dash where the model does not have it."""
    if name not in own or not np.isfinite(own[name]).all():
        return "-"
    weight = np.ones(truth[name].shape)
    if name in NEEDLE_NAMES:
        weight = np.maximum(truth["needle_load"], 0)
    elif name in _TURNING:
        weight = truth["groove_friction_force"]
    size = np.sqrt((weight * truth[name] ** 2).sum() / weight.sum())
    if name in _TURNING:
        off = np.degrees(np.angle(np.exp(1j * np.radians(own[name] - truth[name]))))
        return f"{np.sqrt((weight * off**2).sum() / weight.sum()):.2g} deg"
    percent = 100 * np.sqrt((weight * (own[name] - truth[name]) ** 2).sum() / weight.sum()) / size
    return f"{percent:.0f} %" if percent > 10 else f"{percent:.2g} %"


def main() -> None:
    """Print a row for each output, with the three joints in each column."""
    solved = [{model: outputs(model, given) for model in ("needles", *MODELS)} for given in JOINTS]
    print("| output | " + " | ".join(MODELS) + " |\n|" + " --- |" * (1 + len(MODELS)))
    for output in CONTACT_OUTPUTS:
        cells = [", ".join(miss(output.name, each[model], each["needles"]) for each in solved) for model in MODELS]
        print(f"| {output.name} | " + " | ".join("-" if set(cell) <= set("-, ") else cell for cell in cells) + " |")


if __name__ == "__main__":
    main()
