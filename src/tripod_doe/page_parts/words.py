"""Names, units and factors as sentences, tables and axes show them."""

import math
import re
from collections.abc import Callable, Hashable, Mapping

import xarray as xr

from tripod_doe.number_text import in_words, level, with_unit

ORDINALS = (
    "mean thrust force",
    "first order",
    "second order",
    "third order",
    "fourth order",
    "fifth order",
    "sixth order",
    "seventh order",
    "eighth order",
    "ninth order",
    "tenth order",
    "eleventh order",
    "twelfth order",
)
"""Orders in words."""

_UNITS = {"1": "", "degree": "deg", "mm s-1": "mm/s", "kg m-3": "kg/m3", "s mm-1": "s/mm", "s-1": "1/s"}
_UNIT_SUFFIX = re.compile(r"(?:_per)?_(deg|n_m|n|rpm|mm_s|mm|um|kg_m2|kg_m3|kg|gpa|s_per_mm|s|w)$")


def spoken(name: str) -> str:
    """A parameter's name in words, without its unit: ``joint_angle_deg`` becomes ``joint angle``."""
    return in_words(_UNIT_SUFFIX.sub("", name))


def unit_text(unit: str) -> str:
    """A unit as text."""
    return _UNITS.get(unit, unit)


def with_brackets(words: str, unit: str) -> str:
    """A label with its unit, if it has one: ``torque (N m)``."""
    return f"{words} ({unit})" if unit else words


def listed(names: list[str]) -> str:
    """Names as a sentence lists them: ``a, b and c``."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)


def factor_label(cube: xr.Dataset, name: str) -> str:
    """A factor in words; an argument of a user's function keeps its bare name."""
    return name if cube[name].attrs.get("source") == "user function" else spoken(name)


def factor_unit(cube: xr.Dataset, name: str) -> str:
    """The unit of a factor or a variable as text."""
    return unit_text(str(cube[name].attrs.get("units", "1")))


def axis_label(cube: xr.Dataset, name: str) -> str:
    """A factor as the label of an axis, with its unit."""
    return with_brackets(factor_label(cube, name), factor_unit(cube, name))


def factor_text(cube: xr.Dataset, name: str, value: object, given: Callable[[float], str] = level) -> str:
    """A factor with its value: ``torque 50 N m``, ``initial skew 1 = 2 deg``, ``step not given``.

    Args:
        value: Its value, a number or a word; a number may be given as text.
    """
    label = factor_label(cube, name)
    if isinstance(value, str) and cube[name].dtype.kind == "f":
        value = float(value)
    if isinstance(value, float) and math.isnan(value):
        return f"{label} not given"
    text = with_unit(given(value) if isinstance(value, int | float) else str(value), factor_unit(cube, name))
    return f"{label}{' =' * label[-1].isdigit()} {text}"


def place_text(cube: xr.Dataset, place: Mapping[Hashable, int]) -> str:
    """Where along its dimensions something is, by their labels: `` (groove 1, rotation 30 deg)``; empty for none."""
    text = ", ".join(factor_text(cube, str(dim), cube[dim][at].item()) for dim, at in place.items())
    return f" ({text})" * bool(place)
