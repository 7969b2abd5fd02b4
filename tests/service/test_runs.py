"""The life of a run over HTTP: submitted, watched, asked, stopped, resumed, retried, extended, deleted."""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
import textwrap
import time
from dataclasses import replace

import pytest
import xarray as xr
from service_client import ADDRESS, COAST, Asked
from starlette.testclient import TestClient

import tripod_doe as td
from tripod_doe.analyses.diff.sentences import diff_json
from tripod_doe.service.app import create_app
from tripod_doe.service.routes import results
from tripod_doe.service.settings import Settings
from tripod_doe.workflow.steps_file import write_steps

pytestmark = pytest.mark.usefixtures("charts_not_drawn")


def grown(*angles):
    """The study at other angles, with one output: what a run draws takes as long as all the rest of it."""
    text = textwrap.dedent(COAST).replace("[2.5, 17]", str(list(angles)))
    return text.replace('"thrust_amplitude", "thrust_rms", "groove_thrust_amplitude"', '"thrust_rms"')


def test_health_needs_nothing_and_names_the_version(client):
    assert client.get("/api/v1/health").json() == {"status": "ok", "version": "0.1.0"}


def test_schemas_are_those_of_the_command_line(api):
    from tripod_doe.workflow.workflow_file import workflow_schema

    assert api.get("/schema/study").json() == json.loads(json.dumps(td.study_schema()))
    assert api.get("/schema/study", params={"scene": "roller-in-groove"}).json()["properties"]["base"]
    assert api.get("/schema/study", params={"scene": "rollers-in-groove"}).status_code == 422
    assert api.get("/schema/workflow").json() == json.loads(json.dumps(workflow_schema()))
    assert "/api/v1/runs/{run_id}/query" in api.get("/openapi.json").json()["paths"]


def test_the_description_is_made_before_the_first_request(tmp_path):
    """Regression: it was made in the event loop, where all requests waited for it."""
    with TestClient(create_app(Settings(tmp_path, workers=0))) as client:
        assert client.app.openapi_schema


def test_what_a_route_does_not_read_is_refused(api):
    """Regression: {"days": 1} gave a link of 14 days, and a misspelt parameter the answer without it."""
    made = api.post("/runs/none/shares", {"days": 1})
    assert made.status_code == 422
    assert made.json()["errors"][0]["message"] == "this address takes no body: leave it out; write days into the query"
    assert api.post("/runs/none/shares", {}).status_code == 404
    assert api.post("/runs/none/stop", {"force": True}).status_code == 422
    for path in (
        "/runs?stat=running",
        "/runs/none/query?variabel=x",
        "/limits?x=1",
        "/runs/none/diff/none?variables=x",
        "/runs/none/report?x=1",
        "/runs/none/figure?variabel=x",  # this one read its query itself
    ):
        answer = api.get(path)
        assert answer.status_code == 422, path
        assert "in the query" in answer.json()["errors"][0]["message"]
    assert "did you mean 'state'" in api.get("/runs?stat=running").json()["errors"][0]["message"]


def test_limits_are_told_with_their_meanings(api, settings):
    told = {entry["name"]: entry for entry in api.get("/limits").json()["limits"]}
    assert told["body_bytes"]["value"] == settings.limits.body_bytes == 256 * 1024
    assert all(entry["meaning"] for entry in told.values())


def test_a_plan_counts_and_prices_without_a_trace(api, settings):
    before = sorted(path.name for path in settings.folder.iterdir())
    plan = api.post("/plans", {"study": textwrap.dedent(COAST), "timing": False}).json()
    assert (plan["points"], plan["blocks"]) == (8, 1)
    assert plan["bytes"] == 8 * (8 * 13 * 5 + 1)  # two outputs of 13 orders, and one in three grooves
    assert 0 < plan["cpu_seconds"]["low"] <= plan["cpu_seconds"]["mean"] <= plan["cpu_seconds"]["high"] < 60
    assert plan["foreseen"][0]["outcome"] == "jammed"
    assert plan["foreseen"][0]["count"] == 4
    assert sorted(path.name for path in settings.folder.iterdir()) == before


