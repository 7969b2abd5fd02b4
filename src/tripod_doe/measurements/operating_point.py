"""Operating point of the joint in a record, from its notes, its columns or its file name."""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError, near_match, option
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.measurements.headings import OPERATING, ROLES, plain_words, unit_key

_NUMBER = r"([+-]?\d+(?:[.,]\d+)?(?:e[+-]?\d+)?)"
_MOST_STARS = 3  # stars in a pattern: each multiplies the matching time by the length of a name
_FIELD = re.compile(r"\{([^{}]*)\}")
_UNIT_BEFORE = r"(?:\s*[\[(]([^\])]*)[\])])?"
_UNIT_BEHIND = r"(?:\s*[;,\t]?\s*[\[(]?([^\s;,\t\])]+))?"


def from_notes(notes: Sequence[str]) -> dict[str, float]:
    """Operating values that a recorder wrote before its table: ``Joint angle: 8 deg``, ``Drehmoment;50,0;Nm``.

    A name, an optional unit in brackets, a separator, the number, and an optional unit.
    """
    known: dict[str, float] = {}
    for role in OPERATING:
        names = sorted((role, *ROLES[role].telling, *ROLES[role].plain), key=len, reverse=True)
        words = "|".join(re.escape(name).replace(r"\ ", r"[\s_-]+") for name in names)
        form = re.compile(rf"(?:^|[\s;,\t(])({words}){_UNIT_BEFORE}\s*[:=;,\t]\s*{_NUMBER}{_UNIT_BEHIND}", re.I)
        for match in filter(None, map(form.search, notes)):
            factor = _factor(role, match[2], match[4])
            if role not in known and (factor or plain_words(match[1]) not in ROLES[role].plain):
                known[role] = float(match[3].replace(",", ".")) * (factor or 1.0)
    return known


def _factor(role: str, *units: str | None) -> float | None:
    """Factor of the first unit that the role knows."""
    keys = [unit_key(unit) for unit in units if unit]
    return next((ROLES[role].units[key] for key in keys if key in ROLES[role].units), None)


def from_columns(columns: Mapping[str, FloatArray]) -> dict[str, float]:
    """Means of the columns of joint angle, torque and speed."""
    return {
        role: float(np.nanmean(columns[role]))
        for role in OPERATING
        if role in columns and np.isfinite(columns[role]).any()
    }


def from_name(name: str, pattern: str) -> dict[str, float]:
    """Values in the name of a file.

    Args:
        name: Name of the file.
        pattern: The name with fields for parameters, ``rig_{joint_angle_deg}deg_{torque_n_m}Nm.csv``; * stands for
            any text, and a decimal point may be written as p or comma.

    Raises:
        InputError: If the pattern has no fields, a field is no parameter of the joint, or the name does not match.
    """
    names = [_parameter(field, pattern) for field in _FIELD.findall(pattern)]
    if not names:
        raise InputError(f"{option('pattern', pattern)}: no field; write for instance rig_{{joint_angle_deg}}deg.csv")
    if pattern.count("*") > _MOST_STARS:
        raise InputError(
            f"{option('pattern', pattern)}: {pattern.count('*')} times *; at most {_MOST_STARS} are allowed"
        )
    first, *others = (re.escape(part).replace(r"\*", ".*") for part in _FIELD.split(pattern)[::2])
    # a number is taken whole: possessive quantifiers would say so, but are wrong in Python 3.11.2
    numbers = (rf"(?=([+-]?\d+(?:[.,p]\d+)?))\{at}" for at in range(1, len(names) + 1))
    match = re.fullmatch(first + "".join(map("".join, zip(numbers, others, strict=True))), name, re.I)
    if match is None:
        raise InputError(f"{option('pattern', pattern)}: {name} is of another form")
    return {own: float(re.sub("[,pP]", ".", text)) for own, text in zip(names, match.groups(), strict=True)}


def _parameter(field: str, pattern: str) -> str:
    """The parameter that a field of a pattern names, by our name or a usual name."""
    name = field.strip().replace("-", "_")
    if name in JOINT_PARAMETERS:
        return name
    words = plain_words(re.sub(r"_(n_?m|deg|rpm)$", "", name, flags=re.I))
    for role in OPERATING:
        if words in (*ROLES[role].telling, *ROLES[role].plain):
            return role
    raise InputError(f"{option('pattern', pattern)}: {field!r} is no parameter{near_match(name, JOINT_PARAMETERS)}")
