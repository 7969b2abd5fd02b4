"""Factorial and response-surface designs by pyDOE: points in coded levels, -1 for low and 1 for high.

A factor gives its two levels by ``low`` and ``high`` or by two values, which may be words where a design has no other
levels. The full factorial takes as many levels as a factor lists.
"""

import math
from collections.abc import Mapping
from contextlib import suppress
from itertools import combinations
from typing import Any

import numpy as np

from tripod_doe.array_types import FloatArray
from tripod_doe.errors import InputError
from tripod_doe.study.definition.factors import Factor
from tripod_doe.study.designs.design_interface import Column, Family, Made, Request, column_of

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

    Raises:
        InputError: If a level lies outside of what the parameter allows, or is a word or whole number that is not one
            of the two.
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
    columns = {name: _decoded(f, coded[:, at]) for at, (name, f) in enumerate(request.factors.items())}
    return Made(columns, notes=notes)


def _full_levels(request: Request) -> list[Column]:
    """Levels of the factors of a full factorial: as listed, else `levels` of them from low to high, two if omitted."""
    coded = np.linspace(-1, 1, request.table.levels or 2)
    return [
        _decoded(factor, coded) if factor.values is None else column_of(factor, factor.values)
        for factor in request.factors.values()
    ]


def _full_count(request: Request) -> int:
    own = (len(factor.values) if factor.values else request.table.levels or 2 for factor in request.factors.values())
    return math.prod(own)


def _full(request: Request) -> Made:
    from pydoe import fullfact

    levels = _full_levels(request)
    places = fullfact([len(column) for column in levels]).astype(int)
    return Made({name: levels[at][places[:, at]] for at, name in enumerate(request.factors)})


def _fraction(request: Request) -> tuple[FloatArray, int]:
    """The smallest fraction that has the resolution, and the highest resolution with the same number of points."""
    from pydoe import fracfact_by_res

    width, asked = len(request.factors), request.table.resolution or _DEFAULT_RESOLUTION
    if width < 2:
        raise InputError("a fractional-factorial design needs at least two factors")
    try:
        coded, resolution = np.asarray(fracfact_by_res(width, asked), float), asked
    except ValueError as error:
        raise InputError(f"resolution = {asked}: {error}") from error
    with suppress(ValueError):  # of a resolution that no fraction has
        while len(coded) < 2**width and len(better := fracfact_by_res(width, resolution + 1)) == len(coded):
            coded, resolution = np.asarray(better, float), resolution + 1
    return coded, resolution


def _fractional(request: Request) -> Made:
    coded, resolution = _fraction(request)
    if len(coded) == 2 ** len(request.factors):
        kind = "all combinations, since no fraction has the resolution"
    else:
        kind = f"of resolution {_NUMERALS.get(resolution, resolution)}"
    lists = "; ".join(" = ".join(names) for names in aliases(dict(zip(request.factors, coded.T, strict=True))))
    confounded = f"it confounds {lists}" if lists else "no effects of one factor or two are confounded"
    return _decoded_all(request, coded, (f"two-level design of {len(coded):,} points, {kind}; {confounded}",))


def aliases(columns: Mapping[str, FloatArray]) -> list[list[str]]:
    """Effects of one factor or two that a two-level design cannot tell apart.

    Args:
        columns: Coded levels, -1 or 1, of each factor, shape (point,).

    Returns:
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


_CENTRE_POINTS = 1  # repeated ones are computed once, since a simulator gives the same answer again


def _composite_points(request: Request) -> FloatArray:
    from pydoe import ccdesign

    width = len(request.factors)
    if not 2 <= width <= _MOST_FACTORS:
        raise InputError(f"a central-composite design needs 2 to {_MOST_FACTORS} factors, not {width}")
    among_corners_and_stars = (_CENTRE_POINTS, 0)
    coded = ccdesign(width, center=among_corners_and_stars, alpha="rotatable", face=request.table.star)
    return np.asarray(coded, float)


def _box_behnken_points(request: Request) -> FloatArray:
    from pydoe import bbdesign

    if len(request.factors) < 3:
        raise InputError("a box-behnken design needs at least three factors")
    return np.asarray(bbdesign(len(request.factors), _CENTRE_POINTS), float)


def _box_behnken_count(request: Request) -> int:
    return 2 * len(request.factors) * (len(request.factors) - 1) + _CENTRE_POINTS


def _composite_count(request: Request) -> int:
    return int(2 ** len(request.factors)) + 2 * len(request.factors) + _CENTRE_POINTS


FACTORIAL: dict[str, Family] = {
    "full-factorial": Family(_full, _full_count),
    "fractional-factorial": Family(_fractional, lambda request: len(_fraction(request)[0])),
    "plackett-burman": Family(_plackett_burman, lambda request: 4 * (len(request.factors) // 4 + 1)),
    "central-composite": Family(lambda request: _decoded_all(request, _composite_points(request)), _composite_count),
    "box-behnken": Family(lambda request: _decoded_all(request, _box_behnken_points(request)), _box_behnken_count),
}
"""Factorial and response-surface designs by kind."""
