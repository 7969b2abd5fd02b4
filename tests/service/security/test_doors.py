"""Three doors, the same numbers: command line, Python, HTTP."""

from __future__ import annotations

import io
import json
import math
from contextlib import redirect_stdout

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from service_client import COAST

import tripod_doe as td
from equal_cubes import compare
from tripod_doe.cli import main

FEW = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])

CHOICES = {
    "joint_angle_deg": ["2.5", "17", "2.5,17", "0:10", ":", "16", "99"],
    "speed_rpm": ["150", "4000", "100:200", "150,4000", "149.9"],
    "bearing_radial_clearance_mm": ["0.02", "-0.05", "-1:0", "0.019"],
    "order": ["3", "0", "12", "1:4", "2,3", "99", "x"],
    "groove": ["1", "2,3", "4"],
    "torque_n_m": ["-35"],
}
VARIABLES = [
    "thrust_rms",
    "thrust_amplitude",
    "groove_thrust_amplitude",
    "outcome",
    "outcome_detail",
    "steps",
    "thrust",
]
CONDITIONS = [
    None,
    "outcome == 'finished'",
    "thrust_rms > 0.1",
    "joint_angle_deg * 2 < speed_rpm",
    "order != 3",
    "1 / 0 > 1",
]

questions = st.fixed_dictionaries(
    {
        "variable": st.sampled_from(VARIABLES),
        "select": st.lists(
            st.sampled_from(sorted(CHOICES)).flatmap(
                lambda name: st.sampled_from(CHOICES[name]).map(lambda value: f"{name}={value}")
            ),
            max_size=3,
        ),
        "nearest": st.booleans(),
        "where": st.sampled_from(CONDITIONS),
    }
)

points = st.fixed_dictionaries(
    {"joint_angle_deg": st.floats(0.5, 25), "torque_n_m": st.floats(-400, 400), "speed_rpm": st.floats(5, 5000)},
    optional={
        "groove_sliding_friction": st.floats(0, 0.2),
        "initial_skew_2_deg": st.floats(-1, 1),
        "bearing_radial_clearance_mm": st.sampled_from([0.0, -0.05, 0.3]),
        "needle_count": st.integers(5, 40),
        "model": st.sampled_from(["equilibrium", "equilibrum"]),
    },
)


def called(*words):
    """Exit code and standard output of a command."""
    with redirect_stdout(io.StringIO()) as told:
        code = main([str(word) for word in words])
    return code, told.getvalue()


@pytest.mark.slow
@FEW
@given(question=questions)
def test_a_question_has_one_answer(api, coast, settings, question):
    """Invariance: command line, HTTP and Python give the same cells or refuse the same question, for random questions."""
    directory = settings.folder / coast
    selections = [word for selection in question["select"] for word in ("--select", selection)]
    flags = ["--nearest"] * question["nearest"] + (["--where", question["where"]] if question["where"] else [])
    code, told = called("query", directory, "--variable", question["variable"], *selections, *flags, "--format", "json")
    answer = api.get(
        f"/runs/{coast}/query", params={name: value for name, value in question.items() if value is not None}
    )
    assert (code, answer.status_code) in ((0, 200), (2, 422))
    if code:
        with pytest.raises(td.InputError):
            td.query(directory, **question)
        return
    assert answer.json() == json.loads(told)
    cells = td.query(directory, **question)
    values = cells[question["variable"]].values
    kept = values[cells["selected"].values] if "selected" in cells else values.ravel()
    shown = [row[question["variable"]] for row in answer.json()]
    if question["variable"] == "outcome":
        assert [td.Outcome(int(value)).label for value in kept] == shown
    else:
        assert [None if isinstance(value, float) and math.isnan(value) else value for value in kept.tolist()] == shown


@settings(FEW, max_examples=10)
@given(point=points)
def test_a_point_has_one_answer(api, point):
    point = {"model": "equilibrium"} | point
    code, told = called(
        "simulate", *(f"--{name}={value!r}".replace("'", "") for name, value in point.items()), "--format=json"
    )
    answer = api.post("/simulate", point)
    assert (code, answer.status_code) in ((0, 200), (3, 200), (2, 422))
    if code == 2:
        with pytest.raises(td.InputError):
            td.simulate(**point)
        return
    own, other = json.loads(told), answer.json()
    assert own.pop("cost").keys() == other.pop("cost").keys()
    assert own == other
    simulated = td.simulate(**point)
    assert (own["outcome"] == "finished") == simulated.attrs["finished"]
    if own["outcome"] == "finished":
        np.testing.assert_array_equal(simulated["thrust_amplitude"].values, own["thrust_amplitude"])


@pytest.mark.slow
@pytest.mark.usefixtures("pages_not_made")
def test_a_study_has_one_cube(api, coast, settings, write_study, tmp_path):
    td.run(write_study(COAST), out=tmp_path / "out", workers=0, progress=False)
    cubes = td.open_cube(tmp_path / "out"), td.open_cube(settings.folder / coast)
    assert not list(compare(*cubes))
