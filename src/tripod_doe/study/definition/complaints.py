"""Complaints of pydantic about our files as sentences: table, key, value, reason and a near match."""

import re
from typing import get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from tripod_doe.errors import first_messages, near_match
from tripod_doe.study.definition.toml_text import shown


def complaints(error: ValidationError, model: type[BaseModel]) -> list[str]:
    """Pydantic's complaints about a TOML file, each with table, key, value, reason and a near match.

    Args:
        model: All tables of the file, whose keys are near matches.
    """
    return first_messages(error.errors(include_url=False), lambda item: _complaint(item, model))


def _keys_at(model: type[BaseModel], path: list[str]) -> list[str]:
    """Keys that the table at a path may hold; empty if all keys are allowed."""
    while path:
        field = model.model_fields.get(path[0])
        annotation = field.annotation if field else None
        parts = [annotation, *get_args(annotation)]
        tables = [part for part in parts if isinstance(part, type) and issubclass(part, BaseModel)]
        if not tables:
            return []
        model, path = tables[0], path[2 if get_origin(annotation) is dict else 1 :]
    return [name for name in model.model_fields if name != "designs"]  # a sub-design is written [design.NAME]


_NEEDED_TABLES = ("study", "workflow", "steps")
"""Tables that every file of its kind has."""

_TYPE = re.compile(r"(float|int|str|bool|dict)(\[.*)?")
"""Parts of a pydantic location that name one of several types of a value."""


def _complaint(item: ErrorDetails, model: type[BaseModel]) -> str:
    """One complaint of pydantic; see `complaints`."""
    names = len(item["loc"]) if item["type"] in ("extra_forbidden", "missing") else 2  # a table and a key come first
    location = [str(part) for part in item["loc"]]
    path = location[:names] + [part for part in location[names:] if not _TYPE.fullmatch(part)]
    where, key = ".".join(path[:-1]), path[-1]
    place = f"[{where}]" if where else "the file"
    if item["type"] == "extra_forbidden":
        return f"{place}: unknown key {key!r}{near_match(key, _keys_at(model, path[:-1]))}"
    if item["type"] == "missing":
        return f"{place}: {f'table [{key}]' if key in _NEEDED_TABLES else key} is missing"
    if item["type"] == "literal_error":
        words = re.findall(r"'([^']*)'", item["ctx"]["expected"])
        return f"{place}: {key} = {shown(item['input'])}: unknown{near_match(str(item['input']), words)}"
    if item["type"] in ("model_type", "dict_type"):
        return f"{place}: {key} = {shown(item['input'])}: {_as_table(where, key, item['input'])}"
    return f"{place}: {key} = {shown(item['input'])}: {said_of(item, key)}"


_EXPECTED = {
    "string_type": "expected text in quotes",
    "string_too_short": "must not be empty",
    "string_too_long": "must have at most {max_length:,} characters",
    "dict_type": "expected a table",
    "bool_type": "expected true or false",
    "bool_parsing": "expected true or false",
    "float_type": "expected a number",
    "float_parsing": "expected a number",
    "finite_number": "must be finite",
    "int_type": "expected a whole number",
    "int_parsing": "expected a whole number",
    "int_from_float": "expected a whole number",
    "greater_than": "must be above {gt:g}",
    "greater_than_equal": "must be at least {ge:,g}",
    "less_than": "must be below {lt:g}",
    "less_than_equal": "must be at most {le:,.9g}",
}
"""Reasons by pydantic's name of the complaint, with its numbers."""


def said_of(complaint: ErrorDetails, key: str) -> str:
    """The reason why pydantic refuses a value.

    Args:
        key: The key as a file has it.
    """
    if complaint["type"] in ("list_type", "tuple_type"):
        return f"expected a list, as {key} = [{shown(complaint['input'])}]"
    if complaint["type"] in _EXPECTED:
        return _EXPECTED[complaint["type"]].format(**complaint.get("ctx", {}))
    return complaint["msg"][0].lower() + complaint["msg"][1:]


def _as_table(where: str, key: str, value: object) -> str:
    """The text to write instead of a value if a table is required."""
    if where == "factors" and isinstance(value, list):
        return f"write {key} = {{ values = {shown(value)} }}"
    if where == "factors":
        return "a factor is a table of its values or its range; a parameter with one value belongs in [base]"
    return f"expected a table, as [{where}.{key}]" if where else f"expected a table, as [{key}]"
