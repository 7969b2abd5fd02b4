"""Which region of the factors fails: a small classification tree over the points of a study."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from tripod_doe.analyses.encoding import is_numeric
from tripod_doe.array_types import FloatArray
from tripod_doe.number_text import number
from tripod_doe.page_parts.main_results import asked, finished, point_columns, varies, waiting

_DIGITS = range(4, 18)  # of a threshold: as few as tell the points on both sides apart
_DEPTH = 2  # conditions of a region: more are hard to picture
_FEWEST = 5  # failed points that can show a region
_MOST_FAIL = 0.5  # share of the points of a region that fail
_MOST_LIE = 0.75  # share of the failed points that lie in it
_CHANCE = 1e-5  # largest probability that as many failures lie there by chance: a tree looks at many regions


@dataclass(frozen=True)
class Condition:
    """One side of a threshold of a factor."""

    factor: str  # its name
    above: bool  # whether values above the threshold are meant, else those at or below it
    threshold: float  # between two values that occur

    @property
    def text(self) -> str:
        """As a sentence has it: ``torque_n_m > 80``."""
        return f"{self.factor} {'>' if self.above else '<'} {_written(self.threshold)}"

    def holds(self, columns: Mapping[str, NDArray[np.generic]]) -> NDArray[np.bool_]:
        """Where it holds, shape (point,)."""
        column = np.asarray(columns[self.factor], float)
        return column > self.threshold if self.above else column <= self.threshold


@dataclass(frozen=True)
class FailingRegion:
    """A region in which most failed points lie, and in which most points fail."""

    conditions: tuple[Condition, ...]  # they hold together in it
    # failed, points: failed and all points of the region
    failed: int
    points: int
    all_failed: int  # failed points of the whole study
    # the condition without which the region is left, so that the rest is a box and the factors stay independent
    kept: Condition

    @property
    def text(self) -> str:
        """As a sentence has it, with its numbers."""
        return (
            f"where {_in_words(self.conditions)} ({self.failed:,} of the {self.points:,} points there, "
            f"{self.all_failed - self.failed:,} elsewhere)"
        )

    def attributes(self, outside: int | None) -> dict[str, str | int]:
        """Attributes of a result; where it answers for the rest alone, with the points that lie outside of that."""
        answered = replace(self.kept, above=not self.kept.above).text
        rest = dict[str, str | int](answered_for="the rest", answered_range=answered, points_outside=outside or 0)
        return {"failing_region": self.text, **({"answered_for": "all"} if outside is None else rest)}

    def outside(self, columns: Mapping[str, NDArray[np.generic]]) -> NDArray[np.bool_]:
        """Points of the largest box outside of the region, shape (point,)."""
        return ~self.kept.holds(columns)


def _written(threshold: float) -> str:
    return number(threshold, next(digits for digits in _DIGITS if float(f"{threshold:.{digits}g}") == threshold))


def _in_words(conditions: tuple[Condition, ...]) -> str:
    """Conditions as a sentence has them; both sides of one factor as ``0.15 < joint_angle_deg < 2.65``."""
    texts: dict[str, str] = {}
    for factor in dict.fromkeys(condition.factor for condition in conditions):
        own = [condition for condition in conditions if condition.factor == factor]
        below = [_written(condition.threshold) for condition in own if condition.above]
        texts[factor] = own[0].text
        if len(own) == 2 and len(below) == 1:
            above = next(_written(condition.threshold) for condition in own if not condition.above)
            texts[factor] = f"{below[0]} < {factor} < {above}"
        elif len(own) == 2:  # two on one side: the narrower one
            texts[factor] = (max if own[0].above else min)(own, key=lambda condition: condition.threshold).text
    return " and ".join(texts.values())


def failing_region(columns: Mapping[str, NDArray[np.generic]], failed: NDArray[np.bool_]) -> FailingRegion | None:
    """The failing region; None if the failed points do not lie together.

    Args:
        columns: Values of the factors, shape (point,) each; words are left out.
    """
    numeric = {name: np.asarray(column, float) for name, column in columns.items() if is_numeric(column)}
    total = int(failed.sum())
    if total < _FEWEST or total == failed.size or not numeric:
        return None
    from scipy.stats import hypergeom  # slow to import, and most studies have no failures
    from sklearn.tree import DecisionTreeClassifier

    levels = {name: np.unique(column, return_inverse=True) for name, column in numeric.items()}
    matrix = np.stack([code for _, code in levels.values()], axis=1)  # a tree compares in single precision
    tree = DecisionTreeClassifier(max_depth=_DEPTH, class_weight="balanced", min_samples_leaf=_FEWEST, random_state=0)
    leaves = tree.fit(matrix, failed).apply(matrix)
    counts = {int(leaf): int(failed[leaves == leaf].sum()) for leaf in np.unique(leaves)}
    leaf = max(counts, key=lambda each: counts[each])
    points = int((leaves == leaf).sum())
    if counts[leaf] < _MOST_LIE * total or counts[leaf] < _MOST_FAIL * points:
        return None
    if hypergeom.sf(counts[leaf] - 1, failed.size, total, points) > _CHANCE:
        return None
    conditions = _conditions(tree.tree_, leaf, {name: values for name, (values, _) in levels.items()})
    kept = max(conditions, key=lambda each: int((~each.holds(columns)).sum()))
    return FailingRegion(conditions, counts[leaf], points, total, kept)


def failing_region_of(cube: xr.Dataset) -> FailingRegion | None:
    """The region of a study that contains most of its failed points; None if they do not lie together."""
    rows = asked(cube).values & ~waiting(cube).values
    columns = {name: column for name, column in point_columns(cube, rows).items() if varies(column)}
    return failing_region(columns, ~finished(cube).values[rows])


def _between(low: float, high: float) -> float:
    """A number with few digits from one value to the next one, not that one itself."""
    middle = (low + high) / 2
    rounded = (float(f"{middle:.{digits}g}") for digits in _DIGITS)
    return next((each for each in rounded if low < each < high), low)


def _conditions(tree: object, leaf: int, levels: Mapping[str, FloatArray]) -> tuple[Condition, ...]:
    """The conditions on the way from the root of a tree over numbers of levels to one of its leaves."""
    names = list(levels)
    left, right = getattr(tree, "children_left"), getattr(tree, "children_right")  # noqa: B009
    feature, threshold = getattr(tree, "feature"), getattr(tree, "threshold")  # noqa: B009
    conditions: list[Condition] = []
    node = leaf
    while node != 0:
        above = node in right
        node = int(np.flatnonzero((right if above else left) == node)[0])
        name, at = names[feature[node]], int(threshold[node])
        conditions.append(Condition(name, bool(above), _between(*levels[name][at : at + 2].tolist())))
    return tuple(reversed(conditions))
