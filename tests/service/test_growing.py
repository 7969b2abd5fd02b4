"""Runs that grow: larger studies and variables by formula, priced beforehand, without running a point again."""

from __future__ import annotations

import json
import textwrap
from dataclasses import replace

import pytest
from service_client import COAST

from tripod_doe.cli.main import main
from tripod_doe.service.limits import Limits
from tripod_doe.service.runs.run_end import is_another_study
from tripod_doe.study.journal import Journal
from tripod_doe.study.result_directory.derived_responses import DERIVED

pytestmark = pytest.mark.usefixtures("charts_not_drawn")


@pytest.fixture(scope="module")
def grown(api):
    run_id = api.submit(COAST.replace('"coast"', '"coast that grows"'))
    assert api.wait(run_id, "finished", "failed")["state"] == "finished"
    return run_id


def larger(name="coast that grows"):
    return textwrap.dedent(COAST.replace('"coast"', f'"{name}"').replace("[2.5, 17]", "[2.5, 17, 9]"))


def test_only_what_is_new_has_a_price(api, grown):
    plan = api.post(f"/runs/{grown}/plans", {"study": larger()}).json()
    assert (plan["points"], plan["new_points"]) == (12, 4)
    whole = api.post("/plans", {"study": larger(), "timing": False}).json()["cpu_seconds"]["mean"]
    assert 0 < plan["cpu_seconds"]["mean"] < 0.6 * whole
    same = api.get(f"/runs/{grown}/upload").json()
    assert api.post(f"/runs/{grown}/plans", same).json()["new_points"] == 0
    changed = larger().replace("-35", "-36")
    answer = api.post(f"/runs/{grown}/plans", {"study": changed})
    assert answer.status_code == 422
    assert "base.torque_n_m: -35 -> -36" in answer.text


@pytest.mark.slow
def test_a_variable_by_formula_is_kept_while_a_run_grows(api, grown):
    tables = {"spread": {"formula": "thrust_amplitude[3] - thrust_amplitude[6]", "unit": "N", "meaning": "gap"}}
    plan = api.post(f"/runs/{grown}/plans", {"responses": tables}).json()
    assert (plan["new_points"], plan["cpu_seconds"]["mean"]) == (0, 0)
    assert api.post(f"/runs/{grown}/derive", {"responses": tables}).status_code == 200
    assert api.wait(grown, "finished", "failed")["state"] == "finished"
    cube = api.get(f"/runs/{grown}/cube").json()["variables"]["spread"]
    assert (cube["units"], cube["long_name"]) == ("N", "gap")
    amplitudes = api.get(
        f"/runs/{grown}/query", params={"variable": "thrust_amplitude", "select": ["order=3,6"]}
    ).json()
    spreads = api.get(f"/runs/{grown}/query", params={"variable": "spread"}).json()
    first = {record["order"]: record["thrust_amplitude"] for record in amplitudes[:2]}
    assert spreads[0]["spread"] == pytest.approx(first[3] - first[6])
    assert "[responses.spread]" in api.get(f"/runs/{grown}/upload").json()["study"]
    assert api.post(f"/runs/{grown}/extend", {"study": larger()}).status_code == 200  # which knows nothing of it
    done = api.wait(grown, "finished", "failed")
    assert (done["state"], done["points"]["total"]) == ("finished", 12)
    folder = api.client.app.state.service.runs.directory(grown)
    assert (folder / "study.toml").read_text() != (folder / "upload" / "study.toml").read_text()
    assert not is_another_study(folder)  # regression: any later write made it a run of the command line
    (folder / "upload" / "study.toml").write_text(larger().replace("-35", "-36"))
    assert is_another_study(folder)
    (folder / "upload" / "study.toml").write_text(larger())
    records = api.get(f"/runs/{grown}/query", params={"variable": "spread", "where": "spread > 0"}).json()
    assert {record["joint_angle_deg"] for record in records} == {2.5, 9, 17}


