"""Points and factors that an analysis counts."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from combinations import FOLDER
from test_phases import DESIGN_OF, cube_of

import tripod_doe as td
from slow_cases import first_fast
from tripod_doe.analyses.factorial_effects.factorial_effects import EffectsSettings, factorial_effects
from tripod_doe.analyses.factorial_effects.sentences import find_in_effects
from tripod_doe.analyses.registry import ANALYSES, findings_of, findings_of_all
from tripod_doe.analyses.surrogate.surrogate import SurrogateSettings, surrogate
from tripod_doe.errors import InputError
from tripod_doe.reports.study_report import read_analyses

pytestmark = pytest.mark.usefixtures("pages_not_made")

TABLE = "a,b\n" + "".join(f"{k / 4},{(k * k) % 5 + 3 * k / 4}\n" for k in range(20))


@pytest.fixture
def run_table(tmp_path):
    """Run a table of two columns through y = a + 10 b, of which the study file need list none."""

    def run(table, listed=""):
        (tmp_path / "tenfold.py").write_text("def f(a=0.0, b=0.0):\n    return {'y': a + 10 * b}\n")
        (tmp_path / "t.csv").write_text(table)
        (tmp_path / "s.toml").write_text(
            f'[study]\nname = "t"\nfunction = "tenfold:f"\n{listed}\n[design]\nkind = "table"\ntable = "t.csv"\n'
        )
        td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
        return td.open_cube(tmp_path / "out")

    return run


@pytest.mark.parametrize("listed", ["", "[factors.a]", "[factors.a]\n[factors.b]"])
def test_columns_of_a_table_are_factors_whether_the_study_lists_them_or_not(run_table, listed):
    """Regression: a column that was not listed was left out, and its effect was stated as that of another."""
    cube = run_table(TABLE, listed)
    found = factorial_effects(cube, EffectsSettings(interactions=False, squares=False))
    assert found["effect"].sel(term="a").item() == pytest.approx(np.ptp(cube["a"].values))
    assert found["effect"].sel(term="b").item() == pytest.approx(10 * np.ptp(cube["b"].values))
    learned = surrogate(cube, SurrogateSettings(outputs=["y"]))
    assert float(learned["error_rms"]) < 1e-6 * float(cube["y"].std())


def test_a_column_with_open_fields_is_named(tmp_path):
    angles = "".join(f"{4 + k / 2},{0.05 if k % 2 else ''}\n" for k in range(12))
    (tmp_path / "t.csv").write_text("joint_angle_deg,groove_spin_friction\n" + angles)
    (tmp_path / "s.toml").write_text(
        '[study]\nname = "t"\n[base]\nmodel = "equilibrium"\n[design]\nkind = "table"\ntable = "t.csv"\n'
        '[keep]\noutputs = ["thrust_amplitude"]\n'
    )
    td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    with pytest.raises(InputError, match="column 'groove_spin_friction' of the table has empty fields"):
        factorial_effects(td.open_cube(tmp_path / "out"))


def test_words_and_numbers_in_a_column_are_words(run_table):
    """Regression: a column of both ended the run with an internal error after its last point, as an empty field did."""
    assert run_table("a\n1\ntwo\n")["a"].values.tolist() == ["1", "two"]
    with pytest.raises(InputError, match="line 3: a: this field is empty"):
        run_table("a,b\n1,2\n,3\n")


def test_an_output_that_some_points_lack_is_left_out(tmp_path):
    """Regression: such an output made finished points "lost"; each analysis repeated that it is left out."""
    (tmp_path / "gaps.py").write_text("def gaps(a, b):\n    return {'y': a + b, 'z': a if b > 0.5 else float('nan')}\n")
    (tmp_path / "s.toml").write_text(
        '[study]\nname = "t"\nfunction = "gaps:gaps"\n[factors]\na.values = [0, 1]\nb.values = [0, 0.4, 0.8, 1]\n'
        "[analysis.effects]\n[analysis.again]\nkind = 'effects'\n"
    )
    td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    said = "z is left out: 4 of 8 points do not have it"
    assert sum(said in each for each in findings_of_all(read_analyses(tmp_path / "out"))) == 1
    with td.open_cube(tmp_path / "out" / "analysis" / "effects.nc") as found:
        assert (found.attrs["points_used"], found.attrs["outputs"]) == (8, "y")
        assert any(said in each for each in find_in_effects(found, "e"))


def test_an_output_that_one_of_the_models_lacks_is_left_out(tmp_path):
    """Regression: "12 of 24 points are missing" of a study whose points all finished, and no effects."""
    (tmp_path / "s.toml").write_text(
        '[study]\nname = "t"\n[factors]\nmodel.values = ["equilibrium", "kinetostatic"]\n'
        'joint_angle_deg.values = [4, 8]\n[keep]\noutputs = ["thrust_amplitude", "needle_skew_summary_deg"]\n'
        "[analysis.effects]\n"
    )
    td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    with td.open_cube(tmp_path / "out" / "analysis" / "effects.nc") as found:
        assert (found.attrs["points_used"], found.attrs["outputs"]) == (4, "thrust_amplitude")
        assert found.attrs["left_out"].startswith("needle_skew_summary_deg: 2 of 4 points do not have it")


VIBRATING = ("sobol", "morris", "effects", "tolerance", "surrogate", "pawn", "multifidelity")


@pytest.mark.parametrize("kind", VIBRATING)
def test_joints_that_no_balance_looks_at_are_calm_in_every_analysis(kind):
    """Invariance: a missing `vibrates` of a joint that finished is a zero, and no point is lost for it."""
    plain = cube_of(DESIGN_OF[kind], 0.0, 0.02)
    looked = plain["lag_phase_deg"] > plain["lag_phase_deg"].median()
    values = xr.where(plain["outcome"] == 0, xr.where(looked, 1.0, 0.0), np.nan)
    row, results = ANALYSES[kind], []
    for each in (values, values.where(values > 0)):
        cube = plain.drop_vars("lag_phase_deg").assign(vibrates=each)
        results.append(row.function({"study": cube}, row.settings(outputs=["vibrates"], most_dropped=0.8), FOLDER))
    xr.testing.assert_identical(*results)
    assert results[0].attrs["points_used"] > 0


def test_formulas_of_joints_that_no_balance_looks_at(tmp_path):
    """Regression: a formula had no value at joints that count as calm elsewhere."""
    (tmp_path / "s.toml").write_text(
        '[study]\nname = "t"\n[factors]\njoint_angle_deg.values = [5, 8]\n'
        '[responses.calm_third]\nformula = "thrust_amplitude[3] * (vibrates < 1)"\n'
    )
    td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    with td.open_cube(tmp_path / "out") as cube:
        assert cube["vibrates"].isnull().all()
        assert cube["calm_third"].values.tolist() == cube["thrust_amplitude"].sel(order=3).values.tolist()


CORNER = """
def corner(a, b=0.0, c=0.0):
    if a > 0.8 and b < 0.3:
        raise ValueError("no")
    return {"y": a + b * c}
