"""Wording of the sentence on one factor, or on several alike; `sentences` chooses them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.analyses.main_effects.curve_shape import Shape, extreme_levels, mirror_level
from tripod_doe.analyses.main_effects.main_effects import FactorEffect, Ground
from tripod_doe.analyses.main_effects.regression import Estimate
from tripod_doe.analyses.output_table import without_zero
from tripod_doe.array_types import FloatArray
from tripod_doe.number_text import (
    capital,
    count_of,
    digits_apart,
    interval,
    level,
    number,
    r2_text,
    rounded_up,
    text_range,
    with_unit,
)
from tripod_doe.page_parts.main_results import Response
from tripod_doe.page_parts.words import factor_label, factor_text, factor_unit, listed

_DRIVE = "drive in place of coast"  # what a torque of one size and both signs changes
_ROUNDING = 1e-9  # part of the range of a response that is no effect
_INVISIBLE = 1e-6  # part of the largest value of a response below which a value is written as zero
_STRAIGHT = 0.98  # R^2 above which a line is a fair summary
_EXACT = 0.9999  # R^2 above which no difference from it can be seen
_THROUGH_ZERO = 0.02  # offset of that line over its largest value below which it may be a proportion
_PROPORTIONAL = 0.1  # largest relative difference of a value from a proportion
_OF_VALUE = 2.0  # change in parts of the value there, over that in parts of the range, that is worth a remark
_SIDES = 1.2  # ratio of the values at both signs of a level from which it is stated
_MOST_DIGITS = 6
_MOST_LEVELS = 6  # of a factor with words, whose means a sentence can list
_MANIFOLD = 2.0  # change at a single setting, over the mean change, that is worth a remark
_MOST_UNSEEN = 8  # factors without a visible effect that a sentence names
_MOST_HELD = 3  # values of other factors that a sentence can list


def at_head(cube: xr.Dataset, names: Sequence[str]) -> str:
    """Factors at the head of a sentence; an argument of a user's function keeps its spelling."""
    return _at_head([factor_label(cube, name) for name in names], names)


def _at_head(labels: Sequence[str], names: Sequence[str]) -> str:
    return listed([labels[0] if labels[0] == names[0] else capital(labels[0]), *labels[1:]])


def _only_sign(cube: xr.Dataset, name: str) -> bool:
    """Whether a study has one size of the torque, and both signs of it."""
    levels = np.unique(cube[name].values) if name == "torque_n_m" else np.empty(0)
    return levels.size == 2 and bool(levels[0] == -levels[1])


def _both_signs(effect: FactorEffect) -> bool:
    """Whether a factor has negative and positive values: more of it is then not a larger size of it."""
    return bool(effect.level[0] < 0 < effect.level[-1])


def _is_of_few(effect: FactorEffect) -> bool:
    """Whether most settings of the others have another course than the mean over them, which is then no rule."""
    return effect.shape is not Shape.NONE and effect.ground is Ground.CURVES and 2 * effect.alike < effect.settings


def _about_zero(levels: FloatArray, extreme: FloatArray) -> bool:
    """Whether values of both signs are there, but not zero, and the extreme lies at those next to it."""
    if 0 in levels or not levels[0] < 0 < levels[-1]:
        return False
    return bool(np.isin(extreme, (levels[levels < 0].max(), levels[levels > 0].min())).all())


def _class_ends(effect: FactorEffect, inside: FloatArray) -> FloatArray:
    """The ends of neighbouring classes with these means, halfway to the means of the next ones, shape (2,)."""
    levels = effect.level.astype(float)
    first, last = (int(np.flatnonzero(levels == end)[0]) for end in inside[[0, -1]])
    places = np.log(levels) if effect.logarithmic else levels
    ends = np.array([places[first - 1] + places[first], places[last] + places[last + 1]]) / 2
    return np.exp(ends) if effect.logarithmic else ends


def _digits(effect: FactorEffect, one: float, other: float) -> int:
    """Significant digits that tell two means apart; those of classes to the first digit of their error."""
    digits, size = min(digits_apart(one, other), _MOST_DIGITS), max(abs(one), abs(other))
    if effect.ground is Ground.REGRESSION and size > effect.error > 0:
        digits = max(digits, math.floor(math.log10(size)) - math.floor(math.log10(effect.error)) + 1)
    return min(digits, 15)


