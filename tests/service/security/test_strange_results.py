"""Results in a directory that are not those of its study: refused by every route that reads or delivers them."""

from __future__ import annotations

import shutil
import time

import pytest
from service_client import ADDRESS, TOKEN, Asked
from starlette.testclient import TestClient

import tripod_doe as td
from tripod_doe.service.app import create_app
from tripod_doe.service.settings import Settings

STUDY = """
    [study]
    name = "sampled"
    [base]
    model = "equilibrium"
    [factors.joint_angle_deg]
    low = 4
    high = 12
    [factors.groove_sliding_friction]
    low = 0.04
    high = 0.08
    [design]
    kind = "saltelli"
    samples = 4
    [analysis.sobol]
    """
ROUTES = (
    "/analyses",
    "/query?variable=ST&analysis=sobol",
    "/figure?variable=ST&analysis=sobol",
    "/cube?analysis=sobol",
    "/analysis/sobol.nc",
)


@pytest.fixture(scope="module")
def two(tmp_path_factory):
    """A server with the results of two studies that differ in a range."""
    folder = tmp_path_factory.mktemp("strange")
    for name, high in (("one", 12), ("other", 13)):
        file = folder / f"{name}.toml"
        file.write_text(STUDY.replace("high = 12", f"high = {high}"))
        td.run(file, out=folder / "results" / name, workers=0, progress=False)
    headers = {"authorization": f"Bearer {TOKEN}"}
    settings = Settings(folder / "results", token=TOKEN, workers=0)
    with TestClient(create_app(settings), ADDRESS, raise_server_exceptions=False, headers=headers) as client:
        api, until = Asked(client), time.monotonic() + 60
        while len(api.get("/runs").json()) < 2:
            assert time.monotonic() < until
            time.sleep(0.1)
        yield api, folder / "results"


def test_an_analysis_of_another_study_is_served_by_no_route(two):
    """Its numbers were served in silence, beside the cube of this study."""
    api, results = two
    run_id = next(run["id"] for run in api.get("/runs").json() if _is_at(api, run["id"], results / "one"))
    place = results / "one" / "analysis" / "sobol.nc"
    own = place.read_bytes()
    assert [api.get(f"/runs/{run_id}{route}").status_code for route in ROUTES] == [200] * len(ROUTES)
    shutil.copy(results / "other" / "analysis" / "sobol.nc", place)
    for route in ROUTES:
        answer = api.get(f"/runs/{run_id}{route}")
        assert answer.status_code == 422, route
        assert "its results are of another study" in answer.text, route
    place.write_bytes(own)
    assert [api.get(f"/runs/{run_id}{route}").status_code for route in ROUTES] == [200] * len(ROUTES)


def _is_at(api, run_id, directory):
    return api.get(f"/runs/{run_id}/upload").json()["study"] == (directory / "study.toml").read_text()
