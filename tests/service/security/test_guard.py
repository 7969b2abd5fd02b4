"""Who may ask what: each row of the safety rules as a request that is refused, beside one that is not."""

from __future__ import annotations

import asyncio
import re
import threading
from types import SimpleNamespace

import pytest
from service_client import ADDRESS, API, READ_TOKEN, TOKEN, in_own_loop

from tripod_doe.service.security.guard import Guard, allowed_hosts
from tripod_doe.service.security.sessions import LIFETIME, Sessions
from tripod_doe.service.security.share_links import Shares
from tripod_doe.service.security.tokens import Accesses
from tripod_doe.service.settings import Settings

BEARER = {"authorization": f"Bearer {TOKEN}"}
OWN_PAGE = {"origin": ADDRESS, "sec-fetch-site": "same-origin"}
PATHS = ["/", f"{API}/health", f"{API}/runs", f"{API}/runs/x/report/", f"{API}/openapi.json", "/nowhere"]


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:8811",
        "127.0.0.1.evil.example",
        "",
        "localhost@evil",
        "[::1",
        "evil.com@127.0.0.1",
        "127.0.0.1#evil.com",
        "127.0.0.1/evil.com",
        "127.0.0.1:8811:1",
        "127.0.0.1, evil.com",
    ],
)
def test_a_name_bound_anew_is_refused_on_every_route(client, path, host):
    answer = client.get(path, headers=BEARER | {"host": host})
    assert answer.status_code == 400
    assert "Host" in answer.json()["errors"][0]["message"]


@pytest.mark.parametrize("host", ["localhost:8811", "127.0.0.1:9000", "[::1]:8811", "LOCALHOST"])
def test_the_names_of_this_machine_are_taken(client, host):
    assert client.get(f"{API}/health", headers={"host": host}).status_code == 200


def test_a_server_for_other_machines_is_called_by_addresses_and_its_own_name():
    assert allowed_hosts("127.0.0.1") == {"127.0.0.1", "localhost", "::1"}
    assert "0.0.0.0" not in allowed_hosts("0.0.0.0")
    assert "workstation.example" in allowed_hosts("workstation.example")


@pytest.mark.parametrize("path", [path for path in PATHS if path != f"{API}/health"])
@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"authorization": "Bearer wrong"},
        {"authorization": f"Basic {TOKEN}"},
        {"cookie": "{name}=wrong"},
        {"cookie": "{name}={token}"},
        {"cookie": "tripod_doe_8811={token}"},
        {"cookie": "{cookie}"},
        {"cookie": "{cookie}", "origin": ADDRESS, "sec-fetch-site": "same-origin", "referer": f"{ADDRESS}/"},
        {"authorization": "Bearer wrong", "cookie": "{cookie}"},
    ],
)
def test_everything_but_health_needs_the_token(client, settings, cookie, path, headers):
    words = {"token": TOKEN, "name": settings.cookie, "cookie": cookie}
    answer = client.get(path, headers={name: text.format(**words) for name, text in headers.items()})
    assert answer.status_code == 401
    assert TOKEN not in answer.text
    assert client.get(f"{API}/health").status_code == 200


@pytest.fixture(scope="session")
def cookie(client, settings):
    """The cookie of a browser that has opened the printed address."""
    value = client.get(f"/?token={TOKEN}").headers["set-cookie"].partition(";")[0]
    client.cookies.clear()
    assert value.startswith(f"{settings.cookie}=")
    return value


def test_the_token_in_the_address_begins_a_session_and_leaves_the_address(client, settings):
    answer = client.get(f"/runs?token={TOKEN}&view=3")
    assert answer.status_code == 303
    assert answer.headers["location"] == f"{settings.root}/runs?view=3"
    cookie = answer.headers["set-cookie"]
    assert TOKEN not in cookie
    assert re.search(f"; path={settings.root}(;|$)", cookie, re.IGNORECASE)
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert "Max-Age=43200" in cookie
    client.cookies.clear()
    assert client.get("/?token=wrong").status_code == 401
    assert "set-cookie" not in client.get("/?token=wrong").headers
    assert client.get(f"{API}/runs?token={TOKEN}").status_code == 401  # an address of the interface may be logged
    assert client.get(f"{ADDRESS}//evil.example/?token={TOKEN}").headers["location"] == f"{settings.root}/evil.example/"
    client.cookies.clear()


