"""Joint angle, torque and speed of a record from its notes and the name of its file."""

from __future__ import annotations

from time import process_time

import pytest

from tripod_doe.errors import InputError
from tripod_doe.measurements.measurement import read_measurement
from tripod_doe.measurements.operating_point import from_name, from_notes


def values(notes):
    return {name: statement.value for name, statement in from_notes(notes).items()}


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
    assert values(notes) == pytest.approx({"joint_angle_deg": 8, "torque_n_m": 50, "speed_rpm": 600})


def test_what_is_no_operating_point_is_none():
    assert from_notes(["Torque sensor: 500 Nm", "n = 2000", "m: 3", "speed of light", "Channels: 4"]) == {}


@pytest.mark.parametrize(
    ("note", "value"),
    [
        ("Torque: 50 in-lb", 50 * 4.4482216152605 * 0.3048 / 12),
        ("Torque: 50 N m (set)", 50),
        ("Torque (actual) = 50 Nm", 50),
        ("Drehmoment;1.200,5;Nm", 1200.5),
        ("Drehmoment: 1'200 Nm", 1200),
        ("Torque: 0.125 kNm", 125),
        ("Torque: 50.000 Nm", 50),
        ("Torque: -50, speed: 600 rpm", -50),
        ("Torque = 1,200,000 Nmm", 1200),
        ("Torque: 50; drive", 50),
    ],
)
def test_numbers_and_units_of_notes(note, value):
    assert values([note])["torque_n_m"] == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("note", "reason"),
    [
        ("Torque: 1,200 Nm", "1,200 may be 1.2 or 1200"),
        ("Speed: 1.500 U/min", "1.500 may be 1.5 or 1500"),
        ("Torque: 1 200 Nm", "200 is no known unit"),
        ("Torque: 100-200 Nm", "-200 is no known unit"),
        ("Torque: 0x10", "x10 is no known unit"),
        ("Torque: 50 kgf cm", "kgf is no known unit"),
        ("Torque [MNm]: 50", "MNm is no known unit"),
        ("Torque;50;kN", "kN is no known unit"),
        ("Torque: 1e400 Nm", "may be infinite"),
        ("Joint angle: 480'", "' is no known unit"),
        ("Joint angle: 8°30'", "°30' is no known unit"),
        ("Joint angle: 8° 30'", "minutes of arc"),
        ("Joint angle: 8 deg 30 min", "minutes of arc"),
        ("Speed: 25 knots", "knots is no known unit"),
    ],
)
def test_what_may_mean_something_else_is_not_used(note, reason):
    """Each was taken for a value: 1.2 N m, 1.5 rpm, 8 deg, 50 N m."""
    ((statement),) = from_notes([note]).values()
    assert statement.value != statement.value  # NaN
    assert reason in statement.trouble


def test_lines_that_contradict_each_other_are_not_used():
    assert values(["max. torque: 400 Nm", "Torque: 50 Nm", "Torque 2 = 51 Nm", "Torque: 51 Nm"]) == {"torque_n_m": 50}
    assert "another line is 'Torque: 80 Nm'" in from_notes(["Torque: 50 Nm", "Torque: 80 Nm"])["torque_n_m"].trouble


@pytest.mark.parametrize("piece", ["(n", ";m[", "n=1" + 200 * " ", "torque "])
def test_long_notes_take_no_long_time(piece):
    """82 kB of brackets took a minute."""
    began = process_time()
    assert from_notes([piece * 40_000, *10_000 * [(piece * 500)[:500]]]) == {}
    assert process_time() - began < 5


def test_names_of_files():
    pattern = "rig_{joint_angle_deg}deg_{torque_nm}Nm*.csv"
    assert from_name("rig_8p5deg_-120Nm_run 3.csv", pattern) == {"joint_angle_deg": 8.5, "torque_n_m": -120}
    with pytest.raises(InputError, match=r"rig_8deg\.csv does not match this pattern"):
        from_name("rig_8deg.csv", pattern)
    with pytest.raises(InputError, match="'pressure' is no parameter"):
        from_name("a", "{pressure}")
    for number in ("1,200", "1.200"):
        with pytest.raises(InputError, match=f"speed_rpm: {number} may be 1.2 or 1200"):
            from_name(f"rig_{number}rpm.csv", "rig_{speed_rpm}rpm.csv")
    assert from_name("rig_8.125deg_1p200rpm.csv", "rig_{joint_angle}deg_{speed}rpm.csv") == {
        "joint_angle_deg": 8.125,
        "speed_rpm": 1.2,
    }


def test_a_pattern_takes_no_long_time():
    """Thirty stars over ninety digits took all the time that a plan may take."""
    for stars, message in ((3, "does not match this pattern"), (30, "30 times \\*; at most 3 are allowed")):
        with pytest.raises(InputError, match=message):
            from_name("1" * 90 + ".csv", "*" * stars + "{joint_angle_deg}{torque_nm}{speed_rpm}Z.csv")


def test_name_and_notes_that_contradict_each_other_are_refused(tmp_path):
    path = tmp_path / "run_8.csv"
    path.write_text("# joint angle: 12 deg\nrotation_deg,thrust_n\n0,1\n1,2\n")
    with pytest.raises(InputError, match="joint_angle_deg is 8 by the name of the file and 12"):
        read_measurement(path, pattern="run_{joint_angle_deg}.csv")
    measured = read_measurement(path, pattern="run_{needle_length_mm}.csv")
    assert measured.operating["joint_angle_deg"] == 12
    assert measured.columns == "joint_angle_deg = 12 from 'joint angle: 12 deg'"


def test_name_and_notes_differ_by_a_twentieth_at_small_angles_too(tmp_path):
    """Regression: 0.2 deg counted as no difference, at 2 deg a tenth."""
    path = tmp_path / "run_2.15.csv"
    path.write_text("# joint angle: 2 deg\nrotation_deg,thrust_n\n0,1\n1,2\n")
    with pytest.raises(InputError, match=r"joint_angle_deg is 2\.15 by the name of the file and 2 by its first lines"):
        read_measurement(path, pattern="run_{joint_angle_deg}.csv")


def test_notes_and_columns_that_contradict_each_other_are_refused_and_doubtful_lines_are_named(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("# torque: 400 Nm\nrotation_deg,thrust_n,torque_n_m\n0,1,50\n1,2,50\n")
    with pytest.raises(InputError, match="torque_n_m is 50 by its column and 400 by its first lines"):
        read_measurement(path)
    path.write_text("# torque: 1,200 Nm\nrotation_deg,thrust_n\n0,1\n1,2\n")
    measured = read_measurement(path)
    assert measured.operating == {}
    assert measured.remarks[0].startswith("The line 'torque: 1,200 Nm' of the record is not used for torque_n_m: ")
