"""Every kind of study has its report: random designs of numbers, words and switches through the command line and pages.

A study function, so that a point costs nothing; pages and exports are what is looked at.
"""

from __future__ import annotations

import csv
import json
import warnings

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.cli.main import main
from tripod_doe.model_interface import Outcome
from tripod_doe.number_text import number
from tripod_doe.service.explorer.answers import explore, figure, numbers, point

FUNCTION = """
import numpy as np
import xarray as xr
WORDS = {"low": 0.3, "mid b": 1.7, "x,y": 3.1, "true": 0.5}
def pull(a, b, c=1.0, word="low", other="mid b", switch=1, flag=True):
    if LOST:
        raise ValueError("lost: of <b>this</b> & that")
    t = np.array([0.0, 0.5, 2.0])
    y = 100 * a + WORDS[word] * b + 0.01 * b * b + c * switch + WORDS[other] + flag
    wave = ("t", a * t + 10 * b + WORDS[word] * t * t)
    return xr.Dataset({"y": y, "wave": wave, "y_error": 0.5, "count": int(switch)}, coords={"t": t})
"""
LOST = ("False", "False", "a > 2", "True", "abs(np.sin(1e3 * (a + 2 * b))) < 0.3", "word == 'x,y'")
NUMBERS = [-3, -1, 0, 0.5, 1, 2, 2.5, 3, 7, 11, 1e3, 1e-4]
LEVELS = {
    "a": NUMBERS,
    "b": NUMBERS,
    "c": NUMBERS,
    "word": ["low", "mid b", "x,y", "true"],
    "other": ["low", "mid b"],
    "switch": [1, 2, 3],
    "flag": [True, False],
}


def write_study(folder, random: np.random.Generator) -> None:
    """A study of two numbers and up to two further factors, with a random number of levels, design and failures."""
    names = ["a", "b", *random.permutation(["c", "word", "other", "switch", "flag"])[: random.integers(0, 3)]]
    kind = random.choice(["grid", "grid", "grid", "one-at-a-time", "zip", "table"])
    most = 3 if len(names) == 4 else 5
    levels = {
        name: [LEVELS[name][at] for at in random.permutation(len(LEVELS[name]))[: random.integers(1, most + 1)]]
        for name in names
    }
    if kind == "zip":
        levels = {name: values[: min(map(len, levels.values()))] for name, values in levels.items()}
    text = '[study]\nname = "Every day"\nfunction = "pulls:pull"\n'
    if kind == "one-at-a-time":
        text += "[base]\n" + "".join(f"{name} = {json.dumps(values[0])}\n" for name, values in levels.items())
    given = {name: "" if kind == "table" else f"values = {json.dumps(values)}\n" for name, values in levels.items()}
    text += "".join(f"[factors.{name}]\n{values}" for name, values in given.items()) + f'[design]\nkind = "{kind}"\n'
    if kind == "table":
        text += 'table = "t.csv"\n'
        with (folder / "t.csv").open("w", newline="") as file:
            table = csv.writer(file)
            table.writerow(names)
            table.writerows([[values[random.integers(len(values))] for values in levels.values()] for _ in range(9)])
    text += '[responses.own]\nformula = "y - wave[0]"\n' * bool(random.random() < 0.4)
    (folder / "s.toml").write_text(text)
    (folder / "pulls.py").write_text(FUNCTION.replace("LOST", random.choice(LOST)))


@pytest.mark.parametrize("seed", [32, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(32))])
def test_every_kind_of_study_has_its_report(tmp_path, capsys, seed):
    """Regression: the report of a grid of 3 x 3 numbers over a factor of words ended with an internal error."""
    write_study(tmp_path, np.random.default_rng(seed))
    out = tmp_path / "out"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert main(["run", str(tmp_path / "s.toml"), "--out", str(out), "--workers", "0"]) in (0, 3)
        for form in ("html", "xlsx"):
            assert main(["report", str(out), "--format", form]) == 0
    capsys.readouterr()
    cube = td.open_cube(out)
    finished = int((cube["outcome"] == Outcome.FINISHED).sum())
    assert f"{finished:,} of {cube['outcome'].size:,}" in (out / "report" / "index.html").read_text()
    for items in ([], [("variable", "wave")], [("kind", "points")], [("kind", "map")], [("kind", "parallel")]):
        if finished or not items:
            look_at(str(out), items)
    assert point(str(out), cube["outcome"].size - 1)["number"] == cube["outcome"].size - 1


def look_at(out: str, items: list[tuple[str, str]]) -> None:
    """Draw a view, and find its numbers in the cube."""
    explore(out, items, out)
    figure(out, items, None)
    table = numbers(out, items)
    view = explore(out, items, out)["view"]
    cells = td.query(td.open_cube(out), view["variable"], list(view["select"]))[view["variable"]].values
    written = {text for row in table["rows"] for text in row[1:]}
    assert {number(value, 6) for value in cells[np.isfinite(cells)].ravel()[:20].tolist()} <= written
