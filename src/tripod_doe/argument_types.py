"""Arguments of the public functions, checked against their annotations: a wrong type is refused with a sentence.

Only calls from outside are checked, where a name is taken from the package; what calls within is checked by mypy.
Annotations are read as texts, so the modules of these functions import `annotations` from `__future__`.
"""

from __future__ import annotations

import functools
import inspect
import os
import re
from collections.abc import Callable, Collection, Mapping
from numbers import Integral, Real
from typing import Any, TypeVar

from tripod_doe.errors import InputError

Function = TypeVar("Function", bound=Callable[..., Any])

_LONGEST_SHOWN = 60  # characters of a value in a message
_PARTS = re.compile(r"[^|\[]+(?:\[(?:[^\[\]]|\[[^\]]*\])*\])?")  # alternatives of an annotation, brackets kept whole


def _is_dataset(value: Any) -> bool:
    """Whether a value is a Dataset; xarray need not be imported to know."""
    return any(kind.__module__.startswith("xarray.") and kind.__name__ == "Dataset" for kind in type(value).__mro__)


def _is_list_of_texts(value: Any) -> bool:
    return isinstance(value, Collection) and not isinstance(value, str) and all(isinstance(each, str) for each in value)


_KINDS: Mapping[str, tuple[Callable[[object], bool], str]] = {
    "str": (lambda value: isinstance(value, str), "a text"),
    "Path": (lambda value: isinstance(value, os.PathLike), "a path"),
    "bool": (lambda value: isinstance(value, bool), "True or False"),
    "int": (lambda value: isinstance(value, Integral) and not isinstance(value, bool), "a whole number"),
    "float": (lambda value: isinstance(value, Real) and not isinstance(value, bool), "a number"),
    "None": (lambda value: value is None, "None"),
    "xr.Dataset": (_is_dataset, "an xarray Dataset, as open_cube gives it"),
    "Study": (lambda value: type(value).__name__ == "Study", "a Study, as load_study gives it"),
    "Measurement": (lambda value: type(value).__name__ == "Measurement", "a Measurement, as read_measurement gives it"),
    "Mapping": (lambda value: isinstance(value, Mapping), "a dict"),
    "Sequence[Selection | str]": (lambda value: isinstance(value, list | tuple), "a list"),
    "Sequence[str]": (_is_list_of_texts, "a list of texts"),
    "Collection[str]": (_is_list_of_texts, "a list of texts"),
}
"""The types that a part of an annotation admits, and their name for people."""


def with_checked_arguments(function: Function) -> Function:
    """The same function, refusing arguments whose types its annotations exclude."""
    signature = inspect.signature(function)

    @functools.wraps(function)
    def checked(*given: Any, **named: Any) -> Any:
        for name, value in signature.bind(*given, **named).arguments.items():
            parameter = signature.parameters[name]
            if parameter.kind is not inspect.Parameter.VAR_KEYWORD:
                _check(function.__name__, name, value, str(parameter.annotation))
        return function(*given, **named)

    return checked  # type: ignore[return-value]


def _check(function: str, name: str, value: Any, annotation: str) -> None:
    """Refuse (InputError) a value that no part of an annotation admits; parts that are not known admit everything."""
    parts = [part.strip() for part in _PARTS.findall(annotation) if part.strip()]
    kinds = [_KINDS.get(part) or _KINDS.get(part.partition("[")[0]) for part in parts]
    if name == "cube" and _is_dataset(value) and "outcome" not in value:
        raise InputError(f"{function}: {name}: this Dataset is no result cube: the variable outcome is missing")
    if None in kinds or any(kind and kind[0](value) for kind in kinds):
        return
    shown = repr(value)
    if len(shown) > _LONGEST_SHOWN or "\n" in shown:
        shown = f"a {type(value).__name__}"
    words = dict.fromkeys(kind[1] for kind in kinds if kind and kind[1] != "None")
    if {"a text", "a path"} <= words.keys():
        words = dict.fromkeys(["a path", *(word for word in words if word not in ("a text", "a path"))])
    raise InputError(f"{function}: {name} = {shown}: expected {' or '.join(words)}, not {_kind_of(value)}")


def _kind_of(value: object) -> str:
    return "None" if value is None else f"a value of type {type(value).__name__}"
