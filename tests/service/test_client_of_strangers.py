"""What `td.connect` makes of a server that is not what it seems."""

from __future__ import annotations

import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

import tripod_doe as td
from tripod_doe.client import submission
from tripod_doe.errors import TripodDoeError


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


def test_a_token_that_goes_over_the_network_in_the_clear_warns():
    with pytest.warns(UserWarning, match="unencrypted"), pytest.raises(TripodDoeError):
        td.connect("http://name.invalid", token="secret")
