"""Records of a stranger's rig, in formats that no code of ours writes, from files to frictions."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.measurements.measurement import read_measurement
from tripod_doe.measurements.order_tracking import track_orders

STRANGER = runpy.run_path(str(Path(__file__).parents[2] / "benchmarks" / "stranger_rig.py"))
PATTERN = "Lauf * {joint_angle_deg}grad {torque_n_m}Nm.*"
PULSES = (1, 6, 60)
RECORDS = 4
FIT = f"""
[fit]
name = "a stranger's joint"
model_error = 0
starts = 1
[base]
model = "equilibrium"
needle_length_mm = 9.5
bearing_radial_clearance_mm = 0.02
roller_radius_mm = 15.5
needle_axial_clearance_mm = 0.25
[unknowns.groove_sliding_friction]
low = 0.02
high = 0.15
[unknowns.needle_sliding_friction]
low = 0.01
high = 0.1
[records]
files = ["Lauf *"]
pattern = "{PATTERN}"
sign = -1
orders = [3]
"""


def orders(point):
    values = {**STRANGER["HIDDEN"], **STRANGER["DRAWING"]}
    named = dict(zip(("joint_angle_deg", "torque_n_m", "speed_rpm"), map(float, point), strict=True))
    answer = td.simulate(model="equilibrium", **values, **named)
    return list(zip(answer["thrust_amplitude"].values, answer["thrust_phase_deg"].values, strict=True))


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stranger")
    make = STRANGER["make"]
    make.__globals__.update(orders_of=lambda model, points: list(map(orders, points)), SECONDS=1.2)
    make(folder, "equilibrium", RECORDS, 3)
    return folder


def test_every_record_is_read_without_a_word(rig):
    """The scatter between revolutions is that of the gain; no revolution is lost, and amplitudes are those of the joint."""
    for at, path in enumerate(sorted(rig.glob("Lauf*"))):
        angle, torque, rpm = STRANGER["POINTS"][at]
        measured = read_measurement(path, pattern=PATTERN, sign=-1)
        assert measured.operating["joint_angle_deg"] == angle
        assert measured.operating["torque_n_m"] == torque
        assert measured.pulses_per_revolution == PULSES[at % 3]
        tracked = track_orders(measured.rotation_deg, measured.thrust_n, measured.time_s)
        assert tracked.attrs["revolutions_left_out"] == 0
        assert tracked["speed_rpm"].values == pytest.approx(rpm, rel=0.02)
        third = tracked["thrust_amplitude"].sel(order=3)
        assert float(third.mean()) == pytest.approx(orders((angle, torque, rpm))[3][0], rel=0.01)
        assert float(third.std() / third.mean()) < 0.02


def test_a_point_without_an_answer_makes_no_record(tmp_path, capsys, monkeypatch):
    make, answers = STRANGER["make"], [orders(STRANGER["POINTS"][0]), [(np.nan, np.nan)] * 13]
    monkeypatch.setitem(make.__globals__, "orders_of", lambda model, points: answers)
    make(tmp_path, "rollers", 2, 3)
    assert [path.name for path in tmp_path.iterdir()] == ["Lauf 01 4grad 180Nm.asc"]
    assert "no record 2: rollers has no answer at (5, 90, 900)" in capsys.readouterr().err


def test_from_files_to_frictions(rig):
    (rig / "fit.toml").write_text(FIT)
    result = td.fit(rig / "fit.toml", rig / "out", workers=0, progress=False).result
    for name in ("groove_sliding_friction", "needle_sliding_friction"):
        own = result.sel(unknown=name)
        assert float(own["low"]) <= STRANGER["HIDDEN"][name] <= float(own["high"])
        assert own["verdict"].item() == "found"
    assert not np.any(result["left_out"])
    assert "60 pulses per revolution follow from the speed" in result.attrs["remarks"]
