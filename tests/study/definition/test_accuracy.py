"""Accuracy in studies: as a parameter and a factor, of orders that the table names, in cubes, keys and complaints."""

from __future__ import annotations

import numpy as np
import pytest

import tripod_doe as td
from tripod_doe.errors import InputError
from tripod_doe.study.cube.dataset import RECORD_ROLE
from tripod_doe.study.definition.study import canonical
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.designs import make_points
from tripod_doe.study.fingerprints import point_keys

pytestmark = pytest.mark.usefixtures("pages_not_made")

STUDY = """
[study]
name = "accurate"
[base]
model = "rollers"
samples_per_revolution = 60
cycles = 3
initial_skew_1_deg = 1.5
[factors.joint_angle_deg]
values = [10]
[keep]
outputs = ["thrust_amplitude", "thrust_amplitude_error"]
"""
ORDERS = "[accuracy]\nthrust_amplitude_2 = 0.02\n"


def run(text, tmp_path, write_study):
    summary = td.run(write_study(text), out=tmp_path / "out", workers=0, progress=False)
    assert summary.good
    return td.open_cube(tmp_path / "out")


def test_accuracy_is_a_factor_and_the_tolerance_found_stands_beside_the_error(tmp_path, write_study):
    cube = run(STUDY + "[factors.accuracy]\nvalues = [0.1, 0.001]\n", tmp_path, write_study).squeeze("joint_angle_deg")
    third = cube["thrust_amplitude"].sel(order=3)
    assert bool((cube["thrust_amplitude_error"].sel(order=3) <= cube["accuracy"] * third).all())
    rough, fine = cube["relative_tolerance_used"].values
    assert fine < rough / 2
    assert cube["force_evaluations"].values[1] > 1.5 * cube["force_evaluations"].values[0]
    assert cube["relative_tolerance_used"].attrs["role"] == RECORD_ROLE


def test_orders_of_the_table_decide(tmp_path, write_study):
    cube = run(STUDY + ORDERS, tmp_path, write_study).squeeze("joint_angle_deg")
    second, error = (float(cube[name].sel(order=2)) for name in ("thrust_amplitude", "thrust_amplitude_error"))
    assert error <= 0.02 * max(second, 0.01 * float(cube["thrust_amplitude"].max()))


def test_the_table_is_part_of_the_study():
    """Points that were refined to something else are other points, and a change is told."""
    plain, asked, tight = (parse_study(STUDY + table) for table in ("", ORDERS, ORDERS.replace("0.02", "0.01")))
    keys = [point_keys(study, make_points(study)).tobytes() for study in (plain, asked, tight)]
    assert len(set(keys)) == 3
    assert len({canonical(study).get("accuracy") for study in (plain, asked, tight)}) == 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("", "[accuracy]\nthrust_amplitud_2 = 0.1\n"), "did you mean 'thrust_amplitude_2'"),
        (("", "[accuracy]\n"), "name what must be accurate"),
        (("", ORDERS + "confidence = 0.9\n"), 'confidence: used with model = "auto" only'),
        (("", ORDERS + "[factors.accuracy]\nvalues = [0.1, 0.01]\n"), "accuracy is set as well"),
        (("cycles = 3", "relative_tolerance = 1e-3"), "relative_tolerance is set as well"),
        (("cycles = 3", "acuracy = 0.1"), "did you mean 'accuracy'"),
        (("cycles = 3", "accuracy = 0.9"), "accuracy = 0.9: must be"),
        (
            (
                '[base]\nmodel = "rollers"\nsamples_per_revolution = 60\ncycles = 3\ninitial_skew_1_deg = 1.5\n'
                '[factors.joint_angle_deg]\nvalues = [10]\n[keep]\noutputs = ["thrust_amplitude", "thrust_amplitude_error"]',
                'scene = "needle-between-plates"',
            ),
            r"\[accuracy\]",
        ),
    ],
)
def test_what_cannot_be_asked_is_refused(change, message):
    old, new = change
    text = STUDY + new if not old else STUDY.replace(old, new) + ORDERS
    assert old in STUDY
    with pytest.raises(InputError, match=message):
        parse_study(text)


def test_an_accuracy_without_effect_is_warned_of():
    study = parse_study(STUDY.replace("cycles = 3", "relative_tolerance = 1e-3\naccuracy = 0.1"))
    assert "accuracy has no effect where relative_tolerance is given" in study.warnings


def test_a_smaller_step_starts_from_the_tolerance_that_the_run_found(tmp_path, write_study):
    text = STUDY + '[run]\nretry = ["smaller-step"]\n'
    cube = run(text, tmp_path, write_study)
    assert cube["attempt"].values.tolist() == [0]
    assert 1e-4 < float(np.squeeze(cube["relative_tolerance_used"].values)) < 1e-2