def test_a_cookie_reads_and_changes_from_its_own_page_only(client, settings, cookie):
    own = {"cookie": cookie}
    assert client.get(f"{settings.root}{API}/runs", headers=own).status_code == 200
    stop = f"{settings.root}{API}/runs/none/stop"
    assert client.post(stop, headers=own | OWN_PAGE).status_code == 404
    assert client.post(stop, headers=own).status_code == 403


def test_neither_the_address_nor_the_cookie_is_enough(client, settings, cookie):
    inside = f"{settings.root}{API}/runs"
    assert client.get(inside, headers=OWN_PAGE).status_code == 401
    assert client.get(f"{API}/runs", headers=OWN_PAGE | {"cookie": cookie}).status_code == 401
    for other in ("/s-" + "x" * 22, settings.root[:-1], settings.root + "x", settings.root.upper()):
        assert client.get(f"{other}{API}/runs", headers={"cookie": cookie}).status_code == 401
    for other in (f"other=1; {cookie}", f"{cookie}; other", f"{settings.cookie}=planted; {cookie}"):
        assert client.get(inside, headers={"cookie": other}).status_code == 200


def test_no_answer_without_a_session_holds_the_first_part_of_addresses(client, settings):
    accept = {"accept": "text/html"}
    for path in ("/", "/nowhere", "/assets/x", f"{API}/runs", f"{API}/health", "/?token=wrong", "//", "/%00"):
        answer = client.get(path, headers=accept)
        assert settings.key not in answer.text + str(answer.headers), path


def test_addresses_from_an_earlier_server_lead_on(client, settings):
    """The page that asks for the token holds the script that finds the first part, and no link that would need it."""
    page = client.get(f"/s-{'x' * 22}/runs/abc", headers={"accept": "text/html"})
    assert page.status_code == 401
    assert "door.js" in page.text
    assert "To the list" not in page.text
    script = re.search(r'src="(/assets/[^"]+/door.js)"', page.text)[1]
    assert client.get(script).status_code == 200


def test_who_has_a_link_signs_nobody_else_out():
    sessions = Sessions()
    owner, first = sessions.open("owner"), sessions.open("a link")
    for _ in range(200):
        sessions.open("a link")
    assert sessions.is_open(owner, "owner")
    assert not sessions.is_open(first, "a link")


def test_sessions_end_with_time_and_with_the_server():
    now = [0.0]
    sessions = Sessions(lambda: now[0])
    value = sessions.open("owner")
    assert sessions.is_open(value, "owner")
    assert not sessions.is_open(value + "x", "owner")
    assert not sessions.is_open(value, "reader")
    now[0] = LIFETIME - 1.0
    other = sessions.open("owner")
    now[0] = LIFETIME + 1.0
    assert not sessions.is_open(value, "owner")
    assert sessions.is_open(other, "owner")
    sessions.close()
    assert not sessions.is_open(other, "owner")
    assert not sessions.is_open(sessions.open("owner"), "owner")
    kept = Sessions(lambda: 0.0)
    first = [kept.open("owner") for _ in range(1000)]
    assert sum(kept.is_open(value, "owner") for value in first) == 200


