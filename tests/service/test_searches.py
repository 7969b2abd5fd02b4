"""Fits and optimisations over HTTP: priced, run, stopped, resumed and read as any other run."""

from __future__ import annotations

import json
import re
import time
from pathlib import Path

import pytest

import tripod_doe as td
from tripod_doe.service.limits import Limits
from tripod_doe.service.page.rendering import part
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.workers.answers import base, plan
from tripod_doe.study.cube.netcdf import write_dataset
from tripod_doe.study.journal import Journal

ROOT = Path(__file__).parents[2]
RIG = ROOT / "measurements" / "rig"

JOINT = """
[optimisation]
name = "bore of 29 needles"
question = "Which needle diameter?"
[base]
model = "equilibrium"
needle_count = 29
pitch_radius_mm = 24
roller_radius_mm = 17
[variables.needle_pitch_diameter_mm]
low = 17
high = 21
[variables.groove_radius_ratio]
low = 1.004
high = 1.03
[at.joint_angle_deg]
values = [3, 11]
[objectives.third]
output = "thrust_amplitude"
order = 3
[objectives.bore]
output = "needle_pitch_diameter_mm"
[search]
evaluations = 120
"""
FIT = """
[fit]
name = "frictions"
starts = 1
[base]
model = "equilibrium"
[unknowns.groove_sliding_friction]
low = 0.02
high = 0.15
[records]
table = "records.csv"
orders = [3]
"""


def fit_upload():
    names = [f"record_{number}.csv" for number in (1, 2, 3)]
    rows = (RIG / "records.csv").read_text().splitlines()[:4]
    files = {name: (RIG / name).read_text() for name in names} | {"records.csv": "\n".join(rows) + "\n"}
    return {"fit": FIT, "files": files}


def submitted(api, body):
    answer = api.post("/runs", body)
    assert answer.status_code == 201, answer.text
    return answer.json()["id"]


@pytest.fixture(scope="module")
def optimised(api):
    run_id = submitted(api, {"optimisation": JOINT})
    assert api.wait(run_id, "finished", "failed")["state"] == "finished", api.get(f"/runs/{run_id}/log").text
    return run_id


@pytest.fixture(scope="module")
def fitted(api):
    run_id = submitted(api, fit_upload())
    assert api.wait(run_id, "finished", "failed")["state"] == "finished", api.get(f"/runs/{run_id}/log").text
    return run_id


def test_searches_have_a_price_beforehand(api):
    plan = api.post("/plans", {"optimisation": JOINT, "timing": False}).json()
    assert (plan["kind"], plan["points"]) == ("optimisation", 264)  # 24 of them steps around the best
    assert 0 < plan["cpu_seconds"]["mean"] < 60
    plan = api.post("/plans", fit_upload() | {"timing": False}).json()
    assert (plan["kind"], plan["records"]) == ("fit", 3)
    least, most = plan["points_range"]
    assert 3 < least < plan["points"] < most
    assert plan["unknowns"] == ["groove_sliding_friction"]
    assert f"({least:,} to {most:,})" in part("price.html", plan=plan)


@pytest.mark.slow
def test_an_optimisation_is_a_run(api, optimised, settings, tmp_path):
    """Regression: its front is the one of the command line, to the last digit."""
    run = api.get(f"/runs/{optimised}").json()
    assert run["kind"] == "optimisation"
    assert run["points"]["missing"] == 0
    assert run["points"]["total"] == run["points"]["finished"] + run["points"]["failed"]
    search = next(step for step in run["steps"] if step["name"] == "search")
    assert search["state"] == "finished"
    course = search["generations"]
    assert [row["candidates"] for row in course] == sorted(row["candidates"] for row in course)
    assert course[-1]["candidates"] == 120
    (tmp_path / "joint.toml").write_text(JOINT)
    front = td.optimise(tmp_path / "joint.toml", tmp_path / "out", workers=0, progress=False).front
    steps = re.findall(r"= (\S+)(?: mm)? in place of ([^\s,]+)", front.attrs["findings"])
    assert steps
    assert all(new != old for new, old in steps)  # regression: 1.03 in place of 1.03
    records = api.get(f"/runs/{optimised}/query", params={"variable": "third"}).json()
    assert [record["third"] for record in records] == front["third"].values.tolist()
    assert min(course[-1]["best"]["third"], course[-1]["best"]["bore"]) > 0
    assert course[-1]["best"]["third"] == pytest.approx(float(front["third"].min()))
    points = api.get(f"/runs/{optimised}/query", params={"variable": "thrust_amplitude", "step": "points"}).json()
    assert len({record["point"] for record in points}) == run["points"]["total"]
    assert "knee" in api.get(f"/runs/{optimised}/report/").text
    assert api.get(f"/runs/{optimised}/cube").json()["sizes"] == {"candidate": front.sizes["candidate"]}
    (analysis, _) = api.get(f"/runs/{optimised}/analyses").json()
    assert (analysis["name"], analysis["kind"]) == ("front", "optimisation")
    assert any("The front has" in line for line in analysis["findings"])


