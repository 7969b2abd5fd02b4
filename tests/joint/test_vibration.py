"""The joint that vibrates by itself: told by the stability of its smooth motion, seen in a run that damps nothing."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from few import FEW

from tripod_doe.joint.readings import groove_thrust
from tripod_doe.joint.vibration import vibration
from tripod_doe.mechanics.monitor import Settings
from tripod_doe.mechanics.run import Limits, run

REVOLUTIONS, SAMPLES, TOLERANCE = 3, 180, 4e-3
SMOOTH, UNDAMPED = {"method": "adaptive-euler"}, {"method": "generalized-alpha", "step": 3e-5}


@pytest.fixture(scope="module")
def followed(joint_values, joint_assembly):
    """A run at 300 rpm and another torque than usual."""

    def follow(torque, method, needles=False, step=None):
        given = {"torque_n_m": torque, "speed_rpm": 300} | (FEW if needles else {})
        values = joint_values(**given)
        duration = REVOLUTIONS * 2 * math.pi / values["speed_rpm"]
        result = run(
            joint_assembly(needles, **given), method, duration, step=step, samples=REVOLUTIONS * SAMPLES,
            settings=Settings(tolerance=TOLERANCE), limits=Limits(windows=0),
        )  # fmt: skip
        return values, result

    return follow


def unrest(result):
    """Effective difference of the thrust in the last two revolutions over its third order."""
    thrust = groove_thrust(result.assembly, result.positions, result.velocities).sum(0)[1:].reshape(-1, SAMPLES)
    third = 2 * abs(np.fft.rfft(thrust[-1])[3]) / SAMPLES
    return math.sqrt(2 * ((thrust[-1] - thrust[-2]) ** 2).mean()) / third


def told(values, result, method="adaptive-euler", **_):
    return vibration(values, result, SAMPLES, method, TOLERANCE)


@pytest.mark.parametrize(("torque", "vibrates"), [(5, True), (20, False)])
def test_eigenvalues_and_an_undamped_run_agree(followed, torque, vibrates):
    """Two answers that share nothing but the equations of motion; a damping method is smooth at both torques."""
    values, smooth = followed(torque, **SMOOTH)
    assert unrest(smooth) < 0.01
    assert ("vibrates by itself at about" in told(values, smooth)) == vibrates
    undamped = followed(torque, **UNDAMPED)[1]
    assert (unrest(undamped) > 0.1) == vibrates
    assert told(values, undamped, **UNDAMPED) == told(values, smooth), "a property of the joint, not of the method"


def test_nothing_is_said_of_needles_that_rattle(followed):
    values, result = followed(5, needles=True, **SMOOTH)
    assert told(values, result) == ""


def test_nothing_is_known_of_a_motion_that_stopped(followed):
    values, result = followed(5, **SMOOTH)
    assert told(values, replace(result, times=result.times[:100])) == ""


def test_such_a_run_is_refused(simulated):
    result = simulated(torque_n_m=5, speed_rpm=300)
    assert str(result["outcome"].values) == "2", "inaccurate"
    assert "vibrates by itself" in str(result["outcome_detail"].values)


def test_what_turns_freely_does_not_vibrate(simulated):
    """Without friction rollers turn as they like: departures grow with time, not exponentially."""
    frictions = ("groove_sliding", "groove_rolling", "needle_sliding", "needle_rolling")
    result = simulated(**{f"{name}_friction": 0.0 for name in frictions})
    assert str(result["outcome"].values) == "0", str(result["outcome_detail"].values)