@pytest.mark.parametrize("by", ["token", "cookie"])
@pytest.mark.parametrize(
    "page",
    [
        {"origin": "http://evil.example"},
        {"origin": "null"},
        {"origin": "http://127.0.0.1:1"},
        {"origin": "https://127.0.0.1:8811"},
        {"sec-fetch-site": "cross-site"},
        {"sec-fetch-site": "same-site"},
        {"sec-fetch-site": "none"},
        OWN_PAGE | {"sec-fetch-site": "cross-site"},
    ],
)
@pytest.mark.parametrize("change", ["/runs", "/plans", "/simulate", "/runs/none/stop"])
def test_changes_from_other_pages_are_refused(client, settings, cookie, by, page, change):
    credentials, api = (BEARER, API) if by == "token" else ({"cookie": cookie}, settings.root + API)
    assert client.post(api + change, json={}, headers=credentials | page).status_code == 403
    assert client.request("DELETE", f"{api}/runs/none", headers=credentials | page).status_code == 403


@pytest.mark.parametrize(
    "kind",
    ["text/plain", "application/x-www-form-urlencoded", "multipart/form-data; boundary=x", "application/json-seq", ""],
)
def test_a_body_is_json_and_says_so(client, kind):
    answer = client.post(f"{API}/plans", content=b'{"study": ""}', headers=BEARER | {"content-type": kind})
    assert answer.status_code == 415
    assert client.post(f"{API}/plans", content=b"{}", headers=BEARER).status_code == 415


def test_a_body_beyond_the_limit_is_refused_with_it(client, settings):
    size = settings.limits.body_bytes
    large = client.post(f"{API}/plans", json={"study": "#" * size}, headers=BEARER)
    assert large.status_code == 413
    assert "262,144" in large.json()["errors"][0]["message"]
    streamed = client.post(
        f"{API}/plans",
        content=iter([b'{"study": "', b"#" * size, b'"}']),
        headers=BEARER | {"content-type": "application/json"},
    )
    assert streamed.status_code == 413
    fits = client.post(f"{API}/plans", json={"study": "#" * (size - 100)}, headers=BEARER)
    assert fits.status_code == 422  # it is read, and is no study


def test_nested_brackets_are_refused_before_they_are_parsed(client):
    deep = b'{"joint_angle_deg": ' + b"[" * 100_000 + b"]" * 100_000 + b"}"
    headers = BEARER | {"content-type": "application/json"}
    assert client.post(f"{API}/simulate", content=deep, headers=headers).status_code == 413
    texts = b'{"study": "' + b"[" * 100 + b'"}'  # brackets in a text do not count
    assert client.post(f"{API}/plans", content=texts, headers=headers).status_code == 422


@pytest.mark.parametrize(
    "body",
    [
        b"{",
        b"\xff",
        b'{"study": "\\ud800"}',
        b"[]",
        b"3",
        b'{"study": 3}',
        b'{"study": "", "nothing": 1}',
        b"{}",
        b"",
        b'{"study": "", "workflow": ""}',
        b'{"study": "", "study": ""}',
        b'{"study": "", "files": {"a": "", "a": ""}}',
    ],
)
def test_bad_bodies_are_refused_with_a_list_of_errors(client, body):
    answer = client.post(f"{API}/plans", content=body, headers=BEARER | {"content-type": "application/json"})
    assert answer.status_code == 422
    assert all(error["message"] for error in answer.json()["errors"])


@pytest.mark.parametrize("path", ["/", f"{API}/health", f"{API}/runs", "/nowhere"])
def test_every_answer_keeps_browsers_strict(client, path):
    headers = client.get(path, headers=BEARER).headers
    assert headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
    assert "access-control-allow-origin" not in headers


def test_unknown_addresses_and_methods_are_told_as_errors(client):
    assert client.get(f"{API}/nowhere", headers=BEARER).json()["errors"][0]["message"]
    assert client.put(f"{API}/runs", headers=BEARER).status_code == 405


