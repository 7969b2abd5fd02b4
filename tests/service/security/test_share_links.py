"""Readers and links to one run, attacked: nothing else opens, nothing is changed, and what is revoked is closed."""

from __future__ import annotations

import json
import os
import stat
from math import nan

import pytest
from service_client import ADDRESS, API, READ_TOKEN, TOKEN
from starlette.testclient import TestClient

from tripod_doe.cli import main
from tripod_doe.errors import InputError
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.security.share_links import SHARES, Shares

_RUN = "a" * 16


@pytest.fixture
def browser(client):
    """A browser that knows nothing yet."""
    return TestClient(client.app, ADDRESS, raise_server_exceptions=False, follow_redirects=False)


@pytest.fixture
def link(api, coast):
    made = api.post(f"/runs/{coast}/shares?days=3")
    assert made.status_code == 201, made.text
    yield made.json()
    api.delete(f"/runs/{coast}/shares/{made.json()['id']}")


@pytest.fixture
def other(api):
    """Another run of the same server."""
    run_id = api.submit()
    api.wait(run_id, "finished", "failed")
    yield run_id
    api.delete(f"/runs/{run_id}")


def entered(browser, address):
    """Follow a link in a browser; gives the first part of the addresses."""
    answer = browser.get(address)
    assert answer.status_code == 303
    assert answer.headers["referrer-policy"] == "no-referrer"
    assert answer.headers["cache-control"] == "no-store"
    return answer.headers["location"]


def writes(app):
    """Every way to change or compute something."""
    for path, operations in app.openapi()["paths"].items():
        for method in operations:
            if method in ("post", "patch", "put", "delete"):
                yield method, path


@pytest.mark.parametrize(
    "planted",
    [
        {"expires": 1e300},
        {"expires": "9"},
        {"expires": nan},
        {"created": True},
        {"digest": 3},
        {"id": []},
        {"id": "owner"},
        {"id": "reader"},
        {"run_id": ""},
    ],
)
def test_a_row_that_is_none_of_ours_is_refused_where_the_file_is_read(tmp_path, planted):
    """Regression: each request without a session was an internal error; a link of the id "owner" wrote, too."""
    known = Shares(tmp_path)
    known.add(_RUN, 3)
    (row,) = json.loads((tmp_path / SHARES).read_text())
    (tmp_path / SHARES).write_text(json.dumps([row | planted]))
    assert known.open() == []
    with pytest.raises(InputError, match="delete the file"):
        Shares(tmp_path)


def test_a_link_opens_its_run_in_a_browser_and_for_programs(browser, link, coast):
    page = entered(browser, link["address"])
    assert page.endswith(f"/runs/{coast}")
    secret = link["address"].partition("=")[2]
    assert secret not in page
    root = page.removesuffix(f"/runs/{coast}")
    for place in ("", "/analyses", "/report", "/failed", "/study", "/numbers?variable=thrust_rms", "/points/0"):
        answer = browser.get(f"{root}/runs/{coast}{place}")
        assert answer.status_code == 200, place
        assert "data-post" not in answer.text
        assert "data-delete" not in answer.text
    report = browser.get(f"{root}{API}/runs/{coast}/report/")
    key = report.text.partition('<base href="')[2].partition('"')[0]
    assert TestClient(browser.app, ADDRESS).get(key).status_code == 200  # a sandbox sends no cookie
    asked = TestClient(browser.app, ADDRESS, headers={"authorization": f"Bearer {secret}"})
    assert [run["id"] for run in asked.get(f"{API}/runs").json()] == [coast]
    assert asked.get(f"{API}/runs/{coast}/query?variable=thrust_rms").status_code == 200
    assert asked.get(f"{API}/runs/{coast}/cube.nc").status_code == 200


