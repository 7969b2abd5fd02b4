"""Differences of two studies as text, as CSV and as JSON."""

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Any

from tripod_doe.analyses.diff.definitions import KeyDifference
from tripod_doe.analyses.diff.diff import NO_PHASE, Diff, EqualVariable, ResultDifference
from tripod_doe.errors import printable
from tripod_doe.files.csv_table import csv_cell
from tripod_doe.number_text import count_of, digits_apart, level, number, plain_json, with_unit
from tripod_doe.page_parts.words import unit_text
from tripod_doe.phases import amplitude_of

_MOST = 12  # lines of one kind in a text
_LONGEST = 60  # characters of a value in a text


def diff_text(found: Diff) -> str:
    """All differences, a line each; of results the largest first."""
    lines: list[str] = []
    for title, differences in (
        ("study", found.study),
        ("values that neither study file sets", found.parameters),
        ("program", found.program),
        ("results that are not compared, since their units differ", found.units),
    ):
        if differences:
            lines += [title, *(f"  {one.key}: {_change(one)}" for one in differences)]
    if not lines:
        lines = ["the studies are equal"]
    lines += _points_lines(found)
    return "\n".join(map(printable, lines))


def _points_lines(found: Diff) -> list[str]:
    if not found.points:
        return [found.note] if found.note else []
    counts = found.points
    lines = [f"points  A {counts['a']:,}, B {counts['b']:,}, shared {counts['shared']:,}"]
    if not counts["shared"]:
        return [*lines, found.note]
    lines += _first(
        (f"  outcome at {_place(one.at)}: {one.a} -> {one.b}" for one in found.outcomes), len(found.outcomes)
    )
    if found.results:
        lines.append("largest differences of results at shared points, A -> B")
        lines += _first((f"  {_result(one)}" for one in found.results), len(found.results))
    lines += _first((_equal(one, counts["shared"]) for one in found.equal), len(found.equal))
    if not (found.results or found.equal or found.one_sided or found.units):
        lines.append("no result has a number in both studies")
    lines += _first(
        (
            f"  {_named(one.variable, one.part)}: {_one_sided(one.variable)} at {count_of(one.points, 'point')}"
            for one in found.one_sided
        ),
        len(found.one_sided),
    )
    if found.others:
        lines.append(f"not compared: {', '.join(found.others)} (--variable NAME)")
    return lines


def _one_sided(variable: str) -> str:
    if not amplitude_of(variable):
        return "a number in one study only"
    return f"a phase of an amplitude above {100 * NO_PHASE:g} % of the largest at its point, in one study only,"


def _first(lines: Iterator[str], count: int) -> Iterator[str]:
    for _, line in zip(range(_MOST), lines, strict=False):
        yield line
    if count > _MOST:
        yield f"  and {count - _MOST:,} more: --format csv lists all"


def _equal(one: EqualVariable, shared: int) -> str:
    every = count_of(shared, "shared point")
    where = f"at all {every}" if one.points == shared else f"wherever both have one ({one.points:,} or more of {every})"
    return f"{one.variable} ({count_of(one.numbers, 'number')} a point): equal {where}"


def _result(one: ResultDifference) -> str:
    digits = min(max(digits_apart(one.a, one.b), 3), 12)
    unit = unit_text(one.unit)
    values = f"{number(one.a, digits)} -> {with_unit(number(one.b, digits), unit)}"
    in_percent = math.isfinite(one.relative) and one.a * one.b >= 0  # of a change of sign a percentage says nothing
    relative = f" ({'+' * (one.relative > 0)}{number(100 * one.relative, 2)} %)" if in_percent else ""
    return f"{_named(one.variable, one.part)}: {values}{relative} at {_place(one.at)}"


def _named(variable: str, part: Mapping[str, Any]) -> str:
    labels = ", ".join(f"{name} {value}" for name, value in part.items())
    return f"{variable}, {labels}" if labels else variable


def _place(at: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {_value(value)}" for name, value in at.items()) or "the only point"


def _change(one: KeyDifference) -> str:
    """Old and new value; of two long lists, what was added and what was left out."""
    if isinstance(one.a, list) and isinstance(one.b, list):
        changes = [
            f"{word} {_cut(', '.join(map(_value, values)))}"
            for word, values in (
                ("added", _list_difference(one.b, one.a)),
                ("left out", _list_difference(one.a, one.b)),
            )
            if values
        ]
        return "; ".join(changes) or "in another order"
    return f"{_value(one.a)} -> {_value(one.b)}"


def _list_difference(values: list[Any], others: list[Any]) -> list[Any]:
    """A list without the values of another one, each removed as often as it occurs there."""
    rest = values.copy()
    for value in others:
        if value in rest:
            rest.remove(value)
    return rest


def _value(value: Any) -> str:
    if value is None:
        return "not set"
    if isinstance(value, float):
        return level(value)
    return _cut(value if isinstance(value, str) else json.dumps(value, default=str))


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


def diff_json(found: Diff) -> str:
    """All differences as one JSON object; NaN is null."""
    return json.dumps(plain_json(asdict(found)), default=str)


def diff_csv(found: Diff) -> str:
    """All differences as a table: kind, key, place, values of A and B, difference, relative difference."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(["kind", "key", "at", "a", "b", "difference", "relative"])
    keys = {"study": found.study, "parameter": found.parameters, "program": found.program, "unit": found.units}
    for kind, differences in keys.items():
        for key in differences:
            writer.writerow(map(csv_cell, [kind, key.key, "", _cell(key.a), _cell(key.b), "", ""]))
    for outcome in found.outcomes:
        writer.writerow(map(csv_cell, ["outcome", "outcome", _place(outcome.at), outcome.a, outcome.b, "", ""]))
    for lost in found.one_sided:
        place = count_of(lost.points, "point")
        writer.writerow(map(csv_cell, ["one side alone", _named(lost.variable, lost.part), place, "", "", "", ""]))
    for equal in found.equal:
        place = count_of(equal.points, "point")
        writer.writerow(map(csv_cell, ["equal", equal.variable, place, "", "", "", ""]))
    for one in found.results:
        relative = one.relative if math.isfinite(one.relative) else ""
        cells = ["result", _named(one.variable, one.part), _place(one.at), one.a, one.b, one.difference, relative]
        writer.writerow(map(csv_cell, cells))
    return buffer.getvalue().rstrip("\n")


def _cell(value: Any) -> Any:
    return "" if value is None else value if isinstance(value, str | int | float) else json.dumps(value, default=str)
