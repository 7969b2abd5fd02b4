"""Parameters of contact damping: a time for greased contacts, or a factor for dry ones; their law is `laws.contact`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tripod_doe.array_types import FloatArray
from tripod_doe.model_interface import Parameter, Value

TIME, FACTOR = "contact_damping_time_s", "contact_damping_s_per_mm"

GREASED = 8e-6
"""Damping over stiffness in s if neither is given: geometric mean of the range of greased rolling bearings, 0.25e-5
to 2.5e-5 s (Kraemer, Dynamics of Rotors and Foundations, 1993)."""

BOTH = f"a contact is greased or dry: set {TIME} or {FACTOR} to 0"
"""Reason to refuse a point with both."""

DAMPING_PARAMETERS = (
    Parameter(
        TIME,
        None,
        "s",
        "tau",
        f"damping of greased contacts over their stiffness; by default {GREASED:g} s; 0 where {FACTOR} is above 0",
        "assumed (Kraemer 1993)",
        low=0,
        high=0.01,
        group="material",
    ),
    Parameter(
        FACTOR,
        0.0,
        "s mm-1",
        "",
        f"damping of dry contacts: Hunt-Crossley factor on the penetration rate, in place of {TIME}",
        "assumed",
        low=0,
        high=1,
        group="material",
    ),
)
"""Parameters of a small scene."""


def damping_time(columns: Mapping[str, Any]) -> FloatArray:
    """Time of each point in s; if not given, the time of greased contacts, or 0 for dry contacts."""
    time, factor = (np.asarray(columns[name], float) for name in (TIME, FACTOR))
    return np.where(np.isnan(time), np.where(factor > 0, 0.0, GREASED), time)


def settled(values: Mapping[str, Value]) -> dict[str, Value]:
    """The time of one point with these values, by its name."""
    return {TIME: float(damping_time({name: values[name] for name in (TIME, FACTOR)}))}


def greased_and_dry(columns: Mapping[str, NDArray[Any]]) -> list[int]:
    """Rows of the points with both parameters."""
    return [int(row) for row in np.flatnonzero((damping_time(columns) > 0) & (np.asarray(columns[FACTOR], float) > 0))]
