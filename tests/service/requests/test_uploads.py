"""What is refused of an upload before anything of it is imported, made or run, and where a complaint points."""

from __future__ import annotations

import re
import textwrap
from dataclasses import replace

import pytest
from service_client import COAST

import tripod_doe as td
from tripod_doe.cli.main import main
from tripod_doe.errors import ForbiddenError, TooLargeError
from tripod_doe.service.limits import Limits
from tripod_doe.service.problems import place_of, problems_of
from tripod_doe.service.requests.plans import plan_upload
from tripod_doe.service.requests.uploads import upload_texts, write_upload
from tripod_doe.service.runs.processes import run_words
from tripod_doe.service.runs.run_table import PointCounts, Run, State
from tripod_doe.study.definition.study_file import parse_study
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.execution.timing import time_points

GOOD = textwrap.dedent(COAST)
TABLE = GOOD + '\n[design]\nkind = "table"\ntable = "{}"\n'
CHAIN = """
[workflow]
name = "two"
[steps.map]
kind = "study"
study = "{}"
[steps.beside]
kind = "comparison"
inputs = ["map"]
settings = {{ measurement = "{}" }}
"""


@pytest.fixture(params=["/plans", "/runs"])
def send(request, api):
    """Submit or plan, and give the status with the first error."""

    def send(body):
        answer = api.post(request.param, body)
        return answer.status_code, answer.json()["errors"][0]

    return send


