"""The page on the service tells every limit and every status, and no other."""

from __future__ import annotations

import re
from pathlib import Path

from tripod_doe.service.limits import Limits

TEXT = (Path(__file__).parent.parent.parent / "docs" / "reference" / "service.md").read_text()


def test_every_limit_is_told_with_its_value():
    rows = re.findall(r"^\| `(\w+)` \| ([\d,]+) \| (.*) \|$", TEXT, re.MULTILINE)
    described = [(each["name"], each["value"], each["meaning"]) for each in Limits().described()]
    assert [(name, int(value.replace(",", "")), meaning) for name, value, meaning in rows] == described


def test_every_status_is_told(api):
    told = set(re.findall(r"^\| (\d{3}) \|", TEXT, re.MULTILINE))
    routes = api.get("/openapi.json").json()["paths"].values()
    given = {status for methods in routes for route in methods.values() for status in route["responses"]}
    assert {status for status in given if status >= "4"} == told
