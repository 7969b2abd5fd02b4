"""Requests made to hurt: each is answered by a clear message or the right answer, soon, and none by an internal error."""

from __future__ import annotations

import json
import time

import pytest
from service_client import ADDRESS, API

BIG = "9" * 400
HEAD = '[study]\nname = "x"\n'
STUDY = HEAD + "[factors.joint_angle_deg]\nvalues = [{}]\n"
SELECTIONS = "&".join(f"select=order%3D{number}" for number in range(150))

ADDRESSES = [
    f"{API}/runs?{SELECTIONS}",
    f"/?{SELECTIONS}",
    f"/?{SELECTIONS}&token=wrong",
    f"{API}/runs/{{run}}/query?variable=thrust_rms&{SELECTIONS}",
    f"/runs/{{run}}?{SELECTIONS}",
    f"{API}/runs/..%00",
    f"{API}/runs/{{run}}/pages/x/..%00",
    f"{API}/runs/{{run}}/analysis/..%00.nc",
    "/assets/..%00",
    "/assets/%00/x",
    "/runs/{run}/%1b%5b2J",
    "/new?study=..%00",
    "/new?origin=..%00",
    f"{API}/runs/{{run}}/query?variable=%00",
    f"{API}/runs/{{run}}/query?variable=%ff%fe",
    f"{API}/runs/{{run}}/query?variable=thrust_rms&select=order%3D{BIG}",
    f"{API}/runs/{{run}}/query?variable=thrust_rms&where=1e999>0",
    f"{API}/runs/{{run}}/points/{BIG}",
    f"{API}/runs/{{run}}/points/-1",
    f"{API}/runs/{{run}}/figure?low=nan&high=1e400",
    f"{API}/runs/{{run}}/figure?low=1e999&high=-inf&kind=map",
    f"{API}/runs/{{run}}/cube.nc?step=%00",
    f"{API}/schema/study?scene=%00",
    f"/?order={BIG}",
    f"/runs/{{run}}/analyses?order={BIG}",
    f"/runs/{{run}}/behind?analysis=x&variable=y&cell={BIG}",
    "/parts/parameters?scene=%1b%5b",
    "/runs/{run}/view?select=%1b%5b2J%3D3&x=%00",
]

POINTS = [
    '{"joint_angle_deg": NaN}',
    '{"joint_angle_deg": -Infinity}',
    f'{{"joint_angle_deg": {BIG}}}',
    f'{{"joint_angle_deg": {BIG * 20}}}',
    f'{{"needle_count": {BIG[:99]}}}',
    f'{{"joint_angle_deg": "{BIG}"}}',
    '{"joint_angle_deg": 1e300}',
    '{"joint_angle_deg": 1e999}',
    '{"replicate": 1e300}',
    '{"joint_angle_deg": [NaN]}',
    '{"\\u001b[2J": 1}',
    '{"model": "\\u001b[31m"}',
    '{"scene": NaN}',
    '{"scene": {"a": 1e999}}',
]

STUDIES = [
    STUDY.format(BIG),
    STUDY.format("1e300, nan, inf"),
    STUDY.format("4") + f'[design]\nkind = "sobol"\nsamples = {BIG}\n',
    HEAD + f"[factors.joint_angle_deg]\nlow = 1\nhigh = 2\ncount = {BIG}\n",
    HEAD + "[factors.joint_angle_deg]\nlow = 1\nhigh = 1e300\ncount = 5\n",
    HEAD + '[base]\n"\\u001b[2J" = 3\n',
    STUDY.format("4") + f"[base]\ntorque_n_m = {BIG}\n",
    "study = 3",
    "[factors]\njoint_angle_deg = 3",
]