@pytest.mark.parametrize("by", ["cookie", "bearer"])
def test_a_link_opens_nothing_else(browser, link, coast, other, by):
    page = entered(browser, link["address"])
    root = page.removesuffix(f"/runs/{coast}") if by == "cookie" else ""
    if by == "bearer":
        browser.cookies.clear()
        browser.headers["authorization"] = f"Bearer {link['address'].partition('=')[2]}"
    places = [
        "/new",
        "/diff",
        "/compare",
        "/parts/runs",
        "/parts/extremes",
        f"/runs/{other}",
        f"/parts/runs/{other}",
        f"/runs/{coast}/../{other}",
        f"/runs/{coast}/..%2f{other}",
        f"/runs/{coast}%2f..%2f{other}",
        f"/runs/{other}?minus={coast}",
        f"/runs/{coast}x/",
        f"{API}/runs/{other}",
        f"{API}/runs/{other}/cube.nc",
        f"{API}/runs/{coast}/diff/{other}",
        f"{API}/runs/{coast}/figure?minus={other}",
        f"{API}/runs/{coast}/shares",
        f"{API}/runs/{coast}/pages/{'0' * 32}/report/../../{other}/cube.nc",
        f"{API}/events",
        f"{API}/limits",
        f"{API}/openapi.json",
        f"{API}/schema/study",
        f"//{API}/runs/{other}",
    ]
    for place in places:
        answer = browser.get(f"{root}{place}")
        assert answer.status_code in (400, 401, 403, 404), (place, answer.status_code)
        assert other not in answer.text.replace(place, "").replace(f"{other}: no run of this id", ""), place
    assert [run["id"] for run in browser.get(f"{root}{API}/runs").json()] == [coast]
    assert browser.get(f"{root}{API}/runs?bin=true").json() == []


@pytest.mark.parametrize("who", ["link", "reader"])
def test_who_reads_changes_nothing(client, browser, link, coast, who):
    """Every route that is not GET is refused, by token and by session, also where a page of ours asks."""
    secret = link["address"].partition("=")[2] if who == "link" else READ_TOKEN
    place = entered(browser, f"/?token={secret}")
    root = "/" + place.split("/")[1]
    same = {"origin": ADDRESS, "sec-fetch-site": "same-origin"}
    routes = [*writes(client.app), *(("post", f"/parts/{name}") for name in ("simulate", "price-of-point"))]
    for method, path in routes:
        full = path.replace("{run_id}", coast).replace("{share_id}", link["id"])
        for start, headers in ((root, same), ("", {"authorization": f"Bearer {secret}"})):
            answer = browser.request(
                method.upper(), start + full, json={"study": ""} if method != "delete" else None, headers=headers
            )
            assert answer.status_code == 403, (method, path, answer.text)
    assert client.get(f"{API}/runs/{coast}", headers={"authorization": f"Bearer {TOKEN}"}).json()["state"] == "finished"


def test_a_reader_sees_all_runs_without_a_way_to_change_them(browser, coast, other):
    root = entered(browser, f"/?token={READ_TOKEN}").rstrip("/")
    listed = browser.get(f"{root}/")
    assert coast in listed.text
    assert other in listed.text
    assert "data-delete" not in listed.text
    assert f"{root}/new" not in listed.text
    assert browser.get(f"{root}{API}/runs/{coast}/shares").status_code == 403


def test_sessions_of_one_do_not_serve_another(client, settings, browser, link, coast):
    """Who knows the first part of another's addresses, and has a cookie of theirs, gets nothing by it."""
    shared = entered(browser, link["address"])
    reader = entered(browser, f"/?token={READ_TOKEN}")
    owner = entered(browser, f"/?token={TOKEN}")
    roots = {place.split("/")[1] for place in (shared, reader, owner)}
    assert len(roots) == 3
    value = next(cookie.value for cookie in browser.cookies.jar if cookie.path == f"/{shared.split('/')[1]}")
    thief = TestClient(client.app, ADDRESS, follow_redirects=False)
    for root in roots - {shared.split("/")[1]}:
        answer = thief.get(f"/{root}/runs/{coast}", headers={"cookie": f"{settings.cookie}={value}"})
        assert answer.status_code == 401


