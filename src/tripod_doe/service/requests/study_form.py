"""A study file as a form; a change in the form changes the file's text, and keeps its comments and order.

A parameter is one field: empty for the default, ``600`` for a value that all points share, ``25, 50, 100``
for values of a factor, ``2 : 14 : 13`` for a range with a count and ``2 : 14`` for a range to sample, with ``log`` at
the end for a logarithmic scale. ``1,5`` is refused, since it may be 1.5 or two values. The text alone holds what a
field cannot express, such as a distribution.
"""

import math
from collections.abc import Mapping
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from tripod_doe.errors import InputError
from tripod_doe.model_interface import Parameter
from tripod_doe.page_parts.words import spoken, unit_text, with_brackets
from tripod_doe.study.definition.simulators import SCENES, load_simulator
from tripod_doe.study.definition.study_file_schema import DESIGN_KEYS, DesignTable, keys_read_by
from tripod_doe.study.definition.toml_text import parse_toml
from tripod_doe.typed_numbers import readings, typed_number

_DESIGN_KEYS = ("kind", "samples", "seed", "levels")
_MOST_VALUES = 1_000  # of a field: the time to write them grows with the square
_RANGE_KEYS = {"low", "high", "count", "scale"}


def study_form(study: str) -> Any:
    """The fields of a form for a study file.

    Returns:
        ``head`` (name, question), ``scene`` and ``scenes``, ``design`` with ``designs``, and ``groups`` of parameters
        with their fields.

    Raises:
        InputError: If the text is no TOML.
    """
    tables = parse_toml(study, "study.toml")
    head, base, factors, design = (_table(tables, name) for name in ("study", "base", "factors", "design"))
    scene = str(head.get("scene", "joint"))
    known = load_simulator(scene).parameters.values() if scene in SCENES else ()
    groups: dict[str, list[Parameter]] = {}
    for parameter in known:
        groups.setdefault(parameter.group, []).append(parameter)
    return {
        "head": {name: str(head.get(name, "")) for name in ("name", "question")},
        "scene": scene,
        "scenes": sorted(SCENES),
        "design": {name: "" if design.get(name) is None else str(design[name]) for name in _DESIGN_KEYS},
        "designs": list(DesignTable.model_json_schema()["properties"]["kind"]["enum"]),
        "groups": [
            {"title": title, "fields": [_field(parameter, base, factors) for parameter in members]}
            for title, members in groups.items()
        ],
    }


def _table(study: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    table = study.get(name, {})
    return table if isinstance(table, Mapping) else {}


def _field(parameter: Parameter, base: Mapping[str, Any], factors: Mapping[str, Any]) -> dict[str, Any]:
    factor = factors.get(parameter.name)
    value = _factor_text(factor) if isinstance(factor, Mapping) else _word(base.get(parameter.name))
    return {
        "name": parameter.name,
        "label": with_brackets(spoken(parameter.name), unit_text(parameter.unit)),
        "meaning": f"{parameter.meaning} ({parameter.range_text}; {parameter.source})",
        "default": _word(parameter.default),
        "value": value,
        "varied": isinstance(factor, Mapping),
        "choices": list(parameter.choices),
    }


def _word(value: Any) -> str:
    return "" if value is None else f"{value:.12g}" if isinstance(value, float) else str(value)


def _factor_text(factor: Mapping[str, Any]) -> str | None:
    """The text of a factor's field; None if a field cannot express the factor."""
    if set(factor) == {"values"} and isinstance(factor["values"], list):
        return ", ".join(_word(value) for value in factor["values"]) + ("," if len(factor["values"]) == 1 else "")
    if {"low", "high"} <= set(factor) <= _RANGE_KEYS:
        ends = [_word(factor[name]) for name in ("low", "high", "count") if name in factor]
        return " : ".join(ends) + (" log" if factor.get("scale") == "log" else "")
    return None


def changed_text(study: str, key: str, value: str) -> Any:
    """The text of a study file after one field was changed.

    Args:
        key: ``study.name``, ``design.kind`` or the like, or ``parameter.NAME``.

    Raises:
        InputError: If the text is no TOML, or the field cannot be read.
    """
    parse_toml(study, "study.toml")
    try:
        document = tomlkit.parse(study)
        table, _, name = key.partition(".")
        if table == "parameter":
            _set_parameter(document, name, value.strip())
        else:
            _set(document, table, name, _scalar(value) if table == "design" else value)
        if key == "design.kind" and value in DESIGN_KEYS:  # keys of the kind before mean nothing to it, and are refused
            design = document["design"]
            for other in [other for other in design if other not in keys_read_by(value)]:
                del design[other]
        return tomlkit.dumps(document)
    except (TOMLKitError, AttributeError, TypeError, ValueError) as error:
        raise InputError(
            f"study.toml: change {key} in the text: this form of it cannot be changed by a field"
        ) from error


def _set(document: Any, table: str, name: str, value: Any) -> None:
    if value == "":
        if table in document and name in document[table]:
            del document[table][name]
        return
    if table not in document:
        document[table] = tomlkit.table()
    document[table][name] = value


def _set_parameter(document: Any, name: str, field: str) -> None:
    factor = _factor(name, field)
    if factor is None:
        if name in document.get("factors", {}):
            del document["factors"][name]
            if not document["factors"]:
                del document["factors"]
        _set(document, "base", name, _scalar(field))
        return
    if document.get("design", {}).get("kind") != "one-at-a-time":  # there [base] is the base point
        _set(document, "base", name, "")
    if "factors" not in document:
        document["factors"] = tomlkit.table(is_super_table=True)
    table = tomlkit.table()
    table.update(factor)
    document["factors"][name] = table


def _factor(name: str, field: str) -> dict[str, Any] | None:
    """The factor that a field describes; None for one value or an empty field."""
    words, scale = (field[:-3].rstrip(), "log") if field.endswith("log") and ":" in field else (field, "linear")
    if ":" in words:
        try:
            low, high, *count = (_scalar(part.strip()) for part in words.split(":"))
        except ValueError:
            low, high, count = "", "", []
        if len(count) > 1 or not all(isinstance(part, int | float) for part in (low, high, *count)):
            raise InputError(f"{name} = {field!r}: write low : high or low : high : count, with log for a log scale")
        factor = {"low": low, "high": high} | ({"count": count[0]} if count else {})
        return factor | ({"scale": "log"} if scale == "log" else {})
    for piece in (piece.rstrip(",") for piece in words.split()):
        if "," in piece and readings(piece):
            raise InputError(
                f"{name}: {piece} may be one number or several values: write a point in a number, no sign between "
                "thousands, and a space behind a comma between values"
            )
    if words.count(",") > _MOST_VALUES:
        raise InputError(f"{name}: more than {_MOST_VALUES:,} values: write low : high : count, or them in the text")
    if "," in words:
        return {"values": [_scalar(part.strip()) for part in words.split(",") if part.strip()]}
    return None


def _scalar(text: str) -> Any:
    try:
        number = typed_number(text)
    except ValueError:
        return text
    return int(text) if text.strip().lstrip("+-").isdigit() and math.isfinite(number) else number
