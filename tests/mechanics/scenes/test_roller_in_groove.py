"""The roller in its groove against its closed form (exact physics; numbers of FACTS)."""

import numpy as np
import pytest

from tripod_doe.mechanics.scenes.roller_in_groove import closed_form, simulator
from tripod_doe.model_interface import Outcome


def _force(**values):
    points = {name: np.array([value], object) for name, value in simulator.effective(values).items()}
    result = simulator.simulate(points, ["axial_force_n"])
    assert result.outcome[0] == Outcome.FINISHED, result.detail
    return result.outputs["axial_force_n"].data[0]


def test_closed_form_is_the_published_one():
    values = {k: float(v) for k, v in simulator.effective({}).items() if isinstance(v, int | float)}
    assert closed_form(values) == pytest.approx(6.941268472, rel=1e-9)
    assert closed_form(values | {"transition_ratio": 0.01}) == pytest.approx(6.945927107, rel=1e-9)


@pytest.mark.parametrize("method", ["bdf2", "implicit-euler", "rosenbrock", "generalized-alpha", "scipy-lsoda"])
def test_axial_force(method):
    assert _force(method=method) == pytest.approx(6.941268472, rel=1e-6)


def test_axial_force_with_sharp_friction():
    assert _force(transition_ratio=0.01) == pytest.approx(6.945927107, rel=1e-6)


def test_negative_tilt_and_speed_give_the_same_magnitude():
    assert _force(tilt_deg=-10.0) == pytest.approx(6.941268472, rel=1e-6)
    assert _force(axial_speed_mm_s=-100.0) == pytest.approx(6.941268472, rel=1e-6)
