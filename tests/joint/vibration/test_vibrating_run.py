"""When a vibration counts as followed: statistics of revolutions, and what is done next."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tripod_doe.joint.multibody.revolutions import Revolution, RevolvingJoint
from tripod_doe.joint.multibody.run_result import StoppedError, Wanted
from tripod_doe.joint.orders import ORDERS
from tripod_doe.joint.vibration.vibrating_run import follow_vibration
from tripod_doe.mechanics.integrators.registry import METHODS
from tripod_doe.mechanics.run import Limits, run
from tripod_doe.model_interface import Outcome

METHOD = METHODS["rosenbrock"]


class Turning:
    """A joint whose third order is 10 N, plus a share of the setting, plus chance, under a vibration that grows by half."""

    method, has_needles, evaluations_per_revolution = METHOD, False, 100.0

    def __init__(self, joint_values, by_steps=0.0, by_chance=0.0, growing=0, uneven=0.0, affordable=math.inf):
        self.values, self.by_steps, self.by_chance, self.growing = joint_values(), by_steps, by_chance, growing
        self.uneven, self.affordable = uneven, affordable
        self.rng, self.turns, self.settings, self.taken_over = np.random.default_rng(3), 0, [], []

    def follow(self, count, setting):
        self.settings.append(setting)
        self.affordable -= count
        assert self.affordable >= 0, "more was followed than the budget allows"
        return [self._turn(setting) for _ in range(count)]

    def change_to(self, setting):
        self.taken_over.append(setting)

    def _turn(self, setting):
        self.turns += 1
        thirds = np.zeros((3, ORDERS.size), complex)
        thirds[:, 3] = (
            10 + self.by_steps * setting + self.by_chance * math.sqrt(3) * (self.rng.normal(size=(3, 2)) @ [1, 1j])
        )
        thirds[:, 3] += self.uneven * np.array([1, -2, 1])
        unrests = np.full(3, 1.5 ** min(self.turns, self.growing))
        return Revolution(np.zeros((3, 4)), thirds, None, np.zeros(5), unrests, None, None, 0.0, 0.0)


def allowed(amplitudes):
    """Two percent of the third order."""
    errors = np.full(ORDERS.size, np.inf)
    errors[3] = 0.02 * amplitudes[3]
    return errors


def test_a_regular_vibration_is_followed_once_and_again_finer(joint_values):
    joint = Turning(joint_values)
    found = follow_vibration(joint, 4e-3, allowed)
    assert found.certain
    assert found.third == pytest.approx(10)
    assert (found.followed, joint.settings) == (4 + 2, [4e-3, 1e-3])
    assert joint.taken_over == [1e-3]


def test_a_vibration_that_builds_up_within_a_revolution_needs_two(joint_values):
    """Regression: six revolutions were followed, which at 35 rpm took 70 s."""
    joint = Turning(joint_values)
    found = follow_vibration(joint, 4e-3, allowed, builds_up=True)
    assert found.certain
    assert (joint.turns, found.revolutions, joint.settings) == (3, 2, [4e-3, 4e-3, 1e-3])


def test_one_revolution_tells_its_chance_by_thirds(joint_values):
    """Exact: 0.6 N of 10 N by chance are 12 %, where 2 % is allowed."""
    found = follow_vibration(Turning(joint_values, by_chance=0.6), 4e-3, allowed, builds_up=True)
    assert found.certain
    assert found.revolutions >= 36
    assert abs(found.third - 10) < found.readings.amplitude_error[3] <= 0.02 * found.third


def test_thirds_that_differ_alike_in_all_revolutions_are_no_chance(joint_values):
    """Uneven skews: a revolution by itself cannot tell, a second one does."""
    found = follow_vibration(Turning(joint_values, uneven=1.0), 4e-3, allowed, builds_up=True)
    assert found.certain
    assert found.followed <= 4
    assert found.readings.amplitude_error[3] < 1e-9


def test_growth_is_waited_for(joint_values):
    assert follow_vibration(Turning(joint_values, growing=9), 4e-3, allowed).followed > 18


def test_what_is_uneven_in_finer_steps_is_followed_on(joint_values):
    """Regression: certain orders of finer revolutions, which by chance grew, ended as not settled."""
    joint, unrest = Turning(joint_values), iter([1.0] * 4 + [1.0, 1.5, 2.0] + [1.5] * 100)
    turn = joint._turn
    joint._turn = lambda setting: replace(turn(setting), unrests=np.full(3, next(unrest)))
    found = follow_vibration(joint, 4e-3, allowed)
    assert found.steady
    assert found.certain
    assert found.followed > 6


def test_chance_asks_for_revolutions_and_leaves_an_honest_error(joint_values):
    """Exact: the mean of n revolutions with a standard deviation of 0.6 N is off by 2 * 0.6 / sqrt n at most."""
    found = follow_vibration(Turning(joint_values, by_chance=0.6), 4e-3, allowed)
    assert found.certain
    assert found.revolutions >= 36
    assert found.followed < 100, "161 were followed when steps were told from as many revolutions as the answer"
    assert abs(found.third - 10) < found.readings.amplitude_error[3] <= 0.02 * found.third


def test_steps_that_matter_are_refined(joint_values):
    """Exact: an error in proportion to the setting is a third of what the setting's quarter changed."""
    joint = Turning(joint_values, by_steps=500.0)
    found = follow_vibration(joint, 4e-3, allowed)
    assert found.setting == pytest.approx(4e-3 / 16)
    assert found.readings.amplitude_error[3] == pytest.approx(found.third - 10)


