"""Records of a force sensor whose sign is not known: one sign for all of them, whatever joints they are of."""

from __future__ import annotations

import csv
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from fit_problems import answers, real_rows

from tripod_doe.analyses.fit.estimation.misfit import Misfit
from tripod_doe.analyses.fit.fit_file import load_fit
from tripod_doe.analyses.fit.problem import FitProblem
from tripod_doe.analyses.fit.result import fit_dataset
from tripod_doe.analyses.fit.sentences import _sentence_of_records, find_in_fit, unknown_rows

sys.path.append(str(Path(__file__).parents[3] / "measurements"))
import make_rig

HIDDEN = {"A": (0.5, -0.2), "B": (-0.3, 0.6)}
FIT = """
[fit]
name = "two joints"
[base]
model = "kinetostatic"
needle_sliding_friction = 0.05
[unknowns.initial_skew_1_deg]
low = -1
high = 1
per = "joint"
[unknowns.initial_skew_2_deg]
low = -1
high = 1
per = "joint"
[records]
table = "records.csv"
"""


@pytest.fixture
def rig(tmp_path):
    """Records of two made-up joints by a sensor that is mounted the other way round."""

    def read(sign):
        random, rows = np.random.default_rng(0), []
        for joint, skews in HIDDEN.items():
            for at, values in enumerate(make_rig.POINTS[:4]):
                point = dict(zip(make_rig.OPERATING, map(float, values), strict=True))
                own = {**point, "needle_sliding_friction": 0.05, "initial_skew_3_deg": 0.0}
                own |= {f"initial_skew_{trunnion}_deg": skew for trunnion, skew in enumerate(skews, start=1)}
                orders = answers({name: np.array([value]) for name, value in own.items()})[0][0]
                table = make_rig.record(-orders, point["speed_rpm"], random.uniform(0, 360), random)
                lines = [f"{t:.5f},{angle:.1f},{force:.3f}" for t, angle, force in table]
                (tmp_path / f"{joint}{at}.csv").write_text("\n".join(["time_s,rotation_deg,thrust_n", *lines, ""]))
                rows.append([f"{joint}{at}.csv", *values, joint])
        with (tmp_path / "records.csv").open("w", newline="") as stream:
            csv.writer(stream).writerows([["file", *make_rig.OPERATING, "joint"], *rows])
        (tmp_path / "fit.toml").write_text(f"{FIT}sign = {sign}\n")
        return FitProblem(load_fit(tmp_path / "fit.toml"))

    return read


def fitted(rig):
    solution, error = rig.fit(lambda columns: answers(rig.all_columns(columns)), lambda stage: None)
    return solution, fit_dataset(rig, solution, error, None)


@pytest.mark.parametrize("one_sign", [True, False])
def test_one_sensor_has_one_sign(one_sign):
    """Exact: forces of 1 and -1 N where the model says 1 N, each of the deviation 1 N: one of both is off by 2 N."""
    rows = replace(real_rows(np.array([1.0, -1.0]), 1.0), record=np.arange(2), free_phase=np.zeros(2, bool))
    rows = replace(rows, free_sign=np.ones(2, bool), one_sign=one_sign)
    misfit = Misfit(rows, np.ones(2, bool), (np.zeros(0), np.zeros(0)))
    assert misfit.compare(np.ones(2, complex), np.zeros(0)).chi2.sum() == pytest.approx(4.0 if one_sign else 0.0)
    least = [part.compare(np.ones(2, complex), np.zeros(0)).chi2.tolist() for part in misfit.of_each_sign()]
    assert least == ([[0.0, 4.0], [4.0, 0.0]] if one_sign else [[0.0, 0.0]])


def test_a_column_of_the_table_gives_each_record_a_sign_of_its_own(rig, tmp_path):
    rows = rig('"free"')
    assert rows.rows(rows.first_error()).one_sign
    header, *lines = (tmp_path / "records.csv").read_text().splitlines()
    (tmp_path / "records.csv").write_text("\n".join([f"{header},sign", *(f"{line},free" for line in lines), ""]))
    rows = FitProblem(load_fit(tmp_path / "fit.toml"))
    assert not rows.rows(rows.first_error()).one_sign


def test_the_search_begins_at_skews_on_other_trunnions_of_each_joint_and_at_opposite_ones_of_all(rig):
    """Exact: both joints are turned by themselves, and a sensor is mounted one way round for all of them."""
    place = np.array([0.6, 0.55, 0.45, 0.4])  # skews 1 of A and B, 2 of A and B
    places = np.array(rig('"free"').places_alike(place))
    only = [((places != place)[:, own]).all(axis=1) & (places == place)[:, other].all(axis=1) for own, other in
            (([0, 2], [1, 3]), ([1, 3], [0, 2]))]  # fmt: skip
    assert [own.sum() for own in only] == [2, 2]
    assert len(places) == 7
    assert any(np.allclose(other - 0.5, 0.5 - place) for other in places)
    assert len(rig(-1).places_alike(place)) == 4


def test_values_are_named_and_counted_by_their_groups():
    dims = ("unknown", "record")
    value, words = [[0.1, 0.1, 0.2]], [["found", "found", "one-sided"]]
    fit = xr.Dataset(
        {f"{key}_of_record": (dims, value) for key in ("value", "low", "high")}
        | {"verdict_of_record": (dims, words), "group_of_record": (dims, [["joint A", "joint A", "joint B"]])}
        | {"value": ("unknown", [np.nan]), "low": ("unknown", [np.nan]), "high": ("unknown", [np.nan])}
        | {"correlation": (("unknown", "unknown_2"), [[1.0]])},
        {"unknown": ["initial_skew_1_deg"], "unknown_2": ["initial_skew_1_deg"], "record": ["a.csv", "b.csv", "c.csv"]},
    )
    assert [row[0] for row in unknown_rows(fit)] == [f"initial_skew_1_deg of joint {name}" for name in "AB"]
    assert "(1 found, 1 one-sided)" in _sentence_of_records(fit.isel(unknown=0), "initial_skew_1_deg")


@pytest.mark.slow
def test_a_fit_with_either_sign_is_as_good_as_one_with_the_right_sign(rig):
    """Exact: the former contains the latter, so by its own weights its place is no worse."""
    known, _ = fitted(rig(-1))
    free, fit = fitted(rig('"free"'))
    assert free.best.cost < free.problem.cost(known.best.prediction, known.best.place) + 0.1
    for at, skews in zip((0, 4), HIDDEN.values(), strict=True):
        own = fit.isel(record=at)
        assert (own["low_of_record"] < np.array(skews)).all()
        assert (own["high_of_record"] > np.array(skews)).all()
    assert any("opposite signs" in line for line in find_in_fit(fit))
