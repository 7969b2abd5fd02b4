"""The kind of an analysis result: the attribute ``analysis_kind`` of its Dataset; a study's cube has none."""

from collections.abc import Callable, Mapping
from functools import wraps
from typing import Any, ParamSpec

import xarray as xr

P = ParamSpec("P")
_ATTRIBUTE = "analysis_kind"

MADE: set[str] = set()
"""Kinds of the results that this process has made."""


def makes_kind(kind: str) -> Callable[[Callable[P, xr.Dataset]], Callable[P, xr.Dataset]]:
    """Decorator of an analysis: every result carries its kind, the name that study and workflow files use."""

    def decorate(function: Callable[P, xr.Dataset]) -> Callable[P, xr.Dataset]:
        @wraps(function)
        def analysis(*args: P.args, **kwargs: P.kwargs) -> xr.Dataset:
            result = function(*args, **kwargs).assign_attrs({_ATTRIBUTE: kind})
            for label, values in result.coords.items():
                values.attrs.setdefault("long_name", str(label).replace("_", " "))
            MADE.add(kind)
            return result

        analysis.__dict__[_ATTRIBUTE] = kind
        return analysis

    return decorate


def kind_made_by(function: Callable[..., Any]) -> str:
    """The kind of the results of an analysis; also of one wrapped by `functools.wraps`."""
    return str(function.__dict__[_ATTRIBUTE])


def kind_of(data: xr.Dataset) -> str:
    """The kind of an analysis result, empty for the cube of a study."""
    return str(data.attrs.get(_ATTRIBUTE, ""))


def is_study(data: xr.Dataset) -> bool:
    """Whether a Dataset is the cube of a study and not the result of an analysis."""
    return _ATTRIBUTE not in data.attrs


def of_kind(results: Mapping[str, xr.Dataset], *kinds: str) -> dict[str, xr.Dataset]:
    """The results of these kinds, by their names and in their order."""
    return {name: data for name, data in results.items() if kind_of(data) in kinds}
