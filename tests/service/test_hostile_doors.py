"""Requests made to hurt at the doors of what is written, shared, grown and handed on: refused, and nothing is left.

Each is a row: method, path, body. A refusal says why, and the run, what was submitted, its links, its files and the list
of runs are as before.
"""

import json
import time

import pytest
from service_client import ADDRESS, API, COAST

RUN = f"{API}/runs/{{run}}"
BIG = "9" * 400
ESCAPES = "\\u001b[2J"
LONG = "x" * 100_000
DEEP = '{"a":' * 3_000
FORMULAS = {
    "import": "__import__('os')",
    "attribute": "thrust_amplitude.__class__",
    "call": "open('/etc/passwd')",
    "power": "9 ** 9 ** 9 ** 9",
    "long": " + ".join(["thrust_amplitude[3]"] * 2_000),
    "deep": "(" * 2_000 + "1" + ")" * 2_000,
    "nothing": "",
    "itself": "itself + 1",
    "label": f"thrust_amplitude[{BIG}]",
    "comprehension": "[x for x in thrust_amplitude]",
}


def formulas(name, formula, **more):
    return json.dumps({"responses": {name: {"formula": formula, **more}}})


GROWN = [
    *(("POST", f"{RUN}/derive", formulas(name, formula)) for name, formula in FORMULAS.items()),
    ("POST", f"{RUN}/derive", formulas("../../x", "thrust_amplitude[3]")),
    ("POST", f"{RUN}/derive", formulas("outcome", "thrust_amplitude[3]")),
    ("POST", f"{RUN}/derive", formulas("a", "thrust_amplitude[3]", unit=LONG)),
    ("POST", f"{RUN}/derive", formulas("a", "thrust_amplitude[3]", meaning=LONG)),
    ("POST", f"{RUN}/derive", formulas("a", "thrust_amplitude[3]", function="os:system")),
    ("POST", f"{RUN}/derive", f'{{"responses": {{"{ESCAPES}": {{"formula": "thrust_amplitude[3]"}}}}}}'),
    ("POST", f"{RUN}/derive", '{"responses": 3}'),
    ("POST", f"{RUN}/derive", '{"drop": ["outcome"]}'),
    ("POST", f"{RUN}/derive", json.dumps({"drop": ["x"] * 201})),
    ("POST", f"{RUN}/derive", "{}"),
    ("POST", f"{RUN}/derive", DEEP),
    ("POST", f"{RUN}/extend", json.dumps({"study": COAST.replace("[2.5, 17]", f"[2.5, 17, {BIG}]")})),
    ("POST", f"{RUN}/extend", json.dumps({"study": COAST + '\nfunction = "os:system"'})),
    ("POST", f"{RUN}/extend", json.dumps({"study": COAST, "files": {"../study.toml": "x"}})),
    ("POST", f"{RUN}/extend", json.dumps({"study": COAST, "files": {"study.toml": "x"}})),
    ("POST", f"{RUN}/extend", '{"workflow": "[workflow]\\nname = 3"}'),
    ("POST", f"{RUN}/extend", '{"study": NaN}'),
    ("POST", f"{RUN}/plans", '{"study": "", "responses": {"a": {"formula": "1"}}}'),
    ("POST", f"{RUN}/plans", formulas("a", "exit()")),
]
WRITTEN = [
    ("PATCH", RUN, '{"name": 3}'),
    ("PATCH", RUN, f'{{"name": "{ESCAPES}"}}'),
    ("PATCH", RUN, json.dumps({"name": LONG})),
    ("PATCH", RUN, json.dumps({"note": LONG})),
    ("PATCH", RUN, json.dumps({"tags": ["a"] * 1_000})),
    ("PATCH", RUN, json.dumps({"tags": [LONG]})),
    ("PATCH", RUN, '{"tags": "steel"}'),
    ("PATCH", RUN, '{"owner": {"a": 1}}'),
    *(("PATCH", RUN, json.dumps({"name": name})) for name in ("../../etc", "/etc", "a//b", "a/", "a/./b", "a/ .. /b")),
    ("PATCH", RUN, '{"state": "failed"}'),
    ("PATCH", RUN, '{"place": "/etc"}'),
    ("PATCH", RUN, "[]"),
    ("DELETE", f"{RUN}?bin=true", ""),
    ("DELETE", f"{RUN}?bin=perhaps", ""),
    ("POST", f"{RUN}/restore", ""),
    ("POST", f"{API}/runs/..%2f../restore", ""),
]
SHARED = [
    ("POST", f"{RUN}/shares?days=0", ""),
    ("POST", f"{RUN}/shares?days=-1", ""),
    ("POST", f"{RUN}/shares?days={BIG}", ""),
    ("POST", f"{RUN}/shares?days=nan", ""),
    ("POST", f"{API}/runs/none/shares", ""),
    ("DELETE", f"{RUN}/shares/..%00", ""),
    ("DELETE", f"{RUN}/shares/{BIG}", ""),
]
HANDED_ON = [
    *(
        ("GET", f"{RUN}/what-if{words}", "")
        for words in ("", "?step=..", "?step=..%2f..", "?step=%00", f"?step={LONG[:50_000]}")
    ),
    ("GET", f"{API}/runs/..%2f../what-if", ""),
    ("POST", f"{RUN}/what-if", "{}"),
    ("GET", f"{API}/runs?page={BIG}", ""),
    ("GET", f"{API}/runs?page=-1", ""),
    ("GET", f"{API}/runs?sort=__class__", ""),
    ("GET", f"{API}/runs?state=everything", ""),
    ("GET", f"{API}/runs?since=9999999-99-99", ""),
    ("GET", f"{RUN}/diff/none", ""),
    ("GET", f"{RUN}/diff/..%00", ""),
    ("GET", f"{RUN}/diff/{{run}}?variable=%1b%5b2J", ""),
    ("GET", f"{RUN}/base?candidate={BIG}", ""),
    ("GET", f"{RUN}/base?candidate=-1", ""),
    ("GET", f"{RUN}/query?variable=thrust_rms&format=exe", ""),
    ("GET", f"{RUN}/query?variable=thrust_rms&decimal_comma=perhaps", ""),
    ("GET", f"{RUN}/query?variable=thrust_rms&analysis=..%2fcube", ""),
    ("GET", f"{RUN}/summary.exe", ""),
]


@pytest.fixture(scope="module")
def trace(api, coast, settings):
    """All that a request could leave: the run, what was submitted, its links, its files, and the other runs."""

    def look():
        directory = settings.folder / coast
        files = sorted((path.relative_to(directory), path.stat().st_size) for path in directory.rglob("*.*"))
        answers = [
            api.get(path).json() for path in (f"/runs/{coast}", f"/runs/{coast}/upload", f"/runs/{coast}/shares")
        ]
        return answers, [path for path in files if "journal" not in path[0].name], len(api.get("/runs").json())

    return look


@pytest.mark.parametrize(("method", "path", "body"), [*GROWN, *WRITTEN, *SHARED, *HANDED_ON])
def test_it_is_refused_and_leaves_nothing(api, coast, trace, method, path, body):
    before, started = trace(), time.monotonic()
    address = ADDRESS + path.replace("{run}", coast)
    answer = api.client.request(method, address, content=body, headers={"content-type": "application/json"})
    assert 400 <= answer.status_code < 500, answer.text
    assert time.monotonic() - started < 5
    assert len(answer.content) < 20_000
    assert all(problem["message"].isprintable() for problem in answer.json()["errors"])
    assert trace() == before
