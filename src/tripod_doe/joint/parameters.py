"""Every parameter of the tripod joint with unit, symbol, meaning, range and source.

Names carry the unit a person uses; `internal_values` converts once to mm, N, s, t and rad.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.joint.values import JointValues
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.simulator import Parameter, Value, by_name

MECHANISMS = ("groove_sliding", "groove_spinning", "groove_rolling", "needle_sliding", "needle_rolling")
"""The five friction mechanisms that a contribution study switches on and off."""

_OPERATING = "operating point"
_FRICTION = "friction"
_GEOMETRY = "geometry"
_MATERIAL = "material"
_NUMERICS = "numerics"
_STABILITY = "stability studies"
_SWITCHES = "mechanism switches"


def _skew(trunnion: int) -> Parameter:
    return Parameter(
        f"initial_skew_{trunnion}_deg",
        0.0,
        "degree",
        f"psi_{trunnion}",
        f"initial skew of all needles of trunnion {trunnion}, counterclockwise about the outward normal of the "
        "trunnion surface",
        "paper 3.1, Fig. 9",
        low=-10,
        high=10,
        group=_OPERATING,
    )


def _switch(name: str, meaning: str) -> Parameter:
    return Parameter(
        name,
        1,
        "1",
        "",
        f"{meaning} on (1) or off (0, its coefficient becomes zero)",
        "paper 3.5",
        kind="switch",
        group=_SWITCHES,
    )


_PARAMETERS = [
    Parameter(
        "joint_angle_deg",
        10.0,
        "degree",
        "theta",
        "joint angle between input axis and intermediate shaft",
        "paper 3.1",
        low=0,
        high=40,
        group=_OPERATING,
    ),
    Parameter(
        "torque_n_m",
        50.0,
        "N m",
        "T",
        "load torque of the output shaft; negative on coast",
        "paper 3.1",
        low=-5000,
        high=5000,
        group=_OPERATING,
    ),
    Parameter(
        "speed_rpm",
        600.0,
        "rpm",
        "omega",
        "rotational speed of the housing",
        "paper 3.1",
        low=0,
        high=10000,
        group=_OPERATING,
    ),
    _skew(1),
    _skew(2),
    _skew(3),
    Parameter(
        "groove_sliding_friction",
        0.05,
        "1",
        "mu_s",
        "sliding friction coefficient, roller on groove",
        "paper 3.1",
        low=0,
        high=1,
        group=_FRICTION,
    ),
    Parameter(
        "groove_spin_friction",
        None,
        "1",
        "mu_s",
        "friction coefficient of the spinning moment, roller on groove; by default that of groove_sliding_friction",
        "paper Eq. 7",
        low=0,
        high=1,
        group=_FRICTION,
        follows="groove_sliding_friction",
    ),
    Parameter(
        "needle_sliding_friction",
        0.03,
        "1",
        "mu_s",
        "sliding friction coefficient, needle on other parts",
        "paper 3.1",
        low=0,
        high=1,
        group=_FRICTION,
    ),
    Parameter(
        "groove_rolling_friction",
        0.002,
        "1",
        "mu_r",
        "rolling friction coefficient, roller on groove",
        "paper 3.1",
        low=0,
        high=0.1,
        group=_FRICTION,
    ),
    Parameter(
        "needle_rolling_friction",
        0.002,
        "1",
        "mu_r",
        "rolling friction coefficient, needle on other parts",
        "paper 3.1",
        low=0,
        high=0.1,
        group=_FRICTION,
    ),
    Parameter(
        "transition_ratio",
        0.25,
        "1",
        "v_st/v_max",
        "transition velocity over the largest slip of ideal kinematics",
        "paper 3.1",
        low=0,
        high=10,
        low_open=True,
        group=_FRICTION,
    ),
    Parameter(
        "groove_transition_velocity_mm_s",
        None,
        "mm s-1",
        "v_st",
        "transition velocity of sliding in the groove; by default from transition_ratio",
        "in place of the quarter rule of paper 3.1",
        low=0,
        high=1e5,
        low_open=True,
        group=_FRICTION,
    ),
    Parameter(
        "needle_transition_velocity_mm_s",
        None,
        "mm s-1",
        "v_st",
        "transition velocity of the needles' sliding; by default from transition_ratio",
        "in place of the quarter rule of paper 3.1",
        low=0,
        high=1e5,
        low_open=True,
        group=_FRICTION,
    ),
    Parameter(
        "pitch_radius_mm",
        21.0,
        "mm",
        "R_p",
        "distance of the groove axes from the input axis",
        "assumed",
        low=5,
        high=100,
        group=_GEOMETRY,
    ),
    Parameter(
        "roller_radius_mm",
        16.0,
        "mm",
        "R_s",
        "radius of the spherical roller",
        "assumed",
        low=3,
        high=80,
        group=_GEOMETRY,
    ),
    Parameter(
        "roller_width_mm",
        11.0,
        "mm",
        "",
        "width of the spherical roller, which ends where its bore meets the sphere",
        "assumed",
        low=1,
        high=80,
        group=_GEOMETRY,
    ),
    Parameter(
        "groove_radius_ratio",
        1.0086,
        "1",
        "R_g/R_s",
        "groove radius over roller radius; 1.0086 gives the contact ellipse of 20 to 1",
        "paper 2.3.1",
        low=1,
        high=2,
        low_open=True,
        group=_GEOMETRY,
    ),
    Parameter(
        "groove_rolling_lever_mm",
        None,
        "mm",
        "D/2",
        "lever of the rolling resistance in the groove; by default the roller radius",
        "assumed",
        low=0,
        high=100,
        group=_GEOMETRY,
        follows="roller_radius_mm",
    ),
    Parameter(
        "needle_count",
        27,
        "1",
        "N_n",
        "needles per trunnion",
        "paper 3.1",
        low=1,
        high=100,
        kind="integer",
        group=_GEOMETRY,
    ),
    Parameter(
        "spheres_per_needle",
        7,
        "1",
        "N_s",
        "spheres that stand for a needle",
        "paper 3.1",
        low=1,
        high=51,
        kind="integer",
        group=_GEOMETRY,
    ),
    Parameter("needle_diameter_mm", 2.0, "mm", "d_n", "needle diameter", "assumed", low=0.2, high=10, group=_GEOMETRY),
    Parameter(
        "needle_length_mm",
        10.0,
        "mm",
        "l",
        "length of the needle's line contact",
        "assumed",
        low=0.5,
        high=80,
        group=_GEOMETRY,
    ),
    Parameter(
        "needle_pitch_diameter_mm",
        17.28,
        "mm",
        "d_p",
        "pitch diameter of the needles; trunnion diameter = pitch diameter - needle diameter",
        "assumed",
        low=2,
        high=100,
        group=_GEOMETRY,
    ),
    Parameter(
        "bearing_radial_clearance_mm",
        0.015,
        "mm",
        "c",
        "radial clearance of the needle bearing, added to the bore",
        "assumed",
        low=-0.05,
        high=0.5,
        group=_GEOMETRY,
    ),
    Parameter(
        "needle_axial_clearance_mm",
        0.2,
        "mm",
        "",
        "axial clearance of a needle between flange and retainer",
        "assumed",
        low=0,
        high=5,
        group=_GEOMETRY,
    ),
    Parameter(
        "needle_crown_um",
        0.0,
        "um",
        "",
        "crown of the needle: drop of its profile at the ends",
        "assumed",
        low=0,
        high=100,
        group=_GEOMETRY,
    ),
    Parameter(
        "shaft_length_mm",
        350.0,
        "mm",
        "L",
        "length of the intermediate shaft to the outboard joint",
        "assumed",
        low=50,
        high=5000,
        group=_GEOMETRY,
    ),
    Parameter(
        "outboard_joint_angle_deg",
        0.0,
        "degree",
        "",
        "joint angle of the outboard universal joint",
        "assumed",
        low=0,
        high=40,
        group=_GEOMETRY,
    ),
    Parameter(
        "shaft_mass_kg",
        2.0,
        "kg",
        "m",
        "mass of the intermediate shaft with its spider; inertia of a rod",
        "assumed",
        low=0.01,
        high=100,
        group=_MATERIAL,
    ),
    Parameter(
        "output_inertia_kg_m2",
        0.01,
        "kg m2",
        "J",
        "moment of inertia of the output shaft about its axis",
        "assumed",
        low=1e-6,
        high=10,
        group=_MATERIAL,
    ),
    Parameter(
        "density_kg_m3",
        7850.0,
        "kg m-3",
        "",
        "density of rollers and needles",
        "steel",
        low=100,
        high=25000,
        group=_MATERIAL,
    ),
    Parameter(
        "youngs_modulus_gpa",
        207.0,
        "GPa",
        "E",
        "Young's modulus of all parts in contact",
        "steel",
        low=1,
        high=1000,
        group=_MATERIAL,
    ),
    Parameter(
        "poissons_ratio",
        0.3,
        "1",
        "nu",
        "Poisson's ratio of all parts in contact",
        "steel",
        low=0,
        high=0.49,
        group=_MATERIAL,
    ),
    Parameter(
        "contact_damping_s_per_mm",
        0.001,
        "s mm-1",
        "",
        "Hunt-Crossley factor on the penetration rate",
        "assumed",
        low=0,
        high=1,
        group=_MATERIAL,
    ),
    Parameter(
        "contact_stiffness_factor",
        1.0,
        "1",
        "",
        "factor on every contact stiffness",
        "numerics: for stability studies",
        low=1e-4,
        high=1e4,
        group=_STABILITY,
    ),
    Parameter(
        "needle_mass_factor",
        1.0,
        "1",
        "",
        "factor on the needles' mass and inertia",
        "numerics: for stability studies",
        low=1e-4,
        high=1e4,
        group=_STABILITY,
    ),
    _switch("groove_sliding", "sliding friction between roller and groove"),
    _switch("groove_spinning", "spinning moment between roller and groove"),
    _switch("groove_rolling", "rolling resistance between roller and groove"),
    _switch("needle_sliding", "sliding friction of the needles"),
    _switch("needle_rolling", "rolling resistance of the needles"),
    Parameter(
        "model",
        "kinetostatic",
        "1",
        "",
        "model of the ladder",
        "numerics: model of the ladder",
        kind="choice",
        choices=("equilibrium", "kinetostatic", "rollers", "needles"),
        group=_NUMERICS,
    ),
    Parameter(
        "method",
        None,
        "1",
        "",
        "how the model is solved; by default the model's own",
        "numerics",
        kind="choice",
        choices=("newton", *METHODS),
        group=_NUMERICS,
    ),
    Parameter(
        "relative_tolerance",
        None,
        "1",
        "",
        "relative tolerance of the method; by default the method's own",
        "numerics",
        low=1e-13,
        high=0.1,
        group=_NUMERICS,
    ),
    Parameter(
        "step_s",
        None,
        "s",
        "h",
        "time step of a fixed-step method; by default the method's own",
        "numerics",
        low=1e-10,
        high=1e-2,
        group=_NUMERICS,
    ),
    Parameter(
        "accuracy",
        0.02,
        "1",
        "",
        "relative numerical error that the third order of a run may have, or the "
        "orders under [accuracy]; a run is refined to it unless a tolerance or step is given",
        "numerics",
        low=1e-5,
        high=0.5,
        group=_NUMERICS,
    ),
    Parameter(
        "cycles",
        4,
        "1",
        "",
        "revolutions; the last two are sampled, the transient of the start decays in the cycles - 2 before them",
        "paper 3.2",
        low=2,
        high=1000,
        kind="integer",
        group=_NUMERICS,
    ),
    Parameter(
        "samples_per_revolution",
        360,
        "1",
        "",
        "samples of the rotation angle per revolution",
        "numerics",
        low=30,
        high=36000,
        kind="integer",
        group=_NUMERICS,
    ),
    Parameter(
        "evaluation_budget",
        20_000_000,
        "1",
        "",
        "largest number of force evaluations of a run: some minutes of rollers, half an hour of needles",
        "numerics",
        low=1,
        high=1e12,
        kind="integer",
        group=_NUMERICS,
    ),
    Parameter(
        "replicate",
        0,
        "1",
        "",
        "number of the repetition; has no effect on results",
        "numerics",
        low=0,
        high=1e6,
        kind="integer",
        group=_NUMERICS,
    ),
]

JOINT_PARAMETERS = by_name(_PARAMETERS)
"""All parameters of the joint by name, in the order in which help and documentation list them."""

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
    """Convert numeric columns of points to internal units, and settle the values that follow from others.

    Parameters
    ----------
    columns
        Every numeric joint parameter by name, each of shape (point,), in the units of the names; NaN where unset.
    """
    inside = {}
    for name, column in columns.items():
        parameter = JOINT_PARAMETERS[name]
        if parameter.follows:
            column = np.where(np.isnan(column), columns[parameter.follows], column)
        ending, factor = _INTERNAL[parameter.unit]
        inside[name.removesuffix(ending)] = column * factor
    for switch, coefficient in _SWITCHED.items():
        inside[coefficient] = inside[coefficient] * inside[switch]
    from tripod_doe.joint.contact import contact_constants, elastic_factor  # compiles, and needs scipy

    elastic = elastic_factor(inside["youngs_modulus"], inside["poissons_ratio"]) * inside["contact_stiffness_factor"]
    inside |= contact_constants(
        elastic, inside["roller_radius"], inside["groove_radius_ratio"], inside["needle_length"]
    )
    return JointValues(**{field.name: inside[field.name] for field in fields(JointValues)})


def point_values(given: Mapping[str, Value]) -> JointValues[FloatArray]:
    """One point as a block: values in the units of their names, all other parameters at their defaults."""
    full = {name: given.get(name, parameter.default) for name, parameter in JOINT_PARAMETERS.items()}
    numbers = [name for name, parameter in JOINT_PARAMETERS.items() if parameter.kind != "choice"]
    return internal_values({name: JOINT_PARAMETERS[name].column([full[name]]) for name in numbers})
