"""Streams of changes: each change once, in order, and none lost when a stream breaks off."""

from __future__ import annotations

import asyncio
import json
import socket
import threading
import time

import pytest
import uvicorn
from service_client import API, TOKEN, in_own_loop

from tripod_doe.service.app import create_app
from tripod_doe.service.limits import Limits
from tripod_doe.service.runs.events import _KEPT, Events
from tripod_doe.service.runs.run_table import Run, State
from tripod_doe.service.settings import Settings

QUIET = 0.2


def run(run_id, name):
    return Run(run_id, "study", str(name), "", State.RUNNING)


def watched(events, run_id=None, last=None, count=None):
    """What a stream gives, up to `count` events or the first silence."""

    async def watch():
        events.attach(asyncio.get_running_loop())
        seen = []
        async for event in events.watch(run_id, last, QUIET):
            if event is None:
                break
            seen.append((events.name_of(event), event.run_id, event.text and json.loads(event.text)["name"]))
            if len(seen) == count:
                break
        return seen

    return in_own_loop(watch())


def test_a_stream_begins_with_each_run_as_it_is():
    events = Events()
    for name in range(3):
        events.publish(run("a", name))
    events.publish(run("b", "x"))
    assert [told[1:] for told in watched(events)] == [("a", "2"), ("b", "x")]
    assert [told[1:] for told in watched(events, "b")] == [("b", "x")]


def test_a_stream_goes_on_after_the_last_event_that_was_seen():
    events = Events()
    for name in range(5):
        events.publish(run("a", name))
    first = watched(events, "a", count=1)[0][0]
    for name in range(5, 9):
        events.publish(run("a", name))
        events.publish(run("b", name))
    assert [told[2] for told in watched(events, "a", last=first)] == ["5", "6", "7", "8"]
    assert [told[2] for told in watched(events, "a", last="other-3")] == ["8"]  # of another server
    assert [told[2] for told in watched(events, "a", last="nonsense")] == ["8"]


def test_a_stream_that_was_away_too_long_gets_the_latest():
    events = Events()
    events.publish(run("a", "old"))
    last = watched(events, count=1)[0][0]
    for name in range(_KEPT + 10):
        events.publish(run("a", name))
    assert [told[2] for told in watched(events, "a", last=last)] == [str(_KEPT + 9)]


def test_a_deleted_run_ends_its_stream():
    events = Events()
    events.publish(run("a", 1))
    last = watched(events, "a", count=1)[0][0]
    events.forget("a")
    assert watched(events, "a", last=last)[-1][1:] == ("a", None)
    assert watched(events) == []


def test_no_event_of_a_busy_thread_is_lost():
    """Two hundred streams see every change of a thread, in order."""
    events, count, streams = Events(), 500, 200

    async def watch(number):
        seen = []
        async for event in events.watch("a", None, 30):
            seen.append(event.number)
            if json.loads(event.text)["name"] == str(count - 1):
                return seen

    async def watch_all():
        events.attach(asyncio.get_running_loop())
        events.publish(run("a", "first"))
        watching = [asyncio.create_task(watch(number)) for number in range(streams)]
        await asyncio.sleep(0.1)
        thread = threading.Thread(target=lambda: [events.publish(run("a", name)) for name in range(count)])
        thread.start()
        seen = await asyncio.gather(*watching)
        thread.join()
        return seen

    assert all(numbers == list(range(1, count + 2)) for numbers in in_own_loop(watch_all()))
    assert not events._waiting


def test_streams_asked_for_at_once_keep_the_limit(tmp_path):
    """Each is counted when it is admitted, and no more when its client is gone."""
    settings = Settings(tmp_path, token=TOKEN, limits=Limits(streams=5))
    server = uvicorn.Server(
        uvicorn.Config(create_app(settings), port=0, log_level="error", timeout_graceful_shutdown=1)
    )
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        while not server.started:
            time.sleep(0.05)
        port = server.servers[0].sockets[0].getsockname()[1]
        request = f"GET {API}/events HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {TOKEN}\r\n\r\n"
        for _ in range(2):
            streams = [socket.create_connection(("127.0.0.1", port), timeout=20) for _ in range(12)]
            for stream in streams:
                stream.sendall(request.encode())
            statuses = [stream.recv(4096).split()[1] for stream in streams]
            assert (statuses.count(b"200"), statuses.count(b"503")) == (5, 7)
            for stream in streams:
                stream.close()
            until = time.monotonic() + 20
            while server.config.app.state.service.runs.events.streams:
                assert time.monotonic() < until
                time.sleep(0.05)
    finally:
        server.should_exit = True
        thread.join()


@pytest.mark.parametrize("path", ["/runs/none/events", "/events"])
def test_what_cannot_be_watched_is_refused(client, api, path):
    assert client.get(API + path).status_code == 401
    answer = client.get(API + "/runs/none/events", headers={"authorization": f"Bearer {TOKEN}"})
    assert answer.status_code == 404
    assert answer.json()["errors"][0]["message"] == "none: no run of this id"
