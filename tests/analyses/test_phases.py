"""A phase is an angle: where the circle begins changes no answer of any analysis, or the phase is refused.

A new kind of analysis must appear in one of the tables here.
"""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from combinations import FOLDER, columns_of, numbers
from test_every_combination import ANALYSED, study_of

from slow_cases import first_fast
from tripod_doe.analyses.diff.diff import diff_cubes
from tripod_doe.analyses.diff.sentences import diff_text
from tripod_doe.analyses.findings import find
from tripod_doe.analyses.output_table import without_zero
from tripod_doe.analyses.registry import ANALYSES, charts_of, findings_of, table_of
from tripod_doe.errors import InputError
from tripod_doe.model_interface import Outcome
from tripod_doe.page_parts.main_results import responses
from tripod_doe.phases import JUMPS, around_mean, in_a_row, is_phase, shorter_way
from tripod_doe.study.expressions import Expression

BY_COMPLEX_AMPLITUDES = {"comparison", "choose", "speed-accuracy", "claims", "claims-over-skew"}
"""Analyses that take no output by name; what they say of phases are angles of quotients of complex amplitudes."""
REFUSED = {"contribution": "output: 'lag_phase_deg' is a phase", "stability": f"output = 'lag_phase_deg': {JUMPS}"}
DESIGN_OF = {line.split(": ")[0]: line.split()[1] for line in ANALYSED.strip().split("\n")}
TAKEN = sorted(set(DESIGN_OF) - set(REFUSED))
PLACES = ("mean", "quantile", "quantile_low", "quantile_high", "distribution", "what_if_values")
"""Answers that are phases themselves: they turn with the values."""


def cube_of(design: str, turned: float, lost: float = 0.0) -> xr.Dataset:
    """The cube of a small study with a phase about 180 deg, turned by an angle."""
    text = study_of(design).text.replace("samples = 16", "samples = 32")
    columns = columns_of(text)
    a, b, c = numbers(columns).T
    phase = shorter_way(165 + 20 * a + 12 * b * (1 + a) + 0.01 * c + turned)
    finished = np.random.default_rng(1).random(phase.size) >= lost
    outcome = np.where(finished, Outcome.FINISHED, Outcome.ERROR).astype(np.int8)
    return xr.Dataset(
        {"lag_phase_deg": ("point", np.where(finished, phase, np.nan), {"units": "degree"}), "outcome": ("point", outcome)},
        coords={"point": np.arange(phase.size)}
        | {name: ("point", column, {"source": "this study", **({"role": "switch of the ablation"} if design == "ablation" else {})}) for name, column in columns.items()},
        attrs={"study": text},
    )  # fmt: skip


def test_every_analysis_is_judged_here():
    assert set(ANALYSES) == set(TAKEN) | set(REFUSED) | BY_COMPLEX_AMPLITUDES


def answer(kind: str, turned: float, lost: float = 0.0) -> xr.Dataset:
    row, cube = ANALYSES[kind], cube_of(DESIGN_OF[kind], turned, lost)
    named = {"outputs": ["lag_phase_deg"]} if "outputs" in row.settings.model_fields else {"output": "lag_phase_deg"}
    more = {"most_dropped": 0.8} if lost else {}
    return row.function({"study": cube}, row.settings(**named, **more), FOLDER)


@pytest.mark.parametrize("lost", first_fast([0.02, 0.0], 1))
@pytest.mark.parametrize("kind", TAKEN)
def test_answers_do_not_know_where_the_circle_begins(kind, lost):
    """Invariance: turned phases give equal indices, effects and spreads, and means and quantiles turned as much."""
    if kind == "fast" and lost:
        return  # a curve with a failed point has no answer
    one, other = answer(kind, 0.0, lost), answer(kind, 90.0, lost)
    known = 0
    for name, values in one.data_vars.items():
        if (
            values.dtype.kind not in "fi"
            or np.isinf(values).any()
            or (name.startswith("what_if") and name not in PLACES)
        ):
            continue
        turn = 90.0 if name in PLACES and kind != "pawn" else 0.0
        apart = shorter_way(other[name].values - values.values - turn) if turn else other[name].values - values.values
        np.testing.assert_array_equal(np.isnan(values), np.isnan(other[name]), name)
        scale = max(1.0, np.nan_to_num(np.abs(values.values), posinf=0.0).max(initial=0.0))
        assert np.nan_to_num(np.abs(apart)).max(initial=0.0) < 1e-6 * scale, name
        known += int(np.isfinite(values).sum())
    assert known
    assert findings_of("x", one)
    assert isinstance(table_of(one), tuple | None)
    for figure in ANALYSES[kind].figures:
        charts_of(figure, {"x": one})


@pytest.mark.parametrize("kind", REFUSED)
def test_what_needs_a_zero_is_refused(kind):
    cube = cube_of(DESIGN_OF[kind], 0.0)
    if kind == "stability":
        cube = cube.assign_coords(
            method=("point", ["rk4"] * cube.sizes["point"]), step_s=("point", np.arange(1.0, 1 + cube.sizes["point"]))
        )
    row = ANALYSES[kind]
    with pytest.raises(InputError, match=REFUSED[kind]):
        row.function({"study": cube}, row.settings(output="lag_phase_deg"), FOLDER)


