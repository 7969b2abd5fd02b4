"""Lines of charts over a factor at whose zero the thrust vanishes: through it, or broken, never across."""

from __future__ import annotations

import base64
import re

import numpy as np
import pytest
import xarray as xr

from slow_cases import first_fast
from tripod_doe.analyses.findings import find
from tripod_doe.analyses.main_effects.charts import effect_charts
from tripod_doe.joint.outputs import JOINT_OUTPUTS
from tripod_doe.model_interface import ZERO_AT, Outcome
from tripod_doe.service.explorer.figures.lines import lines
from tripod_doe.service.explorer.slices import numbered
from tripod_doe.study.cube.dataset import RESPONSE_ROLE

ZEROS = " ".join(JOINT_OUTPUTS["thrust_amplitude"].zero_at)


def cube(torques, angles):
    """A grid whose third order is proportional to both factors, and a response of its own."""
    torque, angle = np.meshgrid(torques, angles, indexing="ij")
    third = np.abs(torque) * angle * 0.03
    amplitude = np.stack([0 * third, 0 * third, 0 * third, third], axis=-1)
    source = {"source": "this study"}
    return xr.Dataset(
        {
            "thrust_amplitude": (("torque_n_m", "joint_angle_deg", "order"), amplitude, {"units": "N", ZERO_AT: ZEROS}),
            "own": (("torque_n_m", "joint_angle_deg"), 1 + third, {"role": RESPONSE_ROLE, "long_name": "own"}),
            "outcome": (("torque_n_m", "joint_angle_deg"), np.full(torque.shape, Outcome.FINISHED, np.int8)),
        },
        coords={
            "torque_n_m": ("torque_n_m", torques, {"units": "N m", **source}),
            "joint_angle_deg": ("joint_angle_deg", angles, {"units": "degree", **source}),
            "order": np.arange(4),
        },
        attrs={"study": '[study]\nname = "t"\n'},
    )


@pytest.mark.parametrize("seed", first_fast(range(12), 4))
def test_no_line_crosses_a_zero_that_was_not_computed(seed):
    """Regression: -150 and 150 N m were joined by a flat line at 94 N, and five of six angles had one."""
    random = np.random.default_rng(seed)
    torques = np.unique(random.choice([-450.0, -150, -20, 0, 10, 150, 450], random.integers(2, 7), replace=False))
    data = cube(torques, np.sort(random.uniform(1, 14, random.integers(2, 9))))
    charts = {chart.name: chart for group in effect_charts(data) for chart in group.charts}
    crosses = torques.min() < 0 < torques.max() and 0 not in torques
    for name, at_zero in (("thrust_amplitude_order_3-torque_n_m", 0.0), ("own-torque_n_m", np.nan)):
        (axes,) = charts[name].figure.axes
        drawn = [line for line in axes.lines if len(line.get_xdata()) > 1]
        assert len(drawn) == min(data.sizes["joint_angle_deg"], 6)
        for line in drawn:
            x, y = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
            assert ((x[:-1] >= 0) | (x[1:] <= 0)).all()
            assert 0 not in x[list(line.get_markevery() or range(x.size))] or 0 in torques
            if crosses:
                assert np.array_equal(y[x == 0], [at_zero], equal_nan=True)
        assert charts[name].data["torque_n_m"].tolist() == torques.tolist()
        assert ("0 N m" in charts[name].caption) == crosses
    shown = lines(numbered(data)[["thrust_amplitude", "outcome"]].sel(order=3), "torque_n_m", "joint_angle_deg")["data"]
    assert len(shown) == data.sizes["joint_angle_deg"]


def test_a_line_over_its_zero_is_broken_in_the_explorer():
    """Regression: the line in the browser joined drive and coast."""
    data = numbered(cube(np.array([-150.0, -20.0, 10.0]), np.array([5.0, 8.0])))
    (first, _) = lines(data[["thrust_amplitude", "outcome"]].sel(order=3), "torque_n_m", "joint_angle_deg")["data"]
    broken = np.frombuffer(base64.b64decode(first["y"]["bdata"]))
    assert np.isnan(broken).tolist() == [False, False, True, False]


@pytest.mark.parametrize("known", [True, False])
def test_of_a_sampled_factor_a_class_is_the_smallest_not_its_mean(known):
    """Regression: "smallest, 10.7 N, at 0.0211 N m and grows to both sides" of a mean of a class around zero."""
    random = np.random.default_rng(4)
    torque, angle = random.uniform(-100, 100, 240), random.uniform(5, 6, 240)
    cube = xr.Dataset(
        {
            "thrust_amplitude": (
                ("point", "order"),
                np.abs(torque)[:, None] * angle[:, None] * np.array([0, 0, 0, 0.1]),
                {"units": "N"} | ({ZERO_AT: "torque_n_m"} if known else {}),
            ),
            "outcome": ("point", np.full(240, Outcome.FINISHED, np.int8)),
        },
        coords={
            "order": np.arange(4),
            "torque_n_m": ("point", torque, {"units": "N m", "source": "this study"}),
            "joint_angle_deg": ("point", angle, {"units": "degree", "source": "this study"}),
        },
        attrs={"study": '[study]\nname = "t"\n[design]\nkind = "latin-hypercube"\n'},
    )
    (told,) = [sentence for sentence in find(cube) if sentence.startswith("Over torque")]
    if known:
        assert "rises on both sides of zero: " in told
        assert re.search(r" N at -\d", told)
        assert "smallest" not in told
    else:
        low, high = map(float, re.search(r"smallest, .* N, in the class(?:es)? (\S+) to (\S+) N m", told).groups())
        assert -45 < low < 0 < high < 45
        assert " at 0." not in told
