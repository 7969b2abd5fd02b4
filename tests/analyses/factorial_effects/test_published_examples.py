"""Worked examples of the books, to the digits that they print, and published functions through a whole study."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe.analyses.factorial_effects.factorial_effects import factorial_effects
from tripod_doe.analyses.factorial_effects.sentences import find_in_effects
from tripod_doe.model_interface import Outcome
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import make_points

pytestmark = pytest.mark.usefixtures("pages_not_made")

FACTORS = ("joint_angle_deg", "torque_n_m", "speed_rpm", "shaft_length_mm")  # any that allow the numbers


def measured(design, ranges, answers):
    """The effects of a printed table: `answers` lists (levels from -1 to 1, measurements)."""
    factors = "".join(
        f"{name} = {{low = {low}, high = {high}}}\n" for name, (low, high) in zip(FACTORS, ranges, strict=False)
    )
    text = f'[study]\nname = "t"\n[factors]\n{factors}[design]\n{design}\n'
    columns = make_points(parse_study(text)).columns
    coded = np.stack(
        [
            (2 * column - low - high) / (high - low)
            for column, (low, high) in zip(columns.values(), ranges, strict=True)
        ],
        axis=1,
    )
    of_rows = [
        next(values for levels, values in answers if np.abs(np.array(levels) - row).max() < 1e-3) for row in coded
    ]
    assert sum(map(len, of_rows)) == sum(len(values) for _, values in answers)  # every measurement has its point
    repeats, results = [len(values) for values in of_rows], np.concatenate(of_rows).astype(float)
    cube = xr.Dataset(
        {"y": ("point", results), "outcome": ("point", np.full(results.size, Outcome.FINISHED, np.int8))},
        coords={name: ("point", np.repeat(column, repeats)) for name, column in columns.items()},
        attrs={"study": text},
    )
    return factorial_effects(cube)


@pytest.mark.parametrize("size", [1e300, 1e-300])
def test_numbers_without_squares_are_refused(size):
    """Regression: numpy warned, and no effect was significant."""
    with pytest.raises(td.InputError, match=f"y has values of {5 * size:g}, whose squares no number holds"):
        measured('kind = "full-factorial"', [(1, 3)], [([-1], [size]), ([1], [5 * size])])


def test_a_factorial_of_montgomery_and_runger():
    """Published number: plasma etching, Applied Statistics and Probability for Engineers, 3rd ed., example 14-5."""
    rates = (550, 669, 604, 650, 633, 642, 601, 635, 1037, 749, 1052, 868, 1075, 860, 1063, 729)
    rows = [([2 * (at >> bit & 1) - 1 for bit in range(4)], [rate]) for at, rate in enumerate(rates)]
    found = measured('kind = "full-factorial"', [(1, 3)] * 3 + [(60, 80)], rows)
    assert float(found["mean"]) == pytest.approx(776.0625, rel=1e-12)
    a, b, c, d = FACTORS
    printed = {
        a: -101.625,
        b: -1.625,
        c: 7.375,
        d: 306.125,
        f"{a}:{b}": -7.875,
        f"{a}:{c}": -24.875,
        f"{b}:{c}": -43.875,
        f"{a}:{d}": -153.625,
        f"{b}:{d}": -0.625,
        f"{c}:{d}": -2.125,
    }
    assert dict(zip(found["term"].values, found["effect"].values.round(9), strict=True)) == printed


def test_a_central_composite_of_montgomery():
    """Published number: yield over time and temperature, Design and Analysis of Experiments, example 11-1 (2001)."""
    far = np.sqrt(2)
    rows = [
        ([-1, -1], [76.5]),
        ([-1, 1], [77.0]),
        ([1, -1], [78.0]),
        ([1, 1], [79.5]),
        ([far, 0], [78.4]),
        ([-far, 0], [75.6]),
        ([0, far], [78.5]),
        ([0, -far], [77.0]),
        ([0, 0], [79.9, 80.3, 80.0, 79.7, 79.8]),
    ]
    found = measured('kind = "central-composite"', [(8, 9), (170, 180)], rows)
    a, b = FACTORS[:2]
    table = found.sel(term=[a, b, f"{a}^2", f"{b}^2", f"{a}:{b}"])
    assert table["sum_of_squares"].values == pytest.approx([7.92, 2.12, 13.18, 6.97, 0.25], abs=0.0051)
    assert table["f_value"].values == pytest.approx([111.93, 30.01, 186.22, 98.56, 3.53], abs=0.0051)
    assert table["p_value"].values[[1, 4]] == pytest.approx([0.0009, 0.1022], abs=5.1e-5)
    assert float(found["residual_sum_of_squares"]) == pytest.approx(0.50, abs=0.0051)
    assert found.attrs["degrees_of_freedom"] == 7


def test_a_box_behnken_of_myers_and_montgomery():
    """Published number: viscosity over three factors, Response Surface Methodology, 2nd ed., example 7.5."""
    rows = [
        ([-1, -1, 0], [53]),
        ([1, -1, 0], [58]),
        ([-1, 1, 0], [59]),
        ([1, 1, 0], [56]),
        ([-1, 0, -1], [64]),
        ([1, 0, -1], [45]),
        ([-1, 0, 1], [35]),
        ([1, 0, 1], [60]),
        ([0, -1, -1], [59]),
        ([0, 1, -1], [64]),
        ([0, -1, 1], [53]),
        ([0, 1, 1], [65]),
        ([0, 0, 0], [65, 59, 62]),
    ]
    found = measured('kind = "box-behnken"', [(1, 3), (5, 10), (15, 25)], rows)
    a, b, c = FACTORS[:3]
    table = found.sel(term=[a, b, c, f"{a}^2", f"{b}^2", f"{c}^2", f"{a}:{b}", f"{a}:{c}", f"{b}:{c}"])
    printed = [8.00, 55.12, 45.13, 200.83, 12.98, 48.52, 16.00, 484.00, 12.25]
    assert table["sum_of_squares"].values == pytest.approx(printed, abs=0.0051)
    assert table["f_value"].values[[3, 7]] == pytest.approx([19.59, 47.22], abs=0.0051)
    assert table["p_value"].values[[0, 3, 7]] == pytest.approx([0.4174, 0.0069, 0.0010], abs=5.1e-5)
    assert float(found["residual_sum_of_squares"]) == pytest.approx(51.25, abs=0.0051)
    assert found.attrs["degrees_of_freedom"] == 5


FUNCTIONS = '''
import math


def friedman(x1, x2, x3, x4, x5):
    """Friedman (1991), without noise."""
    return {"y": 10 * math.sin(math.pi * x1 * x2) + 20 * (x3 - 0.5) ** 2 + 10 * x4 + 5 * x5}


def morris(ARGUMENTS):
    """Morris (1991), its remaining coefficients by (-1)^i and (-1)^(i + j) as Saltelli and others (2000) have them."""
    x = [ARGUMENTS]
    w = [2 * (1.1 * v / (v + 0.1) - 0.5) if i in (3, 5, 7) else 2 * (v - 0.5) for i, v in enumerate(x, 1)]
    y = sum((20 if i <= 10 else (-1) ** i) * v for i, v in enumerate(w, 1))
    for i in range(1, 21):
        for j in range(i + 1, 21):
            y += (-15 if j <= 6 else (-1) ** (i + j)) * w[i - 1] * w[j - 1]
    for i in range(1, 6):
        for j in range(i + 1, 6):
            y += sum(-10 * w[i - 1] * w[j - 1] * w[k - 1] for k in range(j + 1, 6))
    return {"y": y + 5 * w[0] * w[1] * w[2] * w[3]}
'''.replace("ARGUMENTS", ", ".join(f"x{i}" for i in range(1, 21)))


def studied(folder, function, width, design, analysis):
    """A study of a published function on the unit cube, from its file to its analysis."""
    (folder / "functions.py").write_text(FUNCTIONS)
    factors = "".join(f"x{i} = {{low = 0, high = 1}}\n" for i in range(1, width + 1))
    (folder / "study.toml").write_text(
        f'[study]\nname = "t"\nfunction = "functions:{function}"\n[factors]\n{factors}[design]\n{design}\n[analysis.{analysis}]\n'
    )
    out = td.run(folder / "study.toml", folder / "out", workers=0, progress=False).directory
    return xr.open_dataset(out / "analysis" / f"{analysis}.nc")


def test_friedmans_function(tmp_path):
    """Exact: variances by quadrature; each index within its 95 % interval."""
    x, weight = np.polynomial.legendre.leggauss(60)
    x, weight = (x + 1) / 2, weight / 2
    wave = 10 * np.sin(np.pi * np.outer(x, x))
    mean = weight @ wave @ weight
    alone = weight @ (wave @ weight) ** 2 - mean**2
    both = weight @ wave**2 @ weight - mean**2
    parts = np.array([alone, alone, 400 * (1 / 80 - 1 / 144), 100 / 12, 25 / 12])
    whole = both + parts[2:].sum()
    found = studied(tmp_path, "friedman", 5, 'kind = "saltelli"\nsamples = 256\nsecond_order = false', "sobol")
    total = parts.copy()
    total[:2] = both - alone
    assert (np.abs(found["S1"].values - parts / whole) <= found["S1_conf"].values).all()
    assert (np.abs(found["ST"].values - total / whole) <= found["ST_conf"].values).all()
    found.close()


def test_morris_own_function(tmp_path):
    """Published: ten factors count and ten do not; 8, 9 and 10 act almost linearly, 1 to 7 with interactions."""
    found = studied(tmp_path, "morris", 20, 'kind = "morris"\nsamples = 20\nseed = 1', "morris")
    size, scatter = found["mu_star"].values, found["sigma"].values
    assert size[:10].min() > 2 * size[10:].max()
    assert scatter[:7].min() > 2 * scatter[7:].max()
    levels = np.arange(4) / 3
    middle = (2 * (1.1 * levels / (levels + 0.1) - 0.5)).mean()  # of w3, w5, w7; those of the others are 0
    exact = [2 * (20 + middle * 3 * (-1) ** (3 + i)) for i in (8, 9, 10)]
    assert (np.abs(found["mu"].values[7:10] - exact) <= found["mu_star_conf"].values[7:10]).all()
    found.close()


@pytest.mark.parametrize("effects", [(64.0, -40.0, 5.0), (3.0, 2.0, 2.5)])
def test_effects_without_points_to_judge_them_by_are_named_with_their_sizes(effects):
    """Regression: "No effect is significant, R2 1" of two levels of two factors, whose three terms use up the points."""
    levels = [(-1, -1), (1, -1), (-1, 1), (1, 1)]
    rows = [((a, b), [10 + (a * effects[0] + b * effects[1] + a * b * effects[2]) / 2]) for a, b in levels]
    sentence = find_in_effects(measured('kind = "full-factorial"', [(1, 3)] * 2, rows), "mine")[0]
    assert "R2" not in sentence
    assert "is significant" not in sentence
    assert all(f"{each:g}" in sentence for each in effects)


def test_an_effect_is_the_mean_over_three_words_and_rounding_is_none(tmp_path):
    """Regression: it was the effect at the first word, and what rounding left was significant, with F infinite."""
    (tmp_path / "three.py").write_text(
        "def f(a, s, b):\n    return {'y': {'x': 2.0, 'y': -1.0, 'z': -1.0}[s] * a + 3.0 * (s == 'z') + 0.7}\n"
    )
    (tmp_path / "s.toml").write_text(
        '[study]\nname = "t"\nfunction = "three:f"\n[factors]\na.values = [0, 1]\ns.values = ["y", "x", "z"]\n'
        "b.values = [0.1, 0.2, 0.7]\n"
    )
    td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    result = factorial_effects(td.open_cube(tmp_path / "out"))
    effect = result["effect"].to_series()
    assert effect["a"] == 0
    assert effect["s=x"] == pytest.approx(1.5)  # (2 - -1) / 2: the mean over a
    assert effect["s=z"] == pytest.approx(3)
    assert effect["a:s=x"] == pytest.approx(1.5)
    assert result["p_value"].to_series()[["a", "b"]].tolist() == [1, 1]


def test_the_mean_of_a_phase_is_a_phase():
    """Regression: it was relative to a circular mean that stood nowhere."""
    text = '[study]\nname = "t"\n[factors]\njoint_angle_deg = {low = 4, high = 8}\n[design]\nkind = "full-factorial"\n'
    cube = xr.Dataset(
        {
            "p": ("point", [170.0, -170.0], {"units": "degree", "wraps_at": "+-180 degree"}),
            "outcome": ("point", np.full(2, Outcome.FINISHED, np.int8)),
        },
        {"joint_angle_deg": ("point", [4.0, 8.0])},
        {"study": text},
    )
    result = factorial_effects(cube)
    assert abs(result["mean"].item()) == pytest.approx(180)
    assert result["effect"].item() == pytest.approx(20)


def test_a_factor_with_one_value_in_a_grid_has_no_effect(tmp_path):
    """Regression: settings that repeat for no term ended the analysis with an internal error."""
    (tmp_path / "one.py").write_text("def f(a, b, c):\n    return {'y': 3 * a + c}\n")
    (tmp_path / "s.toml").write_text(
        '[study]\nname = "t"\nfunction = "one:f"\n[factors]\na.values = [0, 1, 3]\nb.values = [2]\nc.values = [0, 1]\n'
    )
    td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    effect = factorial_effects(td.open_cube(tmp_path / "out"))["effect"].to_series()
    assert set(effect.index) == {"a", "c", "a:c", "a^2"}
    assert effect["a"] == pytest.approx(9)


def test_an_output_that_nothing_changes_is_told(tmp_path):
    """Regression: no sentence at all."""
    (tmp_path / "still.py").write_text("def still(a, b):\n    return {'y': 7.0}\n")
    text = (
        '[study]\nname = "s"\nfunction = "still:still"\n[factors]\na = {low = 0, high = 1}\nb = {low = 0, high = 1}\n'
    )
    (tmp_path / "s.toml").write_text(text + '[design]\nkind = "full-factorial"\n[analysis.effects]\n')
    summary = td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    assert "The main outputs are the same at all points: no term has an effect (analysis effects)." in summary.answers
