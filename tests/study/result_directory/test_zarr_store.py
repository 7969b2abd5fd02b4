"""A cube as a Zarr store: what the cube holds, and a message where zarr is missing."""

from __future__ import annotations

import importlib.util

import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe.cli import main
from tripod_doe.errors import StorageError
from tripod_doe.study.result_directory.zarr_store import export_zarr

pytestmark = pytest.mark.usefixtures("pages_not_made")

STUDY = """
[study]
name = "exported"
[base]
model = "equilibrium"
[factors]
joint_angle_deg = {values = [5, 10]}
bearing_radial_clearance_mm = {values = [0.02, -0.05]}
[run]
expected_outcomes = ["jammed"]
[keep]
outputs = ["thrust_amplitude"]
"""


def test_a_store_holds_what_the_cube_holds(tmp_path, capsys, monkeypatch):
    """Exact: values, texts of points that failed, and attributes; written again, it is replaced as a whole."""
    (tmp_path / "study.toml").write_text(STUDY)
    words = ["run", str(tmp_path / "study.toml"), "--out", str(tmp_path / "out"), "--workers", "0", "--export", "zarr"]
    assert main(words) == main(words) == 0
    assert f"zarr    {tmp_path / 'out' / 'cube.zarr'}\n" in capsys.readouterr().err
    cube = td.open_cube(tmp_path / "out")
    with xr.open_zarr(tmp_path / "out" / "cube.zarr") as stored:
        xr.testing.assert_identical(stored.load(), cube)
    assert main(["query", str(tmp_path / "out" / "cube.zarr"), "--variable", "thrust_amplitude"]) == 2
    assert "name the result directory that it was exported from" in capsys.readouterr().err  # not: run a study there
    assert main(["check", str(tmp_path / "out")]) == 0
    assert "skipped  " + str(tmp_path / "out" / "cube.zarr") in capsys.readouterr().out
    monkeypatch.setattr(xr.Dataset, "to_zarr", lambda *given, **more: (_ for _ in ()).throw(OSError(28, "disk full")))
    with pytest.raises(StorageError, match="disk full"):
        export_zarr(tmp_path / "out")
    assert (tmp_path / "out" / "cube.zarr").exists()


@pytest.mark.slow
def test_a_store_of_earlier_results_is_removed(tmp_path):
    """Regression: with more points, or another formula, the store kept the numbers of before."""
    study, out = tmp_path / "study.toml", tmp_path / "out"
    study.write_text(STUDY)
    run = ["run", str(study), "--out", str(out), "--workers", "0"]
    assert main([*run, "--export", "zarr"]) == 0
    study.write_text(STUDY.replace("[5, 10]", "[5, 8, 10]"))
    assert main(run) == 0
    assert not list(out.glob("*cube.zarr*"))
    export_zarr(out)
    (tmp_path / "more.toml").write_text('[responses.double]\nformula = "thrust_amplitude[3] * 2"\n')
    assert main(["derive", str(out), str(tmp_path / "more.toml")]) == 0
    assert not list(out.glob("*cube.zarr*"))


def test_without_zarr_nothing_starts(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    (tmp_path / "study.toml").write_text(STUDY)
    assert main(["run", str(tmp_path / "study.toml"), "--out", str(tmp_path / "out"), "--export", "zarr"]) == 2
    assert "pip install zarr" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
