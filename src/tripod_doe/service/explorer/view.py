"""A view of a cube: a variable, its axes and the slice. The address of the page is its text."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from urllib.parse import urlencode

from tripod_doe.errors import InputError, near_match
from tripod_doe.typed_numbers import typed_number

KINDS = ("lines", "map", "points", "matrix", "parallel")
"""Kinds of views: lines over one dimension, colours over two, one mark per point, marks over all pairs of axes, and
one line per point over many axes."""

OF_POINTS = ("points", "matrix", "parallel")
"""Kinds that show the points of the design one by one."""

MEANINGS = {
    "variable": "name of the variable",
    "kind": f"one of {', '.join(KINDS)}",
    "x": "dimension or factor along the bottom",
    "by": "dimension of the lines, the other axis of a map, or the colour of points",
    "where": "condition on the cells, as query --where takes it",
    "analysis": "name of the analysis whose result is shown in place of the cube",
    "minus": "what to subtract: another run, by its id, or this cube's values at name=value",
    "low": "lower end of a fixed range of the colours",
    "high": "upper end of a fixed range of the colours",
    "select": "values of the other dimensions and ranges of factors, name=value or name=a:b; repeatable",
}
"""Meanings of the items of an address."""

_WORDS = ("variable", "kind", "x", "by", "where", "analysis", "minus")


@dataclass(frozen=True)
class View:
    """The selected part of a cube, see `MEANINGS`; for an empty field, the cube decides."""

    variable: str = ""
    kind: str = ""
    x: str = ""
    by: str = ""
    select: tuple[str, ...] = ()
    where: str = ""
    low: float | None = None
    high: float | None = None
    analysis: str = ""
    minus: str = ""

    @classmethod
    def from_items(cls, items: Iterable[tuple[str, str]]) -> View:
        """The view that the items of an address describe; ignores unknown items.

        Raises:
            InputError: If a limit is no number, low is not below high, or the kind is unknown.
        """
        given = list(items)
        words: dict[str, str] = {name: text for name, text in given if name in _WORDS}
        limits = {name: _number(name, text) for name, text in given if name in ("low", "high")}
        selected = tuple(text for name, text in given if name == "select" and text)
        view = cls(select=selected, low=limits.get("low"), high=limits.get("high"), **words)
        if view.kind and view.kind not in KINDS:
            raise InputError(f"kind = {view.kind!r}: unknown{near_match(view.kind, KINDS)}")
        if view.low is not None and view.high is not None and view.low >= view.high:
            raise InputError(f"low = {view.low:g}: not below high = {view.high:g}")
        return view

    def items(self) -> list[tuple[str, str]]:
        """The view as items of an address."""
        texts = [(name, getattr(self, name)) for name in _WORDS if getattr(self, name)]
        limits = [(name, f"{value:g}") for name, value in (("low", self.low), ("high", self.high)) if value is not None]
        return texts + limits + [("select", text) for text in self.select]

    @property
    def data_items(self) -> list[tuple[str, str]]:
        """Those items that choose numbers, as the route of a query takes them."""
        return [item for item in self.items() if item[0] in ("variable", "select", "where", "analysis")]

    @property
    def address(self) -> str:
        """The query string of its page."""
        return urlencode(self.items())

    @property
    def minus_level(self) -> tuple[str, str] | None:
        """Coordinate and value whose numbers are subtracted; None if the view subtracts a run, or nothing."""
        name, equals, level = self.minus.partition("=")
        return (name, level) if equals else None

    def selected(self, names: Sequence[str]) -> tuple[str, ...]:
        """The selections of these coordinates."""
        return tuple(text for text in self.select if text.partition("=")[0] in names)


def _number(name: str, text: str) -> float | None:
    if not text:
        return None
    try:
        number = typed_number(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(f"{name} = {text[:100]!r}: expected a number")
    return number


def selected_text(value: object) -> str:
    """A value of a coordinate as selections and the command line take it."""
    return f"{value:.12g}" if isinstance(value, float) else str(value)
