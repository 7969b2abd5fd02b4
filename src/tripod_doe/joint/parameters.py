"""Every parameter of the tripod joint; `parameters.toml` lists them with unit, symbol, meaning, range and source.

They are converted in `unit_conversion`.
"""

from __future__ import annotations

from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.model_interface import read_parameters

MECHANISMS = ("groove_sliding", "groove_spinning", "groove_rolling", "needle_sliding", "needle_rolling")
"""The five friction mechanisms that a contribution study switches on and off."""

JOINT_PARAMETERS = read_parameters("tripod_doe.joint", "parameters.toml", {"method": ("newton", *METHODS)})
"""All parameters of the joint by name, in the order in which help and documentation list them."""
