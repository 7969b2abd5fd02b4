"""Published test functions of sensitivity analysis with their analytic indices, and cubes of their designs."""

from __future__ import annotations

import numpy as np
import xarray as xr

from tripod_doe.model_interface import Outcome
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import make_points

UNIT = {"low": 0.0, "high": 1.0}
ANGLE = {"low": -np.pi, "high": np.pi}


def ishigami(x):
    return np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


_PARTS = {"1": 0.5 * (1 + 0.1 * np.pi**4 / 5) ** 2, "2": 49 / 8, "13": 8 * 0.01 * np.pi**8 / 225}
_WHOLE = sum(_PARTS.values())
ISHIGAMI = {
    "S1": np.array([_PARTS["1"], _PARTS["2"], 0]) / _WHOLE,
    "ST": np.array([_PARTS["1"] + _PARTS["13"], _PARTS["2"], _PARTS["13"]]) / _WHOLE,
    "shapley": np.array([_PARTS["1"] + _PARTS["13"] / 2, _PARTS["2"], _PARTS["13"] / 2]) / _WHOLE,
}
"""Ishigami and Homma (1990) with a = 7, b = 0.1."""

_A = np.array([0.0, 1.0, 4.5])


def sobol_g(x):
    return np.prod((np.abs(4 * x - 2) + _A) / (1 + _A), axis=1)


_V = 1 / (3 * (1 + _A) ** 2)
SOBOL_G = {"S1": _V / (np.prod(1 + _V) - 1), "ST": _V * np.prod(1 + _V) / (1 + _V) / (np.prod(1 + _V) - 1)}
"""Sobol's g function (Saltelli and Sobol' 1995) with a = 0, 1, 4.5."""


def linear_interaction(x):
    return 2 * x[:, 0] + x[:, 1] + 3 * x[:, 0] * x[:, 1]


_LINEAR = {"1": 3.5**2 / 12, "2": 2.5**2 / 12, "12": 9 / 144}
LINEAR = {
    "S1": np.array([_LINEAR["1"], _LINEAR["2"], 0]) / sum(_LINEAR.values()),
    "ST": np.array([_LINEAR["1"] + _LINEAR["12"], _LINEAR["2"] + _LINEAR["12"], 0]) / sum(_LINEAR.values()),
}
"""2 x1 + x2 + 3 x1 x2 on the unit square, with a third factor that does nothing."""

CASES = {
    "ishigami": (ishigami, ANGLE, ISHIGAMI),
    "sobol-g": (sobol_g, UNIT, SOBOL_G),
    "linear": (linear_interaction, UNIT, LINEAR),
}


def cube_of(design, function, bounds=UNIT, width=3, groups=None):
    """Cube of a design: `function` of the points, shape (point, factor), gives (point,) or (point, component)."""
    names = [
        "joint_angle_deg",
        "torque_n_m",
        "speed_rpm",
        "groove_sliding_friction",
        "needle_sliding_friction",
        "groove_rolling_friction",
        "needle_rolling_friction",
        "initial_skew_1_deg",
    ][:width]
    group = {name: f', group = "{label}"' for name, label in (groups or {}).items()}
    factors = "".join(f"{name} = {{low = 0, high = 1{group.get(name, '')}}}\n" for name in names)
    text = f'[study]\nname = "t"\n[factors]\n{factors}[design]\n{design}\n'
    columns = make_points(parse_study(text.replace("high = 1", "high = 0.1"))).columns
    unit = 10 * np.stack(list(columns.values()), axis=1)  # every parameter's range allows 0 .. 0.1
    values = function(bounds["low"] + unit * (bounds["high"] - bounds["low"]))
    dims = ("point", "k")[: values.ndim]
    return xr.Dataset(
        {"y": (dims, values), "outcome": ("point", np.full(len(unit), Outcome.FINISHED, np.int8))},
        coords={"point": np.arange(len(unit))} | {n: ("point", c) for n, c in zip(names, unit.T, strict=True)},
        attrs={"study": text},
    )
