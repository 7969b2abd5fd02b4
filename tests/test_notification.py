"""Word of the end of a run: what is passed on, to whom, and that nothing else is reached."""

from __future__ import annotations

import json
import sys
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest

from tripod_doe.cli import main
from tripod_doe.errors import InputError
from tripod_doe.notification import Notifier

FACTS = {
    "state": "failed",
    "name": "$(touch pwned); `touch pwned` \x1b[2J",
    "message": "full disk",
    "points": {"total": 3},
}
STUDY = '[study]\nname = "x"\n[base]\nmodel = "equilibrium"\n[factors.joint_angle_deg]\nvalues = [4]\n'


@pytest.fixture
def hook():
    """A server of this machine; gives its address and what it was sent."""
    got = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self):
            got.append(
                (self.path, dict(self.headers), json.loads(self.rfile.read(int(self.headers["content-length"]))))
            )
            self.send_response(307 if self.path == "/moved" else 500 if self.path == "/broken" else 204)
            self.send_header("location", "/elsewhere")
            self.end_headers()

        def log_message(self, *words):
            pass

    server = HTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}", got
    server.shutdown()
    server.server_close()


def command(path, script):
    path.write_text(script)
    return f"{sys.executable} {path}"


def test_a_command_gets_the_facts_on_its_standard_input_and_no_shell_reads_them(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    script = "import sys, json; json.dump([sys.argv[1:], json.load(sys.stdin)], open('told.json', 'w'))"
    assert Notifier.of(command(tmp_path / "n.py", script) + " '$HOME;' x").tell(FACTS) == ""
    words, told = json.loads((tmp_path / "told.json").read_text())
    assert words == ["$HOME;", "x"]
    assert told == {"text": "$(touch pwned); `touch pwned` \\x1b[2J: failed: full disk", **FACTS}
    assert {path.name for path in tmp_path.iterdir()} == {"n.py", "told.json"}
    Notifier.of(command(tmp_path / "n.py", script)).tell({"name": "<!channel> A & B", "state": "finished"})
    assert json.loads((tmp_path / "told.json").read_text())[1]["text"] == "&lt;!channel&gt; A &amp; B: finished"


def test_a_webhook_gets_the_facts_and_its_trouble_names_the_host_only(hook, monkeypatch):
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")  # asked for nothing of this machine
    address, got = hook
    assert Notifier.of(f"{address}/services/SECRET?x=1").tell(FACTS) == ""
    path, headers, told = got[0]
    assert (path, told["state"]) == ("/services/SECRET?x=1", "failed")
    assert "authorization" not in {name.lower() for name in headers}
    assert "cookie" not in {name.lower() for name in headers}
    assert Notifier.of(f"{address}/moved").tell(FACTS) == "127.0.0.1 answered 307"
    assert Notifier.of(f"{address}/broken").tell(FACTS) == "127.0.0.1 answered 500"
    assert [path for path, *_ in got[1:]] == ["/moved", "/broken"]
    assert "SECRET" not in Notifier.of("http://127.0.0.1:9/SECRET").tell(FACTS)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("no-such-program-here", "no program 'no-such-program-here'"),
        ("", "no program ''"),
        ("'unfinished", "not a command"),
        ("http://example.com/hook", "example.com: an address of another machine begins with https://"),
        ("https://", "not an address"),
        ("https://a b/", "not an address"),
        ("@/no/such/file", "cannot read this file"),
        ("file:///etc/passwd", "no program"),
    ],
)
def test_what_cannot_be_told_is_refused_before_anything_runs(text, message):
    with pytest.raises(InputError) as refused:
        Notifier.of(text)
    assert message in str(refused.value)


def test_a_file_with_an_address_is_of_its_owner_alone(tmp_path):
    file = tmp_path / "hook"
    file.write_text("https://hooks.example/SECRET\n")
    file.chmod(0o644)
    with pytest.raises(InputError, match="other users can use this file"):
        Notifier.of(f"@{file}")
    file.chmod(0o600)
    assert Notifier.of(f"@{file}").url == "https://hooks.example/SECRET"


@pytest.mark.usefixtures("pages_not_made")
def test_runs_tell_how_they_ended_and_end_so_whatever_becomes_of_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.toml").write_text(STUDY)
    told = command(tmp_path / "n.py", "import sys; open('told.json', 'a').write(sys.stdin.read() + '\\n')")
    words = ["run", "s.toml", "--out", "out", "--workers", "0", "--notify"]
    assert main([*words, told]) == 0
    (tmp_path / "s.toml").write_text(STUDY.replace("4", "5"))
    assert main([*words, told]) == 2
    first, second = map(json.loads, (tmp_path / "told.json").read_text().splitlines())
    assert (first["state"], first["name"], first["directory"]) == ("finished", "out", str(tmp_path / "out"))
    assert second["state"] == "failed"
    assert "joint_angle_deg" in second["message"]
    capsys.readouterr()
    assert main([*words[:3], "out2", *words[4:], command(tmp_path / "m.py", "raise SystemExit('no line')")]) == 0
    assert "--notify: " in capsys.readouterr().err
    assert main([*words, "no-such-program-here"]) == 2
