"""Self-excited vibration: predicted by the stability of the smooth motion, and found in a run without damping."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from few import FEW

import tripod_doe as td
from tripod_doe.joint import multibody_run
from tripod_doe.joint.readings import groove_thrust
from tripod_doe.joint.vibration import Vibration, vibration
from tripod_doe.mechanics.monitor import Settings
from tripod_doe.mechanics.run import Limits, run

REVOLUTIONS, SAMPLES, TOLERANCE = 3, 180, 4e-3
SMOOTH, UNDAMPED = {"method": "adaptive-euler"}, {"method": "generalized-alpha", "step": 3e-5}


@pytest.fixture(scope="module")
def followed(joint_values, joint_assembly):
    """A run at 300 rpm and another torque than usual."""

    def follow(torque, method, step=None):
        given = {"torque_n_m": torque, "speed_rpm": 300, "cycles": 2}  # of what is asked; the run has its own
        values = joint_values(**given)
        duration = REVOLUTIONS * 2 * math.pi / values.speed
        result = run(
            joint_assembly(False, **given), method, duration, step=step, samples=REVOLUTIONS * SAMPLES,
            settings=Settings(tolerance=TOLERANCE), limits=Limits(windows=0),
        )  # fmt: skip
        return values, result

    return follow


def unrest(result):
    """Effective difference of the thrust in the last two revolutions over its third order."""
    thrust = groove_thrust(result.assembly, result.positions, result.velocities).sum(0)[1:].reshape(-1, SAMPLES)
    third = 2 * abs(np.fft.rfft(thrust[-1])[3]) / SAMPLES
    return math.sqrt(2 * ((thrust[-1] - thrust[-2]) ** 2).mean()) / third


def asked(values, joint_assembly, **given):
    """What is found of a joint whose run says nothing by itself."""
    stopped = run(joint_assembly(False, **given), "adaptive-euler", 1e-6, limits=Limits(windows=0))
    return vibration(values, 0.05, stopped, 1, "bdf2", TOLERANCE)


def told(values, result, method="adaptive-euler", **_):
    found = vibration(values, 0.05, result, SAMPLES, method, TOLERANCE)
    return "" if found is None else found.note


@pytest.mark.slow
@pytest.mark.parametrize(("torque", "vibrates"), [(5, True), (20, False)])
def test_eigenvalues_and_an_undamped_run_agree(followed, torque, vibrates):
    """Two answers that share nothing but the equations of motion; a damping method is smooth at both torques."""
    values, smooth = followed(torque, **SMOOTH)
    assert unrest(smooth) < 0.01
    assert ("self-excited vibration at about" in told(values, smooth)) == vibrates
    undamped = followed(torque, **UNDAMPED)[1]
    assert (unrest(undamped) > 0.1) == vibrates
    assert told(values, undamped, **UNDAMPED) == told(values, smooth), "a property of the joint, not of the method"


UNEVEN = {"initial_skew_1_deg": 0.4, "initial_skew_2_deg": -0.4, "initial_skew_3_deg": 0.4}
RUBBING = {"torque_n_m": 25, "groove_sliding_friction": 0.1, "groove_spin_friction": 0.1} | UNEVEN


@pytest.mark.slow
@pytest.mark.parametrize(
    ("given", "lost"), [(RUBBING, 10.6), ({"torque_n_m": 7} | UNEVEN, 0.2)], ids=["a tenth lost", "nothing lost"]
)
def test_lumped_bearings_tell_what_needles_lose(joint_values, joint_assembly, given, lost):
    """Regression: percent of the third order that 27 needles lost in 4 revolutions (BDF2 at 1e-5 s, a minute a run).

    Departures grow 6 and 5 times in a revolution. Of points that lost up to 13, lumped bearings were off by 2 at most.
    """
    found = asked(joint_values(**given), joint_assembly, **given)
    assert float(re.search(r"lower by (\S+) %", found.note)[1]) == pytest.approx(lost, abs=2)
    assert found.invalidates == (lost > 5)


def test_the_reference_joint_does_not_vibrate(joint_values, joint_assembly):
    """Regression: nor did 27 needles in 4 revolutions (BDF2 at 1e-5 s)."""
    assert asked(joint_values(), joint_assembly) is None


@pytest.mark.parametrize("spoils", [True, False])
@pytest.mark.parametrize("model", ["rollers", "needles"])
def test_a_run_that_vibrates_says_so_and_is_refused_if_that_spoils_it(monkeypatch, model, spoils):
    monkeypatch.setattr(multibody_run, "vibration", lambda *_: Vibration(spoils, "the joint hums"))
    few = FEW if model == "needles" else {}
    result = td.simulate(model=model, cycles=2, **few)
    assert result.attrs["finished"] != spoils
    assert str(result["outcome_detail"].values) == "the joint hums"


def test_nothing_is_known_of_a_motion_that_stopped(followed):
    values, result = followed(5, **SMOOTH)
    assert told(values, replace(result, times=result.times[:100])) == ""


@pytest.mark.slow
def test_such_a_run_is_refused(simulated):
    result = simulated(**RUBBING)
    assert str(result["outcome"].values) == "2", "inaccurate"
    assert "self-excited vibration" in str(result["outcome_detail"].values)


def test_what_turns_freely_does_not_vibrate(simulated):
    """Without friction rollers turn as they like: departures grow with time, not exponentially."""
    frictions = ("groove_sliding", "groove_rolling", "needle_sliding", "needle_rolling")
    result = simulated(**{f"{name}_friction": 0.0 for name in frictions})
    assert str(result["outcome"].values) == "0", str(result["outcome_detail"].values)
