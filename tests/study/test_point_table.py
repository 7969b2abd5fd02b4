"""A simulated point as people read it."""

from __future__ import annotations

import re

import numpy as np
import pytest

from tripod_doe.study.point_table import point_table
from tripod_doe.study.simulate import simulate_point


@pytest.fixture(scope="module")
def table() -> str:
    return point_table(simulate_point(model="equilibrium", joint_angle_deg=12, torque_n_m=80))


def rows(table: str, name: str) -> list[list[str]]:
    """Words of the lines below a name, the labels first."""
    below = table.split(f"{name} [")[1].splitlines()[1:]
    return [line.split() for line in below[: next(i for i, line in enumerate(below) if not line.startswith("    "))]]


def test_the_largest_order_comes_before_all_numbers(table):
    amplitude = np.asarray(
        simulate_point(model="equilibrium", joint_angle_deg=12, torque_n_m=80).outputs["thrust_amplitude"].data
    )
    assert f"\nLargest rotating order of the thrust force: 3 with {amplitude[3]:.3g} N, then 9 with" in table
    assert table.index("Largest rotating order") < table.index("Verdict")


def test_the_point_is_named_with_what_was_given(table):
    assert table.splitlines()[1] == "point  joint_angle_deg 12, torque_n_m 80, speed_rpm 600; model equilibrium"


def test_a_doubtful_point_names_the_flag_of_a_surer_model():
    """Regression: it named a key of study files."""
    table = point_table(simulate_point(joint_angle_deg=1, torque_n_m=50))
    assert "; check it with --model rollers (sure there, typically " in table
    assert 'model = "' not in table


def test_a_joint_without_thrust_has_no_largest_order():
    assert "Largest" not in point_table(simulate_point(model="equilibrium", torque_n_m=0))


def test_an_amplitude_of_zero_has_no_phase(table):
    amplitude = rows(table, "\nthrust_amplitude")[1]
    phase = rows(table, "\nthrust_phase_deg")[1]
    assert len(amplitude) == len(phase) == 13
    assert [value == "0" for value in amplitude] == [value == "-" for value in phase]
    assert amplitude[3] != "0"


def test_rows_have_their_labels_and_numbers_three_digits(table):
    first, *grooves = rows(table, "groove_thrust_amplitude")
    assert first == ["order", *map(str, range(13))]
    assert [row[:2] for row in grooves] == [["groove", str(groove)] for groove in (1, 2, 3)]
    point = simulate_point(model="equilibrium", joint_angle_deg=12, torque_n_m=80)
    expected = np.abs(np.asarray(point.outputs["groove_thrust_amplitude"].data)[0, 1])
    assert grooves[0][3] == f"{expected:.3g}"
    numbers = re.findall(r"(?<![\w.])\d+\.?\d*(?![\w.])", table)
    assert all(len(number.replace(".", "").strip("0")) <= 3 for number in numbers)


def test_the_cost_is_told_with_units(table):
    assert re.search(r"\ncost  CPU [\d.]+ m?s, wall [\d.]+ m?s, [\d,]+ steps?, [\d,]+ force evaluations?$", table)


def test_outputs_without_a_number_are_named_and_fill_no_table():
    """Regression: a roller that lifts off had a warning of NumPy and forty lines of "not known"."""
    message = point_table(simulate_point(model="kinetostatic", joint_angle_deg=21, torque_n_m=-6, speed_rpm=2900))
    assert message.startswith("outcome  out_of_range: a roller lifts off its groove")
    assert "\nNo value of groove_thrust_amplitude, " in message
    assert message.splitlines()[-2].endswith(": the point did not finish.")
    assert "[N]" not in message


def test_a_waveform_says_which_revolutions_it_holds(table):
    assert re.search(
        r"\nthrust  -[\d.]+ to [\d.]+ N over the last 2 of 4 revolutions \(rotation_deg 0 to 719\)\n", table
    )


def test_an_output_without_a_value_says_why():
    """Regression: "not known  vibrates"."""
    message = point_table(simulate_point(model="kinetostatic", joint_angle_deg=7, torque_n_m=180))
    assert "\nNo value of vibrates: whether the joint vibrates by itself, 1 or 0; where no recorded joint" in message
