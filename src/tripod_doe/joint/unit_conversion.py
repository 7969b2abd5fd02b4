"""Conversion of the joint's parameters, once, from the units of their names to mm, N, s, t and rad."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.derived_constants.contact_stiffness import contact_constants, elastic_factor
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.contact_damping_parameters import damping_time
from tripod_doe.model_interface import Value

_INTERNAL = {
    "degree": ("_deg", math.pi / 180),
    "N m": ("_n_m", 1e3),
    "rpm": ("_rpm", 2 * math.pi / 60),
    "um": ("_um", 1e-3),
    "kg": ("_kg", 1e-3),
    "kg m2": ("_kg_m2", 1e3),
    "kg m-3": ("_kg_m3", 1e-12),
    "GPa": ("_gpa", 1e3),
    "mm": ("_mm", 1.0),
    "mm s-1": ("_mm_s", 1.0),
    "s": ("_s", 1.0),
    "s mm-1": ("_s_per_mm", 1.0),
    "1": ("", 1.0),
}
"""How the name of a parameter with this unit ends, and the factor to the internal unit."""

_SWITCHED = {
    "groove_sliding": "groove_sliding_friction",
    "groove_spinning": "groove_spin_friction",
    "groove_rolling": "groove_rolling_friction",
    "needle_sliding": "needle_sliding_friction",
    "needle_rolling": "needle_rolling_friction",
}
"""Coefficients that a switch sets to zero."""


def internal_values(columns: Mapping[str, NDArray[Any]]) -> JointValues[FloatArray]:
    """Convert points to internal units, and settle the values that follow from others.

    Args:
        columns: Every joint parameter by name, each of shape (point,), in the units of the names; NaN where unset.
            Choices may be left out.
    """
    inside = {}
    for name, parameter in JOINT_PARAMETERS.items():
        if parameter.kind == "choice":
            continue
        column = np.asarray(columns[name], float)
        if parameter.follows:
            column = np.where(np.isnan(column), columns[parameter.follows], column)
        ending, factor = _INTERNAL[parameter.unit]
        inside[name.removesuffix(ending)] = column * factor
    inside["contact_damping_time"] = damping_time(columns)
    for switch, coefficient in _SWITCHED.items():
        inside[coefficient] = inside[coefficient] * inside[switch]
    elastic = elastic_factor(inside["youngs_modulus"], inside["poissons_ratio"]) * inside["contact_stiffness_factor"]
    inside |= contact_constants(
        elastic, inside["roller_radius"], inside["groove_radius_ratio"], inside["needle_length"]
    )
    return JointValues(**{field.name: inside[field.name] for field in fields(JointValues)})


def point_values(given: Mapping[str, Value]) -> JointValues[FloatArray]:
    """One point as a block: values in the units of their names, all other parameters at their defaults."""
    return internal_values({name: p.column([given.get(name, p.default)]) for name, p in JOINT_PARAMETERS.items()})