def test_readers_take_no_thread_that_the_owner_needs(tmp_path):
    """A link asked 120 times at once for a page held all threads: the owner waited 40 s for the list of runs."""
    settings = Settings(tmp_path, token=TOKEN, read_token=READ_TOKEN)
    inside, served = [], []

    async def slow(scope, receive, send):
        if scope["access"].name == "owner":
            served.append(scope["path"])
            return
        inside.append(scope)
        await asyncio.Event().wait()

    async def asked():
        guard = Guard(slow, settings, Accesses(settings, Shares(tmp_path)), Sessions(), lambda *words: None)

        def ask(token):
            headers = [(b"host", b"127.0.0.1:8811"), (b"authorization", f"Bearer {token}".encode())]
            scope = {"type": "http", "method": "GET", "path": "/", "query_string": b"", "headers": headers}
            return asyncio.create_task(guard(scope, None, None))

        waiting = [ask(READ_TOKEN) for _ in range(120)]
        await asyncio.sleep(0)
        await ask(TOKEN)
        for each in waiting:
            each.cancel()

    in_own_loop(asked())
    assert served == ["/"]
    assert 0 < len(inside) < 10


def test_strangers_wait_for_each_other_and_the_owner_for_none(tmp_path):
    """Regression: 900 connections that asked for the sign of life held each answer to the owner for 19 s."""
    settings = Settings(tmp_path, token=TOKEN)
    answered, served = [], []

    async def answer(scope, receive, send):
        if scope["access"] is not None:
            served.append(scope["path"])
            return
        answered.append(scope["path"])  # without a pause before it
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await asyncio.Event().wait()  # the client does not read

    async def asked():
        guard = Guard(answer, settings, Accesses(settings, Shares(tmp_path)), Sessions(), lambda *words: answer)

        async def send(message):
            pass

        def ask(path, token=""):
            headers = [(b"host", b"127.0.0.1:8811"), (b"authorization", f"Bearer {token}".encode())]
            scope = {"type": "http", "method": "GET", "path": path, "query_string": b"", "headers": headers}
            return asyncio.create_task(guard(scope, None, send))

        waiting = [ask(path) for path in (f"{API}/health", "/", "/assets/page.css") for _ in range(100)]
        await ask(f"{API}/health", TOKEN)
        assert len(answered) == 4
        for _ in range(300):
            await asyncio.sleep(0)
        for each in waiting:
            each.cancel()

    in_own_loop(asked())
    assert served == [f"{API}/health"]
    assert len(answered) == 300


def test_refusals_of_a_crowd_wait_for_each_other(tmp_path):
    """Regression: 900 connections of a reader, nearly all refused at once, took the loop from everybody else."""
    settings = Settings(tmp_path, token=TOKEN, read_token=READ_TOKEN)
    begun = []

    async def endless(scope, receive, send):
        await asyncio.Event().wait()

    async def asked():
        guard = Guard(endless, settings, Accesses(settings, Shares(tmp_path)), Sessions(), lambda *words: None)

        async def send(message):
            if message["type"] == "http.response.start":
                begun.append(message["status"])

        headers = [(b"host", b"127.0.0.1:8811"), (b"authorization", f"Bearer {READ_TOKEN}".encode())]
        scope = {"type": "http", "method": "GET", "path": "/", "query_string": b"", "headers": headers}
        waiting = [asyncio.create_task(guard(dict(scope), None, send)) for _ in range(332)]
        await asyncio.sleep(0)
        assert len(begun) <= 4
        for _ in range(300):
            await asyncio.sleep(0)
        assert begun == [503] * 300
        for each in waiting:
            each.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)

    in_own_loop(asked())


def test_a_crowd_of_the_owner_delays_no_reader_and_slow_answers_no_others(tmp_path):
    """Regression: 900 requests at once by one holder delayed all others by many seconds."""
    settings = Settings(tmp_path, token=TOKEN, read_token=READ_TOKEN)
    begun = []

    async def slow(scope, receive, send):
        begun.append(scope["access"].name)
        if scope["access"].name == "owner":
            await asyncio.Event().wait()

    async def asked():
        guard = Guard(slow, settings, Accesses(settings, Shares(tmp_path)), Sessions(), lambda *words: None)

        async def send(message):
            pass

        def ask(token):
            headers = [(b"host", b"127.0.0.1:8811"), (b"authorization", f"Bearer {token}".encode())]
            scope = {"type": "http", "method": "GET", "path": "/", "query_string": b"", "headers": headers}
            return asyncio.create_task(guard(scope, None, send))

        crowd = [ask(TOKEN) for _ in range(40)]
        await ask(READ_TOKEN)
        assert begun == ["owner"] * 8 + ["reader"]
        for _ in range(200):
            await asyncio.sleep(0.01)
            if len(begun) == 41:
                break
        for each in crowd:
            each.cancel()
        await asyncio.gather(*crowd, return_exceptions=True)

    in_own_loop(asked())
    assert begun.count("owner") == 40