def test_a_finished_run_tells_its_points_and_outcomes(api, coast):
    run = api.get(f"/runs/{coast}").json()
    assert run["state"] == "finished"  # failed points are told by the counts
    assert run["points"] == {"total": 8, "finished": 4, "failed": 4, "missing": 0}
    assert run["outcomes"] == {"finished": 4, "jammed": 4}
    assert run["name"] == "coast"
    assert run["cpu_seconds"] > 0
    assert run["eta_seconds"] is None
    assert run["created"] < run["updated"]
    assert run in api.get("/runs").json()
    assert api.get("/runs/none").status_code == 404


def test_an_idempotency_key_makes_one_run(api):
    headers = {"Idempotency-Key": "one"}
    first = api.submit(grown(3, 4), headers=headers)
    assert api.submit(grown(3, 4), headers=headers) == first
    other = api.post("/runs", {"study": grown(3, 5)}, headers=headers)
    assert other.status_code == 422
    api.post(f"/runs/{first}/stop")
    api.wait(first, "stopped", "finished")
    assert api.delete(f"/runs/{first}").status_code == 204


def test_a_query_selects_as_the_command_line_does(api, coast, tmp_path):
    ask = f"/runs/{coast}/query"
    options = {"variable": "thrust_rms", "select": ["order=3", "joint_angle_deg=2:3"]}
    rows = api.get(ask, params=options).json()
    assert len(rows) == 4
    assert {row["outcome"] for row in rows} == {"finished", "jammed"}
    assert all((row["thrust_rms"] is None) == (row["outcome"] == "jammed") for row in rows)
    assert len(api.get(ask, params=options | {"where": "outcome == 'finished'"}).json()) == 2
    assert api.get(ask, params=options | {"select": "order=99"}).json() == []
    assert api.get(ask, params=options | {"select": ["order=3", "speed_rpm=3500"], "nearest": True}).json()
    table = api.get(ask, params=options | {"format": "csv"})
    assert table.text.splitlines()[0].startswith("joint_angle_deg,speed_rpm")
    assert table.headers["content-type"].startswith("text/csv")
    (tmp_path / "answer.nc").write_bytes(api.get(ask, params=options | {"format": "netcdf"}).content)
    with xr.open_dataset(tmp_path / "answer.nc") as cube:
        assert dict(cube.sizes) == {"joint_angle_deg": 1, "speed_rpm": 2, "bearing_radial_clearance_mm": 2, "order": 1}


@pytest.mark.parametrize(
    ("options", "key", "near"),
    [
        ({"variable": "thrust_rmz"}, "variable", "thrust_rms"),
        ({"variable": "thrust_rms", "select": "torqe=3"}, "select", None),
        ({"variable": "thrust_rms", "where": "thrust_rmz > 1"}, None, "thrust_rms"),
        ({"variable": "thrust_rms", "where": "9**9**9 > thrust_rms +"}, None, None),
        ({"variable": "thrust_rms", "where": "+" * 20_000 + "x"}, None, None),
        ({"variable": "thrust_rms", "format": "xml"}, "format", None),
        ({}, "variable", None),
    ],
)
def test_a_wrong_query_names_what_is_wrong(api, coast, options, key, near):
    answer = api.get(f"/runs/{coast}/query", params=options)
    assert answer.status_code == 422
    error = answer.json()["errors"][0]
    assert error["key"] == key or key is None
    assert error["near"] == near


def test_a_huge_power_is_answered_at_once(api, coast):
    options = {"variable": "thrust_rms", "select": "order=3", "where": "9**9**9 > thrust_rms"}
    assert api.get(f"/runs/{coast}/query", params=options).status_code == 200


