"""The curl calls of the page on HTTP: there is one for each route, and a live service answers each as the page says."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest
from server_process import Server

EXAMPLES = Path(__file__).parents[2] / "docs" / "reference" / "http_examples.toml"
BINARY = ("-o ", "/events", "/report", "/pages/", "/log", "/base")
"""Calls whose answer is no JSON."""
OTHER = """[study]
name = "other"
[base]
model = "equilibrium"
[factors.joint_angle_deg]
values = [12]
"""
DEEPEST, MOST_KEYS, LONGEST = 2, 10, 40
LAST = ("DELETE /runs/{run_id}", "POST /runs/{run_id}/restore")

"""Calls after all others: a run in the bin answers nothing."""


def shape(value):
    """What an answer holds: keys in their order of names, types of values; of a list the first entry."""
    if isinstance(value, dict):
        return {key: shape(value[key]) for key in sorted(value)}
    if isinstance(value, list):
        return [shape(entry) for entry in value[:1]]
    return "number" if isinstance(value, int | float) and not isinstance(value, bool) else type(value).__name__


def shortened(value, depth=0):
    """An answer as the page shows it: the first entry of lists, short texts, and no large objects within objects."""
    if isinstance(value, dict):
        inside = {key: shortened(entry, depth + 1) for key, entry in value.items()}
        return inside if depth == 0 or (depth <= DEEPEST and len(inside) <= MOST_KEYS) else "..."
    if isinstance(value, list):
        return [shortened(entry, depth) for entry in value[:1]]
    if isinstance(value, float):
        return float(f"{value:.4g}")
    return value if not isinstance(value, str) or len(value) <= LONGEST else "..."


@pytest.fixture(scope="module")
def examples():
    return tomllib.loads(EXAMPLES.read_text(encoding="utf-8"))


def test_each_route_has_one_call_with_its_method_and_address(examples, api):
    routes = api.get("/openapi.json").json()["paths"]
    names = [
        f"{method.upper()} {path.removeprefix('/api/v1')}" for path, methods in routes.items() for method in methods
    ]
    assert sorted(examples) == sorted(names)
    for name, example in examples.items():
        method, path = name.split(" ", 1)
        call = example["curl"]
        assert re.search(re.sub(r"\\{\w+\\}", r"[$\\w.]+", re.escape("$SERVER" + path)) + r"[\s\"?]|$", call), name
        assert ("-X" in call or "-d " in call) == (method != "GET"), name
        assert method in ("GET", "POST") or f"-X {method} " in call, name
        answers = routes[f"/api/v1{path}"][method.lower()]["responses"]
        assert str(example.get("status", 200)) in answers or "201" in answers, name


@pytest.mark.slow
@pytest.mark.skipif(not (shutil.which("curl") and shutil.which("jq")), reason="curl or jq is not installed")
def test_a_live_service_answers_each_call_as_the_page_says(examples, tmp_path):
    server = Server(tmp_path / "results", "--workers", "0")
    try:
        answers = _answers(server, examples, tmp_path)
    finally:
        server.end()
    wrong = {
        name: shortened(value)
        for name, value in answers.items()
        if value
        and "answer" in examples[name]
        and shape(json.loads(examples[name]["answer"])) != shape(shortened(value))
    }
    assert not wrong, json.dumps(wrong)


def _answers(server, examples, folder):
    """What a live service answers to each call, in an order in which each has its run."""
    angle = np.arange(0, 1440, 4)
    rows = np.column_stack([angle, 10 * np.cos(3 * np.radians(angle))])
    np.savetxt(folder / "record.csv", rows, delimiter=",", header="rotation_deg,thrust_n", comments="")
    surroundings = {
        **os.environ,
        "SERVER": f"{server.address}/api/v1",
        "TOKEN": f"Authorization: Bearer {server.token}",
        "JSON": "Content-Type: application/json",
    }
    answers = {}
    waits = ("POST /runs", "POST /runs/{run_id}/extend", "POST /runs/{run_id}/derive")
    names = [*waits, *(name for name in examples if name not in (*waits, *LAST)), *LAST]
    names.sort(key=lambda name: "shares/{" in name)  # after the link is made
    names.sort(key=lambda name: name in LAST)
    for name in names:
        example = examples[name]
        if "$KEY" in example["curl"]:
            page = (folder / "report.html").read_text()
            surroundings["KEY"] = re.search(r"/pages/([^/]+)/", page)[1]
        call = re.sub(r"\bcurl ", r"curl -sS -w '\\n%{http_code}' ", example["curl"])
        done = subprocess.run(["bash", "-c", call], cwd=folder, env=surroundings, capture_output=True, text=True)
        body, _, status = done.stdout.rpartition("\n")
        assert int(status) == example.get(
            "status", 201 if name in ("POST /runs", "POST /runs/{run_id}/shares") else 200
        ), f"{name}: {status} {body[:500]}{done.stderr}"
        if not any(word in example["curl"] for word in BINARY) and body:
            answers[name] = json.loads(body)
        if name == "POST /runs":
            surroundings["RUN"] = answers[name]["id"]
            surroundings["OTHER"] = server.submit(OTHER)
        if name in waits:
            for run in ("RUN", "OTHER"):
                server.wait(surroundings[run], lambda told: told["state"] == "finished")
        if name == "POST /runs/{run_id}/shares":
            surroundings["SHARE"] = answers[name]["id"]
    return answers