@pytest.mark.parametrize("design", ["grid", "latin-hypercube", "morris"])
def test_trends_do_not_know_where_the_circle_begins(design):
    """Invariance; and the sentences have neither percentages of a phase nor proportions to one."""
    said = [find(cube_of(design, turned)) for turned in (0.0, 90.0, 180.0)]
    assert len(said[0]) == len(said[1]) == len(said[2])
    rises = [np.ptp(responses(cube_of(design, turned))[0].values.values) for turned in (0.0, 90.0, 180.0)]
    assert max(rises) < 60
    assert np.ptp(rises) < 1e-9
    assert not any(
        "proportional" in text or "% of its value" in text or "times as large" in text
        for text in "\n".join(each for own in said for each in own).split("\n")
    )


def test_phases_all_round_have_no_trends():
    cube = cube_of("grid", 0.0)
    cube["lag_phase_deg"] = cube["lag_phase_deg"].copy(data=np.linspace(-180, 170, cube.sizes["point"]))
    assert responses(cube) == []
    assert f"lag_phase_deg: {JUMPS}; its values lie all round." in find(cube)


def test_differences_go_the_shorter_way():
    change = diff_cubes(cube_of("grid", 0.0), cube_of("grid", 20.0)).results[0]
    assert change.difference == pytest.approx(20)
    assert np.isnan(change.relative)


def test_a_change_of_sign_has_no_percentage():
    """Regression: "(-193 %)" of a skew that turned from 0.4 to -0.37 deg; of a value that grows there is one."""
    cubes = [
        cube_of("grid", 0.0).drop_vars("lag_phase_deg").assign(y=("point", np.full(27, y))) for y in (0.4, -0.37, 0.8)
    ]
    told = [diff_text(diff_cubes(cubes[0], other)) for other in cubes[1:]]
    assert "%" not in told[0]
    assert "(+100 %)" in told[1]


FORMULAS = {
    "lag_phase_deg": True,
    "lag_phase_deg - 2 * other_phase_deg + 30": True,
    "-lag_phase_deg + x": True,
    "abs(lag_phase_deg - 30)": False,
    "x * abs(lag_phase_deg - 30)": False,
    "3 * x": False,
}
NO_FORMULAS = (
    "max(lag_phase_deg, 3)", "mean(lag_phase_deg)", "lag_phase_deg / 2", "0.5 * lag_phase_deg", "x * lag_phase_deg",
    "lag_phase_deg > 3", "lag_phase_deg ** 2", "sqrt(lag_phase_deg)", "1 + 2 * (3 + x / lag_phase_deg)",
)  # fmt: skip
NAMES = ("lag_phase_deg", "other_phase_deg", "x")


@pytest.mark.parametrize(("text", "phase"), FORMULAS.items())
def test_formulas_carry_that_they_are_phases(text, phase):
    assert Expression(text, NAMES, phases=NAMES[:2]).is_phase is phase


@pytest.mark.parametrize("text", NO_FORMULAS)
def test_formulas_that_depend_on_where_the_circle_begins_are_refused(text):
    with pytest.raises(InputError, match=JUMPS):
        Expression(text, NAMES, phases=NAMES[:2])


def test_a_formula_of_phases_is_one_in_the_cube(make_cube, folder):
    """A chain of formulas, of a function whose outputs are known by their names alone."""
    (folder / "phase_functions.py").write_text("def f(x):\n    return {'lag_phase_deg': x, 'size': 2.0}\n")
    cube = make_cube(
        '[study]\nname = "p"\nfunction = "phase_functions:f"\n[factors.x]\nvalues = [100, 170]\n'
        '[responses.twice]\nformula = "2 * lag_phase_deg"\n[responses.later]\nformula = "twice + 30"\n'
        '[responses.far]\nformula = "abs(twice - 170)"\n[responses.own_phase_deg]\nformula = "6 * x * size"\n'
    )
    assert [is_phase(cube[name]) for name in ("lag_phase_deg", "twice", "later", "far", "size")] == [True] * 3 + [
        False
    ] * 2
    assert cube["twice"].values.tolist() == [-160, -20]
    assert cube["twice"].attrs["units"] == cube["own_phase_deg"].attrs["units"] == "degree"
    assert cube["later"].values.tolist() == [-130, 10]
    assert cube["far"].values.tolist() == [30, 170]
    assert without_zero(cube["later"])
    assert not without_zero(cube["far"])


def test_conditions_take_differences_of_phases_by_the_shorter_way():
    """Regression: 10 deg from 175 to -175 deg counted as 350; a phase alone is compared as it stands."""
    columns = {"lag_phase_deg": np.array([175.0, -60]), "other_phase_deg": np.array([-175.0, -50]), "x": np.zeros(2)}
    for text, met in {
        "other_phase_deg - lag_phase_deg < 20": [True, True],
        "abs(lag_phase_deg - other_phase_deg) > 20 or x > 1": [False, False],
        "lag_phase_deg > 100": [True, False],
        "lag_phase_deg * 0.5 > 50": [True, False],
    }.items():
        condition = Expression(text, NAMES, phases=NAMES[:2], is_condition=True)
        assert condition(columns).tolist() == met


def test_means_of_phases():
    """Exact: unknown ones do not count, opposite ones have the first for a mean, and half a turn is 180 deg."""
    relative, centre = around_mean(np.array([[170.0, 10], [-170, -170], [np.nan, np.nan]]))
    assert centre == pytest.approx([180, 10])
    assert relative[:2] == pytest.approx(np.array([[-10, 0], [10, 180]]))
    assert np.isnan(relative[2]).all()
    assert shorter_way(np.array([-180.0, 540, -180 + 1e-12, np.inf]))[:3] == pytest.approx(180)
    assert in_a_row(np.array([170.0, -170])) == pytest.approx([170, 190])
    assert in_a_row(np.array([0.0, 100, 200])) is None
