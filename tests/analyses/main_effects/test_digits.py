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
    told = next(sentence for sentence in find(cube) if "to both sides" in sentence)
    best, *sides = re.findall(r"([\d.]+) N", told)
    assert len(sides) == 2
    assert all(sign * (float(side) - float(best)) > 0 for side in sides)


def test_a_bend_of_a_thousandth_of_the_range_is_none():
    """Points without noise resolve any bend; one of 0.05 % of the response is not worth a sentence."""
    x, other = np.random.default_rng(1).random((2, 400))
    for size, seen in ((0.0005, False), (0.05, True)):
        response = 30 * (other + 4 * size * (x - 0.5) ** 2)
        assert fit_factor({"x": x, "other": other}, "x", response, 0.0).bend.sure is seen