def test_a_candidate_is_taken_as_a_base(api, optimised):
    knee = api.get(f"/runs/{optimised}/base").text
    assert knee.startswith("[base]\n")
    records = api.get(f"/runs/{optimised}/query", params={"variable": "needle_pitch_diameter_mm"}).json()
    first = api.get(f"/runs/{optimised}/base", params={"candidate": 0}).text
    assert f"needle_pitch_diameter_mm = {records[0]['needle_pitch_diameter_mm']!r}" in first
    study = f'[study]\nname = "taken"\n{first}[factors.joint_angle_deg]\nvalues = [6]\n'
    assert api.post("/plans", {"study": study, "timing": False}).status_code == 200
    assert api.get(f"/runs/{optimised}/base", params={"candidate": len(records)}).status_code == 404


def test_a_fit_is_a_run(api, fitted):
    run = api.get(f"/runs/{fitted}").json()
    assert (run["kind"], run["points"]["missing"]) == ("fit", 0)
    assert run["steps"][-1] == run["steps"][-1] | {"name": "report", "state": "finished"}
    (record,) = api.get(f"/runs/{fitted}/query", params={"variable": "value"}).json()
    assert 0.05 < record["value"] < 0.1
    assert "groove_sliding_friction = " in api.get(f"/runs/{fitted}/base").text
    assert api.get(f"/runs/{fitted}/base", params={"candidate": 0}).status_code == 404
    assert "groove sliding friction" in api.get(f"/runs/{fitted}/report/").text
    (analysis,) = api.get(f"/runs/{fitted}/analyses").json()
    assert analysis["kind"] == "fit"
    assert analysis["findings"]
    assert len(analysis["table"]["rows"]) == 1


def test_a_fit_takes_no_formulas_and_no_points(api, fitted):
    """Regression: of formulas it said that only a study can be extended, by a study."""
    formula = {"responses": {"r": {"formula": "2 * thrust_amplitude[3]"}}}
    for path, body in (("derive", formula), ("plans", formula), ("extend", {"study": ""})):
        answer = api.post(f"/runs/{fitted}/{path}", body)
        assert answer.status_code == 409, path
        words = "kind: fit: only the run of a study takes further points, or variables by formula"
        assert answer.json()["errors"][0]["message"] == words


@pytest.mark.slow
def test_a_search_that_was_stopped_goes_on(api, settings):
    """Invariance: no point runs twice, and the front is that of a search without a stop."""
    slow = JOINT.replace('"equilibrium"', '"kinetostatic"').replace("bore of 29", "stopped, of 29")
    run_id = submitted(api, {"optimisation": slow})
    until = time.monotonic() + 60
    while not api.get(f"/runs/{run_id}").json()["points"]["finished"]:
        assert time.monotonic() < until
        time.sleep(0.02)
    api.post(f"/runs/{run_id}/stop")
    stopped = api.wait(run_id, "stopped", "finished", "failed")
    assert stopped["state"] == "stopped", stopped
    assert api.post(f"/runs/{run_id}/resume").status_code == 200
    done = api.wait(run_id, "finished", "failed")
    assert done["state"] == "finished", done
    with Journal(settings.folder / run_id / "steps" / "points", read_only=True) as journal:
        keys = [key.tobytes() for key in journal.keys()]  # noqa: SIM118
    assert len(keys) == len(set(keys)) == done["points"]["total"] > stopped["points"]["finished"]


