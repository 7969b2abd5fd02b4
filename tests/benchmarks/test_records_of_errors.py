"""The benchmarks that make the records of errors and of vibrating joints, in a tiny form."""

from __future__ import annotations

import pandas as pd
import pytest

import tripod_doe as td

STUDY = """
[study]
name = "Two joints"
question = "What do the rollers do?"
[base]
model = "rollers"
cycles = 2
[factors]
joint_angle_deg = { values = [8, 9] }
[keep]
outputs = ["thrust_amplitude", "thrust_amplitude_error"]
"""


@pytest.fixture
def recorder(benchmark):
    return benchmark("model_error")


def test_a_joint_that_vibrates_is_known_as_one(recorder):
    """A joint of little torque and speed, and the reference joint."""
    vibrates = {"joint_angle_deg": 10.0, "torque_n_m": 5.0, "speed_rpm": 300.0}
    assert recorder.vibrates(vibrates)
    assert not recorder.vibrates({"joint_angle_deg": 10.0})


def test_errors_of_the_balances_are_recorded_beside_those_that_are_there(recorder, tmp_path, monkeypatch):
    """A study of two points added to a record of one; none of a joint that vibrates."""
    (tmp_path / "two.toml").write_text(STUDY)
    td.run(tmp_path / "two.toml", out=tmp_path / "two", workers=0)
    known = tmp_path / "errors.csv"
    known.write_text(
        "# made before\njoint_angle_deg,speed_rpm,needles,needles_2,equilibrium,equilibrium_2,kinetostatic,"
        "kinetostatic_2,rollers,rollers_2\n3,700,1,0.1,0.2,0.3,0.4,0.5,0.6,0.7\n"
    )
    monkeypatch.setattr(recorder, "RECORDED", known)
    monkeypatch.setattr(recorder, "vibrates", lambda point: point["joint_angle_deg"] == 9)
    recorder.main([tmp_path / "two"], add=True)
    head, _ = known.read_text().split("\n", 1)
    assert head.startswith("# made before; kernels ")
    table = pd.read_csv(known, comment="#")
    assert table["joint_angle_deg"].tolist() == [3, 8, 9]
    assert (table["speed_rpm"] == [700, 600, 600]).all()  # of the reference joint where it was not varied
    assert table["kinetostatic"][0] == 0.4
    assert abs(table["kinetostatic"][1]) < 0.02
    assert table["kinetostatic"].isna().tolist() == [False, False, True]


def test_a_record_is_renewed_where_models_have_changed(recorder, monkeypatch):
    """Rows beside needles get today's answers, relative to the third order that equilibrium's error implies."""
    monkeypatch.setattr(recorder, "vibrates", lambda point: point["joint_angle_deg"] == 10)
    renewed = ("kinetostatic", "rollers")
    known = pd.DataFrame({"joint_angle_deg": [9.0, 10.0, 9.0], "needles": [1, 1, 0], "needles_2": 0.01}).assign(
        equilibrium=-0.02, **{f"{model}{order}": 0.5 for model in renewed for order in ("", "_2")}
    )
    third = {
        model: float(td.simulate(model=model, joint_angle_deg=9).thrust_amplitude.sel(order=3))
        for model in ("equilibrium", *renewed)
    }
    found = recorder.renewed(known, list(renewed))
    for model in renewed:
        assert found[model][0] == pytest.approx(0.98 * third[model] / third["equilibrium"] - 1, abs=2e-3)
        assert found[f"{model}_2"][0] < 0.1
    assert found.loc[1, ["rollers", "rollers_2"]].isna().all()
    pd.testing.assert_frame_equal(found.drop(index=[0, 1]), known.drop(index=[0, 1]))
