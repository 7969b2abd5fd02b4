"""Tolerance analyses that other points confirm."""

from __future__ import annotations

from math import erfc, sqrt

import pytest

import tripod_doe as td
from tripod_doe.cli.main import main

pytestmark = pytest.mark.usefixtures("pages_not_made")

FUNCTIONS = """
def sum_of_two(x, y):
    return {"f": x + y}
"""
STUDY = """
[study]
name = "two lengths"
function = "functions_to_confirm:sum_of_two"
[factors.x]
distribution = "normal"
mean = 10
std = 1
[factors.y]
distribution = "normal"
mean = 5
std = 0.2
[design]
kind = "sobol"
samples = 2048
[analysis.tolerance]
limits = { f = 17.1 }
confirm = 4096
"""


@pytest.fixture
def study(tmp_path, monkeypatch):
    (tmp_path / "functions_to_confirm.py").write_text(FUNCTIONS)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "two.toml").write_text(STUDY)
    return tmp_path / "two.toml"


@pytest.mark.slow
def test_the_first_change_is_run_with_other_points(study, tmp_path, capsys):
    """Exact: of a sum of normal lengths; the change is that of the wider one, and its chance that of a normal tail."""
    first = td.run(study, tmp_path / "out", workers=0, progress=False)
    (said,) = (line for line in first.answers if "The change of " in line)
    assert said.startswith("The change of [factors.x] std = 0.")
    result = td.open_cube(tmp_path / "out" / "analysis" / "tolerance.nc")
    scale = float(result["scale_to_keep"].sel(factor="x", factor_2="x"))
    tail = erfc(2.1 / sqrt(scale**2 + 0.2**2) / sqrt(2)) / 2
    assert float(result["exceedance_confirmed_low"]) < tail < float(result["exceedance_confirmed_high"])
    verdict = "confirmed" if float(result["exceedance_confirmed_high"]) <= 0.01 else "neither confirmed nor refuted"
    assert f" is {verdict} by 4,096 other points: " in said
    own = td.open_cube(tmp_path / "out" / "confirmation" / "tolerance" / "f")
    assert own["x"].values.std() == pytest.approx(scale, rel=0.02)
    assert own["y"].values.std() == pytest.approx(0.2, rel=0.02)
    result.close(), own.close()
    again = td.run(study, tmp_path / "out", workers=0, progress=False)
    assert again.computed == 0
    assert said in again.answers
    assert main(["plan", str(study), "--no-timing"]) == 0
    assert "confirmation at most 4,096 points beyond these" in capsys.readouterr().out


def test_a_limit_that_is_kept_needs_no_other_points(study, tmp_path):
    study.write_text(STUDY.replace("17.1", "25"))
    summary = td.run(study, tmp_path / "out", workers=0, progress=False)
    assert not any("By 4,096 other points" in line for line in summary.answers)
    assert not (tmp_path / "out" / "confirmation").exists()


@pytest.mark.slow
def test_another_change_is_confirmed_anew(study, tmp_path):
    """Regression: with another `keep`, every later run ended since the points were those of another change."""
    for keep in (0.99, 0.98, 0.99):
        study.write_text(STUDY.replace("confirm = 4096", f"confirm = 512\nkeep = {keep}"))
        td.run(study, tmp_path / "out", workers=0, progress=False)
        result = td.open_cube(tmp_path / "out" / "analysis" / "tolerance.nc")
        own = td.open_cube(tmp_path / "out" / "confirmation" / "tolerance" / "f")
        scale = float(result["scale_to_keep"].sel(factor="x", factor_2="x"))
        assert own["x"].values.std() == pytest.approx(scale, rel=0.05)


def test_a_sequence_is_not_confirmed_by_itself(study, tmp_path):
    """Regression: a sequence that is not scrambled gave "other points" that were the same for any seed."""
    study.write_text(STUDY.replace("2048", "2048\nscramble = false").replace('"sobol"', '"halton"'))
    study.write_text(study.read_text().replace('"normal"', '"truncated-normal"\nlow = 0\nhigh = 20'))
    td.run(study, tmp_path / "out", workers=0, progress=False)
    cube = td.open_cube(tmp_path / "out")
    own = td.open_cube(tmp_path / "out" / "confirmation" / "tolerance" / "f")
    assert not set(cube["y"].values) & set(own["y"].values)


@pytest.mark.slow
def test_what_has_no_orders_is_confirmed_once_beside_an_output_over_orders(study, tmp_path):
    """Regression: an output was confirmed once for each order, and a response was told as that of an order."""
    (tmp_path / "functions_to_confirm.py").write_text(
        "import xarray as xr\n"
        "def sum_of_two(x, y):\n"
        "    return xr.Dataset({'f': x + y, 'amplitude': ('order', [x, x, x, y])}, {'order': [0, 1, 2, 3]})\n"
    )
    text = STUDY.replace("2048", "512").replace("confirm = 4096", "confirm = 64\nkeep = 0.9")
    text = text.replace("f = 17.1", "f = 16.1, twice = 32.4, amplitude_3 = 5.1")
    study.write_text(text + '[responses.twice]\nformula = "2 * f"\n')
    said = td.run(study, tmp_path / "out", workers=0, progress=False).answers
    runs = tmp_path / "out" / "confirmation" / "tolerance"
    assert {place.name for place in runs.iterdir()} == {"f", "twice", "amplitude_3"}
    assert sum("by 64 other points" in line for line in said) == 3
    assert not any("twice of the" in line or "f of the" in line for line in said)
    result = td.open_cube(tmp_path / "out" / "analysis" / "tolerance.nc")
    confirmed = result["exceedance_confirmed"].sel(output=["f", "twice"])
    assert confirmed.notnull().all()
    assert (confirmed == confirmed.isel(order=0)).all()
    result.close()
