"""The page on the service tells every request, every limit and every status, and no other."""

from __future__ import annotations

import re
from pathlib import Path

from tripod_doe.service.limits import MEANINGS, Limits

TEXT = (Path(__file__).parent.parent.parent / "docs" / "reference" / "service.md").read_text()


def test_every_request_is_described(api):
    told = set(re.findall(r"`(GET|POST|DELETE|PUT|PATCH) (/api/v1[^`?]*)`", TEXT))
    described = api.get("/openapi.json").json()["paths"]
    known = {(method.upper(), path) for path, methods in described.items() for method in methods}
    known = {(method, path) for method, path in known if not path.endswith("/report")}  # leads to report/
    assert told - {("GET", "/api/v1/openapi.json")} == {
        (method, path) for method, path in known if path.startswith("/api/")
    }


def test_every_limit_is_told_with_its_value():
    rows = re.findall(r"^\| `(\w+)` \| ([\d,]+) \| (.*) \|$", TEXT, re.MULTILINE)
    assert {name: int(value.replace(",", "")) for name, value, _ in rows} == vars(Limits())
    assert {name: meaning for name, _, meaning in rows} == MEANINGS


def test_every_status_is_told(api):
    told = set(re.findall(r"^\| (\d{3}) \|", TEXT, re.MULTILINE))
    routes = api.get("/openapi.json").json()["paths"].values()
    given = {status for methods in routes for route in methods.values() for status in route["responses"]}
    assert {status for status in given if status >= "4"} == told
