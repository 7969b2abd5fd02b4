"""Limit cases of the joint in every model: what has an answer gives it, what has none says so."""

from __future__ import annotations

import numpy as np
import pytest
from few import CALM, FEW

from tripod_doe.joint.models.registry import MODELS
from tripod_doe.model_interface import Outcome

NO_FRICTION = {
    "groove_sliding_friction": 0,
    "groove_rolling_friction": 0,
    "needle_sliding_friction": 0,
    "needle_rolling_friction": 0,
}


def run(simulated, model, **given):
    result = simulated(model=model, **{**(FEW if model == "needles" else {}), **given})
    return Outcome(int(result["outcome"])).label, str(result["outcome_detail"].values), result


@pytest.mark.parametrize("model", MODELS)
def test_without_torque(simulated, model):
    """The balances have no thrust then (exact); in motion nothing holds the rollers."""
    outcome, detail, result = run(simulated, model, torque_n_m=0)
    if model in ("equilibrium", "kinetostatic"):
        assert outcome == "finished", detail
        assert np.abs(result["thrust"].values).max() < 1e-6
    else:
        assert outcome == "out_of_range"
        assert "use model equilibrium" in detail


@pytest.mark.parametrize("model", MODELS)
def test_at_rest(simulated, model):
    """Friction at rest has no single value, so neither has the thrust."""
    outcome, detail, _ = run(simulated, model, speed_rpm=0)
    assert outcome == "out_of_range"
    assert "raise speed_rpm" in detail


@pytest.mark.slow
@pytest.mark.parametrize("given", [{"joint_angle_deg": 0}, NO_FRICTION])
@pytest.mark.parametrize("model", MODELS)
def test_without_joint_angle_or_friction(simulated, model, given):
    """Exact physics: nothing slides, or sliding costs nothing; a ten-thousandth of the third order is rounding."""
    numerics = {"accuracy": 0.2, "cycles": 3} if model == "needles" else {}  # needles rattle; they make no thrust of it
    outcome, detail, result = run(simulated, model, **given, **numerics)
    assert outcome == "finished", detail
    assert np.abs(result["thrust"].values).max() < 1e-3


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("skew", [6.0, -10.0])
def test_skew_beyond_what_the_ring_allows(simulated, model, skew):
    """Geometry (tests/joint/test_fit.py): neighbours would have to cross."""
    outcome, detail, _ = run(simulated, model, initial_skew_3_deg=skew)
    assert outcome == "jammed"
    assert "initial_skew_3_deg" in detail


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_one_needle_missing(simulated, model):
    """Limit: the others carry its share, so that the third order stays within the 3 % that nine needles rattle by. With
    a gap as wide as one of them they rattle more, so that their tolerance must be lower."""
    numerics = CALM | {"cycles": 3} if model == "needles" else {}
    full = FEW["needle_count"] if model == "needles" else 27
    third = []
    for count in (full, full - 1):
        outcome, detail, result = run(simulated, model, needle_count=count, **numerics)
        assert outcome == "finished", detail
        third.append(result["thrust_amplitude"].values[3])
    assert third[1] == pytest.approx(third[0], rel=0.03)