def test_a_vibration_that_never_settles_says_so(joint_values):
    found = follow_vibration(Turning(joint_values, growing=1000), 4e-3, allowed)
    assert not found.steady
    assert not found.certain


@pytest.mark.parametrize("affordable", [8, 20, 30])
def test_a_budget_leaves_an_answer_with_its_error_and_what_certainty_would_take(joint_values, affordable):
    """Regression: 1,900 CPU-s of needles ended without a number. Certainty takes about 60 revolutions here."""
    joint = Turning(joint_values, by_chance=0.6, affordable=affordable)
    found = follow_vibration(joint, 4e-3, allowed)
    assert not found.certain
    assert joint.turns > affordable / 2
    assert abs(found.third - 10) < found.readings.amplitude_error[3]
    assert 1000 < found.lacking < 50_000


def test_more_cycles_than_are_ever_followed_are_followed(joint_values):
    joint = Turning(lambda: joint_values(cycles=200))
    assert follow_vibration(joint, 4e-3, allowed).followed == 202


@pytest.fixture
def stopping(monkeypatch, joint_values, joint_assembly):
    """A joint whose revolutions stop unless their step is below 1e-5 s, by the outcome that is given."""
    real = run(joint_assembly(False), "bdf2", 1e-9, step=1e-9, limits=Limits(windows=0))

    def make(outcome):
        tried = []

        def turn(self, setting, duration):
            tried.append(setting)
            if setting > 1e-5:
                raise StoppedError(replace(real, outcome=outcome))
            return real

        monkeypatch.setattr(RevolvingJoint, "_tried", turn)
        monkeypatch.setattr(RevolvingJoint, "_read", lambda self, result: result)
        return RevolvingJoint(
            joint_assembly(False), joint_values(), METHODS["bdf2"], Wanted(60), Limits(), 10**6
        ), tried

    return make


def test_a_revolution_that_stops_is_followed_in_shorter_steps(stopping):
    """Regression: 27 needles of 5 mm that vibrate at 726 Hz diverged 2.5 ms after their start, with steps of 3e-5 s."""
    joint, tried = stopping(Outcome.DIVERGED)
    assert len(joint.follow(1, 3e-5)) == 1
    assert tried == [3e-5, 1.5e-5, 0.75e-5]


def test_long_steps_with_which_most_revolutions_stop_are_given_up(stopping):
    joint, tried = stopping(Outcome.DIVERGED)
    joint.follow(4, 3e-5)
    assert tried[3:] == [3e-5, 1.5e-5, 0.75e-5, 1.5e-5, 0.75e-5, 0.75e-5]


def test_a_stop_by_chance_leaves_the_steps_of_the_next_revolutions(stopping):
    """Regression: all revolutions after it cost twice as much, after three of them eight times."""
    joint, tried = stopping(Outcome.DIVERGED)
    joint.follow(6, 0.9e-5)
    joint.follow(1, 1.2e-5)
    joint.follow(1, 0.9e-5)
    assert tried[6:] == [1.2e-5, 0.6e-5, 0.9e-5]


@pytest.mark.parametrize(("outcome", "count"), [(Outcome.DIVERGED, 4), (Outcome.EVALUATION_LIMIT, 1)])
def test_what_stops_with_all_steps_or_for_its_budget_ends(stopping, outcome, count):
    joint, tried = stopping(outcome)
    with pytest.raises(StoppedError):
        joint.follow(1, 1.0)
    assert len(tried) == count