BODIES = [
    *((f"{API}/simulate", text) for text in POINTS),
    *(("/parts/price-of-point", f'{{"scene": "joint", "parameters": {text}}}') for text in POINTS),
    *(("/parts/simulate", f'{{"scene": "joint", "parameters": {text}}}') for text in POINTS),
    *((f"{API}/plans", json.dumps({"study": text, "timing": False})) for text in STUDIES),
    *((f"{API}/runs", json.dumps({"study": text})) for text in STUDIES),
    *(("/parts/price", json.dumps({"study": text, "timing": False})) for text in STUDIES),
    (f"{API}/plans", '{"study": NaN}'),
    (f"{API}/plans", '{"study": "", "timing": NaN}'),
    (f"{API}/plans", '{"study": "", "files": {"a": NaN}}'),
    (f"{API}/plans", '{"study": "", "files": {' + ", ".join(f'"{name}": 1' for name in range(20_000)) + "}}"),
    (f"{API}/runs", '{"study": "", "files": {"a\\u0000": "x"}}'),
    (f"{API}/runs/{{run}}/compare", '{"measurement": "a,b\\n1,2", "reference_angle": NaN}'),
    (f"{API}/runs/{{run}}/compare", f'{{"measurement": "a", "pulses_per_revolution": {BIG}}}'),
    (f"{API}/runs/{{run}}/compare", '{"measurement": "", "speeds": "1e300:nan"}'),
    (f"{API}/runs/{{run}}/compare", '{"measurement": "\\u0000", "columns": {"thrust_n": "\\u001b"}}'),
]


def judged(answer, started):
    """A message that says something, or an answer; not an internal error, and soon."""
    assert answer.status_code < 500, answer.text
    assert time.monotonic() - started < 5
    if answer.status_code >= 400 and "json" in answer.headers["content-type"]:
        problems = json.loads(answer.text)["errors"]  # and it is JSON
        assert 0 < len(problems) <= 51
        assert all(problem["message"] for problem in problems)
        assert len(answer.content) < 200_000


@pytest.mark.parametrize("path", ADDRESSES)
def test_an_address_is_never_an_internal_error(api, coast, path):
    started = time.monotonic()
    judged(api.client.get(ADDRESS + path.replace("{run}", coast)), started)


@pytest.mark.parametrize(("path", "body"), BODIES)
def test_a_body_is_never_an_internal_error(api, coast, path, body):
    started = time.monotonic()
    answer = api.client.post(path.replace("{run}", coast), content=body, headers={"content-type": "application/json"})
    assert answer.status_code >= 400
    judged(answer, started)


@pytest.mark.parametrize(
    "body",
    [
        '"' + '\\"' * 65_536,
        '{"study": "' + '\\"' * 65_536,
        "[" * 131_072,
        '{"a":' * 26_000,
        '"' * 131_072,
        "1," * 65_536,
        "-" * 131_072,
        '{"study": "' + "\\ud800" * 20_000 + '"}',
        json.dumps({"study": "[a" + ".a" * 60_000 + "]"}),
        json.dumps({"study": "a = " + "[" * 60_000}),
        json.dumps({"study": "'" * 120_000}),
        json.dumps({"study": '"""' + "\\" * 60_000}),
        json.dumps({"study": "\n".join(f"[base.x{number}]" for number in range(9_000))}),
        json.dumps({"study": "\n".join(f"[unknown{number}]" for number in range(9_000))}),
        json.dumps({"study": "[base]\n" + "\n".join(f"x{number} = 1" for number in range(12_000))}),
        json.dumps({"study": STUDY.format(", ".join(["4"] * 60_000))}),
    ],
)
@pytest.mark.parametrize("path", ["/api/v1/plans", "/parts/price", "/parts/form"])
def test_a_large_text_neither_takes_long_nor_holds_up_others(serve_for_all, path, body):
    """In 131 kB: others are answered meanwhile, as nothing of it is read in the loop."""
    server = serve_for_all
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(1) as thread:
        started = time.monotonic()
        asked = thread.submit(server.post_text, path, body)
        slowest = 0.0
        while not asked.done():
            before = time.monotonic()
            assert server.ask("/health")[0] == 200
            slowest = max(slowest, time.monotonic() - before)
        assert asked.result() in (413, 422, *([200] if path == "/parts/form" else []))
        assert time.monotonic() - started < 15
    assert slowest < 2
