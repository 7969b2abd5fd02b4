"""What becomes of a joint that vibrates: which runs are followed, which may do without, and what they say."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from tripod_doe.joint.multibody.run_result import Readings, StoppedError, Wanted
from tripod_doe.joint.orders import ORDERS
from tripod_doe.joint.vibration.growing_vibration import Vibration
from tripod_doe.joint.vibration.vibrating_run import FollowedVibration
from tripod_doe.joint.vibration.vibration_effect import VibratingJoint
from tripod_doe.mechanics.run import Limits
from tripod_doe.mechanics.stability.floquet import Growth
from tripod_doe.model_interface import Outcome

SMOOTH = Vibration(Growth(3.0, 10.0, 2 * math.pi * 700), third=10.0, unrest=0.1)


def followed_to(third, unrest=5.0, certain=True, lacking=0.0):
    """What following it came to."""
    readings = Readings(
        np.zeros((4, 3, 30)),
        None,
        np.zeros(5),
        np.full(ORDERS.size, 0.1),
        None,
        None,
        penetration=0.0,
        energy_residual=0.0,
    )
    return FollowedVibration(
        4,
        11,
        1e-3,
        third,
        0.2,
        unrest,
        steady=certain or lacking > 0,
        certain=certain,
        lacking=lacking,
        readings=readings,
    )


@pytest.fixture
def vibrating(monkeypatch, joint_values):
    """A joint of which is known what following it comes to; that of needles is 9 N."""

    def make(lumped):
        joint = VibratingJoint(joint_values(), SMOOTH, Wanted(30), Limits(), lambda a: 0.02 * a)
        outcomes = {False: lumped, True: followed_to(9.0)}
        asked = SimpleNamespace(needles=[])

        def follow(self, needles):
            asked.needles.append(needles)
            return outcomes[needles]

        monkeypatch.setattr(VibratingJoint, "_followed", follow)
        monkeypatch.setattr(
            "tripod_doe.joint.vibration.vibration_effect.damping_against", lambda *_: "contact_damping_time_s = 1.6e-05"
        )
        return joint, asked

    return make


def test_rollers_are_followed(vibrating):
    joint, _ = vibrating(followed_to(9.5))
    answer = joint.answer(needles=False)
    assert answer.outcome == Outcome.FINISHED
    for part in ("at about 700 Hz", "9.5 +- 0.1 N", "10 N without", "contact_damping_time_s = 1.6e-05 it would not"):
        assert part in answer.detail


def test_what_comes_to_nothing_is_no_vibration(vibrating):
    joint, _ = vibrating(followed_to(10.0, unrest=0.11))
    assert joint.answer(needles=False) is None
    assert joint.verdict(10.0, 0.05) == (Outcome.FINISHED, "")
    assert joint.answer(needles=False, anyhow=True).outcome == Outcome.FINISHED


@pytest.mark.parametrize(("lumped", "asked"), [(9.85, [False]), (9.0, [False, True])])
def test_needles_are_followed_where_it_matters(vibrating, lumped, asked):
    """2 % of 10 N may be off, of which 0.1 N is not known."""
    joint, seen = vibrating(followed_to(lumped))
    answer = joint.answer(needles=True)
    assert seen.needles == asked
    assert (answer is None) == (len(asked) == 1)


@pytest.mark.parametrize(
    ("third", "outcome"), [(9.1, Outcome.FINISHED), (10.0, Outcome.INACCURATE), (None, Outcome.INACCURATE)]
)
def test_a_run_whose_method_is_chosen_is_compared(vibrating, third, outcome):
    joint, _ = vibrating(followed_to(9.0))
    found, note = joint.verdict(third, 0.05)
    assert found == outcome
    assert "the third order is 9 N with it and 10 N without it" in note
    assert ("leave out method" in note) == (outcome == Outcome.INACCURATE)


def test_what_has_not_settled_is_no_result(vibrating):
    joint, _ = vibrating(followed_to(9.0, certain=False))
    answer = joint.answer(needles=False)
    assert answer.outcome == Outcome.INACCURATE
    assert "after 11 revolutions it has not settled" in answer.detail


def test_what_the_budget_leaves_uncertain_says_what_is_lacking(vibrating):
    joint, _ = vibrating(followed_to(9.0, certain=False, lacking=312_000))
    answer = joint.answer(needles=False)
    assert (answer.outcome, answer.readings.amplitude_error[3]) == (Outcome.INACCURATE, 0.1)
    assert answer.detail.endswith(
        "is not as certain as required, which would take about 3e+05 more force evaluations; "
        "raise evaluation_budget, accuracy or contact damping"
    )


@pytest.mark.parametrize(("needles", "count", "told"), [(True, 20, True), (True, 26, False), (False, 20, False)])
def test_needles_that_a_vibration_shakes_together_are_named(monkeypatch, joint_values, needles, count, told):
    """27 needles fit; with one less no pack of them leaves room for another."""
    joint = VibratingJoint(joint_values(needle_count=count), SMOOTH, Wanted(30), Limits(), lambda a: 0.02 * a)
    bodies = SimpleNamespace(has_needles=needles, steps=1, solves=1, force_evaluations=1, state=None)

    def stop(self, needles):
        self._joints.append(bodies)
        raise StoppedError(SimpleNamespace(outcome=Outcome.INACCURATE, detail="a penetration is outside the law"))

    monkeypatch.setattr(VibratingJoint, "_followed", stop)
    answer = joint.answer(needles=needles)
    assert answer.outcome == Outcome.INACCURATE
    assert ("there is room for 7 more: raise needle_count" in answer.detail) == told


def test_what_vibrates_only_after_a_kick_says_so(monkeypatch, joint_values):
    kept_up = Vibration(Growth(1.0, 0.0, 0.0), third=10.0, unrest=0.0)
    joint = VibratingJoint(joint_values(), kept_up, Wanted(30), Limits(), lambda a: 0.02 * a)
    monkeypatch.setattr(VibratingJoint, "_followed", lambda self, needles: followed_to(9.5))
    answer = joint.answer(needles=False)
    assert answer.outcome == Outcome.FINISHED
    assert answer.detail.startswith("the motion does not repeat, though small departures from it die out; followed by")
    assert answer.detail.endswith("10 N without the vibration; a kick such as the start keeps it up")
