"""Connections that a client keeps without using them: limited in time, in size and in number."""

from __future__ import annotations

import json
import logging
import re
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack

import pytest
from server_process import Server
from starlette.requests import Request

from tripod_doe.service.log import MOST_ALIKE, Bounded, Plain
from tripod_doe.service.page import asset_files


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A server that may have 256 files open."""
    server = Server(tmp_path_factory.mktemp("small") / "results", files=256)
    yield server
    assert server.process.poll() is None
    _, _, complaints = server.end()
    assert len(complaints) < 100_000


def connected(server):
    return socket.create_connection(("127.0.0.1", int(server.address.rpartition(":")[2])), timeout=30)


def answer_of(connection):
    """All that arrives until the server ends the connection."""
    data = b""
    try:
        while piece := connection.recv(65536):
            data += piece
    except ConnectionResetError:
        pass
    return data.decode()


def post(server, length, place="/api/v1/plans"):
    return (
        f"POST {place} HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {server.token}\r\n"
        f"Content-Type: application/json\r\nContent-Length: {length}\r\n\r\n"
    ).encode()


@pytest.mark.slow
def test_half_sent_headers_end_in_time_and_keep_nobody_out(small):
    connections = [connected(small) for _ in range(300)]
    try:
        for connection in connections:
            connection.sendall(b"GET /api/v1/runs HTTP/1.1\r\nHost: 127.")
        started = time.monotonic()
        assert small.ask("/health", seconds=5)[0] == 200
        assert small.ask("/runs", seconds=5)[0] == 200
        answers = [answer_of(connection) for connection in connections]
        assert time.monotonic() - started < 15
        assert any("408" in answer and "within 10 s" in answer for answer in answers)
    finally:
        for connection in connections:
            connection.close()
    assert small.ask("/health")[0] == 200


@pytest.mark.slow
def test_bytes_that_begin_no_request_do_not_keep_a_connection(small):
    with connected(small) as connection:
        started = time.monotonic()
        try:
            while time.monotonic() - started < 14:
                connection.sendall(b"\r\n")
                time.sleep(0.5)
        except OSError:
            pass
        assert time.monotonic() - started < 13


@pytest.mark.slow
def test_a_slow_body_is_refused(small):
    with connected(small) as connection, ThreadPoolExecutor(1) as thread:
        connection.sendall(post(small, 1000))
        started = time.monotonic()
        answer = thread.submit(answer_of, connection)
        while not answer.done() and time.monotonic() - started < 20:
            try:
                connection.sendall(b" ")
            except OSError:
                break
            time.sleep(0.5)
        assert re.match(r"HTTP/1.1 408 .*arrives too slowly", answer.result(), re.DOTALL)
        assert time.monotonic() - started < 13


@pytest.mark.parametrize(
    "headers", [b"A: " + b"x" * 70_000, b"\r\n".join(b"A%d: x" % number for number in range(9_000))]
)
@pytest.mark.parametrize("end", [b"", b"\r\n\r\n"])
def test_large_headers_are_refused(small, headers, end):
    with connected(small) as connection:
        connection.sendall(b"GET /api/v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\n" + headers + end)
        assert answer_of(connection).startswith("HTTP/1.1 431 ")
    assert small.ask("/health")[0] == 200


def test_a_body_that_nobody_reads_ends_the_connection(small):
    with connected(small) as connection:
        connection.sendall(b"GET /api/v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 1000000\r\n\r\n")
        started = time.monotonic()
        assert answer_of(connection).startswith("HTTP/1.1 200 ")
        assert time.monotonic() - started < 3


def test_an_answer_that_nobody_reads_does_not_hold_up_others(small):
    with connected(small) as connection:
        connection.sendall(b"GET /assets/plotly.js HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 50)
        assert small.ask("/health", seconds=5)[0] == 200


def test_many_first_requests_for_a_file_read_it_once(monkeypatch):
    """Regression: 900 of them at once, without a token, kept the server busy for 25 CPU-s and took 500 MB."""
    reads = []

    def slow(data, level):
        reads.append(len(data))
        time.sleep(0.2)
        return data

    monkeypatch.setattr(asset_files.gzip, "compress", slow)
    asset_files._read.cache_clear()
    request = Request({"type": "http", "headers": []})
    with ThreadPoolExecutor(8) as threads:
        answers = list(threads.map(lambda _: asset_files.unversioned("door.js", request).status_code, range(8)))
    asset_files._read.cache_clear()
    assert answers == [200] * 8
    assert len(reads) == 1


def test_requests_in_a_row_are_answered_in_a_row(small):
    one = b"GET /api/v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    with connected(small) as connection:
        connection.sendall(one * 9 + one.replace(b"\r\n\r\n", b"\r\nConnection: close\r\n\r\n"))
        assert answer_of(connection).count("200 OK") == 10


def test_requests_of_clients_that_have_left_keep_nobody_waiting(small):
    """Regression: they were worked off one after the other, here for minutes."""
    body = json.dumps({"model": "needles", "cycles": 200}).encode()
    for _ in range(4):
        with connected(small) as connection:
            connection.sendall(post(small, len(body), "/api/v1/simulate") + body)
    assert small.ask("/simulate", {"model": "equilibrium"}, seconds=100)[0] == 200


def record(text, *words):
    return logging.LogRecord("name", logging.WARNING, "file.py", 3, text, words, None)


def test_messages_are_bounded_in_number_and_length_and_hold_no_escape():
    now = [0.0]
    bounded = Bounded(lambda: now[0])
    assert sum(bounded.filter(record("again %s", number)) for number in range(1000)) == MOST_ALIKE
    now[0] = 61.0
    last = record("once more")
    assert bounded.filter(last)
    assert last.getMessage() == f"({1000 - MOST_ALIKE} more messages like those before)\nonce more"
    told = Plain().format(record("%s", "\x1b[2J\x07red\x9b31m" + "x" * 1_000_000))
    assert told.startswith("\\x1b[2J\\x07red\\x9b31m")
    assert len(told) < 11_000


def test_connections_that_idle_after_an_answer_make_room(small):
    """Regression: strangers who kept their connections after an answer kept everybody out."""
    ask = b"GET /api/v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    connections = []
    try:
        for _ in range(300):
            connections.append(connected(small))
            connections[-1].sendall(ask)
            assert connections[-1].recv(15) == b"HTTP/1.1 200 OK"
        assert small.ask("/runs", seconds=5)[0] == 200
    finally:
        for connection in connections:
            connection.close()


def test_strangers_who_do_not_read_hold_up_no_others(small):
    with ExitStack() as opened:
        for _ in range(8):
            opened.enter_context(connected(small)).sendall(
                b"GET /assets/plotly.js HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 50
            )
        with connected(small) as connection:
            connection.settimeout(5)
            connection.sendall(b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n")
            assert answer_of(connection).startswith("HTTP/1.1 401 ")
