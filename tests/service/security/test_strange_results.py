"""Results in a directory that are not those of its study: refused by every route that reads or delivers them."""

from __future__ import annotations

import json
import shutil
import time

import pytest
from service_client import ADDRESS, TOKEN, Asked
from starlette.testclient import TestClient

import tripod_doe as td
from tripod_doe.errors import TooLargeError
from tripod_doe.service.app import create_app
from tripod_doe.service.limits import Limits
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.settings import Settings
from tripod_doe.service.workers.answers import extend, query
from tripod_doe.service.workers.worker_pool import AllBusyError, LateError, WorkerPool
from tripod_doe.study.journal import KERNELS, Journal

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
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tripod_doe.workflow.run_study.write_report", lambda directory, findings: None)
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_large_answer_keeps_no_small_one_waiting(two, monkeypatch):
    """Three queries of 151 MB had all workers; a small one waited for 15 s."""
    api, _ = two
    run_id = api.get("/runs").json()[0]["id"]
    service = api.client.app.state.service
    asked = []
    for name in ("ask", "ask_large"):
        own = getattr(service, name)

        def noted(question, *words, own=own, name=name, **more):
            asked.append((name, question.partition(":")[2]))
            return own(question, *words, **more)

        monkeypatch.setattr(service, name, noted)
    small = api.get(f"/runs/{run_id}/query?variable=thrust_rms&select=order=3")
    assert small.status_code == 200
    assert asked == [("ask", "small_query")]
    asked.clear()
    large = api.get(f"/runs/{run_id}/query?variable=groove_thrust")  # 77,760 cells
    assert large.status_code == 200
    assert len(large.json()) > 50_000
    assert asked == [("ask", "small_query"), ("ask_large", "query")]


@pytest.mark.slow
def test_an_answer_that_proves_long_is_made_where_large_ones_are(two, monkeypatch):
    """It frees the worker of small questions; threads are left where all questions that may wait do so."""
    api, _ = two
    service = api.client.app.state.service
    assert service.threads > sum(pool.threads for pool in service._pools)
    run_id = api.get("/runs").json()[0]["id"]
    asked = []

    def late(question, seconds, *words, **more):
        asked.append(seconds)
        raise LateError(413, "late")

    monkeypatch.setattr(service._pool, "ask", late)
    assert api.get(f"/runs/{run_id}/cube").status_code == 200
    assert asked == [5.0]
    monkeypatch.setattr(service._large, "ask", late)
    assert api.get(f"/runs/{run_id}/cube").status_code == 413
    assert asked == [5.0, 5.0, service.settings.limits.query_seconds]


@pytest.mark.parametrize("form", ["json", "csv", "netcdf"])
def test_an_answer_of_too_many_bytes_is_refused(two, form):
    _, results = two
    words = {"variable": "thrust_rms", "select": [], "nearest": False, "where": None, "form": form}
    size = len(query(str(results / "one"), **words, limits=Limits()))
    assert len(query(str(results / "one"), **words, limits=Limits(answer_bytes=size + 10_000))) > 0
    with pytest.raises(
        TooLargeError, match=r"an answer of about [\d,]+ bytes; at most .* are sent: select fewer cells"
    ):
        query(str(results / "one"), **words, limits=Limits(answer_bytes=size // 2))


def test_who_extends_a_run_is_not_sent_to_the_command_line(two, tmp_path):
    """A client has no --out."""
    _, results = two
    copy = shutil.copytree(results / "one", tmp_path / "copy")
    with Journal(copy) as journal:
        journal.remember({KERNELS: "other kernels"})
    text = (copy / "study.toml").read_text().replace("samples = 4", "samples = 8")
    with pytest.raises(RefusedError) as refused:
        extend(json.dumps({"study": text}).encode(), str(tmp_path / "upload"), str(copy), Limits())
    told = refused.value.problems[0].message
    assert "another version of the kernels" in told
    assert "submit it as a run of its own" in told
    assert "out" not in told.split()


def _is_at(api, run_id, directory):
    return api.get(f"/runs/{run_id}/upload").json()["study"] == (directory / "study.toml").read_text()


class BusyPool(WorkerPool):
    """A pool whose workers are all at work."""

    def __init__(self):
        pass

    def ask(self, question, seconds, as_json=False, left=None, reader="", **arguments):
        raise AllBusyError


def test_long_plans_keep_no_query_waiting(two, monkeypatch):
    """Three plans of 30 s had all workers."""
    api, _ = two
    service = api.client.app.state.service
    run_id = api.get("/runs").json()[0]["id"]
    monkeypatch.setattr(service, "_planning", BusyPool())
    assert api.post("/plans", json={"study": STUDY, "timing": False}).status_code == 503
    assert api.post("/runs", json={"study": STUDY}).status_code == 503
    assert api.get(f"/runs/{run_id}/query?variable=thrust_rms&select=order=3").status_code == 200
