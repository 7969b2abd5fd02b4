"""What to measure next: operating point and group of the record are named, and its effect is that of such a record."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tripod_doe.analyses.fit.fit_file import load_fit
from tripod_doe.analyses.fit.model_error import Needles, model_error
from tripod_doe.analyses.fit.next_record import next_record
from tripod_doe.analyses.fit.problem import FitProblem
from tripod_doe.analyses.fit.result import fit_dataset
from tripod_doe.analyses.fit.sentences import candidate_rows, find_in_fit

FIT = """
[fit]
name = "two frictions"
model_error = 0
starts = 1
[base]
model = "equilibrium"
speed_rpm = 600
[unknowns.groove_sliding_friction]
low = 0.02
high = 0.15
per = "{per}"
[unknowns.needle_sliding_friction]
low = 0.01
high = 0.1
[records]
table = "records.csv"
orders = [3]
[next]
narrow = "groove_sliding_friction"
[next.at.joint_angle_deg]
values = [4, 14]
"""
RECORDS = [(5, 100.5, "A", 0.07), (8, 200.5, "B", 0.05), (11, 100.5, "A", 0.07), (13, 300.5, "B", 0.05)]


def answers(every):
    """A made-up thrust force: frictions add up, the needles' part falls with the joint angle."""
    angle = np.radians(every["joint_angle_deg"])
    needles = every["needle_sliding_friction"] * 0.1 / angle
    orders = np.zeros((angle.size, 13), complex)
    orders[:, 3] = every["torque_n_m"] * angle * (every["groove_sliding_friction"] + needles)
    blank = np.full((angle.size, 3), np.nan)
    return orders, Needles(blank.astype(complex), blank)


@pytest.fixture
def fitted(tmp_path):
    """The result of a fit to made-up records, whose table is one of a German spreadsheet."""

    def fit(per, records, text=FIT):
        random, turned = np.random.default_rng(2), np.arange(6 * 72) * 5.0
        rows = ["file;joint_angle_deg;torque_n_m;grease;sign"]
        for at, (angle, torque, grease, friction) in enumerate(records):
            point = {"joint_angle_deg": angle, "torque_n_m": torque, "groove_sliding_friction": friction}
            size = answers({name: np.array([v]) for name, v in {**point, "needle_sliding_friction": 0.04}.items()})
            force = np.abs(size[0][0, 3]) * (
                np.cos(np.radians(3 * turned)) + 0.01 * random.standard_normal(turned.size)
            )
            lines = [f"{a},{f:.6f}" for a, f in zip(turned, force, strict=True)]
            (tmp_path / f"{at}.csv").write_text("\n".join(["rotation_deg,thrust_n", *lines]))
            rows.append(f"{at}.csv;{angle};{str(torque).replace('.', ',')};{grease};1.0")
        (tmp_path / "records.csv").write_text("\n".join(rows))
        (tmp_path / "fit.toml").write_text(text.format(per=per))
        own = FitProblem(load_fit(tmp_path / "fit.toml"))
        points = lambda columns: answers(own.all_columns(columns))  # noqa: E731
        solution, error = own.fit(points, lambda stage: None)
        return fit_dataset(own, solution, error, next_record(own, points, solution))

    return fit


def half(fit, grease):
    own = fit.sel(unknown="groove_sliding_friction", record=f"{'AB'.index(grease)}.csv")
    return float(own["high_of_record"] - own["low_of_record"]) / 2


@pytest.mark.slow
def test_a_record_is_of_the_group_that_it_is_to_narrow(fitted):
    """Regression: every candidate was of a group of its own, and so narrowed none. Within what noise changes."""
    before = fitted("grease", RECORDS)
    group = before.attrs["next_unknown"].split()[-1]
    best = before.isel(candidate=int(np.argmin(before["next"].values)))
    angle, torque = float(best["candidate_joint_angle_deg"]), float(best["candidate_torque_n_m"])
    after = fitted("grease", [*RECORDS, (angle, torque, group, {"A": 0.07, "B": 0.05}[group])])
    assert half(after, group) / half(before, group) == pytest.approx(float(best["next"]), abs=0.15)
    assert float(best["next"]) < 0.95
    said = next(line for line in find_in_fit(before) if "interval becomes" in line or "the interval of" in line)
    assert f"joint angle {angle:g} deg, torque {torque:g} N m, grease {group}:" in said
    assert all(row[0].endswith(f"grease {group}") for row in candidate_rows(before))


@pytest.mark.slow
def test_a_group_may_have_the_value_of_a_candidate(fitted):
    """Exact: at the torque of a group a record tells of its friction; the middle torque is the candidates'."""
    fit = fitted("torque_n_m", RECORDS)
    assert fit.attrs["next_group"] == ""
    if fit.attrs["next_unknown"].endswith("torque_n_m 200.5"):
        assert float(fit["next"].min()) < 0.9
    else:
        assert float(fit["next"].min()) > 0.9


@pytest.mark.slow
def test_a_record_with_a_value_of_its_own_says_little_of_others(fitted):
    """Regression: where bounds end intervals, one more record was said to make them 100 % shorter."""
    fit = fitted("record", RECORDS[:3])
    assert (fit["next"] > 0.5).all()
    wide = fit["predicted_error"] / fit["predicted"]
    assert (wide > 0.3).all()  # its friction may be anything between the bounds


def test_a_candidate_may_have_errors_that_records_have_not(fitted, monkeypatch):
    """Regression: phases of the candidates alone erred by more than amplitudes, and the fit ended with numpy's error."""

    def error_in_drive(simulator, columns, *rest):
        own = model_error(simulator, columns, *rest)
        drive = bool((columns["torque_n_m"] > 0).all())
        return replace(own, turning=np.full((*own.shared.shape[:2], 3), 0.1)) if drive else own

    monkeypatch.setattr("tripod_doe.analyses.fit.problem.model_error", error_in_drive)
    coast = [(angle, -torque, *rest) for angle, torque, *rest in RECORDS[:2]]
    fit = fitted("all", coast, FIT + "[next.at.torque_n_m]\nvalues = [100]\n")
    assert np.isfinite(fit["next"]).all()
