"""Joint angle, torque and speed of a record from its notes and the name of its file."""

from __future__ import annotations

import pytest

from tripod_doe.errors import InputError
from tripod_doe.measurements.measurement import read_measurement
from tripod_doe.measurements.operating_point import from_name, from_notes


@pytest.mark.parametrize(
    "notes",
    [
        ["joint angle = 8 deg, torque: 50 Nm, speed = 600 rpm"],
        ["Beugewinkel;8,0;°", "Antrieb", "Drehmoment [Nm];50", "Drehzahl: 10 1/s"],
        ["joint_angle_deg: 8", "torque_n_m: 50", "speed_rpm: 600"],
        ["Articulation angle (rad) = 0.13962634015954636", "Torque\t0.05 kNm", "n = 600 1/min", "Samples n = 7200"],
    ],
)
def test_notes_state_the_operating_point(notes):
    assert from_notes(notes) == pytest.approx({"joint_angle_deg": 8, "torque_n_m": 50, "speed_rpm": 600})


def test_what_is_no_operating_point_is_none():
    assert from_notes(["Torque sensor: 500 Nm", "n = 2000", "m: 3", "speed of light", "Channels: 4"]) == {}


def test_names_of_files():
    pattern = "rig_{joint_angle_deg}deg_{torque_nm}Nm*.csv"
    assert from_name("rig_8p5deg_-120Nm_run 3.csv", pattern) == {"joint_angle_deg": 8.5, "torque_n_m": -120}
    with pytest.raises(InputError, match=r"rig_8deg\.csv is of another form"):
        from_name("rig_8deg.csv", pattern)
    with pytest.raises(InputError, match="'pressure' is no parameter"):
        from_name("a", "{pressure}")


def test_a_pattern_takes_no_long_time():
    """Thirty stars over ninety digits took all the time that a plan may take."""
    for stars, message in ((3, "is of another form"), (30, "30 times \\*; at most 3 are allowed")):
        with pytest.raises(InputError, match=message):
            from_name("1" * 90 + ".csv", "*" * stars + "{joint_angle_deg}{torque_nm}{speed_rpm}Z.csv")


def test_name_and_notes_that_contradict_each_other_are_refused(tmp_path):
    path = tmp_path / "run_8.csv"
    path.write_text("# joint angle: 12 deg\nrotation_deg,thrust_n\n0,1\n1,2\n")
    with pytest.raises(InputError, match="joint_angle_deg is 8 by the name of the file and 12"):
        read_measurement(path, pattern="run_{joint_angle_deg}.csv")
    assert read_measurement(path, pattern="run_{needle_length_mm}.csv").operating["joint_angle_deg"] == 12
