"""Selections of labels of a coordinate, and the positions of these labels."""

import math
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.array_types import IntArray
from tripod_doe.errors import InputError, option
from tripod_doe.number_text import level
from tripod_doe.study.named_arrays import MATCH, meant
from tripod_doe.typed_numbers import number_or_text, readings, typed_number

_LISTED = 8  # labels that are listed one by one

Chosen = float | str | slice | Sequence[float | str]
"""A selection of a coordinate: a value, a range (either end may be None), or several values."""


@dataclass(frozen=True)
class Selection:
    """One selection: a coordinate, and the values or the range that it may take."""

    name: str
    values: tuple[float | str, ...] = ()  # numbers if possible, else texts
    low: float = -math.inf
    high: float = math.inf
    texts: tuple[str, ...] = ()  # allowed text labels: the parts of the selection
    written: str = ""  # all of it as written, perhaps one label; empty where Python code selects


def parse_selection(text: str) -> Selection:
    """Parse ``name=value``, ``name=a,b,c`` or ``name=a:b`` (either end may be left out).

    Raises:
        InputError: If the text has another form.
    """
    name, equals, wanted = text.partition("=")
    name = name.strip().replace("-", "_")
    if not equals or not name or not wanted:
        raise InputError(f"{option('select', text)}: write name=value, name=a,b,c or name=a:b")
    texts = tuple(part.strip() for part in wanted.split(","))
    if ":" in wanted:
        try:
            low, high = (typed_number(end) if end.strip() else None for end in wanted.split(":"))
        except ValueError:  # no range, but labels may be texts with such a sign
            return Selection(name, (wanted,), texts=texts, written=wanted)
        return Selection(name, (), -math.inf if low is None else low, math.inf if high is None else high, texts, wanted)
    return Selection(name, tuple(map(number_or_text, texts)), texts=texts, written=wanted)


def selections(select: Mapping[str, Chosen] | Sequence[Selection | str]) -> list[Selection]:
    """Selections from texts (``"order=3"``) or by name (``{"order": 3, "torque_n_m": slice(20, 60)}``).

    Raises:
        InputError: If a text has another form, a range other ends than numbers, or what is chosen is no value.
    """
    if isinstance(select, Mapping):
        return [_selected(name, wanted) for name, wanted in select.items()]
    parsed = [parse_selection(item) if isinstance(item, str) else item for item in select]
    if wrong := [item for item in parsed if not isinstance(item, Selection)]:
        raise InputError(f"select: {wrong[0]!r}: write 'name=value', 'name=a,b,c' or 'name=a:b'")
    return parsed


def _selected(name: Any, wanted: Any) -> Selection:
    """The selection that Python code asks for by the name of a coordinate."""
    try:
        if isinstance(wanted, slice):
            low = -math.inf if wanted.start is None else wanted.start
            high = math.inf if wanted.stop is None else wanted.stop
            if wanted.step is None and not any(isinstance(end, str | bool) for end in (low, high)):
                return Selection(name, (), _number(low), _number(high))
        elif isinstance(name, str) and not isinstance(wanted, Mapping):
            several = [wanted] if isinstance(wanted, str | float | int | np.generic) else list(wanted)
            if several:
                return Selection(name, tuple(map(_value, several)), texts=tuple(map(str, several)))
    except (TypeError, ValueError, OverflowError):  # no numbers
        pass
    raise InputError(
        f"select: {name!r}: {wanted!r}: give the name of a coordinate and a value, a list of values, or slice(a, b) "
        "with two numbers"
    )


def _value(given: Any) -> float | str:
    """A value as selections hold it; a bool stays a bool, which may be a label."""
    if isinstance(given, bool | np.bool_):
        return bool(given)
    return given if isinstance(given, str) else _number(given)


def _number(given: Any) -> float:
    if np.iscomplexobj(given):  # of which NumPy would give the real part
        raise TypeError
    return float(given)


def sole_number(labels: xr.Variable, selection: Selection) -> float | None:
    """The one number that is asked for of numeric labels, if it is one."""
    one = selection.values[0] if len(selection.values) == 1 and labels.dtype.kind in "fiu" else None
    return None if isinstance(one, bool | str) else one


def taken(labels: xr.Variable, left: IntArray | None, selection: Selection, nearest: bool) -> IntArray:
    """Positions of the labels that meet a selection.

    Args:
        left: Positions to search; None for all.
        selection: The selection.
    """
    own = np.arange(labels.size) if left is None else left
    values = labels.values[own]
    if labels.dtype.kind not in "fiub":
        known = labels.values.astype(str)
        return own[np.isin(known[own], _text_labels(selection, set(known.tolist())))]
    if nearest:
        nearest_ones = tuple(_nearest(wanted, values) for wanted in selection.values)
        selection = replace(selection, values=selection.values + nearest_ones)
    return own[_matching(values, selection)]


