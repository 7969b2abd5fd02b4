"""Every sentence on a factor is true: random designs of all kinds, responses whose truth is known, each sentence checked.

Sentences on points (steps, ranges, curves over grids) are checked against the points by brute force; those of a
regression against the response itself, by its mean over the ranges of the other factors.
"""

from __future__ import annotations

import itertools
import re

import numpy as np
import pytest
import xarray as xr
from SALib.sample import fast_sampler, morris, sobol
from scipy.stats import qmc

from tripod_doe.analyses.findings import find
from tripod_doe.model_interface import Outcome
from tripod_doe.page_parts.words import listed

NAMES = ("x1", "x2", "x3")
PROBLEM = {"num_vars": 3, "names": list(NAMES), "bounds": [[-1, 1]] * 3}


def noise(*x):
    return np.sin(1e4 * sum((i + 1.7) * each for i, each in enumerate(x))) % 0.37


RESPONSES = {
    "linear": lambda a, b, c: 3 * a - b + 0 * c,
    "negative": lambda a, b, c: -10 + a - 2 * b + 0 * c,
    "crossing": lambda a, b, c: 2 * a + 0 * b + 0 * c,
    "vee": lambda a, b, c: np.abs(a) + 0.3 * b + 0 * c,
    "lopsided vee": lambda a, b, c: np.abs(a - 0.4) + 0 * b + 0 * c,
    "optimum": lambda a, b, c: -((a - 0.2) ** 2) + 0.1 * b + 0 * c,
    "interaction": lambda a, b, c: a * b + 0 * c,
    "triple": lambda a, b, c: a * b * c,
    "none": lambda a, b, c: 7 + 0 * a + 0 * b + 0 * c,
    "noise": noise,
    "noisy": lambda a, b, c: a + noise(a, b, c),
    "ishigami": lambda a, b, c: np.sin(3 * a) + 7 * np.sin(3 * b) ** 2 + 8 * c**4 * np.sin(3 * a),
    "waves": lambda a, b, c: np.sin(9 * a) + 0.2 * c + 0 * b,
    "steep": lambda a, b, c: np.exp(4 * a) * (1.5 + b) + 0 * c,
}


def unit_points(kind: str, seed: int) -> np.ndarray:
    """Points of a design over -1 .. 1, shape (point, 3)."""
    random = np.random.default_rng(seed)
    count = int(random.integers(5, 260))
    grid = [np.unique(random.choice(np.linspace(-1, 1, 9), int(random.integers(1, 6)))) for _ in range(3)]
    corners = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    match kind:
        case "grid":
            return np.array(list(itertools.product(*grid)))
        case "full-factorial":
            return corners
        case "fractional-factorial":
            return corners[corners.prod(axis=1) > 0]
        case "plackett-burman":
            row = np.array([1, 1, -1, 1, 1, 1, -1, -1, -1, 1, -1.0])
            return np.array([*(np.roll(row, k) for k in range(11)), -np.ones(11)])[:, random.permutation(11)[:3]]
        case "central-composite":
            return np.concatenate([corners / 1.5, np.eye(3), -np.eye(3), np.zeros((3, 3))])
        case "box-behnken":
            edges = np.array([row for row in itertools.product((-1, 0, 1), repeat=3) if np.abs(row).sum() == 2], float)
            return np.concatenate([edges, np.zeros((3, 3))])
        case "one-at-a-time":
            base = random.choice(np.linspace(-1, 1, 9), 3)
            rows = [base] + [np.where(np.arange(3) == at, v, base) for at in range(3) for v in grid[at]]
            return np.array(rows)
        case "one-at-a-time x grid":
            base = random.choice(np.linspace(-1, 1, 9), 2)
            rows = [base] + [np.where(np.arange(2) == at, v, base) for at in range(2) for v in grid[at]]
            return np.array([[*row, c] for row in rows for c in grid[2]])
        case "zip":
            return np.sort(random.uniform(-1, 1, (int(random.integers(2, 20)), 3)), axis=0) * random.choice((-1, 1), 3)
        case "table":
            return random.choice(np.linspace(-1, 1, 4), (min(count, 40), 3))
        case "latin-hypercube":
            return 2 * qmc.LatinHypercube(3, rng=seed).random(count) - 1
        case "sobol":
            return 2 * qmc.Sobol(3, rng=seed).random(128) - 1
        case "halton":
            return 2 * qmc.Halton(3, rng=seed).random(count) - 1
        case "saltelli":
            return sobol.sample(PROBLEM, 2 ** int(random.integers(2, 6)), seed=seed)
        case "morris":
            return morris.sample(PROBLEM, int(random.integers(2, 12)), seed=seed)
        case "fast":
            return fast_sampler.sample(PROBLEM, 100, seed=seed)
        case "one point":
            return random.uniform(-1, 1, (1, 3))
        case "constant factor":
            return np.where(np.arange(3) == 2, 0.5, 2 * qmc.LatinHypercube(3, rng=seed).random(count) - 1)
        case "correlated":
            first = random.uniform(-1, 1, (count, 1))
            return np.clip(first + random.normal(0, random.choice((0.05, 0.3, 1)), (count, 3)), -1, 1)
        case "parabola":  # x2 follows from x1 without being correlated with it
            a = np.linspace(-1, 1, 21)
            return np.column_stack([a, 2 * a**2 - 1, random.permutation(a)])
    raise AssertionError(kind)


