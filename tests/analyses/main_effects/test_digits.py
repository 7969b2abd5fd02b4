"""Values of an optimum and of both sides are written with the digits that tell them apart."""

from __future__ import annotations

import re

import numpy as np
import pytest
import xarray as xr

from tripod_doe.analyses.findings import find
from tripod_doe.analyses.main_effects.regression import fit_factor
from tripod_doe.model_interface import Outcome
from tripod_doe.study.cube.dataset import RESPONSE_ROLE


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("depth", [0.5, 0.05, 0.004, 0.0007])
def test_an_optimum_differs_from_its_sides_in_what_is_written(depth, sign):
    """Regression: "smallest, 18.8 N, at 0.014 mm and grows to both sides: 18.8 N at 0.0112 mm, 18.8 N at 0.0188 mm"."""
    levels = np.linspace(0.011, 0.019, 5)
    values = 18.75 + sign * depth * np.array([1.0, 0.3, 0.0, 0.2, 0.8])
    cube = xr.Dataset(
        {
            "own": ("x", values, {"units": "N", "role": RESPONSE_ROLE, "long_name": "own"}),
            "outcome": ("x", np.full(5, Outcome.FINISHED, np.int8)),
        },
        coords={"x": ("x", levels, {"source": "this study"})},
        attrs={"study": '[study]\nname = "t"\n'},
    )
    told = next(sentence for sentence in find(cube) if "on both sides" in sentence)
    best, *sides = re.findall(r"([\d.]+) N", told)
    assert len(sides) == 2
    assert all(sign * (float(side) - float(best)) > 0 for side in sides)


def test_a_slope_is_stated_within_the_range_of_its_factor():
    """Regression: "decreases by 2.66 N per mm" over clearances of 0.011 to 0.019 mm, where it changes by 0.02 N."""
    levels = np.linspace(0.011, 0.019, 5)
    cube = xr.Dataset(
        {
            "own": ("x_mm", 20 - 2.66 * levels, {"units": "N", "role": RESPONSE_ROLE, "long_name": "own"}),
            "outcome": ("x_mm", np.full(5, Outcome.FINISHED, np.int8)),
        },
        coords={"x_mm": ("x_mm", levels, {"units": "mm", "source": "this study"})},
        attrs={"study": '[study]\nname = "t"\n'},
    )
    assert any("own decreases with x by 0.00266 N per 0.001 mm (0.011 to 0.019 mm; " in each for each in find(cube))


@pytest.mark.parametrize("size", [1e-300, 1.0, 1e300])
def test_a_line_is_a_line_at_any_size_of_its_values(size):
    """Regression: the squares of such numbers are zero or infinite, and the report ended with an internal error."""
    cube = xr.Dataset(
        {
            "own": ("x", size * np.array([3.0, 4, 5.1]), {"role": RESPONSE_ROLE, "long_name": "own"}),
            "outcome": ("x", np.full(3, Outcome.FINISHED, np.int8)),
        },
        coords={"x": ("x", [1.0, 2, 3], {"source": "this study"})},
        attrs={"study": '[study]\nname = "t"\n'},
    )
    assert any("own increases with x by" in each and "R2 = 0.9992" in each for each in find(cube))


def test_the_end_of_a_class_beside_zero_is_zero():
    """Regression: "in the class -0.0366 to -2.92e-6 deg" of a skew that is sampled from -0.3 to 0.3 deg."""
    random = np.random.default_rng(2)
    skew, other = random.permutation(np.linspace(-0.3, 0.3, 400)) - 1e-6, random.random(400)
    own = 1 + (skew + 0.02) ** 2 + 0.1 * other
    cube = xr.Dataset(
        {
            "own": ("point", own, {"units": "N", "role": RESPONSE_ROLE, "long_name": "own"}),
            "outcome": ("point", np.full(400, Outcome.FINISHED, np.int8)),
        },
        coords={"x": ("point", skew, {"source": "this study"}), "z": ("point", other, {"source": "this study"})},
        attrs={"study": '[study]\nname = "t"\n[design]\nkind = "latin-hypercube"\n'},
    )
    assert any("in the class -0.0602 to 0 and rises" in sentence for sentence in find(cube))


def test_a_bend_of_a_thousandth_of_the_range_is_none():
    """Points without noise resolve any bend; one of 0.05 % of the response is not worth a sentence."""
    x, other = np.random.default_rng(1).random((2, 400))
    for size, seen in ((0.0005, False), (0.05, True)):
        response = 30 * (other + 4 * size * (x - 0.5) ** 2)
        assert fit_factor({"x": x, "other": other}, "x", response, 0.0).bend.sure is seen