"""


@pytest.mark.parametrize("kind", first_fast(["tolerance", "effects", "surrogate", "pawn", "sobol"], 2))
def test_an_answer_for_the_rest_says_for_which_range_it_holds(tmp_path, kind):
    """Regression: 43 points that finished were called missing, and numbers for a < 0.8 stood without this range."""
    (tmp_path / "corners.py").write_text(CORNER)
    limits = "limits = {y = 1.2}\n" * (kind == "tolerance")
    design = "saltelli" if kind == "sobol" else "latin-hypercube"
    (tmp_path / "s.toml").write_text(
        '[study]\nname = "c"\nfunction = "corners:corner"\n'
        + "".join(f"[factors.{name}]\nlow = 0\nhigh = 1\n" for name in "abc")
        + f'[design]\nkind = "{design}"\nsamples = 256\nseed = 1\n[analysis.k]\nkind = "{kind}"\n'
        + f'holes = "rest"\nmost_dropped = 0.9\noutputs = ["y"]\n{limits}'
    )
    td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    cube, result = td.open_cube(tmp_path / "out"), read_analyses(tmp_path / "out")["k"]
    block = cube.sizes["point"] // 256
    lost = block * int((cube["outcome"].values != 0).reshape(-1, block).any(axis=1).sum())
    assert result.attrs["points_dropped"] == lost
    assert lost + result.attrs["points_used"] + result.attrs["points_outside"] == cube.sizes["point"]
    first, *others = findings_of("k", result)
    threshold = float(first.split(" hold for a < ")[1].split(" only")[0])
    assert 0.75 < threshold < 0.82
    assert f"{result.attrs['points_outside']:,} points that have an answer outside" in first
    assert any(f"{lost:,} points" in sentence for sentence in others)


def test_joints_that_no_balance_looks_at_count_as_calm_in_a_tolerance(tmp_path):
    """Regression: they were "missing", so the chance of a vibration was that of the others."""
    (tmp_path / "s.toml").write_text(
        '[study]\nname = "t"\n[factors]\njoint_angle_deg = {low = 8, high = 14}\n[design]\nkind = "latin-hypercube"\n'
        'samples = 20\n[keep]\noutputs = ["thrust_amplitude", "vibrates"]\n'
        '[analysis.tolerance]\noutputs = ["vibrates"]\nlimits = {vibrates = 0.5}\n'
    )
    td.run(tmp_path / "s.toml", tmp_path / "out", workers=0, progress=False)
    looked = td.open_cube(tmp_path / "out")["vibrates"].notnull()
    assert 0 < int(looked.sum()) < 20
    with td.open_cube(tmp_path / "out" / "analysis" / "tolerance.nc") as found:
        assert (found.attrs["points_used"], found.attrs["points_dropped"]) == (20, 0)