CUBE = qmc.Sobol(3, rng=0).random(1024)
"""Points over which means are taken."""

KINDS = (
    "grid",
    "full-factorial",
    "fractional-factorial",
    "plackett-burman",
    "central-composite",
    "box-behnken",
    "one-at-a-time",
    "one-at-a-time x grid",
    "zip",
    "table",
    "latin-hypercube",
    "sobol",
    "halton",
    "saltelli",
    "morris",
    "fast",
    "one point",
    "constant factor",
    "correlated",
    "parabola",
)


TOLD = {
    "grid": "curve",
    "full-factorial": "curve",
    "fractional-factorial": "unknown",
    "plackett-burman": "unknown",
    "central-composite": "steps",
    "one-at-a-time": "curve",
    "one-at-a-time x grid": "curve",
    "zip": "unknown",
    "latin-hypercube": "regression",
    "sobol": "regression",
    "halton": "regression",
    "saltelli": "steps",
    "morris": "steps",
    "fast": "regression",
    "one point": "same",
    "parabola": "unknown",
}
"""What is stated of some kinds, so that silence does not pass for truth."""


def cube_of(points: np.ndarray, response: np.ndarray) -> xr.Dataset:
    outcome = np.where(np.isfinite(response), Outcome.FINISHED, Outcome.DIVERGED)
    marks = {"source": "user function", "units": "1"}
    own = {"units": "1", "long_name": "output of a user function"}
    return xr.Dataset(
        {"y": ("point", response, own), "outcome": ("point", outcome)},
        coords={name: ("point", column, marks) for name, column in zip(NAMES, points.T, strict=True)},
    )


