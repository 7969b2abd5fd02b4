"""A workflow over HTTP: its steps with states, their cubes and analyses, a measurement beside a point."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from tripod_doe.service.problems import RefusedError
from tripod_doe.service.service import Service
from tripod_doe.service.settings import Settings

RUN_UP = (Path(__file__).parent.parent.parent / "measurements" / "run_up.csv").read_text()
CHAIN = """
[workflow]
name = "shares on coast"
question = "which friction?"

[steps.switched]
kind = "study"
study = "switched.toml"

[steps.beside]
kind = "comparison"
inputs = ["switched"]
settings = { measurement = "run_up.csv", select = ["all_on=1"] }

[steps.page]
kind = "report"
inputs = ["switched"]
"""
SWITCHED = """
[study]
name = "switched"
[base]
model = "equilibrium"
joint_angle_deg = 13
torque_n_m = -60
[design]
kind = "ablation"
combinations = "single"
[analysis.contribution]
"""


@pytest.fixture(scope="module")
def chain(api):
    """A workflow whose comparison fails, as it selects by a name that its cube does not have."""
    body = {"workflow": CHAIN, "files": {"switched.toml": SWITCHED, "run_up.csv": RUN_UP[:100_000]}}
    answer = api.post("/runs", body)
    assert answer.status_code == 201, answer.text
    run_id = answer.json()["id"]
    api.wait(run_id, "finished", "failed", seconds=240)
    return run_id


@pytest.mark.slow
def test_a_workflow_tells_its_steps(api, chain):
    run = api.get(f"/runs/{chain}").json()
    assert run["kind"] == "workflow"
    assert run["name"] == "shares on coast"
    assert run["points"] == {"total": 12, "finished": 12, "failed": 0, "missing": 0}
    steps = {step["name"]: step for step in api.get(f"/runs/{chain}/steps").json()}
    assert list(steps) == ["switched", "beside", "page"]
    assert {name: step["state"] for name, step in steps.items()} == {
        "switched": "finished",
        "beside": "failed",
        "page": "finished",
    }
    assert steps["switched"]["seconds"] > 0
    assert steps["page"]["inputs"] == ["switched"]
    assert run["state"] == "failed"
    assert run["message"].startswith("beside: ")
    assert "all_on" in run["message"]
    assert api.get(f"/runs/{chain}/report/").status_code == 200


@pytest.mark.slow
def test_a_step_is_asked_as_a_study_is(api, chain, settings):
    options = {"variable": "thrust_rms", "select": "order=3"}
    refused = api.get(f"/runs/{chain}/query", params=options)
    assert refused.status_code == 409
    assert "switched" in refused.json()["errors"][0]["message"]
    assert len(api.get(f"/runs/{chain}/query", params=options | {"step": "switched"}).json()) == 12
    assert api.get(f"/runs/{chain}/query", params=options | {"step": "../switched"}).status_code == 404
    whole = api.get(f"/runs/{chain}/cube.nc", params={"step": "switched"})
    assert whole.content == (settings.folder / chain / "steps" / "switched" / "cube.nc").read_bytes()


@pytest.mark.slow
def test_links_of_a_report_work_without_the_cookie_and_open_nothing_else(api, client, chain):
    page = api.get(f"/runs/{chain}/report/")
    assert "sandbox" in page.headers["content-security-policy"]
    base = re.search('<base href="([^"]+)index.html">', page.text)[1]
    linked = client.get(base + "../steps/switched/report/index.html")  # the client resolves it as a browser does
    assert linked.status_code == 200
    assert "sandbox" in linked.headers["content-security-policy"]
    root, _, key = base.removesuffix("/report/").rpartition("/pages/")
    assert len(key) == 32
    for place in (
        "report/../upload/switched.toml",
        "upload/workflow.toml",
        "steps.json",
        "..%2f..%2fservice.sqlite",
        "report/nothing.html",
        "steps/switched/journal.sqlite",
        "run.log",
    ):
        assert client.get(f"{root}/pages/{key}/{place}").status_code in (401, 404)
    assert client.get(f"{root}/pages/{'0' * 32}/report/index.html").status_code == 401
    assert client.get(f"/api/v1/runs/{'0' * 16}/pages/{key}/report/index.html").status_code == 401
    assert client.post(f"{root}/pages/{key}/report/index.html").status_code == 401


@pytest.mark.slow
def test_analyses_come_with_their_sentences_and_cubes(api, chain):
    (analysis,) = api.get(f"/runs/{chain}/analyses", params={"step": "switched"}).json()
    assert (analysis["name"], analysis["kind"]) == ("contribution", "contribution")
    assert any("third order" in sentence for sentence in analysis["findings"])
    assert analysis["variables"]["share_off"]["dims"]
    options = {"variable": "share_off", "select": "order=3", "step": "switched", "analysis": "contribution"}
    rows = api.get(f"/runs/{chain}/query", params=options).json()
    assert {row["mechanism"] for row in rows} >= {"groove_sliding", "needle_rolling"}
    file = api.get(f"/runs/{chain}/analysis/contribution.nc", params={"step": "switched"})
    assert file.content.startswith(b"\x89HDF")
    near = api.get(f"/runs/{chain}/analysis/contributions.nc", params={"step": "switched"})
    assert near.status_code == 404
    assert "did you mean 'contribution'?" in near.json()["errors"][0]["message"]


def test_the_analysis_steps_of_a_workflow_are_its_analyses(tmp_path):
    """Regression: they were listed, but asked for by name the answer was to name a step."""
    (tmp_path / "runs").mkdir()
    service = Service(Settings(tmp_path / "runs", workers=0))
    (tmp_path / "upload").mkdir()
    steps = {"map": {"kind": "study", "inputs": []}, "shares": {"kind": "contribution", "inputs": ["map"]}}
    plan = {"kind": "workflow", "name": "chain", "question": "", "unique": 0, "steps": steps}
    run = service.runs.submit(tmp_path / "upload", plan)
    cube = service.directory(run.id) / "steps" / "shares" / "cube.nc"
    cube.parent.mkdir(parents=True)
    cube.touch()
    assert service.analysis_file(run.id, "shares") == cube
    with pytest.raises(RefusedError, match="not made; did you mean 'shares'"):
        service.analysis_file(run.id, "share")
    service.runs._table.close()


@pytest.mark.slow
def test_a_measurement_is_compared_as_on_the_command_line(api, chain, settings, tmp_path, capsys):
    from tripod_doe.cli import main

    (tmp_path / "measurement.csv").write_text(RUN_UP)
    body = {"measurement": RUN_UP, "select": ["point=0"], "reference_angle": 0.0, "nearest": True}
    answer = api.post(f"/runs/{chain}/compare", body, params={"step": "switched"})
    cube = settings.folder / chain / "steps" / "switched"
    words = [
        "compare",
        str(cube),
        str(tmp_path / "measurement.csv"),
        "--select",
        "point=0",
        "--nearest",
        "--reference-angle",
        "0",
        "--format",
        "json",
    ]
    assert main(words) == 0
    told = json.loads(capsys.readouterr().out)
    assert answer.json() | {"measurement": told["measurement"]} == told
    wrong = api.post(f"/runs/{chain}/compare", body | {"measurement": "a,b\n1,2\n"}, params={"step": "switched"})
    assert wrong.status_code == 422
    assert wrong.json()["errors"][0]["message"].startswith("measurement.csv")