def test_a_point_stays_the_same_while_a_run_grows(api):
    """Regression: the address of a point led to another one, as did what an open page offers to do with it."""
    run_id = api.submit(COAST.replace('"coast"', '"coast whose points move"'))
    api.wait(run_id, "finished", "failed")
    point = api.get(f"/runs/{run_id}/points/4").json()
    assert point["factors"][0]["value"] == "17 deg"
    assert api.post(f"/runs/{run_id}/extend", {"study": larger("coast whose points move")}).status_code == 200
    api.wait(run_id, "finished", "failed")
    moved = api.get(f"/runs/{run_id}/points/4", params={"at": point["at"]}).json()
    assert (moved["number"], moved["factors"], moved["at"]) == (8, point["factors"], point["at"])
    study = api.client.get("/new", params={"contributions": run_id, "point": 4, "at": point["at"]}).text
    assert "joint_angle_deg = 17.0" in study
    assert api.get(f"/runs/{run_id}/points/4", params={"at": "{}["}).status_code == 422


@pytest.mark.slow
def test_a_variable_by_formula_is_dropped(api, settings):
    """It goes with its note, so that no later run brings it back; the others stay."""
    run_id = api.submit(COAST.replace('"coast"', '"coast that shrinks"'))
    api.wait(run_id, "finished", "failed")
    tables = {"gap": {"formula": "thrust_amplitude[3] - 1"}, "twice": {"formula": "2 * gap"}}
    assert api.post(f"/runs/{run_id}/derive", {"responses": tables}).status_code == 200
    api.wait(run_id, "finished", "failed")
    refused = api.post(f"/runs/{run_id}/derive", {"drop": ["gap"]})
    assert refused.status_code == 422  # the other follows from it
    assert "gap" in refused.text
    near = api.post(f"/runs/{run_id}/derive", {"drop": ["twise"]})
    assert "did you mean 'twice'" in near.json()["errors"][0]["message"]
    assert api.post(f"/runs/{run_id}/derive", {"drop": ["twice"]}).status_code == 200
    assert api.wait(run_id, "finished", "failed")["state"] == "finished"
    variables = api.get(f"/runs/{run_id}/cube").json()["variables"]
    assert ("gap" in variables, "twice" in variables) == (True, False)
    with Journal(settings.folder / run_id, read_only=True) as journal:
        assert list(json.loads(journal.recall(DERIVED))) == ["gap"]
    assert main(["derive", str(settings.folder / run_id), "--drop", "gap"]) == 0
    assert "gap" not in api.get(f"/runs/{run_id}/cube").json()["variables"]
    assert main(["derive", str(settings.folder / run_id)]) == 2
    api.delete(f"/runs/{run_id}")


def test_a_refused_formula_leaves_no_trace(api, settings, grown, monkeypatch):
    """Regression: the journal held it although the queue was full."""
    tables = {"refused": {"formula": "thrust_amplitude[3] + 1", "unit": "N"}}
    before = api.get(f"/runs/{grown}/upload").json()
    runs = api.client.app.state.service.runs
    monkeypatch.setattr(runs, "settings", replace(settings, limits=Limits(queued=0)))
    assert api.post(f"/runs/{grown}/derive", {"responses": tables}).status_code == 413
    with Journal(settings.folder / grown, read_only=True) as journal:
        assert "refused" not in (journal.recall(DERIVED) or "")
    assert api.get(f"/runs/{grown}/upload").json() == before


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"spread": {"formula": "thrust_amplitud[3]"}}, "did you mean 'thrust_amplitude'"),
        ({"spread": {"formula": "max(abs(thrust))"}}, "not among the outputs"),
        ({"../x": {"formula": "thrust_amplitude[3]"}}, "x"),
        ({"spread": {"formula": "thrust_amplitude[3]", "units": "N"}}, "did you mean 'unit'"),
        ({"spread": {"formula": "__import__('os')"}}, "formula"),
        ({"spread": {"formula": None}}, "expected texts and numbers"),
        ({}, "responses"),
    ],
)  # fmt: skip
def test_what_cannot_be_derived_is_said(api, grown, tables, words):
    before = api.get(f"/runs/{grown}/upload").json()
    for address in (f"/runs/{grown}/plans", f"/runs/{grown}/derive"):
        answer = api.post(address, {"responses": tables})
        assert answer.status_code == 422, answer.text
        assert words in answer.json()["errors"][0]["message"]
    assert api.get(f"/runs/{grown}/upload").json() == before