def test_the_cube_is_a_file_that_can_be_read_in_parts(api, coast, settings):
    whole = api.get(f"/runs/{coast}/cube.nc")
    assert whole.content == (settings.folder / coast / "cube.nc").read_bytes()
    part = api.get(f"/runs/{coast}/cube.nc", headers={"range": "bytes=8-107"})
    assert part.status_code == 206
    assert part.content == whole.content[8:108]
    assert part.headers["content-range"] == f"bytes 8-107/{len(whole.content)}"
    assert api.get(f"/runs/{coast}/cube.nc", headers={"range": "bytes=99999999-"}).status_code == 416


def test_a_point_is_not_named_by_an_empty_list(api, coast):
    """Regression: at=[] was point 0."""
    for wrong in ("[]", "{}", "[[]]", "0"):
        assert api.get(f"/runs/{coast}/points/0", params={"at": wrong}).status_code == 422, wrong


def test_the_cube_of_a_study_that_runs_is_written_aside_and_goes_when_it_is_sent(api, coast, monkeypatch, tmp_path):
    """Exact: the points that the journal holds, here all of them."""
    shown = api.get(f"/runs/{coast}/cube.nc").content
    monkeypatch.setattr(results, "is_shown", lambda path: False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    so_far = api.get(f"/runs/{coast}/cube.nc")
    assert so_far.headers["content-type"] == "application/x-netcdf"
    assert not list(tmp_path.iterdir())
    (tmp_path / "shown.nc").write_bytes(shown)
    (tmp_path / "so_far.nc").write_bytes(so_far.content)
    with xr.open_dataset(tmp_path / "shown.nc") as one, xr.open_dataset(tmp_path / "so_far.nc") as other:
        xr.testing.assert_equal(one, other)


def test_a_cube_is_described_for_those_who_choose_from_it(api, coast):
    told = api.get(f"/runs/{coast}/cube").json()
    assert told["sizes"]["order"] == 13
    assert told["coordinates"]["joint_angle_deg"]["values"] == [2.5, 17.0]
    assert told["variables"]["thrust_rms"]["units"] == "N"
    assert told["variables"]["outcome"]["flags"]["0"] == "finished"
    assert "study_hash" in told["attributes"]


def test_what_was_submitted_can_be_submitted_again(api, coast):
    assert api.get(f"/runs/{coast}/upload").json() == {"study": textwrap.dedent(COAST), "files": {}}
    assert api.get(f"/runs/{coast}/plan").json()["points"] == 8
    assert api.get(f"/runs/{coast}/steps").json() == []
    assert "8 points computed" in api.get(f"/runs/{coast}/log").text


def test_a_report_stands_in_a_sandbox(api, coast):
    page = api.get(f"/runs/{coast}/report/")
    assert page.status_code == 200
    assert "coast" in page.text
    policy = page.headers["content-security-policy"]
    assert "sandbox allow-scripts allow-downloads;" in policy
    assert "allow-same-origin" not in policy
    assert "default-src 'none'" in policy
    assert api.get(f"/runs/{coast}/report").headers["location"] == f"/api/v1/runs/{coast}/report/"


def test_wrong_states_are_refused(api, coast):
    assert api.post(f"/runs/{coast}/stop").status_code == 409
    assert api.post(f"/runs/{coast}/resume").status_code == 409
    assert api.get(f"/runs/{coast}/analysis/sobol.nc").status_code == 404
    assert api.get(f"/runs/{coast}/query", params={"variable": "thrust_rms", "step": "pilot"}).status_code == 404
    for path in ("/stop", "/resume", "/retry-failed"):
        assert api.post(f"/runs/none{path}").status_code == 404


CHAIN = """
[workflow]
name = "chain"
[steps.map]
kind = "study"
study = "study.toml"
"""
BY_FUNCTION = """
[study]
name = "Own function"
function = "own_module:peak"
[factors.width]
values = [1, 2, 3]
"""


@pytest.fixture
def own_folder(settings, tmp_path):
    """An interface of a server on an empty folder, and the folder."""
    with TestClient(create_app(replace(settings, folder=tmp_path)), ADDRESS) as client:
        client.headers["authorization"] = f"Bearer {settings.token}"
        yield Asked(client), tmp_path


def shown(own, count, *states):
    """The runs, as soon as there are so many in these states."""
    until = time.monotonic() + 60
    while len(runs := own.get("/runs").json()) != count or {run["state"] for run in runs} - set(states):
        assert time.monotonic() < until, runs
        time.sleep(0.05)
    return runs


def test_directories_of_the_command_line_appear_change_and_go_while_the_server_runs(
    coast, settings, own_folder, caplog
):
    own, folder = own_folder
    by_hand = folder / "by_hand"
    shutil.copytree(settings.folder / coast, by_hand, ignore=shutil.ignore_patterns("upload", ".alive"))
    shutil.copytree(by_hand, folder / "damaged")
    (folder / "damaged" / "study.toml").write_text("[study]\n")
    (run,) = shown(own, 1, "finished")
    assert (run["name"], run["found"], run["points"]["total"]) == ("coast", True, 8)
    assert len(own.get(f"/runs/{run['id']}/query", params={"variable": "outcome"}).json()) == 8
    assert own.get(f"/runs/{run['id']}/upload").json()["study"] == textwrap.dedent(COAST)
    for change in (own.post(f"/runs/{run['id']}/retry-failed"), own.delete(f"/runs/{run['id']}")):
        assert change.status_code == 409
        assert "by_hand" in change.json()["errors"][0]["message"]
    assert caplog.text.count("damaged is not shown") == 1
    (by_hand / "report" / "index.html").unlink()  # as when a run that goes on is interrupted
    os.utime(by_hand / "study.toml")
    assert shown(own, 1, "stopped")[0]["id"] == run["id"]
    with TestClient(create_app(replace(settings, folder=folder)), ADDRESS) as client:
        client.headers["authorization"] = f"Bearer {settings.token}"
        assert [again["id"] for again in Asked(client).get("/runs").json()] == [run["id"]]
    shutil.rmtree(by_hand)
    assert shown(own, 0) == []


def test_other_results_in_the_same_place_are_another_run(coast, settings, own_folder):
    """Regression: links to the former run opened them, also after a variable was derived here, under its name."""
    own, folder = own_folder
    ignored = shutil.ignore_patterns("upload", ".alive")
    shutil.copytree(settings.folder / coast, folder / "by_hand", ignore=ignored)
    (first,) = shown(own, 1, "finished")
    responses = {"responses": {"twice": {"formula": "2 * thrust_rms", "unit": "N"}}}
    assert own.post(f"/runs/{first['id']}/derive", responses).status_code < 300
    assert shown(own, 1, "finished")[0]["id"] == first["id"]
    (folder / "by_hand").rename(settings.folder.parent / "away")
    shutil.copytree(settings.folder / coast, folder / "by_hand", ignore=ignored)
    until = time.monotonic() + 30
    while (other := shown(own, 1, "finished")[0]["id"]) == first["id"]:
        assert time.monotonic() < until
        time.sleep(0.1)
    assert own.get(f"/runs/{first['id']}").status_code == 404
    assert own.get(f"/runs/{other}/upload").json()["study"] == textwrap.dedent(COAST)


def test_a_run_that_the_command_line_went_on_with_has_its_points(own_folder, tmp_path):
    """Regression: the list kept the counts and extremes of the smaller study, for ever."""
    own, folder = own_folder
    run_id = own.submit(COAST)
    shown(own, 1, "finished")
    larger = tmp_path / "larger.toml"
    larger.write_text(textwrap.dedent(COAST).replace("150, 4000", "150, 1000, 4000"))
    td.run(larger, out=folder / run_id, workers=0, progress=False)
    until = time.monotonic() + 30
    while own.get(f"/runs/{run_id}").json()["points"]["finished"] == 4:
        assert time.monotonic() < until
        time.sleep(0.1)
    (run,) = shown(own, 1, "finished")
    assert (run["id"], run["points"]["total"]) == (run_id, 12)
    assert "1000" in own.get(f"/runs/{run_id}/upload").json()["study"]


def test_the_directories_of_runs_bring_back_a_table_that_is_lost(coast, settings, own_folder):
    """Regression: workflows and searches were gone, and studies were runs of the command line under other names."""
    own, folder = own_folder
    upload = folder / ("b" * 16) / "upload"
    upload.mkdir(parents=True)
    (upload / "workflow.toml").write_text(CHAIN)
    (upload / "study.toml").write_text(textwrap.dedent(COAST))
    write_steps(upload.parent, [])
    shutil.copytree(settings.folder / coast, folder / coast)
    runs = {run["id"]: run for run in shown(own, 2, "finished", "failed")}
    assert {key: run["kind"] for key, run in runs.items()} == {coast: "study", "b" * 16: "workflow"}
    assert [run["found"] for run in runs.values()] == [False, False]
    assert runs[coast]["points"]["finished"] == 4
    assert own.post(f"/runs/{'b' * 16}/resume").json()["state"] == "queued"
    assert own.delete(f"/runs/{coast}").status_code == 204


def test_a_run_of_a_function_is_shown_and_never_imported(own_folder, monkeypatch):
    """The service reads its results; what would run the function is refused."""
    own, folder = own_folder
    source = folder / "source"
    source.mkdir()
    module = source / "own_module.py"
    module.write_text("def peak(width):\n    return {'height': 3.0 * width}\n")
    (source / "s.toml").write_text(BY_FUNCTION)
    monkeypatch.setattr("sys.path", [*sys.path])
    td.run(source / "s.toml", out=folder / "by_function", workers=0, progress=False)
    module.write_text(f"open({str(folder / 'imported')!r}, 'w')\n")
    (run,) = shown(own, 1, "finished")
    assert (run["name"], run["points"]["finished"]) == ("Own function", 3)
    address = f"/runs/{run['id']}"
    assert [row["height"] for row in own.get(f"{address}/query", params={"variable": "height"}).json()] == [3, 6, 9]
    for page in ("", "?point=1", "/analyses", "/study", "/points/1"):
        assert own.client.get(f"{address}{page}").status_code == 200, page
    tables = {"twice": {"formula": "2 * height", "unit": "1"}}
    refused = [
        own.post(f"{address}/extend", {"study": BY_FUNCTION}),
        own.post(f"{address}/plans", {"responses": tables}),
    ]
    refused += [own.post(f"{address}/derive", {"responses": tables}), own.post("/runs", {"study": BY_FUNCTION})]
    assert [answer.status_code for answer in refused] == [409, 409, 409, 403]
    assert not (folder / "imported").exists()


@pytest.mark.slow
def test_a_directory_of_the_command_line_is_extended(coast, settings, tmp_path):
    """Invariance: only what is new runs, into the directory of the command line, which is never removed."""
    by_hand = tmp_path / "by_hand"
    shutil.copytree(settings.folder / coast, by_hand, ignore=shutil.ignore_patterns("upload", ".alive"))
    for path in (
        by_hand,
        *by_hand.rglob("*"),
    ):  # as with a umask of 022: the service wrote its own files there as private
        path.chmod(0o755 if path.is_dir() else 0o644)
    larger = textwrap.dedent(COAST).replace("[2.5, 17]", "[2.5, 17, 9]")
    with TestClient(create_app(replace(settings, folder=tmp_path)), ADDRESS) as client:
        client.headers["authorization"] = f"Bearer {settings.token}"
        own = Asked(client)
        until = time.monotonic() + 60
        while not (runs := own.get("/runs").json()) or runs[0]["state"] != "finished":
            assert time.monotonic() < until, runs
            time.sleep(0.05)
        run_id = runs[0]["id"]
        tables = {"twice": {"formula": "2 * thrust_amplitude[3]", "unit": "N"}}
        assert own.post(f"/runs/{run_id}/plans", {"responses": tables}).json()["new_points"] == 0
        assert own.post(f"/runs/{run_id}/plans", {"study": larger}).json()["new_points"] == 4
        (by_hand / "link").symlink_to("/etc")
        assert own.post(f"/runs/{run_id}/extend", {"study": larger}).status_code == 403
        (by_hand / "link").unlink()
        assert own.post(f"/runs/{run_id}/extend", {"study": larger}).status_code == 200
        assert own.wait(run_id, "finished", "failed")["points"]["total"] == 12
        assert "4 points computed" in own.get(f"/runs/{run_id}/log").text
        assert "9" in own.get(f"/runs/{run_id}/upload").json()["study"]
        assert own.get(f"/runs/{run_id}/query", params={"variable": "thrust_rms"}).status_code == 200
        assert own.post(f"/runs/{run_id}/derive", {"responses": tables}).status_code == 200
        assert own.wait(run_id, "finished", "failed")["state"] == "finished"
        assert own.delete(f"/runs/{run_id}").status_code == 409
    with td.open_cube(by_hand) as cube:
        assert cube.sizes["joint_angle_deg"] == 3
        assert "twice" in cube


@pytest.mark.slow
def test_a_run_grows_and_keeps_what_it_has(api):
    """Invariance over HTTP: an extended run computes what is new, a repeated one what failed, and a deleted one is gone."""
    run_id = api.submit(grown(3))
    api.wait(run_id, "finished")
    changed = api.post(f"/runs/{run_id}/extend", {"study": grown(3, 4).replace("-35", "-36")})
    assert changed.status_code == 422
    assert {error["key"] for error in changed.json()["errors"]} >= {"torque_n_m"}
    longer = api.post(f"/runs/{run_id}/extend", {"study": grown(3, 4)})
    assert longer.json()["points"] == {"total": 8, "finished": 2, "failed": 2, "missing": 4}
    assert api.wait(run_id, "finished")["points"] == {"total": 8, "finished": 4, "failed": 4, "missing": 0}
    assert "4 points computed" in api.get(f"/runs/{run_id}/log").text
    assert api.post(f"/runs/{run_id}/retry-failed").json()["state"] == "queued"
    assert api.wait(run_id, "finished")["points"]["failed"] == 4  # they fail again, and are counted once
    assert "4 points computed" in api.get(f"/runs/{run_id}/log").text
    assert api.delete(f"/runs/{run_id}").status_code == 204
    assert api.get(f"/runs/{run_id}").status_code == 404


def test_an_extended_run_keeps_the_limits_whatever_its_files_are_called(api):
    """Regression: with a file workflow.toml only that was counted, and the run was stored as that of a workflow."""
    run_id = api.submit(grown(3))
    api.wait(run_id, "finished")
    small = "[workflow]\nname = 'w'\n[steps.s]\nkind = 'study'\nstudy = 'study.toml'\n"
    many = grown(3) + "\n[factors.torque_n_m]\nlow = -50\nhigh = -10\ncount = 125001\n"
    many = many.replace("torque_n_m = -35\n", "")
    told = api.post(f"/runs/{run_id}/extend", {"study": many, "files": {"workflow.toml": small}})
    assert told.status_code == 413, told.text
    longer = api.post(f"/runs/{run_id}/extend", {"study": grown(3, 4), "files": {"workflow.toml": small}})
    assert longer.json()["kind"] == "study"
    assert api.wait(run_id, "finished", "failed")["points"]["total"] == 8
    other = api.post("/runs", {"study": grown(5), "files": {"workflow.toml": small}})
    assert other.json()["kind"] == "study"
    assert api.wait(other.json()["id"], "finished", "failed")["state"] == "finished"


def test_runs_are_chosen_by_what_people_write_about_them(api, coast):
    assert (
        api.patch(f"/runs/{coast}", {"name": "customer/coast", "tags": ["x 1"], "note": "by *hand*"}).status_code == 200
    )
    run = api.get(f"/runs/{coast}").json()
    assert (run["name"], run["owner"], run["tags"], run["note"]) == ("customer/coast", "", ["x 1"], "by *hand*")
    for asked in (
        {"tag": "x 1"},
        {"folder": "customer"},
        {"text": "HAND coast"},
        {"text": "bearing_radial hand", "state": "finished"},
    ):
        answer = api.get("/runs", params=asked)
        assert [each["id"] for each in answer.json()] == [coast], asked
        assert answer.headers["x-total-count"] == "1"
        assert api.get("/runs", params=asked | {"page": 2}).json() == []
    assert api.get("/runs", params={"tag": "y"}).json() == []
    for wrong in ({"sort": "size"}, {"state": "done"}, {"page": 0}, {"since": "yesterday"}):
        assert api.get("/runs", params=wrong).status_code == 422, wrong
    for wrong in ({"nam": "x"}, {"tags": "x"}, {"name": 3}, {"note": "x" * 20_001}, {"tags": ["a,b"]}):
        assert api.patch(f"/runs/{coast}", wrong).status_code == 422, wrong
    assert api.patch("/runs/none", {"name": "x"}).status_code == 404
    assert api.patch(f"/runs/{coast}", {"name": "", "tags": [], "note": ""}).json()["name"] == "coast"


def test_a_deleted_run_is_restored_with_its_results(api):
    run_id = api.submit(grown(4, 6))
    before = api.wait(run_id, "finished", "failed")
    cells = api.get(f"/runs/{run_id}/query", params={"variable": "thrust_rms"}).json()
    assert api.delete(f"/runs/{run_id}").status_code == 204
    answer = api.get(f"/runs/{run_id}")
    assert answer.status_code == 404
    assert "in the bin" in answer.json()["errors"][0]["message"]
    assert run_id not in [run["id"] for run in api.get("/runs").json()]
    assert run_id in [run["id"] for run in api.get("/runs", params={"bin": True}).json()]
    assert api.post(f"/runs/{run_id}/restore").json() == before
    assert api.get(f"/runs/{run_id}/query", params={"variable": "thrust_rms"}).json() == cells
    assert api.post(f"/runs/{run_id}/restore").status_code == 404
    assert api.delete(f"/runs/{run_id}", params={"bin": True}).status_code == 409
    for _ in range(2):  # sent again, it stays in the bin
        assert api.delete(f"/runs/{run_id}").status_code == 204
    assert api.delete(f"/runs/{run_id}", params={"bin": True}).status_code == 204
    assert api.delete(f"/runs/{run_id}").status_code == 404


def test_two_runs_are_compared_as_by_the_command(api, coast, settings):
    other = api.submit(grown(2.5, 6))
    api.wait(other, "finished", "failed")
    told = api.get(f"/runs/{coast}/diff/{other}").json()
    assert told["points"] == {"a": 8, "b": 8, "shared": 4}
    assert {row["key"] for row in told["study"]} == {"factors.joint_angle_deg.values", "keep.outputs"}
    assert told["results"] == []
    own = json.loads(diff_json(td.diff(settings.folder / coast, settings.folder / other)))
    assert told == own
    assert api.get(f"/runs/{coast}/diff/none").status_code == 404
    assert api.get(f"/runs/{coast}/diff/{other}", params={"variable": "thrust"}).status_code == 422
    api.delete(f"/runs/{other}")


def test_a_run_says_why_an_analysis_was_not_made(api):
    """Regression: it had finished, and its page said no word of it."""
    study = """
        [study]
        name = "few"
        [base]
        model = "equilibrium"
        [factors.joint_angle_deg]
        low = 2
        high = 10
        [design]
        kind = "latin-hypercube"
        samples = 4
        seed = 1
        [keep]
        outputs = ["thrust_rms"]
        [analysis.surrogate]
        outputs = ["thrust_rms"]
        """
    run = api.wait(api.submit(study), "finished", "failed")
    reason = "Analysis surrogate was not made: a surrogate needs at least 10 different points, 4 finished."
    assert (run["state"], run["message"]) == ("finished", reason)
    assert reason in api.client.get(f"/runs/{run['id']}").text
    api.delete(f"/runs/{run['id']}")
