from __future__ import annotations

import os
import signal

import pytest
from server_process import Server, runs_in
from service_client import ADDRESS, READ_TOKEN, TOKEN, Asked
from starlette.testclient import TestClient

from tripod_doe.service.app import create_app
from tripod_doe.service.runs import processes
from tripod_doe.service.settings import Settings


@pytest.fixture(scope="session")
def settings(tmp_path_factory):
    return Settings(tmp_path_factory.mktemp("service"), token=TOKEN, read_token=READ_TOKEN, workers=0)


@pytest.fixture(scope="session")
def client(settings):
    """A client without a token, of a server in this process; its runs, which would outlive it, end with the tests."""
    with TestClient(create_app(settings), ADDRESS, raise_server_exceptions=False, follow_redirects=False) as client:
        yield client
        for directory in settings.folder.iterdir():
            processes.kill_run(directory)


@pytest.fixture(scope="session")
def api(client, settings):
    """The interface as a program with the token asks it."""
    own = TestClient(
        client.app,
        ADDRESS,
        raise_server_exceptions=False,
        follow_redirects=False,
        headers={"authorization": f"Bearer {settings.token}"},
    )
    return Asked(own)


@pytest.fixture(scope="session")
def coast(api):
    """A finished run."""
    run_id = api.submit()
    assert api.wait(run_id, "finished", "failed")["state"] == "finished"
    return run_id


@pytest.fixture(scope="session")
def serve_for_all(tmp_path_factory):
    """A server of its own process for tests that change nothing."""
    server = Server(tmp_path_factory.mktemp("all") / "results", "--workers", "0")
    server.ask("/plans", {"study": "", "timing": False})  # a worker is there
    yield server
    server.end()


@pytest.fixture
def serve(tmp_path):
    """Start servers on one folder; at the end they and their runs are gone."""
    servers = []

    def serve(*flags):
        servers.append(Server(tmp_path / "results", *flags))
        return servers[-1]

    yield serve
    for server in servers:
        if server.process.poll() is None:
            server.end(signal.SIGKILL)
    for process in runs_in(tmp_path):
        os.killpg(process.pid, signal.SIGKILL)
