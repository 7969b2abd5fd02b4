"""Differences of two study files, key by key, and of the program and the values behind two cubes."""

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import xarray as xr

from tripod_doe.errors import CubeError, InputError
from tripod_doe.study.definition.toml_text import parse_toml

NOT_SET = None


@dataclass(frozen=True)
class KeyDifference:
    """One key whose value differs; a side that does not set it has None."""

    key: str  # of a study file, as ``factors.torque_n_m.values``, or the name of a parameter or a package
    a: Any
    b: Any


def study_differences(a: str, b: str) -> list[KeyDifference]:
    """Keys in which two study files differ; comments, order and spelling of numbers do not count.

    Raises:
        InputError: If a text is not TOML.
    """
    return _different(_flat(parsed_study(a)), _flat(parsed_study(b)))


def program_differences(a: xr.Dataset, b: xr.Dataset) -> list[KeyDifference]:
    """Versions of kernels and packages, and models, in which two cubes differ."""
    return _different(_program(a.attrs), _program(b.attrs))


def parameter_differences(a: xr.Dataset, b: xr.Dataset, leave_out: Collection[str]) -> list[KeyDifference]:
    """Parameters that have one value in all points of each of two cubes, and another one in the other.

    A default that another version of the program has changed is among them, though no study file sets it.

    Args:
        leave_out: Names to leave out: those that the study files set.
    """
    first, second = fixed_parameters(a), fixed_parameters(b)
    both = [name for name in first if name in second and name not in leave_out]
    return _different({name: first[name] for name in both}, {name: second[name] for name in both})


def fixed_parameters(cube: xr.Dataset) -> dict[str, Any]:
    """Parameters that have one value in all points of a cube."""
    return _values(cube.attrs, "fixed_parameters")


def _values(attributes: Mapping[str, Any], name: str) -> dict[str, Any]:
    """An attribute of a cube that holds numbers and texts by name."""
    try:
        values: dict[str, Any] = json.loads(str(attributes.get(name, "{}")))
    except (ValueError, RecursionError) as error:
        raise CubeError(f"the attribute {name} of this cube is damaged: {error}") from error
    if not isinstance(values, dict) or any(isinstance(value, list | dict) for value in values.values()):
        raise CubeError(f"the attribute {name} of this cube is damaged: values by name are expected")
    return values


def parsed_study(text: str) -> dict[str, Any]:
    """The tables of a study file; InputError if the text is not TOML."""
    try:
        return parse_toml(text, "its text")
    except InputError as error:
        raise InputError(f"not a study file: {error}") from error


def _program(attributes: Mapping[str, Any]) -> dict[str, Any]:
    versions = _values(attributes, "package_versions")
    own = {name: attributes[name] for name in ("kernel_source_hash", "models") if name in attributes}
    return own | versions


def _different(a: Mapping[str, Any], b: Mapping[str, Any]) -> list[KeyDifference]:
    keys = dict.fromkeys([*a, *b])
    pairs = [KeyDifference(key, a.get(key, NOT_SET), b.get(key, NOT_SET)) for key in keys]
    return [pair for pair in pairs if pair.a != pair.b]


def _flat(tables: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in tables.items():
        name = f"{prefix}.{key}" if prefix else key
        flat |= _flat(value, name) if isinstance(value, dict) else {name: value}
    return flat
