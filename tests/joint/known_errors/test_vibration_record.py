"""What is on record of joints that vibrate by themselves, and what it makes of the errors of models without vibration."""

from __future__ import annotations

import numpy as np
import pytest
from operating_points import points

from tripod_doe.joint.known_errors import vibration_record
from tripod_doe.joint.known_errors.error_estimate import WITHOUT_VIBRATION, known_errors, similar_errors
from tripod_doe.joint.known_errors.vibration_record import SHARE, may_vibrate, vibration_errors, vibration_share
from tripod_doe.joint.models.registry import MODELS
from tripod_doe.joint.simulator import simulator
from tripod_doe.model_interface import Accuracy, Quantity, model_notes

FLUTTERING = {"joint_angle_deg": 17.0, "torque_n_m": -300.0, "speed_rpm": 1500.0, "groove_sliding_friction": 0.15}
"""Its third order is 391 N without vibration, and 255 N with it by three methods (docs/explanation/vibration.md)."""


def test_a_joint_is_compared_with_the_recorded_ones_nearest_in_angle_and_friction(monkeypatch, tmp_path):
    """Exact: ten joints at one place, three of which lose a fifth of their third order; ten far from them."""
    rows = ["10,0.1,0.03,-0.2"] * 3 + ["10,0.1,0.03,0"] * 7 + ["2,0.01,0.03,0"] * 10
    head = ["# some", "joint_angle_deg,groove_friction,needle_friction,third_changed"]
    (tmp_path / "some.csv").write_text("\n".join([*head, *rows]))
    monkeypatch.setattr(vibration_record, "VIBRATING", tmp_path / "some.csv")
    vibration_record._recorded.cache_clear()
    try:
        block = points(joint_angle_deg=[11.0, 2.0], groove_sliding_friction=[0.09, 0.02])
        np.testing.assert_allclose(vibration_share(vibration_errors(block)), [0.3, 0])
        np.testing.assert_allclose(np.sort(vibration_errors(block)[0])[-4:], [0, 0.25, 0.25, 0.25])
        off = points(joint_angle_deg=[11.0], groove_sliding_friction=[0.09], groove_sliding=[0.0])
        assert vibration_share(vibration_errors(off)) == 0  # without sliding friction in the grooves none is compared
    finally:
        vibration_record._recorded.cache_clear()


def test_nine_in_ten_recorded_joints_are_within_the_limit_of_the_others_like_them():
    """Each joint of the record left out in turn; of those that may vibrate, since most others are within by nothing."""
    places, errors, _ = vibration_record._recorded()
    within = []
    for at in range(len(errors)):
        others = np.arange(len(errors)) != at
        apart = np.square(places[others] - places[at]).sum(1)
        alike = np.sort(errors[others][np.argsort(apart, kind="stable")[:10]])
        if alike[-1] > 0:
            within.append(errors[at] <= alike[-1])
    assert len(within) > 50
    assert 0.8 < np.mean(within) < 0.98


@pytest.mark.parametrize("model", WITHOUT_VIBRATION)
def test_a_balance_states_what_vibration_may_make_of_its_error(model):
    """Regression: `kinetostatic` stated at most 0.3 % where it was off by 50 to 120 % (seed 230116 of the field)."""
    block = points(model=np.array([model], object), **FLUTTERING)
    _, limit, unknown = known_errors(model, block)
    assert unknown[0] or limit[0] > 0.53
    (share,) = vibration_share(vibration_errors(block))
    assert share > 0.1  # where the range of balances ends
    assert any(SHARE in told for told in model_notes(simulator, block, {}))


def test_joints_of_little_friction_keep_their_errors_and_their_range():
    block = points(joint_angle_deg=[5.0, 10.0], groove_sliding_friction=0.05)
    _, limit, _ = known_errors("kinetostatic", block)
    assert (limit < 0.02).all()
    assert not vibration_share(vibration_errors(block)).any()


def test_a_choice_counts_what_vibration_makes_of_similar_errors():
    accuracy = Accuracy(
        (
            Quantity("thrust_amplitude_3", "thrust_amplitude", 3, 0.03),
            Quantity("thrust_amplitude_2", "thrust_amplitude", 2, 0.1),
        ),
        0.01,
    )
    block = points(**FLUTTERING | {"groove_sliding_friction": 0.1})
    vibrates = vibration_errors(block)[0] > 0
    third, second = similar_errors("kinetostatic", block, accuracy)[0].T
    assert vibrates.any()
    assert np.isnan(second[vibrates]).all()
    assert not (third[vibrates] < vibration_errors(block)[0][vibrates] / 0.03).any()


def test_models_that_follow_vibrations_have_no_such_range():
    for name, model in MODELS.items():
        assert (SHARE in {valid.quantity for valid in model.valid}) == (name in WITHOUT_VIBRATION)


def test_a_joint_may_vibrate_by_the_friction_of_its_needles():
    """Regression: a joint with this needle friction vibrates (18.3 deg, -206 N m, 1,625 rpm: 850 Hz).

    Such joints were not looked at, since only angle and groove friction were compared.
    """
    angle, groove = np.array([18.304, 18.304]), np.array([0.054, 0.054])
    assert may_vibrate(angle, groove, np.array([0.01, 0.102])).tolist() == [False, True]