class Truth:
    """What is true of a response over a design."""

    def __init__(self, points: np.ndarray, values: np.ndarray, function) -> None:
        finished = np.isfinite(values)
        self.points, self.values, self.function = points[finished], values[finished], function
        self.every, self.failed_or_not = points, ~finished

    def groups(self, at: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Levels and responses of the points that share all other factors, repeated points once."""
        found: dict[tuple, dict[float, float]] = {}
        for row, value in zip(self.points, self.values, strict=True):
            found.setdefault(tuple(np.delete(row, at)), {})[row[at]] = value
        return [
            (np.array(sorted(group)), np.array([group[x] for x in sorted(group)]))
            for group in found.values()
            if len(group) > 1
        ]

    def shared(self, at: int, other: int) -> np.ndarray:
        """Values of another factor at the points that `groups` compares."""
        settings, which = np.unique(np.delete(self.points, at, axis=1), axis=0, return_inverse=True)
        several = [np.unique(self.points[which.ravel() == row, at]).size > 1 for row in range(len(settings))]
        return np.unique(settings[several, other - (other > at)])

    def mean_curve(self, at: int) -> np.ndarray:
        """Mean over the settings of the other factors at which all levels are, shape (level,)."""
        levels = np.unique(self.points[:, at])
        return np.mean([values for group, values in self.groups(at) if group.size == levels.size], axis=0)

    def population_mean(self, at: int, level: float) -> float:
        """Mean of the response over the ranges of the other factors that the design fills, at one level."""
        low, high = self.points.min(axis=0), self.points.max(axis=0)
        rows = low + (high - low) * CUBE
        rows[:, at] = level
        return float(self.function(*rows.T).mean())

    def largest_change(self, at: int) -> float:
        return max((np.ptp(values) for _, values in self.groups(at)), default=0.0)

    @property
    def span(self) -> float:
        return float(np.ptp(self.values))


def number_after(text: str, sentence: str) -> float:
    return float(re.search(text + r"(-?[\d.,]*\d(?:e-?\d+)?)", sentence)[1].replace(",", ""))


def check_curve(sentence: str, truth: Truth, at: int) -> None:
    """A sentence on the course over one factor."""
    if "classes" in sentence or "regression" in sentence:
        check_regression(sentence, truth, at)
        return
    curve = truth.mean_curve(at)
    step, small = np.diff(curve), 2e-9 * np.abs(truth.values).max()
    if against := re.search(rf"; at ({NUMBER}) it is ({NUMBER}) times as large as at ({NUMBER})", sentence):
        levels = np.unique(truth.points[np.isfinite(truth.values), at])
        more, times, less = map(float, against.groups())
        assert (more, less) in ((levels[0], levels[-1]), (levels[-1], levels[0]))
        assert curve[levels == more] / curve[levels == less] == pytest.approx(times, rel=0.06)
    others = re.search(r"the trend differs at (\d+) of (\d+) settings", sentence)
    if others and "lies between" not in sentence:  # a rule is that of most settings
        assert 2 * int(others[1]) <= int(others[2])
    if slope := re.search(rf"proportional to \w+: ({NUMBER})", sentence):
        line = float(slope[1]) * np.unique(truth.points[np.isfinite(truth.values), at])
        assert (np.abs(curve - line) <= 0.11 * np.abs(line) + 0.021 * np.abs(curve).max() * (line == 0)).all()
    if re.search(r"increases|(?<!-)\bproportional to \w+: (?!-)", sentence):
        assert (step >= -small).all()
    elif re.search(r"decreases|proportional to \w+: -", sentence):
        assert (step <= small).all()
    elif "both sides of zero" in sentence:
        levels = np.unique(truth.points[np.isfinite(truth.values), at])
        assert levels[0] < 0 < levels[-1]
        assert 0 not in levels
        assert (step[levels[1:] < 0] <= small).all()
        assert (step[levels[:-1] > 0] >= -small).all()
        assert ("symmetrically" in sentence) <= np.allclose(curve, curve[::-1], atol=0.0101 * np.ptp(curve))
        for value, level in re.findall(r"([\d.e-]+) at (-?[\d.e-]+\d)", sentence):
            assert curve[np.isclose(levels, float(level))] == pytest.approx(float(value), rel=2e-2, abs=1e-8)
    elif "smallest" in sentence or "largest" in sentence:
        turned = curve if "smallest" in sentence else -curve
        bottom = int(turned.argmin())
        assert (np.diff(turned[: bottom + 1]) <= small).all()
        assert (np.diff(turned[bottom:]) >= -small).all()
        assert 0 < bottom < curve.size - 1
        said = re.search(rf"(?:smallest|largest), ({NUMBER})(?: to ({NUMBER}))?, at", sentence)
        assert turned.min() == pytest.approx(
            min(float(each) * (1 if "smallest" in sentence else -1) for each in said.groups() if each),
            rel=6e-3,
            abs=1e-8,
        )
        assert ("symmetrically" in sentence) <= np.allclose(curve, curve[::-1], atol=0.0101 * np.ptp(curve))
    elif "rises and falls" in sentence:
        assert step.max() > small
        assert step.min() < -small
    elif "lies between" in sentence:
        levels = np.unique(truth.points[np.isfinite(truth.values), at])
        few = 2 * int(others[1]) > int(others[2]) if others else False
        assert few or (levels.size == 2 and levels[0] < 0 < levels[1])
        assert [number_after("between ", sentence), number_after(r"\) and ", sentence)] == pytest.approx(
            [curve.min(), curve.max()], rel=6e-3, abs=1e-8
        )
    else:
        assert "does not depend on" in sentence, sentence
        assert np.ptp(curve) <= small
        assert truth.largest_change(at) > 0.05 * truth.span


def check_regression(sentence: str, truth: Truth, at: int) -> None:
    """Trends and courses of a regression hold for the mean over the ranges of the other factors."""
    if "By regression" in sentence:
        rows = np.linspace(truth.points[:, at].min(), truth.points[:, at].max(), 33)
        means = [truth.population_mean(at, each) for each in rows]
        slope, bend = np.polyfit(rows, means, 1)[0], np.polyfit(rows, means, 2)[0]
        if re.search("increases|decreases", sentence):
            assert (slope > 0) == ("increases" in sentence), slope
        if "curved" in sentence:
            assert (bend > 0) == ("above the middle" in sentence), bend
        return
    error = number_after(r"\+- ", sentence)
    ends = [float(each) for each in re.findall(r"\(at (-?[\d.e-]+)\)", sentence)]
    if "rises and falls" in sentence or "smallest" in sentence or "largest" in sentence:
        levels = np.linspace(truth.points[:, at].min(), truth.points[:, at].max(), 33)
        means = np.array([truth.population_mean(at, level) for level in levels])
        assert np.diff(means).max() > 0 > np.diff(means).min()
        if ends := re.search(rf"in the class(?:es)? ({NUMBER}) to ({NUMBER}) ", sentence):
            low, high = map(float, ends.groups())
            assert truth.points[:, at].min() < low < high < truth.points[:, at].max()
            best = means if "smallest" in sentence else -means
            inside = best[(levels >= low) & (levels <= high)]
            assert inside.size == 0 or inside.min() <= best.min() + 2.2 * error + 0.1 * np.ptp(means)
        return
    if not ends:
        ends = [float(each) for each in re.search(r"\((-?[\d.e-]+) to (-?[\d.e-]+),", sentence).groups()]
    change = truth.population_mean(at, ends[1]) - truth.population_mean(at, ends[0])
    told = re.search(r"proportional to \w+: (-?)", sentence)
    rising = told[1] == "" if told else "increases" in sentence
    assert (change if rising else -change) > -0.1 * error, (change, error)


def steps_of(truth: Truth, at: int) -> tuple[int, int, int]:
    """How many steps in a factor rise, how many fall, and how many there are."""
    steps = np.concatenate([np.diff(values) for _, values in truth.groups(at)])
    small = 1.1e-9 * np.abs(truth.values).max()
    return int((steps > small).sum()), int((steps < -small).sum()), steps.size


def check_held(told: str, truth: Truth, at: int) -> None:
    """Other factors have the one value that is told of them at all points that are compared, and no others do."""
    held = {NAMES.index(name): float(value) for name, value in re.findall(rf"(x[123]) = ({NUMBER})", told)}
    for other in {0, 1, 2} - {at}:
        if other in held:
            assert truth.shared(at, other) == pytest.approx([held[other]], rel=1e-5)
        else:
            assert truth.shared(at, other).size > 1 or np.ptp(truth.points[:, other]) == 0


def check_steps(sentence: str, truth: Truth, at: int) -> None:
    """The number of steps and their signs are those of the points."""
    up, down, steps = steps_of(truth, at)
    if "with the size of" in sentence:
        assert min(up, down) > 0
        pairs = [pair for group in truth.groups(at) for pair in zip(*map(itertools.pairwise, group), strict=True)]
        moves = [(b - a) * np.sign(abs(y) - abs(x)) for (x, y), (a, b) in pairs if x * y >= 0]
        if "different sizes" in sentence:
            moves = [(b - a) * np.sign(abs(y) - abs(x)) for (x, y), (a, b) in pairs if abs(x) != abs(y)]
        assert len(moves) == (1 if "only pair" in sentence else number_after(r"In (?:all )?(?:\d+ of )?", sentence))
        assert ",," not in sentence
        rising = "increases" in sentence
        assert all((move if rising else -move) > -1.1e-9 * np.abs(truth.values).max() for move in moves)
        assert number_after("by up to ", sentence) == pytest.approx(np.abs(moves).max(), rel=6e-3)
        return
    assert (up, down)[("decreases" not in sentence)] == 0
    assert ("all " in sentence or "only pair" in sentence) == (steps in (up, down))
    told = number_after("by up to ", sentence)
    assert told == pytest.approx(truth.largest_change(at), rel=6e-3)


NUMBER = r"-?[\d.]*\d(?:e-?\d+)?"
STEPS = r"with a larger value, it increases in (\d+) and decreases in (\d+) of (\d+) pairs of points that differ in"
ONE = rf"(x[123])( \(with its sign\))?: {STEPS} \1 alone(?: \((at [^()]*)\))?, by up to ({NUMBER})"
FIRST = rf"(x[123])( with its sign)? \({STEPS} this factor alone(?:, (at [^()]*))?, by up to ({NUMBER})\)"
FURTHER = rf"(x[123])( with its sign)? \((\d+), (\d+) of (\d+)(?:, (at [^()]*))?; ({NUMBER})\)"


def check_no_direction(sentence: str, truth: Truth) -> None:
    """The steps in each of one or several factors, and the largest change of each, in descending order."""
    start, over, told = sentence.removesuffix(".").partition("y has no single direction over ")
    assert (start, over) == ("", "y has no single direction over ")
    found = [re.fullmatch(ONE, told)]
    if not found[0]:
        found = [re.match(FIRST, told), *re.finditer(FURTHER, told)]
        assert len(found) > 1
        assert told == listed([each[0] for each in found])
    for name, signed, *counts, held, _ in (each.groups() for each in found):
        at = NAMES.index(name)
        assert tuple(map(int, counts)) == steps_of(truth, at)
        assert min(map(int, counts[:2])) > 0
        assert bool(signed) == (truth.every[:, at] < 0).any()
        check_held(held or "", truth, at)
    largest = [truth.largest_change(NAMES.index(each[1])) for each in found]
    assert [float(each[7]) for each in found] == pytest.approx(largest, rel=6e-3)
    assert (np.diff(largest) <= 1e-12 * truth.span).all()


def check_weak(sentence: str, truth: Truth, factors: list[int]) -> None:
    """What changes little does so between all points that can be compared."""
    change = max(truth.largest_change(at) for at in factors)
    if "at any setting" in sentence:  # no point stands at a setting that lacks a level
        for at in factors:
            every = [levels.size for levels, _ in truth.groups(at)]
            assert min(every) == np.unique(truth.points[:, at]).size
            assert sum(every) == len(np.unique(truth.points, axis=0))
    if "at most" in sentence:
        assert change <= 1.0000001 * number_after("at most ", sentence) / 100 * truth.span
    elif "at these" in sentence:
        swapped = truth.points.copy()
        swapped[:, factors] = truth.points[::-1][:, factors]
        assert np.allclose(truth.function(*swapped.T), truth.values, atol=1e-6 * truth.span)
    else:
        assert change <= 2e-9 * np.abs(truth.values).max()


def check_region(sentence: str, truth: Truth) -> None:
    """The region that fails holds as many points and failures as it says; thresholds are printed to four digits."""
    inside = np.ones(len(truth.failed_or_not), bool)
    for low, name in re.findall(r"(-?[\d.]+) < (x[123]) <", sentence):
        inside &= truth.every[:, NAMES.index(name)] > float(low)
    for name, side, threshold in re.findall(r"(x[123]) ([<>]) (-?[\d.]+)", sentence):
        column = truth.every[:, NAMES.index(name)]
        inside &= column > float(threshold) if side == ">" else column < float(threshold)
    failed, points = truth.failed_or_not[inside].sum(), inside.sum()
    assert f"({failed} of the {points} points there, {truth.failed_or_not.sum() - failed} elsewhere)" in sentence


def check(sentence: str, truth: Truth) -> str:
    """Check one sentence; returns what kind it was."""
    named = [NAMES.index(name) for name in dict.fromkeys(re.findall(r"\bx[123]\b", sentence))]
    if sentence.startswith("y lies between"):
        assert number_after("between ", sentence) == pytest.approx(truth.values.min(), rel=6e-3, abs=1e-8)
        assert number_after(r"and ", sentence) == pytest.approx(truth.values.max(), rel=6e-3, abs=1e-8)
        return "range"
    if sentence.startswith(("y is the same", "y is ")) and "proportional" not in sentence:
        assert np.ptp(truth.values) <= 1e-6 * np.abs(truth.values).max()
        return "same"
    if re.search(r"no effect on|at most", sentence):
        head = re.split(r" (?:ha(?:s|ve)|changes?) ", sentence)[0]
        check_weak(sentence, truth, [NAMES.index(name) for name in re.findall(r"x[123]", head)])
        return "weak"
    if "no single direction" in sentence:
        check_no_direction(sentence, truth)
        return "steps"
    if "pair" in sentence:
        check_steps(sentence, truth, named[0])
        return "steps"
    if "points fail where" in sentence:
        check_region(sentence, truth)
        return "region"
    if re.search(
        r"resolves? no |does not separate|too few points for|do not finish|did not finish|No trend|None of|Only points",
        sentence,
    ):
        return "unknown"
    check_curve(sentence, truth, named[0])
    return "regression" if "classes" in sentence or "regression" in sentence else "curve"


def check_designs(kind: str, seeds: range) -> None:
    """Check every sentence on random designs of a kind, all responses, with and without points that failed."""
    seen = set()
    for seed in seeds:
        points = unit_points(kind, seed)
        for name, function in RESPONSES.items():
            values = function(*points[:, :3].T) + 0.0
            if seed % 3 == 2:
                values[np.random.default_rng(seed).random(values.size) < 0.2] = np.nan
            truth = Truth(points, values, function)
            for sentence in find(cube_of(points, values)):
                try:
                    seen.add(check(sentence, truth))
                except AssertionError as error:
                    raise AssertionError(f"{kind}, seed {seed}, {name}: {sentence}\n{error}") from error
    assert TOLD.get(kind, "range") in seen


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_no_sentence_lies(kind):
    """Three random designs of a kind; `benchmarks/sentences.py` checks as many as wanted."""
    check_designs(kind, range(3))


def test_a_slope_beside_large_values_is_not_zero():
    """Regression: "y increases with x1 by 0 per 1" where all values lie about 1000."""
    points = np.array(list(itertools.product((-3.0, -1, 1, 3), (0.0, 1), (0.0,))))
    said = find(cube_of(points, 1000 + 0.001 * points[:, 0] + 0.01 * points[:, 1]))
    assert any("increases with x1 (with its sign) by 0.001 per 1 " in each for each in said)


def test_a_rise_on_both_sides_of_zero_shows_beside_large_values():
    """Regression: "1000 at -1 to 1000 at -3, and 1000 at 1 to 1000 at 2"."""
    points = np.array(list(itertools.product((-3.0, -1, 1, 2), (0.0,), (0.0,))))
    said = find(cube_of(points, 1000 + 0.1 * np.abs(points[:, 0])))
    assert any("1000.1 at -1 to 1000.3 at -3, and 1000.1 at 1 to 1000.2 at 2" in each for each in said)


def test_means_of_classes_have_the_digits_of_their_error():
    """Regression: "from 999.6 to 1001, each +- 0.23" for 1000.6."""
    points = 2 * qmc.LatinHypercube(3, rng=1).random(200) - 1
    said = find(cube_of(points, 999.6 + 0.5 * np.tanh(9 * points[:, 0]) + 0.5 + 0.1 * points[:, 1]))
    (text,) = (each for each in said if each.startswith("y increases with x1"))
    low, high, error = map(float, re.search(r"from (\S+) \(.* to (\S+) \(.*each \+- (.*)\.$", text).groups())
    assert abs(high - low - 1) < error < 0.2


def test_classes_of_independent_points_are_no_settings_with_all_levels():
    """Regression: "over the 108 of 157 settings that have all levels" of Saltelli's points, of which many had failed."""
    points = sobol.sample(PROBLEM, 128, seed=1)
    response = np.where(
        np.random.default_rng(1).random(len(points)) < 0.15, 3 * points[:, 0] + 0.1 * points[:, 1], np.nan
    )
    (text,) = (each for each in find(cube_of(points, response)) if each.startswith("y is proportional to x1"))
    assert re.search(r", means of \d+ classes of \d+ independent points, each ", text)
    assert "settings that have all levels" not in text
