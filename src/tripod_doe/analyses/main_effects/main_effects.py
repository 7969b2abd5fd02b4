"""Effect of each factor on a response, as far as the points of the design separate it.

A statement on one factor rests on one of three grounds, tried in this order; they follow from the columns of the
points that finished, whatever the design was called.

1. *All levels at one setting of the others* (grids, one factor at a time, their products): only this factor changes,
   and the mean over such settings compares like with like. Holes do not matter as long as half of the points that can
   be compared are at settings without them.
2. *Steps in one factor alone* (trajectories, Saltelli's pairs, star points, grids with many holes): the sign of each
   step is a fact; this needs at least half as many steps per factor as a design would have that changes one factor at
   a time in turn.
3. *Regression on all factors* (random samples, fractional designs): stands only where the column of the factor is not
   explained by the columns of the others, see `additive_fit.separation`, and only as far as its interval allows.

Where none holds, as for lists of points in which factors change together, the design does not separate the factor.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from tripod_doe.analyses.encoding import Column, is_numeric
from tripod_doe.analyses.main_effects.curve_shape import Shape, curve_shapes
from tripod_doe.analyses.main_effects.regression import Fit, Separation, fit_factor, separation
from tripod_doe.analyses.main_effects.repeated_sample import one_of_each_block, own_sample
from tripod_doe.array_types import FloatArray, IntArray
from tripod_doe.process.one_thread import one_thread


def setting_of_others(codes: IntArray) -> IntArray:
    """For each factor, which points share the levels of all the others.

    Args:
        codes: Number of the level, shape (point, factor).

    Returns:
        Number of the setting of the other factors, same shape. From sums of random 64-bit keys, one per level, so that
        a million points take no sorting of rows; two settings share a sum with a probability below 1e-7.
    """
    random = np.random.default_rng(0)
    keys = np.empty(codes.shape, np.uint64)
    for factor in range(codes.shape[1]):
        words = random.integers(0, 2**64 - 1, int(codes[:, factor].max(initial=0)) + 1, np.uint64)
        keys[:, factor] = words[codes[:, factor]]
    others = keys.sum(axis=1, dtype=np.uint64)[:, None] - keys  # modulo 2^64
    settings = [np.unique(column, return_inverse=True)[1] for column in others.T]
    return np.stack(settings, axis=1).astype(np.int64)


@dataclass(frozen=True)
class Comparison:
    """A response at points that differ in one factor alone."""

    # response at every level, shape (setting of the others, level), of those settings at which there are all levels
    curves: FloatArray
    whole: IntArray  # numbers of these settings
    several: IntArray  # numbers of the settings at which there are at least two levels
    steps: FloatArray  # changes from each level to the next one that there is, over all settings, shape (pair,)
    ends: IntArray  # numbers of these two levels, shape (pair, 2)
    largest: float  # largest change at one setting; 0 if no two points can be compared
    # the largest change over the value there, of settings where the response is not nearly zero
    relative: float


def compare_settings(setting: IntArray, code: IntArray, response: FloatArray) -> Comparison:
    """Compare the points that share the setting of all other factors.

    Args:
        setting, code: Setting of the other factors, and level of this one, in ascending order; shape (point,).
        response: Finite values, shape (point,). Repeated points are averaged.
    """
    levels = int(code.max()) + 1
    cells, inverse = np.unique(setting * levels + code, return_inverse=True)
    mean = np.bincount(inverse, response) / np.bincount(inverse)
    owner, start, count = np.unique(cells // levels, return_index=True, return_counts=True)
    whole, several = count == levels, count > 1
    rows = start[whole][:, None] + np.arange(levels)
    same = np.diff(cells // levels) == 0
    high, low = np.maximum.reduceat(mean, start), np.minimum.reduceat(mean, start)
    spread, size = high - low, np.maximum(np.abs(high), np.abs(low))
    seen = size > _NEARLY_ZERO * size.max(initial=0.0)
    return Comparison(
        curves=mean[rows] if levels > 1 else np.empty((0, 1)),
        whole=owner[whole & several],
        several=owner[several],
        steps=np.diff(mean)[same],
        ends=np.stack([cells[:-1], cells[1:]], axis=1)[same] % levels,
        largest=float(spread.max()),
        relative=float((spread[seen] / size[seen]).max(initial=0.0)),
    )


_MOST_ROWS = 4096  # points of a regression: more would narrow its intervals beyond any use
_NEARLY_ZERO = 1e-3  # part of the largest value below which a change is not compared with the value itself
_SMALL = 0.02  # part of its range up to which a step, as of finite differences, says nothing of a factor's effect
_ROUNDING = 1e-9  # part of the largest value within which two values are the same


class Ground(Enum):
    """On what a statement about a factor stands."""

    CURVES = "all levels at one setting of the others"
    STEPS = "steps in this factor alone"
    REGRESSION = "regression on all factors"
    NOT_SEPARATED = "the design does not separate the factor"


@dataclass(frozen=True)
class FactorEffect:
    """The effect of one factor on a response."""

    factor: str  # its name
    numeric: bool  # whether its levels are numbers
    ground: Ground  # on what the rest stands
    shape: Shape = Shape.NONE  # course of the mean curve; NONE if there is no curve
    # level, mean: the curve: levels in ascending order (words in any order), and the mean response over the settings of
    # the others, or over classes. Empty where there is none.
    level: Column = field(default_factory=lambda: np.empty(0))
    mean: FloatArray = field(default_factory=lambda: np.empty(0))
    error: float = 0.0  # difference up to which two values of the curve count as equal
    # largest, relative: largest change at one setting of the others, and over the value there; NaN for a regression
    largest: float = np.nan
    relative: float = np.nan
    # settings, of_settings: settings of the others that were used, and at which there are at least two levels. For
    # steps: pairs. For a regression: independent points, and all of them.
    settings: int = 0
    of_settings: int = 0
    alike: int = 0  # settings at which the course agrees with the mean
    # rising, falling: steps with a rise or a fall beyond the error
    rising: int = 0
    falling: int = 0
    # outward, crossing: of a factor of both signs over which the response rises and falls, but in one direction with
    # the size of the factor: the largest such step, and whether that holds across zero, too, or on each side alone.
    # Only those steps are then counted. NaN for all other factors.
    outward: float = np.nan
    crossing: bool = False
    # averaged, held: other factors over which the settings differ, and those that keep one value at all of them
    # although they vary elsewhere in the design
    averaged: tuple[str, ...] = ()
    held: Mapping[str, object] = field(default_factory=dict)
    fit: Fit | None = None  # the regression, if the effect is based on it
    logarithmic: bool = False  # whether that is over its logarithm
    # why the design does not separate the factor
    separation: Separation = field(default_factory=lambda: Separation(True))

    @property
    def rise(self) -> float:
        """Largest less smallest mean; the trend of a regression without classes."""
        if self.mean.size:
            return float(np.ptp(self.mean))
        return max(abs(self.fit.trend.value), abs(self.fit.bend.value)) if self.fit else 0.0

    @property
    def both_ways(self) -> bool:
        """Whether some steps in a number rise and others fall."""
        return self.ground is Ground.STEPS and self.numeric and min(self.rising, self.falling) > 0


def factor_effects(
    columns: Mapping[str, Column], response: FloatArray, error: float = 0.0, logarithmic: Collection[str] = ()
) -> list[FactorEffect]:
    """The effect of each factor that varies, on the best ground that the points give.

    Args:
        columns: Values of the factors at the points that finished, shape (point,) each: numbers or words.
        response: Finite values, shape (point,).
        error: Difference up to which two values are equal within their numerical error; at least rounding is assumed.
        logarithmic: Factors with a logarithmic scale, all above 0: regressions are over their logarithms.
    """
    levels = {name: np.unique(column, return_inverse=True) for name, column in columns.items()}
    varying = {name: columns[name] for name, (distinct, _) in levels.items() if distinct.size > 1}
    if not varying:
        return []
    error = max(error, _ROUNDING * float(np.abs(response).max()))
    codes = np.stack([levels[name][1] for name in varying], axis=1).astype(np.int64)
    settings, own_codes = setting_of_others(codes), dict(zip(varying, codes.T, strict=True))
    on_scale = {name: np.log(column) if name in logarithmic else column for name, column in varying.items()}
    effects = []
    for at, name in enumerate(varying):
        compared = compare_settings(settings[:, at], codes[:, at], response)
        ground = _ground(compared, settings[:, at], len(varying))
        if ground is Ground.STEPS and is_numeric(varying[name]):
            steps = np.ptp(levels[name][0].astype(float)[compared.ends], axis=1)
            if steps.max() <= _SMALL * np.ptp(levels[name][0]):
                continue
        if ground is Ground.CURVES:
            effects.append(_by_curves(name, varying, levels[name][0], compared, settings[:, at], error))
        elif ground is Ground.STEPS:
            effects.append(_by_steps(name, varying, levels[name][0], compared, settings[:, at], error))
        else:
            with one_thread():
                rows = one_of_each_block(np.delete(settings, at, axis=1))
                effect = _by_regression(name, on_scale, own_codes, response, error, rows)
            log = name in logarithmic
            effects.append(replace(effect, level=np.exp(effect.level), logarithmic=True) if log else effect)
    return effects


def _ground(compared: Comparison, setting: IntArray, factors: int) -> Ground:
    """The strongest ground that the points give, see the head of this module."""
    comparable = int(np.isin(setting, compared.several).sum())
    if compared.whole.size and 2 * int(np.isin(setting, compared.whole).sum()) >= comparable:
        return Ground.CURVES
    enough = 2 * (factors + 1) * compared.steps.size >= setting.size
    return Ground.STEPS if compared.steps.size and enough else Ground.REGRESSION


def _surroundings(
    name: str, columns: Mapping[str, Column], rows: NDArray[np.bool_]
) -> tuple[tuple[str, ...], dict[str, object]]:
    """The other factors that vary over these points, and those that do not, with their value."""
    distinct = {other: np.unique(column[rows]) for other, column in columns.items() if other != name}
    averaged = tuple(other for other, values in distinct.items() if values.size > 1)
    return averaged, {other: values[0].item() for other, values in distinct.items() if values.size == 1}


def _by_curves(
    name: str, columns: Mapping[str, Column], levels: Column, compared: Comparison, setting: IntArray, error: float
) -> FactorEffect:
    averaged, held = _surroundings(name, columns, np.isin(setting, compared.whole))
    mean = compared.curves.mean(axis=0)
    shape = Shape(int(curve_shapes(mean[None], error)[0]))
    return FactorEffect(
        name,
        is_numeric(columns[name]),
        Ground.CURVES,
        shape,
        levels,
        mean,
        error,
        compared.largest,
        compared.relative,
        compared.whole.size,
        compared.several.size,
        int((curve_shapes(compared.curves, error) == shape).sum()),
        averaged=averaged,
        held=held,
    )


def _by_steps(
    name: str, columns: Mapping[str, Column], levels: Column, compared: Comparison, setting: IntArray, error: float
) -> FactorEffect:
    averaged, held = _surroundings(name, columns, np.isin(setting, compared.several))
    numeric, steps, outward, crossing = is_numeric(columns[name]), compared.steps, np.nan, False
    if numeric and levels[0] < 0 < levels[-1] and min((steps > error).sum(), (steps < -error).sum()) > 0:
        for any_side in (True, False):
            by_size = _outward_steps(levels.astype(float)[compared.ends], steps, any_side)
            up, down = int((by_size > error).sum()), int((by_size < -error).sum())
            if min(up, down) == 0 < max(up, down) and 2 * by_size.size >= compared.steps.size:  # few pairs are no rule
                steps, outward, crossing = by_size, float(np.abs(by_size).max()), any_side
                break
    return FactorEffect(
        name,
        numeric,
        Ground.STEPS,
        error=error,
        largest=compared.largest,
        relative=compared.relative,
        settings=steps.size,
        of_settings=steps.size,
        rising=int((steps > error).sum()),
        falling=int((steps < -error).sum()),
        averaged=averaged,
        held=held,
        outward=outward,
        crossing=crossing,
    )


def _outward_steps(ends: FloatArray, steps: FloatArray, any_side: bool) -> FloatArray:
    """The steps between two values of different size, as changes away from zero.

    Args:
        ends: Values of the factor, shape (pair, 2).
        any_side: Whether steps across zero are among them; else those between values of one sign, or zero, alone.
    """
    further = np.sign(np.diff(np.abs(ends), axis=1)[:, 0])
    one_side = (ends >= 0).all(axis=1) | (ends <= 0).all(axis=1)
    rows = (further != 0) & (one_side | any_side)
    return steps[rows] * further[rows]


def _by_regression(
    name: str,
    columns: Mapping[str, Column],
    codes: Mapping[str, IntArray],
    response: FloatArray,
    error: float,
    independent: IntArray,
) -> FactorEffect:
    """Fit where the columns separate the factor; words and single points are left to the other grounds."""
    others, points = tuple(other for other in columns if other != name), response.size
    columns, response = own_sample(columns, codes, name, response)
    if response.size == points:
        columns, response = {other: column[independent] for other, column in columns.items()}, response[independent]
    rows = np.random.default_rng(0).permutation(response.size)[:_MOST_ROWS]
    numeric, response = is_numeric(columns[name]), response[rows]
    columns = {other: column[rows] for other, column in columns.items() if np.unique(column[rows]).size > 1}
    separated = separation(columns, name) if name in columns else Separation(False, too_few=True)
    if not (numeric and separated.separated):
        return FactorEffect(name, numeric, Ground.NOT_SEPARATED, separation=separated)
    fit = fit_factor(columns, name, response, error)
    error = max(error, fit.error)
    shape = Shape(int(curve_shapes(fit.mean[None], error)[0])) if fit.mean.size else Shape.NONE
    return FactorEffect(
        name,
        True,
        Ground.REGRESSION,
        shape,
        fit.level,
        fit.mean,
        error,
        settings=response.size,
        of_settings=min(points, _MOST_ROWS),
        averaged=others,
        fit=fit,
    )
