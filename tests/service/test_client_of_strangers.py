"""What `td.connect` makes of a server: the verbs of the package, and a server that is not what it seems."""

from __future__ import annotations

import io
import json
import threading
from email.message import Message
from http.server import BaseHTTPRequestHandler, HTTPServer

import numpy as np
import pytest
import xarray as xr

import tripod_doe as td
from tripod_doe import client
from tripod_doe.client import Service, _selection, submission
from tripod_doe.errors import TripodDoeError
from tripod_doe.study.definition.toml_text import toml_text


def test_a_redirection_is_neither_followed_nor_taken_for_an_answer():
    asked = []

    class Elsewhere(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            self.send_response(302)
            self.send_header("Location", f"http://localhost:{server.server_port}/elsewhere")
            self.send_header("Content-Type", "application/json")
            self.end_headers()
            self.wfile.write(b"[]")

        def log_message(self, *words):
            pass

    with HTTPServer(("127.0.0.1", 0), Elsewhere) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with pytest.raises(TripodDoeError, match="302"):
            td.connect(f"http://127.0.0.1:{server.server_port}", token="secret")
        server.shutdown()
    assert asked == ["/api/v1/runs?page=1"]


RUN = {"id": "a", "name": "a", "state": "finished", "message": ""}
POINTS = {"total": 9, "finished": 9, "failed": 0, "missing": 0}


class Answers:
    """An opener of a server that says what it likes."""

    def __init__(self, content, kind="application/json"):
        self.content, self.kind = content, kind

    def open(self, request, timeout):
        answer = io.BytesIO(self.content)
        answer.status, answer.headers = 200, Message()
        answer.headers["Content-Type"] = self.kind
        return answer


def service_that_says(content, kind="application/json"):
    service = Service("http://127.0.0.1:1", "token")
    service._opener = Answers(content if isinstance(content, bytes) else json.dumps(content).encode(), kind)
    return service


def test_a_state_with_control_characters_does_not_reach_the_terminal():
    (run,) = service_that_says([RUN | {"state": "\x1b]0;pwned\x07", "points": POINTS}]).runs()
    assert "\x1b" not in repr(run)
    (run,) = service_that_says([RUN | {"state": "failed", "message": "\x1b[2J", "points": POINTS}]).runs()
    with pytest.raises(TripodDoeError) as failed:
        run.wait(progress=False)
    assert "\x1b" not in str(failed.value)


@pytest.mark.parametrize(
    "answer",
    [
        {},
        [1],
        [RUN],
        [RUN | {"points": POINTS | {"total": "9"}}],
        [RUN | {"name": 3, "points": POINTS}],
        b"{",
        b"[" * 99_999,
    ],
)
def test_what_describes_no_run_is_refused_in_words(answer):
    """Regression: a total of "9" was a TypeError."""
    with pytest.raises(TripodDoeError, match="its answer"):
        service_that_says(answer).runs()


def test_an_answer_without_end_is_not_read_to_its_end(monkeypatch):
    monkeypatch.setattr(client, "_MOST_FILE_BYTES", 1_000)
    assert len(service_that_says(b"x" * 1_000, "text/html").ask("GET", "/")) == 1_000
    with pytest.raises(TripodDoeError, match="an answer of more than 1,000 bytes"):
        service_that_says(b"x" * 1_001, "text/html").ask("GET", "/")


def test_a_text_that_is_spelled_as_a_file_sends_no_file(tmp_path):
    for name in (".env", "id_rsa", "points.csv"):
        (tmp_path / name).write_text("torque_n_m\n50\n")
    study = tmp_path / "s.toml"
    study.write_text(
        '[study]\nname = "id_rsa"\nquestion = ".env"\n[factors.torque_n_m]\n'
        '[design]\nkind = "table"\ntable = "points.csv"\n'
    )
    assert list(submission(study)["files"]) == ["points.csv"]
    study.write_text(study.read_text().replace("points.csv", ".env"))
    assert submission(study)["files"] == {}
    (tmp_path / "t.csv").symlink_to(tmp_path / ".env")
    study.write_text(study.read_text().replace(".env", "t.csv"))
    assert submission(study)["files"] == {}, "a link in a stranger's folder may lead to any file"


@pytest.mark.parametrize("named", ['table = "records.csv"', 'files = ["r*.csv"]'])
def test_a_fit_is_sent_with_its_records(tmp_path, named):
    """Regression: records that a table or a pattern names stayed behind, and the service refused the fit."""
    (tmp_path / "records.csv").write_text("torque_n_m, file\n50, r1.csv\n60, r2.csv\n70, ../r3.csv\n80, .r4.csv\n")
    for name in ("r1.csv", "r2.csv", ".r4.csv", "other.csv"):
        (tmp_path / name).write_text("rotation_deg,thrust_n\n0,1\n")
    fit = tmp_path / "fit.toml"
    fit.write_text(f'[fit]\nname = "a"\n[records]\n{named}\n')
    assert sorted(submission(fit)["files"]) == ["r1.csv", "r2.csv", "records.csv"]


def test_selections_are_those_of_a_query():
    chosen = {"a": slice(None, 50), "b": np.array([300, 600]), "c": "needles", "d": slice(1.5, None)}
    assert _selection(chosen) == ["a=:50", "b=300,600", "c=needles", "d=1.5:"]


def test_a_token_that_goes_over_the_network_in_the_clear_warns():
    with pytest.warns(UserWarning, match="unencrypted"), pytest.raises(TripodDoeError):
        td.connect("http://name.invalid", token="secret")


def test_points_of_a_service_are_those_of_this_process(serve_for_all):
    """Exact: every combination of the values, also the point that jams."""
    service = td.connect(serve_for_all.address, token=serve_for_all.token)
    models = ["equilibrium", "kinetostatic"]
    asked = {"bearing_radial_clearance_mm": [0.01, -0.05], "joint_angle_deg": [4, 9], "model": models}
    there, here = service.simulate(**asked), td.simulate(**asked)
    assert here["outcome"].values.any()
    xr.testing.assert_identical(there.drop_attrs(deep=False), here.drop_attrs(deep=False))
    assert there.attrs["parameters"] == here.attrs["parameters"]
    assert there.attrs["model_notes"] == here.attrs["model_notes"]
    for wrong in ({"joint_angle": [4]}, {"joint_angle_deg": []}, {"joint_angle_deg": [[1, 2]]}, {"model": [object()]}):
        with pytest.raises(TripodDoeError):
            service.simulate(**wrong)


@pytest.mark.slow
@pytest.mark.usefixtures("pages_not_made")
def test_a_search_by_a_service_gives_its_candidates_and_its_points(serve_for_all, tmp_path):
    (tmp_path / "bore.toml").write_text(
        '[optimisation]\nname = "Bore"\n[base]\nmodel = "equilibrium"\n[variables.needle_pitch_diameter_mm]\nlow = 16.2\n'
        'high = 18\n[objectives.third]\noutput = "thrust_amplitude"\norder = 3\n[search]\nevaluations = 20\n'
    )
    service = td.connect(serve_for_all.address, token=serve_for_all.token)
    run = service.run(tmp_path / "bore.toml", progress=False)
    assert run.analysis("candidates").sizes["candidate"] == 20
    assert run.analysis("front").sizes["candidate"] == 1
    points = run.open_cube("points")
    assert points.sizes["point"] == run.points["total"]
    assert run.query("thrust_amplitude", {"order": 3}, step="points").sizes["point"] == points.sizes["point"]
    with pytest.raises(TripodDoeError, match="points"):
        run.open_cube()


@pytest.mark.slow
def test_a_fit_by_a_service_gives_its_unknowns_its_points_and_its_report(serve_for_all, tmp_path):
    """Recovers the friction with which the record was computed."""
    point = {"model": "equilibrium", "joint_angle_deg": 8, "torque_n_m": 50, "speed_rpm": 600}
    thrust = td.simulate(**point, groove_sliding_friction=0.07)["thrust"].values
    noise = np.random.default_rng(1).normal(0, 0.05, 2 * thrust.size)
    rows = [f"{angle},{force}" for angle, force in enumerate(np.tile(thrust, 2) + noise)]
    (tmp_path / "record.csv").write_text("\n".join(["rotation_deg,thrust_n", *rows]))
    fit = {
        "fit": {"name": "friction"},
        "base": point,
        "unknowns": {"groove_sliding_friction": {"low": 0.02, "high": 0.15}},
        "records": {"files": ["record.csv"], "orders": [3]},
    }
    (tmp_path / "fit.toml").write_text(toml_text(fit))
    run = td.connect(serve_for_all.address, token=serve_for_all.token).run(
        tmp_path / "fit.toml", wait=False, progress=False
    )
    assert run.wait(progress=False).state == "finished"
    found = run.analysis("fit").sel(unknown="groove_sliding_friction")
    assert float(found["low"]) < 0.07 < float(found["high"])
    assert float(found["value"]) == pytest.approx(0.07, rel=0.01)
    assert run.open_cube("points").sizes["point"] == run.points["total"]
    assert "friction" in run.report()


@pytest.mark.slow
@pytest.mark.usefixtures("pages_not_made")
def test_a_run_of_a_service_grows_and_is_compared_as_in_python(serve_for_all, tmp_path):
    study = {
        "study": {"name": "grows from Python"},
        "base": {"model": "equilibrium", "torque_n_m": 70},
        "factors": {"joint_angle_deg": {"values": [4, 9]}},
        "keep": {"outputs": ["thrust_amplitude", "thrust_phase_deg", "thrust"]},
    }
    run = td.connect(serve_for_all.address, token=serve_for_all.token).run(study, progress=False)
    study["factors"]["joint_angle_deg"]["values"].append(12)
    assert run.extend(study, progress=False).points == {"total": 3, "finished": 3, "failed": 0, "missing": 0}
    (tmp_path / "r.toml").write_text('[responses.twice]\nformula = "2 * thrust_amplitude[3]"\nunit = "N"\n')
    assert run.derive(tmp_path / "r.toml").state == "finished"
    cube = run.open_cube()
    assert "twice" in cube
    assert {"cpu_seconds", "worker"} <= set(cube)  # regression: it had no costs
    assert "twice" not in run.derive(drop=["twice"]).open_cube()
    measured = tmp_path / "m.csv"
    rows = [
        f"{angle},{float(force)}" for angle, force in enumerate(np.tile(5 * np.sin(np.radians(3 * np.arange(360))), 3))
    ]
    measured.write_text("\n".join(["rotation_deg,thrust_n", *rows]))
    expected = td.compare(measured, td.model_point(cube, ["joint_angle_deg=9"]))
    xr.testing.assert_equal(run.compare(measured, {"joint_angle_deg": 9}), expected)
    for wrong in ({}, {"joint_angle_deg": 5}, {"speed": 9}):
        with pytest.raises(TripodDoeError):
            run.compare(measured, wrong)
    for wrong in (
        {"import": {"formula": "__import__('os')"}},
        {"x": {"formula": "thrust[" * 500}},
        {"x": {}},
        {"x": 3},
    ):
        with pytest.raises(TripodDoeError):
            run.derive(wrong)


def test_tables_and_records_of_spreadsheets_are_uploaded_as_text(tmp_path):
    """Regression: a table that every command read was refused, as it is not UTF-8."""
    (tmp_path / "fit.toml").write_text('[fit]\nname = "x"\n[records]\ntable = "records.csv"\n')
    (tmp_path / "records.csv").write_bytes("file;Öl\r\nWelle_ä.csv;60 °C\r\n".encode("utf-16"))
    (tmp_path / "Welle_ä.csv").write_bytes("Drehwinkel [°];Kraft [N]\n0;1,5\n".encode("cp1252"))
    files = submission(tmp_path / "fit.toml")["files"]
    assert files["records.csv"].startswith("file;Öl\r\n")
    assert files["Welle_ä.csv"].startswith("Drehwinkel [°];")
