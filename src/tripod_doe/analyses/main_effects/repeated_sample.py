"""Samples that a design repeats at other settings, as a product of a sample and a grid does.

The points of one sample point are not independent: a regression that counts each of them has intervals too narrow by
the square root of their number. Here each sample point counts once.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from tripod_doe.analyses.encoding import Column
from tripod_doe.array_types import FloatArray, IntArray

_COMPLETE = 2 / 3  # share of all combinations that must be there: some points fail


def own_sample(
    columns: Mapping[str, Column], codes: Mapping[str, IntArray], factor: str, response: FloatArray
) -> tuple[dict[str, Column], FloatArray]:
    """The points of the sample to which a factor belongs, each once, with its mean response.

    The mean response at the same setting of all other factors is taken off first, so that a setting that some points
    lack changes little. A design that repeats no sample stays as it is.

    Args:
        columns: Values of all factors that vary, shape (point,) each.
        codes: Numbers of their levels, from 0 on.
        response: Shape (point,).

    Returns:
        The factors of the sample, and the response, at the points of the sample.
    """
    unchanged = dict(columns), response
    if int(codes[factor].max()) + 1 == response.size:  # each point has a value of its own
        return unchanged
    own = varied_together(codes, factor)
    rest = [name for name in codes if name not in own]
    if len(own) == 1 or not rest:
        return unchanged
    at, place = numbered(codes[name] for name in own), numbered(codes[name] for name in rest)
    if not _is_product(at, place):
        return unchanged
    count = np.bincount(at)
    response = response - (np.bincount(place, response) / np.bincount(place))[place] + response.mean()
    first = np.unique(at, return_index=True)[1]
    return {name: columns[name][first] for name in own}, np.bincount(at, response) / count


def one_of_each_block(settings: IntArray) -> IntArray:
    """Rows of points no two of which are joined by steps in single factors, as those of a block of differences are.

    Args:
        settings: Numbers of the settings of all factors but one, shape (point, factor left out); where no column leaves
            out a factor, the points of a block share its value.
    """
    block = np.arange(len(settings))
    while True:
        before = block
        for column in settings.T:
            first = np.full(int(column.max()) + 1, len(settings))
            np.minimum.at(first, column, block)
            block = first[column]
        if (block == before).all():
            return np.unique(block)


def varied_together(codes: Mapping[str, IntArray], factor: str) -> list[str]:
    """The factors that vary together with one: those not combined with all levels of it, and with theirs in turn."""
    group, new = [factor], [factor]
    while new:
        one = codes[new.pop()]
        found = [name for name, other in codes.items() if name not in group and not _is_product(one, other)]
        group, new = [*group, *found], [*new, *found]
    return group


def _is_product(first: IntArray, second: IntArray) -> bool:
    """Whether almost all levels of one are combined with all levels of the other."""
    combinations = (int(first.max()) + 1) * (int(second.max()) + 1)
    return int(numbered([first, second]).max()) + 1 > _COMPLETE * combinations


def numbered(codes: Iterable[IntArray]) -> IntArray:
    """Numbers of the combinations of levels, shape (point,)."""
    number, *others = codes
    for other in others:
        number = np.unique(number * (int(other.max()) + 1) + other, return_inverse=True)[1]
    return np.asarray(number, np.int64)
