"""Factorial and response-surface designs by pyDOE: points in coded levels, -1 for low and 1 for high.

A factor gives its two levels by ``low`` and ``high`` or by two values, which may be words where a design has no other
levels. The full factorial takes as many levels as a factor lists.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.study.definition.factors import Factor
from tripod_doe.study.designs.columns import Column
from tripod_doe.study.designs.request import Family, Made, Request, column_of, held

_NUMERALS = {3: "III", 4: "IV", 5: "V", 6: "VI", 7: "VII", 8: "VIII"}
_DEFAULT_RESOLUTION = 4  # main effects apart from the interactions of two factors
_MOST_FACTORS = 12  # of a central composite design, whose cube has 2^n corners


def _ends(factor: Factor) -> tuple[Any, Any]:
    """The values at the coded levels -1 and 1."""
    name, table = factor.parameter.name, factor.table
    if factor.values is not None and len(factor.values) == 2:
        return factor.values[0], factor.values[1]
    if factor.values is None and table.distribution is None and table.low is not None and table.high is not None:
        return table.low, table.high
    raise InputError(f"[factors.{name}]: this design needs two levels; give low and high, or two values")


def _decoded(factor: Factor, coded: FloatArray) -> Column:
    """Values of a factor at coded levels; between and beyond its ends on the scale of the factor.

    Raises
    ------
    InputError
        If a level lies outside of what the parameter allows, or is a word or whole number that is not one of the two.
    """
    low, high = _ends(factor)
    parameter, log = factor.parameter, factor.table.scale == "log"
    if isinstance(low, str) or isinstance(high, str):
        if (np.abs(coded) != 1).any():
            raise InputError(f"[factors.{parameter.name}]: this design needs levels between {low} and {high}")
        return column_of(factor, [low if level < 0 else high for level in coded])
    ends = np.log([low, high]) if log else np.array([low, high], float)
    values = ends.mean() + coded * (ends[1] - ends[0]) / 2
    values = np.exp(values) if log else values
    values = np.where(coded == -1, low, np.where(coded == 1, high, values))  # the ends exact, whatever rounding does
    for level, value in sorted(set(zip(coded.tolist(), values.tolist(), strict=True))):
        try:
            parameter.check(value)
        except InputError as error:
            remedy = '; narrow its range, or set star = "inscribed"' if abs(level) > 1 else ""
            raise InputError(f"[factors.{parameter.name}]: its coded level {level:g}: {error}{remedy}") from error
    return column_of(factor, [parameter.check(value) for value in values.tolist()])


def _decoded_all(request: Request, coded: FloatArray, notes: tuple[str, ...] = ()) -> Made:
    return held({name: _decoded(f, coded[:, at]) for at, (name, f) in enumerate(request.factors.items())}, notes=notes)


def _full_levels(request: Request) -> list[Column]:
    """Levels of the factors of a full factorial: those listed, or so many from low to high (two if not said)."""
    found = []
    for factor in request.factors.values():
        if factor.values is not None:
            found.append(column_of(factor, factor.values))
        else:
            found.append(_decoded(factor, np.linspace(-1, 1, request.table.levels or 2)))
    return found


def _full_count(request: Request) -> int:
    own = (len(factor.values) if factor.values else request.table.levels or 2 for factor in request.factors.values())
    return math.prod(own)


def _full(request: Request) -> Made:
    from pydoe import fullfact

    levels = _full_levels(request)
    places = fullfact([len(column) for column in levels]).astype(int)
    return held({name: levels[at][places[:, at]] for at, name in enumerate(request.factors)})


def _fraction(request: Request) -> tuple[FloatArray, int]:
    """The fraction with the fewest points that has the resolution, and the highest that so many points can have."""
    from pydoe import fracfact_by_res

    width, asked = len(request.factors), request.table.resolution or _DEFAULT_RESOLUTION
    if width < 2:
        raise InputError("a fractional-factorial design needs at least two factors")
    try:
        coded, resolution = np.asarray(fracfact_by_res(width, asked), float), asked
    except ValueError as error:
        raise InputError(f"resolution = {asked}: {error}") from error
    while len(coded) < 2**width and len(better := fracfact_by_res(width, resolution + 1)) == len(coded):
        coded, resolution = np.asarray(better, float), resolution + 1
    return coded, resolution


def _fractional(request: Request) -> Made:
    coded, resolution = _fraction(request)
    if len(coded) == 2 ** len(request.factors):
        told = "all combinations, since no fraction has the resolution"
    else:
        told = f"of resolution {_NUMERALS.get(resolution, resolution)}"
    lists = "; ".join(" = ".join(names) for names in aliases(dict(zip(request.factors, coded.T, strict=True))))
    confounded = f"it confounds {lists}" if lists else "no effects of one factor or two are confounded"
    return _decoded_all(request, coded, (f"two-level design of {len(coded):,} points, {told}; {confounded}",))


def aliases(columns: Mapping[str, FloatArray]) -> list[list[str]]:
    """Effects of one factor or two that a two-level design cannot tell apart.

    Parameters
    ----------
    columns
        Coded levels, -1 or 1, of each factor, shape (point,).

    Returns
    -------
    list of list of str
        Names such as ``a`` and ``b:c``, those in one list confounded with each other; each list in the order of the
        factors, lists of one are left out.
    """
    products = dict(columns)
    products |= {f"{one}:{other}": columns[one] * columns[other] for one, other in combinations(columns, 2)}
    same: dict[bytes, list[str]] = {}
    for name, product in products.items():
        same.setdefault((product * product[0]).astype(np.int8).tobytes(), []).append(name)
    return [names for names in same.values() if len(names) > 1]


def _plackett_burman(request: Request) -> Made:
    from pydoe import pbdesign

    try:
        coded = np.asarray(pbdesign(len(request.factors)), float)
    except ValueError as error:
        raise InputError(
            f"there is no plackett-burman design of {len(request.factors)} factors; use a fractional-factorial design"
        ) from error
    note = (
        f"Plackett-Burman design of {len(coded):,} points: effects of single factors, each mixed with interactions of "
        "the others"
    )
    return _decoded_all(request, coded, (note,))


def _centre_points(request: Request) -> int:
    given = request.table.centre_points
    return 1 if given is None else given  # of a deterministic model, more of them tell nothing


def _composite_points(request: Request) -> FloatArray:
    from pydoe import ccdesign

    width, table, centre = len(request.factors), request.table, _centre_points(request)
    if not 2 <= width <= _MOST_FACTORS:
        raise InputError(f"a central-composite design needs 2 to {_MOST_FACTORS} factors, not {width}")
    split = (centre - centre // 2, centre // 2)  # among the cube's points and the stars
    coded = ccdesign(width, center=split, alpha=table.star_distance, face=table.star)
    return np.asarray(coded, float)


def _box_behnken_points(request: Request) -> FloatArray:
    from pydoe import bbdesign

    if len(request.factors) < 3:
        raise InputError("a box-behnken design needs at least three factors")
    return np.asarray(bbdesign(len(request.factors), _centre_points(request)), float)


def _box_behnken_count(request: Request) -> int:
    return 2 * len(request.factors) * (len(request.factors) - 1) + _centre_points(request)


def _composite_count(request: Request) -> int:
    return int(2 ** len(request.factors)) + 2 * len(request.factors) + _centre_points(request)


CODED: dict[str, Family] = {
    "full-factorial": Family(_full, _full_count),
    "fractional-factorial": Family(_fractional, lambda request: len(_fraction(request)[0])),
    "plackett-burman": Family(_plackett_burman, lambda request: 4 * (len(request.factors) // 4 + 1)),
    "central-composite": Family(lambda request: _decoded_all(request, _composite_points(request)), _composite_count),
    "box-behnken": Family(lambda request: _decoded_all(request, _box_behnken_points(request)), _box_behnken_count),
}
"""Factorial and response-surface designs by kind."""