def _r2(curve: FloatArray, fitted: FloatArray) -> float:
    """Part of the variation that fitted values explain."""
    scale = np.abs(curve).max()  # squares of numbers such as 1e-200 or 1e200 are no numbers
    curve, fitted = curve / scale, fitted / scale
    return 1 - float(((curve - fitted) ** 2).sum()) / float(((curve - curve.mean()) ** 2).sum())


def _is_proportion(levels: FloatArray, curve: FloatArray, slope: float) -> bool:
    """Whether every value lies nearly on a straight line through zero."""
    line, apart = slope * levels, _THROUGH_ZERO * np.abs(curve).max()
    near = np.where(levels == 0, np.abs(curve) <= apart, np.abs(curve - line) <= _PROPORTIONAL * np.abs(line))
    return bool(near.all())


@dataclass(frozen=True)
class EffectWording:
    """Words for the effects on one response."""

    # response, cube: what is stated, and its cube for the names of the factors
    response: Response
    cube: xr.Dataset
    span: float  # largest less smallest value of the response

    @property
    def name(self) -> str:
        """The response within a sentence."""
        return self.response.label if self.response.key == self.response.label else f"the {self.response.label}"

    @property
    def start(self) -> str:
        """The response at the head of a sentence; the name of a user's variable keeps its spelling."""
        return self.name if self.response.key == self.response.label else capital(self.name)

    def sentence(self, effect: FactorEffect) -> str:
        """One factor that changes the response."""
        if effect.ground is Ground.STEPS:
            return self._steps(effect)
        if effect.ground is Ground.REGRESSION and effect.shape is Shape.NONE:
            return self._trend(effect)
        if not effect.numeric or (effect.level.size == 2 and _both_signs(effect)) or _is_of_few(effect):
            return self._words(effect)
        text = {
            Shape.NONE: self._flat,
            Shape.RISING: self._one_way,
            Shape.FALLING: self._one_way,
            Shape.VALLEY: self._optimum,
            Shape.PEAK: self._optimum,
            Shape.MIXED: self._mixed,
        }[effect.shape](effect)
        return f"{text}{self._against(effect)}{self._alike(effect)}."

    def _against(self, effect: FactorEffect) -> str:
        """How the values at both signs of the outermost level compare, as those of drive and coast."""
        levels, curve = effect.level.astype(float), effect.mean
        if without_zero(self.response.values) or not np.isclose(levels[0], -levels[-1]):
            return ""
        if not curve[[0, -1]].min() > _INVISIBLE * curve.max():
            return ""
        more, less = (0, -1) if curve[0] > curve[-1] else (-1, 0)
        ratio = float(curve[more] / curve[less])
        if ratio < _SIDES or abs(float(curve[more] - curve[less])) <= effect.error:
            return ""
        larger, smaller = (self.at(effect, levels[at].item()) for at in (more, less))
        return f"; at {larger} it is {number(ratio, 2)} times as large as at {smaller}"

    def _signed(self, effect: FactorEffect) -> str:
        """A factor whose value grows or falls, with a note if it can be negative, as the torque of coast can."""
        return factor_label(self.cube, effect.factor) + " (with its sign)" * self._is_signed(effect)

    def _is_signed(self, effect: FactorEffect) -> bool:
        return bool((self.cube[effect.factor].values < 0).any())

    def value(self, value: float, digits: int = 3) -> str:
        """A value of the response with its unit; rounding errors are zero."""
        rounding = _INVISIBLE * float(np.nanmax(np.abs(self.response.values.values)))
        return with_unit(number(0.0 if abs(value) <= rounding else value, digits), self.response.unit)

    def change(self, value: float) -> str:
        """A change of the response with its unit; compared with large values it may be tiny, and is not zero."""
        return with_unit(number(value), self.response.unit)

    def at(self, effect: FactorEffect, value: object) -> str:
        """A level of a factor with its unit; a mean of a class is rounded."""
        if not isinstance(value, int | float):
            return "none" if value == "nan" else str(value)  # a column with open fields
        digits = min(digits_apart(float(effect.level.min()), float(effect.level.max())), _MOST_DIGITS)
        nothing = abs(value) < 10.0**-digits * float(np.abs(effect.level).max())  # the end of a class next to zero
        text = number(0.0 if nothing else value, digits) if effect.ground is Ground.REGRESSION else level(value)
        return with_unit(text, factor_unit(self.cube, effect.factor))

    def where(self, effect: FactorEffect) -> str:
        """How the other factors are treated, with a comma in front; empty if there are none."""
        parts = []
        if effect.averaged:
            several = len(effect.averaged) > 1
            over = "the other factors" if several else factor_label(self.cube, effect.averaged[0])
            parts.append(f"averaged over {over}")
        if effect.held:
            parts.append(self._held(effect))
        if effect.ground is not Ground.REGRESSION and effect.settings < effect.of_settings:
            parts.append(f"over the {effect.settings:,} of {effect.of_settings:,} settings that have all levels")
        if effect.ground is Ground.REGRESSION:
            each = with_unit(number(effect.error, 2), self.response.unit)
            of = f" of {effect.settings:,} independent points" * (effect.settings < effect.of_settings)
            parts.append(f"means of {effect.mean.size} classes{of}, each +- {each}")
        return "".join(f", {part}" for part in parts)

    def _held(self, effect: FactorEffect) -> str:
        if "varied" in self.cube.coords:
            return "others at their base values"
        if len(effect.held) > _MOST_HELD:
            return "each other factor at one value"
        return f"at {listed([factor_text(self.cube, name, held) for name, held in effect.held.items()])}"

    def _alike(self, effect: FactorEffect) -> str:
        """How single settings of the others differ from the mean over them, with semicolons in front."""
        other, text = effect.settings - effect.alike, ""
        if effect.ground is not Ground.CURVES or effect.shape is Shape.NONE:
            return ""
        if other and effect.shape is not Shape.MIXED:
            text = f"; the trend differs at {other:,} of {count_of(effect.settings, 'setting')} of the other factors"
        if effect.largest > _MANIFOLD * effect.rise:
            text += f"; at single settings of the other factors the change reaches {self.change(effect.largest)}"
        return text

    def _one_way(self, effect: FactorEffect) -> str:
        """A rise or a fall: proportional, along a straight line, or by its ends."""
        levels, curve = effect.level.astype(float), effect.mean
        label, own = factor_label(self.cube, effect.factor), factor_unit(self.cube, effect.factor)
        verb = "increases" if effect.shape is Shape.RISING else "decreases"
        slope, offset = np.polyfit(levels, curve, 1)
        through = float(levels @ curve) / float(levels @ levels)
        straight = _r2(curve, slope * levels + offset)
        if straight < _STRAIGHT or levels.size < 3:
            ends = self._at_levels(effect, (0, -1))
            return f"{self.start} {verb} with {self._signed(effect)}, from {ends[0]} to {ends[1]}{self.where(effect)}"
        # "per 1" or "per mm" is far outside the range of a friction or a clearance: say it per 0.01, for instance.
        width = float(np.ptp(levels))
        step = 1.0 if own and width >= 1 else 10.0 ** math.floor(math.log10(width))
        one = own if own and step == 1 else with_unit(number(step), own)
        written = number if effect.ground is Ground.REGRESSION else level
        over = text_range(written(float(levels[0])), written(float(levels[-1])), own) + self.where(effect)
        near_zero = abs(offset) <= _THROUGH_ZERO * float(np.abs(curve).max())
        own_r2 = _r2(curve, through * levels)
        near_zero &= not without_zero(self.response.values)
        proportional = near_zero and own_r2 >= _STRAIGHT and _is_proportion(levels, curve, through)
        r2 = own_r2 if proportional else straight
        exact = r2 > _EXACT
        fit = "R2 of these means" if effect.ground is Ground.REGRESSION else "R2"
        fit += f" {r2_text(r2)}"
        if proportional:
            per = f"{self.change(through * step)} per {one}"
            return f"{self.start} is {'' if exact else 'nearly '}proportional to {label}: {per} ({over}; {fit})"
        per = f"{self.change(abs(slope) * step)} per {one}"
        return f"{self.start} {verb} with {self._signed(effect)} by {per} ({over}; straight line with {fit})"

    def _optimum(self, effect: FactorEffect) -> str:
        levels, curve = effect.level.astype(float), effect.mean
        inside = extreme_levels(levels, curve, effect.shape, effect.error)
        classes = effect.ground is Ground.REGRESSION
        edges = _class_ends(effect, inside) if classes else inside[[0, -1]]
        if effect.shape is Shape.VALLEY:
            if classes and effect.factor in self.response.zero_at and edges[0] < 0 < edges[1]:
                return self._from_zero(effect, ~np.isin(levels, inside))
            if not classes and _about_zero(levels, inside):
                return self._from_zero(effect, np.ones(levels.size, bool))
        best, verb = ("largest", "falls") if effect.shape is Shape.PEAK else ("smallest", "rises")
        spots = list(dict.fromkeys(self.at(effect, end.item()) for end in edges))
        own = factor_unit(self.cube, effect.factor)
        spot = text_range(spots[0].removesuffix(f" {own}"), spots[-1].removesuffix(f" {own}"), own)
        spot = f"in the class{'es' * (inside.size > 1)} {spot}" if classes else f"at {spot}"
        within = curve[(levels >= inside[0]) & (levels <= inside[-1])]
        edge = float(within.min() if effect.shape is Shape.PEAK else within.max())
        digits = max(_digits(effect, edge, float(curve[at])) for at in (0, -1))
        value = " to ".join(dict.fromkeys(self.value(float(end), digits) for end in (within.min(), within.max())))
        label = factor_label(self.cube, effect.factor)
        head = f"Over {label}, {self.name} is {best}, {value}, {spot} and {verb} on both sides"
        middle = mirror_level(levels, curve, effect.error)
        if middle is not None:
            far = f"{self.value(float(curve[[0, -1]].mean()), digits)} at {self.at(effect, levels[0].item())} and "
            far += self.at(effect, levels[-1].item())
            return f"{head}, symmetrically: {far}{self.where(effect)}"
        ends = [f"{self.value(float(curve[at]), digits)} at {self.at(effect, levels[at].item())}" for at in (0, -1)]
        return f"{head}: {ends[0]}, {ends[1]}{self.where(effect)}"

    def _from_zero(self, effect: FactorEffect, aside: NDArray[np.bool_]) -> str:
        """A rise with the size of a factor to both signs, without a value at zero: where it is least is not known.

        Args:
            aside: Which levels lie to one side of zero, shape (level,); a class may hold values of both signs.
        """
        levels, curve = effect.level.astype(float)[aside], effect.mean[aside]
        label = factor_label(self.cube, effect.factor)
        head = f"Over {label}, {self.name} rises on both sides of zero"
        if mirror_level(levels, curve, effect.error) is not None:
            inner = int((levels < 0).sum()) - 1
            means = [float(curve[[at, -1 - at]].mean()) for at in (inner, 0)]
            ends = [
                f"{self.value(mean, _digits(effect, *means))} at {level(levels[at].item())} and "
                f"{self.at(effect, levels[-1 - at].item())}"
                for mean, at in zip(means, (inner, 0), strict=True)
            ]
            return f"{head}, symmetrically: {', '.join(dict.fromkeys(ends))}{self.where(effect)}"
        sides = []
        of_sides = [rows[[0, -1]] for rows in (np.flatnonzero(levels < 0)[::-1], np.flatnonzero(levels > 0))]
        digits = max((_digits(effect, *curve[rows].tolist()) for rows in of_sides if rows[0] != rows[1]), default=3)
        for rows in of_sides:
            text = [f"{self.value(float(curve[at]), digits)} at {self.at(effect, levels[at].item())}" for at in rows]
            sides.append(" to ".join(dict.fromkeys(text)))
        return f"{head}: {', and '.join(sides)}{self.where(effect)}"

    def _mixed(self, effect: FactorEffect) -> str:
        least, most = self._extremes(effect)
        label = factor_label(self.cube, effect.factor)
        return f"Over {label}, {self.name} rises and falls between {least} and {most}{self.where(effect)}"

    def _extremes(self, effect: FactorEffect) -> list[str]:
        """Smallest and largest value of the mean curve, with their levels."""
        return self._at_levels(effect, (int(np.argmin(effect.mean)), int(np.argmax(effect.mean))))

    def _at_levels(self, effect: FactorEffect, ends: tuple[int, int]) -> list[str]:
        """Two values of the mean curve, with their levels."""
        by = "at " if effect.numeric else ""
        digits = _digits(effect, *(float(effect.mean[at]) for at in ends))
        return [
            f"{self.value(float(effect.mean[at]), digits)} ({by}{self.at(effect, effect.level[at].item())})"
            for at in ends
        ]

    def _words(self, effect: FactorEffect) -> str:
        """A factor whose mean curve is no rule: words, one value of each sign, or a course of few settings."""
        if effect.shape is Shape.NONE:
            return f"{self._flat(effect) if effect.rise <= self.rounding else self._means(effect)}."
        least, most = self._extremes(effect)
        label = factor_label(self.cube, effect.factor)
        rest = f"{self._against(effect) if effect.numeric else ''}{self._alike(effect)}"
        return f"Over {label}, {self.name} lies between {least} and {most}{self.where(effect)}{rest}."

    def _means(self, effect: FactorEffect) -> str:
        """Means within the error of one another, which may be known for some of the words only, as for models."""
        if effect.mean.size > _MOST_LEVELS:
            text = " to ".join(self._extremes(effect))
        else:
            values = zip(effect.mean.tolist(), effect.level.tolist(), strict=True)
            text = listed([f"{self.value(mean)} ({self.at(effect, word)})" for mean, word in values])
        return (
            f"Over {factor_label(self.cube, effect.factor)}, the mean of {self.name} is {text}{self.where(effect)}; "
            f"the largest known numerical error is {self.change(effect.error)}"
            + f"; at single settings of the other factors the change reaches {self.change(effect.largest)}"
            * bool(effect.averaged)
        )

    def _flat(self, effect: FactorEffect) -> str:
        """No effect in the mean although single settings change: an interaction."""
        beyond = " beyond its numerical error" * (effect.rise > self.rounding)
        if not effect.averaged:
            label, most = factor_label(self.cube, effect.factor), self.change(effect.largest)
            return (
                f"{self.start} changes with {label} by up to {most}, not beyond its numerical error{self.where(effect)}"
            )
        return (
            f"The mean of {self.name} does not depend on {factor_label(self.cube, effect.factor)}{beyond} ("
            f"{self.where(effect).removeprefix(', ')}), but at single settings of the other factors the change reaches "
            f"{self.change(effect.largest)}"
        )

    def _steps(self, effect: FactorEffect) -> str:
        """The signs of the steps in one factor, unless they rise and fall."""
        label, pairs, by_size = factor_label(self.cube, effect.factor), effect.settings, math.isfinite(effect.outward)
        alone = f"{'the only pair' if pairs == 1 else f'{pairs:,} pairs'} of points that differ in {label} alone"
        alone += ", on one side of zero" * (by_size and not effect.crossing)
        alone += " and have different sizes of it" * (by_size and effect.crossing)
        most = f"by up to {self.change(effect.outward if by_size else effect.largest)}"
        held = f" ({self._held(effect)})" if effect.held else ""
        if not effect.numeric:
            return f"In {alone}{held}, {self.name} changes {most}."
        if effect.rising == effect.falling == 0:
            return f"In {alone}{held}, {self.name} changes {most}, not beyond its numerical error."
        verb, moved = ("increases", effect.rising) if effect.rising else ("decreases", effect.falling)
        every = f"In {'all ' if pairs > 1 else ''}{alone}" if moved == pairs else f"In {moved:,} of {alone}"
        more = f"the size of {label}" if by_size else self._signed(effect)
        rest = "" if moved == pairs else ", and does not change beyond its numerical error in the others"
        return f"{every}{held}, {self.name} {verb} with {more}, {most}{rest}."

    def no_direction(self, effects: list[FactorEffect]) -> str:
        """Factors over which some steps rise and others fall: one sentence, the largest change first."""
        first, *others = sorted(effects, key=lambda effect: -effect.largest)
        steps = f"with a larger value, it increases in {first.rising:,} and decreases in {first.falling:,} of "
        steps += f"{first.settings:,} pairs of points that differ in "
        if not others:
            held = f" ({self._held(first)})" if first.held else ""
            over = f"{self._signed(first)}: {steps}{factor_label(self.cube, first.factor)} alone{held}"
            return f"{self.start} has no single direction over {over}, by up to {self.change(first.largest)}."
        text = [self._briefly(first, f"{steps}this factor alone", ", by up to ")]
        text += [self._briefly(each, f"{each.rising:,}, {each.falling:,} of {each.settings:,}") for each in others]
        return f"{self.start} has no single direction over {listed(text)}."

    def _briefly(self, effect: FactorEffect, steps: str, most: str = "; ") -> str:
        """A factor with its steps in brackets; those of further factors in the order of the first one's words."""
        held = f", {self._held(effect)}" if effect.held else ""
        sign = " with its sign" * self._is_signed(effect)
        return f"{factor_label(self.cube, effect.factor)}{sign} ({steps}{held}{most}{self.change(effect.largest)})"

    def _trend(self, effect: FactorEffect) -> str:
        """A trend, a bend or both from the regression, if there are too few points for a course."""
        assert effect.fit is not None
        trend, bend = effect.fit.trend, effect.fit.bend
        label, text = factor_label(self.cube, effect.factor), []
        if trend.sure:
            verb = "increases" if trend.value > 0 else "decreases"
            text.append(f"{verb} with {self._signed(effect)}, by {self._estimate(trend)} over its range")
        if bend.sure:
            place = "above" if bend.value > 0 else "below"
            scale = " of its logarithmic scale" * effect.logarithmic
            text.append(f"is curved over {label}: the ends lie {self._estimate(bend)} {place} the middle{scale}")
        return (
            f"By regression on all factors, {self.name} {', and '.join(text)} (95 % interval, "
            f"{effect.settings:,} {'independent ' * (effect.settings < effect.of_settings)}points)."
        )

    def _estimate(self, estimate: Estimate) -> str:
        return with_unit(interval(abs(estimate.value), estimate.half), self.response.unit)

    def weak(self, effects: list[FactorEffect]) -> str:
        """Factors that change the response little, or not at all, at every setting of the others."""
        names = [effect.factor for effect in effects]
        changed = [_DRIVE if _only_sign(self.cube, name) else factor_label(self.cube, name) for name in names]
        head = _at_head(changed, names)
        largest, several = max(effect.largest for effect in effects), len(effects) > 1
        if largest <= self.rounding:
            verb = f"{'have' if several else 'has'} no effect on {self.name}"
        else:
            bound = f"{rounded_up(100 * largest / self.span, 1)} % of its range"
            local = max(effect.relative for effect in effects)
            if local > _OF_VALUE * largest / self.span and not without_zero(self.response.values):
                bound += f", and by up to {rounded_up(100 * local, 2)} % of its value there"
            bound += ", not beyond its numerical error" * (largest <= max(effect.error for effect in effects))
            verb = f"{'change' if several else 'changes'} {self.name} by at most {bound}"
        return f"{head} {verb}{self._everywhere(effects)}."

    @property
    def rounding(self) -> float:
        """Up to which change nothing changes."""
        return _ROUNDING * float(np.nanmax(np.abs(self.response.values.values)))

    def _everywhere(self, effects: list[FactorEffect]) -> str:
        """For which settings of the other factors that holds."""
        if "varied" in self.cube.coords:
            return ", others at their base values"
        points = int(np.isfinite(self.response.values.values).sum())
        if all(effect.settings * effect.level.size >= points for effect in effects):  # all settings, without gaps
            return ", at any setting of the other factors that was computed"
        which = "the only two" if all(e.settings == 1 and e.ground is Ground.STEPS for e in effects) else "any two"
        return f" between {which} points that differ in {'one of them' if len(effects) > 1 else 'it'} alone"

    def unseen(self, effects: list[FactorEffect]) -> str:
        """Factors whose effect does not exceed the scatter."""
        most = max(max(effect.fit.trend.most, effect.fit.bend.most) for effect in effects if effect.fit)
        points, scale = effects[0].settings, " (logarithmic scale)"
        labels = [factor_label(self.cube, effect.factor) + scale * effect.logarithmic for effect in effects]
        if most <= _ROUNDING * self.span:
            head = at_head(self.cube, [effect.factor for effect in effects])
            return (
                f"{head} {'have' if len(effects) > 1 else 'has'} no effect on {self.name} at these {points:,} points."
            )
        over = listed(labels) if len(labels) <= _MOST_UNSEEN else f"any of {len(labels)} factors"
        return (
            f"The {points:,} points resolve no trend or curvature of {self.name} over {over} by a regression that "
            "takes interactions for scatter; they do not exclude trends of up to "
            f"{with_unit(rounded_up(most), self.response.unit)}, and other effects."
        )