@pytest.mark.parametrize(
    ("body", "status", "words"),
    [
        ({"optimisation": JOINT.replace("[base]", 'function = "os:getcwd"\n[base]')}, 403, "functions are not allowed"),
        ({"optimisation": JOINT.replace("[at.joint_angle_deg]\nvalues = [3, 11]", '[at]\ntable = "/etc/passwd"')}, 403, "elsewhere"),
        ({"optimisation": JOINT.replace("evaluations = 120", "evaluations = 9000000")}, 413, "at most 200,000"),
        ({"optimisation": JOINT.replace("order = 3", "order = 33")}, 422, "orders are 0 to 12"),
        ({"fit": FIT, "files": {}}, 403, "records.csv"),
        ({"fit": FIT, "files": {"records.csv": "file,torque_n_m\n/etc/hostname,3\n"}}, 403, "elsewhere"),
        ({"fit": FIT, "files": {"records.csv": "file,torque_n_m\n../service.sqlite,3\n"}}, 403, "elsewhere"),
        ({"fit": FIT.replace('table = "records.csv"', 'files = ["/etc/*"]')}, 422, "no file has such a name"),
        ({"fit": FIT, "study": FIT}, 422, "give one of"),
        ({"fit": "[study]\nname = 'x'"}, 422, "not a fit"),
        ({"optimisation": JOINT, "files": {"long.toml": "#" * 300_000}}, 413, "262,144"),
    ],
)  # fmt: skip
def test_what_searches_may_not_ask(api, body, status, words):
    for address in ("/plans", "/runs"):
        answer = api.post(address, body)
        assert answer.status_code == status, answer.text
        assert words in json.dumps(answer.json())


CANDIDATES = "[next.at.joint_angle_deg]\nvalues = {0}\n[next.at.torque_n_m]\nvalues = {0}\n".format(
    list(range(1, 3_001))
)


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            {"study": '[study]\nname = "t"\n[design]\nkind = "table"\ntable = "t.csv"\n[factors.torque_n_m]\n'},
            "t.csv': more than 200,000 rows",
        ),
        ({"fit": FIT + CANDIDATES}, "[next.at]: 9,000,000 candidates; at most 10,000"),
        ({"fit": FIT + '[next]\ntable = "t.csv"\n'}, "t.csv': more than 10,000 rows"),
        ({"fit": FIT.replace("records.csv", "t.csv")}, "t.csv': more than 10,000 rows"),
        (
            {"optimisation": JOINT.replace("[at.joint_angle_deg]\nvalues = [3, 11]", '[at]\ntable = "t.csv"')},
            "t.csv': more than 10,000 rows",
        ),
    ],
)
def test_rows_and_candidates_are_counted_before_they_are_made(body, message):
    """Regression: nine million candidates, and a table of three million rows, took 50 s of the worker that plans."""
    files = fit_upload()["files"] | {"t.csv": "torque_n_m\n" + "4\n" * 1_000_000}
    request = json.dumps(body | {"files": files, "timing": False}).encode()
    started = time.process_time()
    with pytest.raises(RefusedError) as refused:
        plan(request, Limits())
    assert message in refused.value.problems[0].message
    assert time.process_time() - started < 5


@pytest.mark.parametrize(("name", "address"), [("base.toml", "base"), ("report/index.html", "report/")])
def test_a_flipped_bit_in_a_text_of_a_fit_is_not_delivered(api, settings, fitted, name, address):
    path = settings.folder / fitted / name
    whole = path.read_bytes()
    path.write_bytes(whole.replace(b"friction", b"frictioo", 1))
    try:
        answer = api.get(f"/runs/{fitted}/{address}")
        assert answer.status_code == 422
        assert f"{name}: damaged or edited" in answer.text
        assert str(settings.folder) not in answer.text
    finally:
        path.write_bytes(whole)
    assert api.get(f"/runs/{fitted}/{address}").status_code == 200


def test_a_front_that_another_program_wrote_is_said(api, settings, optimised, tmp_path):
    """Regression: internal errors where a role, a value of each candidate or the file itself is missing."""
    front = td.open_cube(settings.folder / optimised / "front.nc")
    spoilt = (
        front.drop_vars("knee"),
        front.assign(groove_radius_ratio=((), 1.0, front["groove_radius_ratio"].attrs)),
        front.assign_attrs(optimisation="name = 1"),
        front.drop_attrs(deep=False),
    )
    for number, data in enumerate(spoilt):
        write_dataset(data, path := tmp_path / f"{number}.nc")
        with pytest.raises(RefusedError, match="optimisation"):
            base(str(path), "optimisation", None)
