"""Operating point of the joint in a record, from its notes, its columns or its file name."""

import math
import re
from collections.abc import Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError, near_match, option
from tripod_doe.joint.parameters import JOINT_PARAMETERS
from tripod_doe.measurements.headings import OPERATING, ROLES, factor_of, is_no_unit, is_unit, plain_words
from tripod_doe.number_text import number
from tripod_doe.typed_numbers import readings

_MOST_STARS = 3  # stars in a pattern: each multiplies the matching time by the length of a name
_FIELD = re.compile(r"\{([^{}]*)\}")
_MOST_NOTES, _LONGEST = 1000, 500  # lines, and characters of a line, in which values are looked for
_NUMBER = re.compile(r"[+-]?[0-9][0-9.,'’]*(?:e[+-]?[0-9]+)?", re.I)
_MINUTES_OF_ARC = re.compile(r"\s?(?:°|deg\w*\.?|grad)\s?[0-9.,]+\s?(?:['’′]|min|arcmin)", re.I)
_OTHER_QUANTITY = re.compile(r"(?:max|min|peak|limit|rated|range|full)\w*[\s.,:-]*$", re.I)
_APART = 0.05  # largest relative difference of two statements of one value


class Statement(NamedTuple):
    """What a line of a record says about an operating value."""

    line: str
    value: float  # in our unit, NaN where it is not known for certain
    trouble: str = ""  # why it is not


def from_notes(notes: Sequence[str]) -> dict[str, Statement]:
    """Operating values that a recorder wrote before its table: ``Joint angle: 8 deg``, ``Drehmoment;50,0;Nm``.

    A name, an optional unit in brackets, a separator, the number, and an optional unit. A number that may mean two
    values, an unknown unit and lines that contradict each other are no values.
    """
    known, lines = {}, [note for note in notes[:_MOST_NOTES] if len(note) <= _LONGEST]
    for role in OPERATING:
        said = list(filter(None, (_statement(role, line) for line in lines)))
        sure = [one for one in said if not one.trouble]
        if (other := next((one for one in sure if differ(one.value, sure[0].value)), None)) is not None:
            known[role] = Statement(sure[0].line, math.nan, f"another line is {other.line!r}")
        elif said:
            known[role] = (sure or said)[0]
    return known


def differ(value: float, other: float, small: float = 0.0) -> bool:
    """Whether a value contradicts another statement of it, by more than a small difference."""
    return abs(value - other) > max(_APART * abs(other), small)


@cache
def _form(role: str) -> re.Pattern[str]:
    """An expression for a name of a role with a unit in brackets, up to the number."""
    names = sorted((role, *ROLES[role].telling, *ROLES[role].plain), key=len, reverse=True)
    words = "|".join(re.escape(name).replace(r"\ ", r"[\s_-]{1,3}") for name in names)
    return re.compile(
        rf"(?:^|[\s;,\t(])({words})\s?(?:[\[(]([^\])]{{0,20}})[\])])?\s?[:=;,\t]\s{{0,9}}(?=[+-]?\d)", re.I
    )


def _statement(role: str, line: str) -> Statement | None:
    """The value that a line gives for a role; None if it names none."""
    for match in _form(role).finditer(line):
        digits = _NUMBER.match(line, match.end())
        if digits is None or _OTHER_QUANTITY.search(line[: match.start(1)]):
            continue
        text = digits[0].rstrip(".,'’")
        before = "" if match[2] is None or is_no_unit(match[2]) else match[2]
        unit = _unit_behind(role, line[match.end() + len(text) :]) or before
        factor = factor_of(role, unit) if unit else 1.0
        if plain_words(match[1]) in ROLES[role].plain and (not unit or factor is None):
            continue  # a short name may be anything
        if factor is None:
            return Statement(line, math.nan, f"{unit} is no known unit")
        if role == "joint_angle_deg" and _MINUTES_OF_ARC.match(line, match.end() + len(text)):
            return Statement(line, math.nan, "it has minutes of arc: write decimal degrees")
        values = _allowed(role, text, factor)
        if len(values) == 1 and math.isfinite(values[0]):
            return Statement(line, values[0])
        return Statement(line, math.nan, _doubt(text, values))
    return None


def _allowed(role: str, text: str, factor: float = 1.0) -> list[float]:
    """The numbers that a text may mean for a parameter, without those outside of its range; else the first of them."""
    allowed, values = JOINT_PARAMETERS[role], [value * factor for value in readings(text)]
    return [value for value in values if allowed.low <= value <= allowed.high] or values[:1]


def _doubt(text: str, values: Sequence[float]) -> str:
    return f"{text} may be {' or '.join(map(number, values)) or 'any number'}"


def _unit_behind(role: str, text: str) -> str:
    """The unit at the beginning of a text, with all that belongs to the number before it; empty if there is none."""
    field = re.match(r"\s?[;,\t]?\s?[\[(]?([^;,\t\])]*)", text)
    words = field[1].split()[:3] if field else []
    for many in range(len(words), 0, -1):
        if factor_of(role, unit := " ".join(words[:many])) is not None:
            return unit
    apart = text.lstrip()[:1] in {";", ",", "\t"}
    return "" if not words or (apart and not is_unit(words[0])) else words[0]


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
        InputError: If the pattern has no fields, a field is no parameter of the joint, the name does not match, or a
            number in it may mean two values.
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
    numbers = (rf"(?=([+-]?[0-9]+(?:[.,p][0-9]+)?))\{at}" for at in range(1, len(names) + 1))
    match = re.fullmatch(first + "".join(map("".join, zip(numbers, others, strict=True))), name, re.I)
    if match is None:
        raise InputError(f"{option('pattern', pattern)}: {name} does not match this pattern")
    stated = {}
    for own, text in zip(names, match.groups(), strict=True):
        values = [float(text.lower().replace("p", "."))] if "p" in text.lower() else _allowed(own, text)
        if len(values) != 1:
            raise InputError(f"{option('pattern', pattern)}: {name}: {own}: {_doubt(text, values)}")
        stated[own] = values[0]
    return stated


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