def test_a_revoked_link_is_closed_at_once_with_its_sessions_and_report_pages(client, api, browser, coast):
    made = api.post(f"/runs/{coast}/shares").json()
    page = entered(browser, made["address"])
    root = page.removesuffix(f"/runs/{coast}")
    report = browser.get(f"{root}{API}/runs/{coast}/report/").text
    key = report.partition('<base href="')[2].partition('"')[0]
    bearer = {"authorization": f"Bearer {made['address'].partition('=')[2]}"}
    assert client.get(key).status_code == 200
    assert [each["id"] for each in api.get(f"/runs/{coast}/shares").json()] == [made["id"]]
    assert "address" not in api.get(f"/runs/{coast}/shares").text
    assert api.delete(f"/runs/{coast}/shares/{made['id']}").status_code == 204
    assert browser.get(page).status_code == 401
    assert client.get(key).status_code == 401
    assert client.get(f"{API}/runs/{coast}", headers=bearer).status_code == 401
    assert TestClient(client.app, ADDRESS, follow_redirects=False).get(made["address"]).status_code == 401
    assert api.delete(f"/runs/{coast}/shares/{made['id']}").status_code == 404


def test_links_end_with_time_survive_a_restart_and_keep_no_secret(tmp_path):
    now = [1e9]
    shares = Shares(tmp_path, lambda: now[0])
    share, secret = shares.add(_RUN, 2)
    assert secret not in (tmp_path / SHARES).read_text()
    again = Shares(tmp_path, lambda: now[0])
    assert again.by_secret(secret) == share
    assert again.by_secret(secret[:-1]) is None
    with pytest.raises(RefusedError, match="no such link"):
        again.revoke("another run", share.id)
    now[0] += 2 * 86_400
    assert again.by_secret(secret) is None
    assert again.of(_RUN) == []
    again.add(_RUN, 1)
    assert len(json.loads((tmp_path / SHARES).read_text())) == 1  # the old one is gone
    (tmp_path / SHARES).write_text("[{]")
    with pytest.raises(InputError, match=r"shares.json: cannot read these links"):
        Shares(tmp_path)


def test_the_file_of_links_is_closed_to_others(tmp_path):
    """As all files of the server, by its umask."""
    before = os.umask(0o077)
    try:
        Shares(tmp_path).add(_RUN, 1)
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / SHARES).stat().st_mode) == 0o600


def test_the_owner_and_readers_need_tokens_of_their_own(tmp_path, capsys):
    file = tmp_path / "token"
    words = ["serve", "--folder", str(tmp_path / "runs"), "--token-file", str(file), "--read-token-file", str(file)]
    assert main(words) == 2
    assert "this is the token of the owner" in capsys.readouterr().err


def test_a_link_opened_many_times_ends_no_session_of_another(client, browser, link):
    """Only so many sessions are kept: the owner's browser was signed out by whoever opened a link 200 times."""
    owner = TestClient(client.app, ADDRESS, follow_redirects=False)
    root = entered(owner, f"/?token={TOKEN}")
    assert owner.get(root).status_code == 200
    for _ in range(220):
        page = entered(browser, link["address"])
    assert owner.get(root).status_code == 200
    assert browser.get(page).status_code == 200


def test_a_link_revoked_by_another_server_of_the_folder_is_closed_here(tmp_path):
    """A server with --read-only beside the one that revokes it read the file once, at its start."""
    writing = Shares(tmp_path)
    share, secret = writing.add(_RUN, 3)
    reading = Shares(tmp_path)
    assert reading.by_secret(secret).id == share.id
    kept, other = writing.add("b" * 16, 3)
    assert reading.by_secret(other).id == kept.id
    writing.revoke(_RUN, share.id)
    assert reading.by_secret(secret) is None
    assert not reading.is_open(share.id)
    assert reading.is_open(kept.id)
    (tmp_path / SHARES).unlink()
    assert reading.open() == writing.open() == []