def nearest_rows(asked: Sequence[tuple[xr.Variable, float]], left: IntArray | None) -> IntArray:
    """Positions of the point nearest to numbers along one dimension, and of those with the same labels.

    Args:
        asked: Labels, and the number asked for; differences count as parts of the range of the labels.
        left: Positions to search; None for all.
    """
    own = np.arange(asked[0][0].size) if left is None else left
    values = np.array([labels.values[own].astype(float) for labels, _ in asked])
    apart = np.array([np.abs(one - number) for one, (_, number) in zip(values, asked, strict=True)])
    if not (known := np.isfinite(apart).all(axis=0)).any():
        return own[:0]
    ranges = np.array([[np.nanmax(labels.values) - np.nanmin(labels.values) or 1] for labels, _ in asked])
    nearest = np.where(known, np.hypot.reduce(apart / ranges), np.inf).argmin()
    return own[np.isclose(values, values[:, [nearest]], rtol=MATCH, atol=0).all(axis=0)]


def refuse_unmatched(labels: xr.Variable, selection: Selection, nearest: bool) -> None:
    """Refuse a list with a value that no label has; a single value and a range may meet none.

    Raises:
        InputError: With these values, the labels, and the number that a decimal comma would have meant.
    """
    if len(selection.values) < 2:
        return
    known = np.unique(labels.values)
    if known.dtype.kind in "fiub":
        wanted = zip(selection.texts, selection.values, strict=True)
        missing = [t for t, value in wanted if not (nearest or _matching(known, Selection("", (value,))).any())]
    else:
        texts = set(known.astype(str).tolist())
        missing = [text for text in _text_labels(selection, texts) if text not in texts]
    if missing:
        meant = " or ".join(f"{value:.12g}" for value in readings(selection.written))
        raise InputError(
            f"{option('select', selection.name)}: no label is {' or '.join(missing[:_LISTED])}; {selection.name} "
            f"{labels_text(labels)}" + f"; write {meant} with a decimal point, and no comma" * bool(meant)
        )


def _text_labels(selection: Selection, known: Container[str]) -> list[str]:
    """The labels that are meant: all that is written where it is one, else its parts, with their blanks if known so."""
    if selection.written in known:
        return [selection.written]
    parts = selection.written.split(",") if selection.written else selection.texts
    return [part if part in known else part.strip() for part in parts]


def _nearest(wanted: float | str, values: NDArray[Any]) -> float | str:
    """The first label nearest to a number; a text is returned unchanged."""
    if isinstance(wanted, str) or not math.isfinite(wanted):
        return wanted
    if not np.isfinite(values).any():
        return wanted
    return float(values[np.nanargmin(np.abs(values.astype(float) - wanted))])


def _matching(values: NDArray[Any], selection: Selection) -> NDArray[np.bool_]:
    """Numbers that meet a selection."""
    _refuse_impossible(selection)
    if not selection.values:
        slack = MATCH * np.abs(values)  # linspace's 0.30000000000000004 lies in 0.1:0.3
        return np.asarray((values >= selection.low - slack) & (values <= selection.high + slack))
    keep = np.zeros(values.size, bool)
    place = option("select", selection.name)
    for wanted in selection.values:
        if isinstance(wanted, bool) and values.dtype.kind != "b":
            raise InputError(f"{place}: {wanted} is no number")
        if isinstance(wanted, str):
            if ":" in wanted:
                raise InputError(f"{place}: {wanted!r}: a range is two numbers, a:b")
            raise InputError(f"{place}: {wanted!r} is not a number; select each coordinate by an argument of its own")
        keep |= meant(values, wanted)
    return keep


def _refuse_impossible(selection: Selection) -> None:
    """Refuse selections that no number can meet: NaN, and a range with reversed ends."""
    numbers = [each for each in (*selection.values, selection.low, selection.high) if isinstance(each, float)]
    place = option("select", selection.name)
    if any(map(math.isnan, numbers)):
        raise InputError(f"{place}: no label is nan; leave it out")
    if selection.low > selection.high:
        raise InputError(
            f"{place}: no number lies in {level(selection.low)}:{level(selection.high)}; write the smaller end first"
        )


def labels_text(labels: xr.Variable) -> str:
    """The labels in words: few one by one, numbers by their ends."""
    known = np.unique(labels.values)
    texts = [level(float(value)) if known.dtype.kind in "fiu" else str(value) for value in known[:_LISTED].tolist()]
    if 1 < known.size <= _LISTED:
        return f"is {', '.join(texts[:-1])} or {texts[-1]}"
    if known.size == 1:
        return f"is {texts[0]}"
    if known.dtype.kind in "fiu":
        return f"has {known.size:,} values from {texts[0]} to {level(float(np.nanmax(known)))}"
    return f"has {known.size:,} values, as {', '.join(texts[:3])}"
