"""Sentences on the effect of each factor: only what its points support, see `analyses.main_effects.main_effects`."""

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
import xarray as xr

from tripod_doe.analyses.main_effects.curve_shape import Shape
from tripod_doe.analyses.main_effects.main_effects import FactorEffect, Ground, factor_effects
from tripod_doe.analyses.main_effects.regression import Separation
from tripod_doe.analyses.main_effects.wording import EffectWording, at_head
from tripod_doe.page_parts.main_results import Response, logarithmic_factors, point_columns
from tripod_doe.page_parts.words import factor_label, listed

_MINOR = 0.05  # change over the range of the response below which a factor shares one sentence with others


def effects_on(response: Response, cube: xr.Dataset) -> list[FactorEffect]:
    """The effects of all factors that vary over the points with a number."""
    rows = np.isfinite(response.values.values)
    values = response.values.values[rows].astype(float)
    return factor_effects(point_columns(cube, rows), values, response.error, logarithmic_factors(cube))


def find_effects(response: Response, cube: xr.Dataset, effects: Sequence[FactorEffect]) -> Iterator[str]:
    """Yield one sentence per factor that changes the response, then those on several of them.

    Several factors share one sentence where they have no single direction, little effect or none.

    A factor has little effect only where no change at any setting of the others is large: one whose mean is flat while
    single settings differ is stated with its interactions.
    """
    values = response.values.values
    span = float(np.nanmax(values) - np.nanmin(values))
    wording = EffectWording(response, cube, span)
    separated = [effect for effect in effects if effect.ground is not Ground.NOT_SEPARATED]
    weak = [effect for effect in separated if effect.largest <= _MINOR * span]
    unseen = [effect for effect in separated if effect.ground is Ground.REGRESSION and not _is_seen(effect)]
    strong = [effect for effect in separated if effect not in weak and effect not in unseen]
    mixed = [effect for effect in strong if effect.both_ways]
    for effect in sorted(strong, key=lambda effect: -effect.rise):
        if effect not in mixed:
            yield wording.sentence(effect)
    if mixed:
        yield wording.no_direction(mixed)
    for group in (True, False):  # those without any effect are not among those with a small one
        if alike := [effect for effect in weak if (effect.largest > wording.rounding) is group]:
            yield wording.weak(alike)
    if unseen:
        yield wording.unseen(unseen)


def _is_seen(effect: FactorEffect) -> bool:
    """Whether a regression shows an effect above its interval: a course over classes, or else a trend."""
    return effect.shape is not Shape.NONE or (
        effect.fit is not None and (effect.fit.trend.sure or effect.fit.bend.sure)
    )


def unseparated(cube: xr.Dataset, effects: Iterable[FactorEffect]) -> list[str]:
    """State which factors the design does not separate, and why."""
    lost = {effect.factor: effect.separation for effect in effects if effect.ground is Ground.NOT_SEPARATED}
    groups = _tied_groups(lost)
    sentences = [_tied_sentence(cube, names, [name for name in names if name in lost]) for names in groups]
    left = {name: answers for name, answers in lost.items() if not any(name in group for group in groups)}
    for name, answers in left.items():
        if answers.interaction:
            product = listed([factor_label(cube, other) for other in answers.tied_to])
            sentences.append(
                f"This design does not separate the effect of {factor_label(cube, name)} from the interaction of "
                f"{product}."
            )
    if few := [factor_label(cube, name) for name, answers in left.items() if answers.too_few]:
        own = "effects" if len(few) > 1 else "effect"  # means of groups may still be compared, as in factorial designs
        sentences.append(
            f"There are too few points for a regression on all factors, which would give the {own} of {listed(few)}."
        )
    reasons = {
        "the factors vary mostly together": [
            name for name, answers in left.items() if not (answers.separated or answers.too_few or answers.interaction)
        ],
        "no two points differ in one factor alone": [name for name, answers in left.items() if answers.separated],
    }
    for why, names in reasons.items():
        if names:
            labels = listed([factor_label(cube, name) for name in names])
            own = "effects" if len(names) > 1 else "effect"
            sentences.append(
                f"This design does not separate the {own} of {labels} from the effects of other factors: {why}."
            )
    return sentences


def _tied_sentence(cube: xr.Dataset, names: list[str], lost: list[str]) -> str:
    """Factors that change together; of some of them there may be points that differ in them alone."""
    if len(lost) == len(names):
        return f"{at_head(cube, names)} change together in this design, which does not separate their effects."
    others = listed([factor_label(cube, name) for name in names if name not in lost])
    labels = listed([factor_label(cube, name) for name in lost])
    return f"This design does not separate the effects of {labels} and {others}: they change together."


def _tied_groups(lost: Mapping[str, Separation]) -> list[list[str]]:
    """Factors that change together, in groups, each named once."""
    groups: list[list[str]] = []
    for name, why in lost.items():
        if why.tied_to and not why.interaction:
            members = [name, *why.tied_to]
            joined = [group for group in groups if set(group) & set(members)]
            groups = [group for group in groups if group not in joined]
            groups.append(list(dict.fromkeys(each for group in [*joined, members] for each in group)))
    return groups
