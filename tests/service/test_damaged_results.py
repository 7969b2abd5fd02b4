"""Results of a finished run that were damaged on disk: the answer names the resume, which makes them again."""

from __future__ import annotations

import pytest
from service_client import COAST
from test_searches import JOINT, fit_upload
from test_workflows import SWITCHED

from tripod_doe.service.problems import among_runs
from tripod_doe.service.workers.answers import is_damaged
from tripod_doe.study.cube.netcdf import remedy

CHAIN = """
[workflow]
name = "chain"
[steps.map]
kind = "study"
study = "switched.toml"
[steps.shares]
kind = "contribution"
inputs = ["map"]
[steps.page]
kind = "report"
inputs = ["map", "shares"]
"""
WORKFLOW = {"workflow": CHAIN, "files": {"switched.toml": SWITCHED}}
_SAME = ("state", "points", "cpu_seconds")  # the last would grow with points that are computed again
STEP = {"step": "map", "analysis": "contribution", "variable": "share_off"}


def flip(path):
    whole = bytearray(path.read_bytes())
    whole[len(whole) // 2] ^= 0xFF
    path.write_bytes(whole)


def test_a_damaged_cube_names_the_resume(api, coast, settings):
    """Regression: the advice was a command, and the resume was refused as nothing was missing."""
    cube = settings.folder / coast / "cube.nc"
    whole = cube.read_bytes()
    flip(cube)
    try:
        answer = api.get(f"/runs/{coast}/query", params={"variable": "thrust_rms"})
        assert is_damaged(str(cube.parent))
    finally:
        cube.write_bytes(whole)
    (problem,) = answer.json()["errors"]
    assert answer.status_code == 422
    assert "resume this run" in problem["message"]
    assert "--out" not in problem["message"]
    refused = api.post(f"/runs/{coast}/resume")
    assert refused.status_code == 409
    assert "no file is damaged" in refused.text


@pytest.mark.parametrize("name", ["analysis/effects.nc", "cube.nc", "choice.nc", "steps/shares/cube.nc"])
def test_every_remedy_names_the_resume(tmp_path, name):
    (tmp_path / "journal.sqlite").touch()
    assert "resume this run" in among_runs(remedy(tmp_path / name), tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "names", "address", "asked"),
    [
        ({"study": COAST}, ["cube.nc"], "query", {"variable": "thrust_rms"}),
        ({"study": COAST}, ["report/index.html"], "report/", {}),
        ({"optimisation": JOINT}, ["front.nc", "candidates.nc"], "query", {"variable": "third"}),
        (fit_upload(), ["fit.nc", "base.toml"], "base", {}),
        (WORKFLOW, ["steps/shares/cube.nc"], "analyses", {}),
        (WORKFLOW, ["steps/map/analysis/contribution.nc"], "query", STEP),
    ],
)
def test_what_is_damaged_is_made_again_by_a_resume(api, settings, body, names, address, asked):
    run_id = api.post("/runs", body).json()["id"]
    run = api.wait(run_id, "finished", "failed", seconds=240)
    whole = api.get(f"/runs/{run_id}/{address}", params=asked)
    assert whole.status_code == 200, whole.text
    for name in names:
        flip(settings.folder / run_id / name)
    answer = api.get(f"/runs/{run_id}/{address}", params=asked)
    assert answer.status_code == 422
    assert "resume this run" in answer.text
    assert api.post(f"/runs/{run_id}/resume").json()["state"] == "queued"
    again = api.wait(run_id, "finished", "failed", seconds=240)
    assert {name: again[name] for name in _SAME} == {name: run[name] for name in _SAME}
    assert api.get(f"/runs/{run_id}/{address}", params=asked).status_code == 200
    assert api.post(f"/runs/{run_id}/resume").status_code == 409