def test_who_has_left_is_not_worked_for(tmp_path, caplog):
    """Regression: for each client that left before its turn, uvicorn logged an error."""
    settings = Settings(tmp_path, token=TOKEN)
    statuses, served = [], []

    async def answer(scope, receive, send):
        served.append(scope["path"])

    async def asked():
        guard = Guard(answer, settings, Accesses(settings, Shares(tmp_path)), Sessions(), lambda *words: None)
        connection = SimpleNamespace(left=threading.Event(), missed_by_nobody={})
        connection.left.set()

        async def send(message):
            statuses.append(message.get("status"))

        headers = [(b"host", b"127.0.0.1:8811"), (b"authorization", f"Bearer {TOKEN}".encode())]
        scope = {"type": "http", "method": "GET", "path": "/", "query_string": b"", "headers": headers}
        await guard(scope | {"state": {"connection": connection}}, None, send)

    in_own_loop(asked())
    assert statuses[:1] == [400]
    assert not served


def test_a_reader_fills_neither_connections_nor_streams(tmp_path):
    """Regression: streams and waiting requests of one link took all connections, and the owner was refused."""
    settings = Settings(tmp_path, token=TOKEN, read_token=READ_TOKEN)
    refused, served = [], []

    async def endless(scope, receive, send):
        served.append(scope["access"].name)
        await asyncio.Event().wait()

    async def asked(path):
        guard = Guard(endless, settings, Accesses(settings, Shares(tmp_path)), Sessions(), lambda *words: None)

        def ask(token):
            async def send(message):
                if message["type"] == "http.response.start":
                    refused.append((message["status"], dict(message["headers"])[b"retry-after"]))

            headers = [(b"host", b"127.0.0.1:8811"), (b"authorization", f"Bearer {token}".encode())]
            scope = {"type": "http", "method": "GET", "path": path, "query_string": b"", "headers": headers}
            return asyncio.create_task(guard(scope, None, send))

        waiting = [*(ask(READ_TOKEN) for _ in range(50)), ask(TOKEN)]
        for _ in range(100):
            await asyncio.sleep(0)
        for each in waiting:
            each.cancel()
        await asyncio.gather(*waiting, return_exceptions=True)

    for path in ("/", f"{API}/events"):
        in_own_loop(asked(path))
        assert [status for status, after in refused if after == b"5"] == [503] * 18
        assert served.count("owner") == 1
        refused.clear()
        served.clear()


def test_long_answers_are_sent_in_pieces(tmp_path):
    """Regression: all of 4.8 MB was kept for each client that did not read; 700 of them silenced the service."""
    settings, data = Settings(tmp_path, token=TOKEN), bytes(range(256)) * 1000
    sent = []

    async def answer(scope, receive, send):
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": data})

    async def asked():
        guard = Guard(answer, settings, Accesses(settings, Shares(tmp_path)), Sessions(), lambda *words: None)

        async def send(message):
            sent.append(message)

        headers = [(b"host", b"127.0.0.1:8811")]
        path = "/assets/1/plotly.js"
        scope = {"type": "http", "method": "GET", "path": path, "query_string": b"", "headers": headers}
        await guard(scope, None, send)

    in_own_loop(asked())
    bodies = sent[1:]
    assert b"".join(message["body"] for message in bodies) == data
    assert max(len(message["body"]) for message in bodies) <= 65_536
    assert [message["more_body"] for message in bodies] == [True] * (len(bodies) - 1) + [False]
