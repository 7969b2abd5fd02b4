"""Tiny studies of every design with factors of every kind, and the truth of their responses by a grid of quantiles."""

from __future__ import annotations

import itertools
from functools import lru_cache
from math import comb
from pathlib import Path

import numpy as np
import xarray as xr

from tripod_doe.model_interface import Outcome
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.designs import make_points
from tripod_doe.study.designs.sampling import distributed

FOLDER = StudyFolder(Path(__file__).parent)
FUNCTION = "combinations:function"
WORDS = {"low": 0.0, "mid": 0.5, "top": 1.0}

FACTORS = {
    "uniform": "{low = 0.0, high = 1.0}",
    "normal": '{distribution = "normal", mean = 0.5, std = 0.25}',
    "truncated": '{distribution = "truncated-normal", mean = 0.5, std = 0.25, low = 0.0, high = 1.0}',
    "log": '{distribution = "log-uniform", low = 0.01, high = 1.0}',
    "triangular": '{distribution = "triangular", low = 0.0, high = 1.0, mode = 0.2}',
    "two": '{distribution = "discrete", values = [0, 1]}',
    "five": '{distribution = "discrete", values = [0, 0.25, 0.5, 0.75, 1]}',
    "weighted": '{distribution = "discrete", values = [0, 0.5, 1], weights = [0.1, 0.3, 0.6]}',
    "words": '{distribution = "discrete", values = ["low", "mid", "top"]}',
    "listed": "{values = [0, 0.5, 1]}",
    "listed words": '{values = ["low", "mid", "top"]}',
    "group": '{low = 0.0, high = 1.0, group = "g"}',
}
"""A factor of each kind."""


def function(a, b, c, model="truth"):
    """The study function of a run; `responses` are those of a cube made here."""
    return {"y": 3 * WORDS.get(a, a) + 2 * WORDS.get(b, b) + 0 * WORDS.get(c, c) + (model != "truth")}


RESPONSES = ("sum", "product", "curved", "heavy", "jumps", "offset", "ties", "rare", "constant", "narrow")


def responses(x: np.ndarray) -> np.ndarray:
    """Responses to two of three factors: smooth, skewed, with jumps and ties, nearly always or always the same."""
    a, b, _ = x.T
    total = 3 * a + 2 * b
    return np.stack(
        [
            total, a * b, np.sin(2 * np.pi * a) + 4 * (b - 0.5) ** 2, np.exp(4 * a + b), 1.0 * (a > 0.5) + 0.5 * (b > 0.3),
            1e6 + 1e-2 * total, np.round(2 * (a + b)), 1.0 * ((a > 0.85) & (b > 0.7)), 0 * a + 7, np.round(2 * a) + 1e-4 * b,
        ],
        axis=1,
    )  # fmt: skip


LISTED_TWO = {"two listed": "{values = [0, 1]}", "none": "{}"}


def text_of(design: str, kinds: tuple[str, ...], more: str = "") -> str:
    factors = "".join(f"{name} = {(FACTORS | LISTED_TWO)[kind]}\n" for name, kind in zip("abc", kinds, strict=False))
    return f'[study]\nname = "t"\nfunction = "{FUNCTION}"\n[factors]\n{factors}[design]\n{design}\n{more}'


def columns_of(text: str) -> dict[str, np.ndarray]:
    points = make_points(parse_study(text, folder=FOLDER))
    return dict(points.columns) | dict(points.labels)


def numbers(columns: dict[str, np.ndarray]) -> np.ndarray:
    """Values of the factors, words by their places, shape (point, 3)."""
    return np.stack(
        [np.array([WORDS.get(each, each) for each in columns[name].tolist()], float) for name in "abc"], axis=1
    )


def cube_of(text: str, lost: float = 0.0, outputs: str = "k") -> xr.Dataset:
    """The cube of a study of `responses`, of which a part of the points failed."""
    columns = columns_of(text)
    values = responses(numbers(columns))
    finished = np.random.default_rng(1).random(len(values)) >= lost
    values[~finished] = np.nan
    variables = (
        {"y": (("point", "k"), values)}
        if outputs == "k"
        else dict(zip(RESPONSES, (("point", column) for column in values.T), strict=True))
    )
    outcome = np.where(finished, Outcome.FINISHED, Outcome.ERROR).astype(np.int8)
    return xr.Dataset(
        variables | {"outcome": ("point", outcome)},
        coords={"point": np.arange(len(values))} | {name: ("point", column) for name, column in columns.items()},
        attrs={"study": text},
    )


@lru_cache
def truth_of(kinds: tuple[str, ...], count: int = 60) -> dict[str, np.ndarray]:
    """Indices of each response, shape (factor, response), and its values over all cells of equal chance."""
    factors = parse_study(text_of('kind = "halton"\nsamples = 2', kinds), folder=FOLDER).factors
    columns = distributed(np.repeat((np.arange(count)[:, None] + 0.5) / count, 3, axis=1), factors)
    cells = np.stack([axis.ravel() for axis in np.meshgrid(*numbers(columns).T, indexing="ij")], axis=1)
    flat = responses(cells)
    flat[:, RESPONSES.index("offset")] -= 1e6  # the rest keeps its digits
    values = flat.reshape(count, count, count, -1)
    whole = values.var(axis=(0, 1, 2))
    own = {
        chosen: values.mean(axis=tuple({0, 1, 2} - {*chosen})).var(axis=tuple(range(size))) if size else 0 * whole
        for size in range(4)
        for chosen in itertools.combinations(range(3), size)
    }
    with np.errstate(invalid="ignore"):
        share = {chosen: part / whole for chosen, part in own.items()}
    others = {at: tuple({0, 1, 2} - {at}) for at in range(3)}
    shapley = [
        sum(
            (share[tuple(sorted((*before, at)))] - share[before]) / (3 * comb(2, size))
            for size in range(3)
            for before in itertools.combinations(others[at], size)
        )
        for at in range(3)
    ]
    return {
        "S1": np.stack([share[(at,)] for at in range(3)]),
        "ST": np.stack([1 - share[others[at]] for at in range(3)]),
        "shapley": np.stack(shapley),
        "flat": flat,
    }