def test_a_function_is_refused_before_its_module_is_imported(send, tmp_path, monkeypatch):
    mark = tmp_path / "imported"
    (tmp_path / "evil.py").write_text(f"open({str(mark)!r}, 'w')\ndef f(x): return {{'y': x}}\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    study = '[study]\nname = "evil"\nfunction = "evil:f"\n[factors.x]\nvalues = [1]\n'
    status, error = send({"study": study})
    assert status == 403
    assert (error["key"], error["value"], error["line"], error["column"]) == ("function", "evil:f", 3, 1)
    for odd in (
        'study = {name = "e", function = "evil:f"}\nfactors.x.values = [1]',
        'study.name = "e"\nstudy."function" = "evil:f"',
    ):
        assert send({"study": odd})[0] == 403
    assert send({"workflow": CHAIN.format("a.toml", "m.csv"), "files": {"a.toml": study, "m.csv": ""}})[0] == 403
    assert not mark.exists()


@pytest.mark.parametrize(
    "name",
    [
        "../points.csv",
        "/etc/passwd",
        "a/points.csv",
        "..",
        ".hidden",
        "",
        "other.csv",
        "points.csv\\u0000",
        "C:points.csv",
    ],
)
def test_tables_come_from_the_upload_alone(send, name):
    status, error = send({"study": TABLE.format(name), "files": {"points.csv": "joint_angle_deg\n3\n"}})
    assert status == 403
    assert error["key"] == "table"
    assert error["line"] == TABLE.format(name).split("\n").index(f'table = "{name}"') + 1


def test_marks_in_front_of_texts_are_left_out():
    """Regression: a study that Notepad had saved was refused, which the command line takes."""
    body = {"study": "\ufeff[study]\n", "files": {"points.csv": "\ufeffx\n1\n"}}
    assert upload_texts(body) == ("study", {"study.toml": "[study]\n", "points.csv": "x\n1\n"})


def test_an_uploaded_table_is_used(api):
    table = "joint_angle_deg,speed_rpm,bearing_radial_clearance_mm\n3,100,0.02\n14,2000,0.01\n8,900,0.03\n"
    body = {"study": TABLE.format("points.csv"), "files": {"points.csv": table}, "timing": False}
    refused = api.post("/plans", body).json()["errors"][0]["message"]
    assert "[factors.joint_angle_deg]: the table has joint_angle_deg = 3.0; leave the keys" in refused
    plan = api.post("/plans", body | {"study": re.sub("values = .*", "", body["study"])})
    assert plan.json()["points"] == 3


@pytest.mark.parametrize(
    "name", ["../a.csv", "/a.csv", "a/b", "..", ".a", "", "a" * 200, "study.toml", "a\x00b", "a\nb"]
)
def test_files_have_plain_names(send, name):
    assert send({"study": GOOD, "files": {name: ""}})[0] == 403


@pytest.mark.parametrize(
    ("study", "measurement"),
    [("../a.toml", "m.csv"), ("a.toml", "/etc/passwd"), ("b.toml", "m.csv"), ("a.toml", "n.csv")],
)
def test_a_workflow_reads_its_uploads_alone(send, study, measurement):
    assert send({"workflow": CHAIN.format(study, measurement), "files": {"a.toml": GOOD, "m.csv": "x"}})[0] == 403


def test_a_design_that_a_workflow_changes_reads_its_uploads_alone(send):
    chain = '[workflow]\nname = "w"\n[steps.a]\nkind = "study"\nstudy = "a.toml"\ndesign = { table = "/etc/passwd" }\n'
    assert send({"workflow": chain, "files": {"a.toml": GOOD}})[0] == 403


MARKER = "import pathlib\npathlib.Path({!r}).touch()\ndef f(x): return {{'y': x}}\n"
JAMMED = '\n[run]\nexpected_outcomes = ["jammed"]\n'
FUNCTION = '[study]\nname = "evil"\nfunction = "evil:f"\n[factors.x]\nvalues = [1]\n'
STEP = '[workflow]\nname = "w"\n[steps.a]\nkind = "study"\nstudy = "{}"\n'


@pytest.mark.parametrize("name", ["s.csv", "s", "s.TOML", "toml"])
def test_no_name_of_an_uploaded_file_makes_its_function_run(send, tmp_path, name):
    mark = tmp_path / "imported"
    files = {name: FUNCTION, "evil.py": MARKER.format(str(mark))}
    status, error = send({"workflow": STEP.format(name), "files": files})
    assert (status, error["key"], error["file"]) == (403, "function", name)
    assert not mark.exists()


@pytest.mark.parametrize("name", ["s.csv", "s.TOML"])
def test_no_step_that_chooses_for_an_uploaded_study_runs_its_function(tmp_path, name):
    mark = tmp_path / "imported"
    files = {name: FUNCTION, "evil.py": MARKER.format(str(mark))}
    chosen = STEP.format("b.toml") + f'[steps.b]\nkind = "choose"\ninputs = ["a"]\nsettings = {{ study = "{name}" }}\n'
    write_upload(tmp_path / "upload", {"workflow.toml": chosen, "b.toml": GOOD + JAMMED} | files)
    path, out = tmp_path / "upload" / "workflow.toml", tmp_path / "out"
    with pytest.raises(ForbiddenError, match="functions are not allowed here"):
        td.run_workflow(path, out, workers=0, progress=False, untrusted=True)
    assert not mark.exists()


@pytest.mark.parametrize("name", ["/etc/passwd", "../../../../etc/passwd", "missing.csv", ""])
def test_no_name_of_an_uploaded_study_makes_it_read_a_file_of_the_server(send, name):
    status, error = send({"workflow": STEP.format("s.csv"), "files": {"s.csv": TABLE.format(name)}})
    assert (status, error["key"], error["file"]) == (403, "table", "s.csv")
    assert "root:" not in error["message"]


def test_what_the_supervisor_starts_obeys_the_rules_of_uploads(tmp_path, monkeypatch):
    """The study is read again there: a file that changed in between, or got by the check, still runs nothing."""
    mark, upload = tmp_path / "imported", tmp_path / "upload"
    write_upload(
        upload,
        {"study.toml": FUNCTION, "workflow.toml": STEP.format("study.toml"), "evil.py": MARKER.format(str(mark))},
    )
    run = Run("0", "study", "n", "", State.QUEUED, plan={}, counts=PointCounts(1), created="", updated="")
    for kind in ("study", "workflow"):
        words = run_words(replace(run, kind=kind), tmp_path, workers=0)
        assert main(words) == 2
    assert not mark.exists()
    assert main(["run", str(upload / "study.toml"), "--out", str(tmp_path / "own"), "--workers", "0"]) == 0
    assert mark.exists()


def test_a_timed_plan_obeys_the_rules_of_uploads(tmp_path):
    """Points are timed in a process of its own, which reads the study again."""
    mark = tmp_path / "imported"
    (tmp_path / "evil.py").write_text(MARKER.format(str(mark)))
    study = parse_study(GOOD, folder=StudyFolder(tmp_path, trusted=False))
    assert time_points(replace(study, text=FUNCTION), 5.0) == []
    assert not mark.exists()


def test_a_workflow_is_planned_step_by_step(api):
    chain = '[workflow]\nname = "w"\n[steps.a]\nkind = "study"\nstudy = "a.toml"\n[steps.b]\nkind = "report"\ninputs = ["a"]\n'
    plan = api.post("/plans", {"workflow": chain, "files": {"a.toml": GOOD}}).json()
    assert plan["points"] == plan["steps"]["a"]["points"] == 8
    assert plan["steps"]["b"] == {"kind": "report", "inputs": ["a"]}
    wrong = api.post("/plans", {"workflow": chain, "files": {"a.toml": GOOD.replace("-35", "-1e9")}}).json()["errors"][
        0
    ]
    assert (wrong["file"], wrong["key"], wrong["line"]) == ("a.toml", "torque_n_m", 7)


def test_a_study_whose_model_is_chosen_is_planned_with_its_pilot(api):
    study = GOOD.replace('"equilibrium"', '"auto"') + "\n[accuracy]\nthrust_amplitude_3 = 0.05\n"
    plan = api.post("/plans", {"study": study, "timing": False}).json()
    assert plan["points"] == 8
    assert plan["model_chosen_by_pilot"]
    assert plan["cpu_seconds"] is None
    assert any("pilot" in line for line in plan["choice"])


@pytest.mark.parametrize(
    "text",
    [
        "[[" * 450 + "]]" * 450,
        "a = " + "[" * 900 + "]" * 900,
        "a = " + "{a=" * 900,
        "a." * 20_000 + "a = 1",
        "[" + "a." * 20_000 + "a]",
        r'"\"".' * 20_000 + "a = 1",
    ],
)
def test_nested_and_dotted_texts_are_refused_at_once(send, text):
    assert send({"study": text})[0] == 422


@pytest.mark.parametrize(("count", "expected"), [(1_000_000_000, (422, "1,000,000")), (900_000, (413, "200,000"))])
def test_too_many_values_are_refused_before_they_are_made(send, count, expected):
    levels = f"count = {count}\nlow = 1\nhigh = 2"
    status, error = send({"study": f'[study]\nname = "x"\n[factors.joint_angle_deg]\n{levels}\n'})
    assert status == expected[0]
    assert expected[1] in error["message"]


def test_a_grid_of_a_thousand_million_points_is_refused_with_its_size(send):
    grid = "".join(
        f"[factors.{name}]\ncount = 1000\nlow = 1\nhigh = 2\n"
        for name in ("joint_angle_deg", "torque_n_m", "speed_rpm")
    )
    status, error = send({"study": '[study]\nname = "x"\n' + grid})
    assert status == 413
    assert "1,000,000,000 points" in error["message"]


def test_a_study_of_too_many_cpu_hours_or_bytes_is_refused_with_its_price(write_study, tmp_path):
    write_study(GOOD.replace('"equilibrium"', '"needles"'))
    for limits, unit in ((Limits(cpu_hours=1e-4), "CPU-hours"), (Limits(cube_bytes=100), "bytes")):
        with pytest.raises(TooLargeError, match=unit):
            plan_upload(tmp_path, "study", limits, timing=False)
    assert plan_upload(tmp_path, "study", Limits(), timing=False)["points"] == 8


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (("joint_angle_deg]", "joint_angel_deg]"), ("joint_angel_deg", None, 10, 2, "joint_angle_deg")),
        (("torque_n_m = -35", "torque_nm = -35"), ("torque_nm", -35, 7, 1, "torque_n_m")),
        (("torque_n_m = -35", 'torque_n_m = "x"'), ("torque_n_m", "x", 7, 1, None)),
        (('model = "equilibrium"', 'model = "equilibrum"'), ("model", "equilibrum", 6, 1, "equilibrium")),
        (("values = [150", "valus = [150"), ("valus", None, 14, 1, "values")),
        (("outputs = [", "output = ["), ("output", None, 20, 1, "outputs")),
        (("name = ", "nam = "), ("name", None, 2, 2, None)),
        (("[150, 4000]", "[150, 1e9]"), ("speed_rpm", 1e9, 13, 2, None)),
        (("[150, 4000]", "[150, 4000"), (None, None, 16, 1, None)),
    ],
)
def test_a_complaint_points_to_its_line_and_column(api, change, expected):
    answer = api.post("/plans", {"study": GOOD.replace(*change), "timing": False})
    assert answer.status_code == 422
    errors = answer.json()["errors"]
    found = [tuple(error[key] for key in ("key", "value", "line", "column", "near")) for error in errors]
    assert expected in found
    assert all(error["file"] == "study.toml" for error in errors)


def test_keys_are_found_in_every_form_of_toml():
    text = 'a.b = 1\n[t]\nx = {y = 1, z = 2}\nnote = """\nq = 1\n"""\n"q" = 3\n  [ t.u ]\n  v = [\n  1,\n  ]\n'
    assert place_of(text, ["a", "b"]).line == 1
    assert (place_of(text, ["t", "x", "z"]).line, place_of(text, ["t", "x", "z"]).column) == (3, 13)
    assert place_of(text, ["t", "q"]).line == 7
    assert (place_of(text, ["t", "u", "v"]).line, place_of(text, ["t", "u", "v"]).column) == (9, 3)
    assert place_of(text, ["t", "u", "missing"]).line == 8
    assert place_of(text, ["other"]) is None


def test_a_list_of_changes_stays_with_its_file():
    told = "study.toml: the study changed\n  base.torque_n_m: 3 -> 4\n  factors.x.values.1: not set -> 3"
    first, second, third = problems_of(told, {"study.toml": "[base]\ntorque_n_m = 4\n[factors]\nx = {values=[3]}\n"})
    assert (second.key, second.table, second.line, second.file) == ("torque_n_m", "base", 2, "study.toml")
    assert (third.line, first.line) == (4, None)
