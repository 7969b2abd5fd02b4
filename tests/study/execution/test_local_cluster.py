"""Worker processes of this machine, and another user of it who tries to use them."""

from __future__ import annotations

import stat
import subprocess
import sys
import tempfile
import urllib.error
import urllib.request
from contextlib import closing, suppress
from pathlib import Path

import psutil
import pytest

from tripod_doe.errors import TripodDoeError
from tripod_doe.study.execution import dask_local_cluster
from tripod_doe.study.execution.dask_local_cluster import LocalWorkers

CLIENT = """
import sys
from distributed import Client
from distributed.security import Security
address, kind = sys.argv[1:]
security = {"none": None, "own": Security.temporary}[kind]
try:
    with Client(address, timeout=3, security=security and security()) as client:
        print("RAN", client.submit(lambda: 6 * 7).result(timeout=10))
except BaseException as error:
    print("refused", type(error).__name__)
"""


@pytest.fixture(scope="module")
def workers():
    with closing(LocalWorkers(1)) as started:
        with closing(started.connect()) as client:
            client.wait_for_workers(1)
        yield started


def listening(workers: LocalWorkers) -> list[tuple[str, int]]:
    """Where the processes of a cluster take connections."""
    program = psutil.Process(workers._program.pid)
    answer = set()
    for process in [program, *program.children(recursive=True)]:
        with suppress(psutil.Error):
            answer |= {tuple(c.laddr) for c in process.net_connections("tcp") if c.status == psutil.CONN_LISTEN}
    return sorted(answer)


def test_its_owner_runs_code_there(workers):
    with closing(workers.connect()) as client:
        assert client.submit(lambda: 6 * 7).result(timeout=30) == 42


@pytest.mark.parametrize("kind", ["none", "own"])
def test_a_client_without_its_credentials_runs_no_code(workers, kind):
    """Regression: another user of the machine ran code as the owner, and read a file of mode 0600."""
    scheme = "tcp" if kind == "none" else "tls"
    words = [f"{scheme}://127.0.0.1:{workers.address.rpartition(':')[2]}", kind]
    ended = subprocess.run([sys.executable, "-c", CLIENT, *words], capture_output=True, text=True, timeout=120)
    assert ended.stdout.startswith("refused"), ended.stdout


def test_all_its_ports_are_of_this_machine_and_give_nothing_without_credentials(workers):
    """Scheduler, nanny and worker speak TLS; the HTTP servers of scheduler and worker have no page."""
    places = listening(workers)
    assert len(places) == 5
    answers = []
    for host, port in places:
        assert host == "127.0.0.1"
        for page in ("/", "/info/main/workers.html", "/metrics", "/json/identity.json", "/health", "/status"):
            try:
                urllib.request.urlopen(f"http://{host}:{port}{page}", timeout=5)
            except urllib.error.HTTPError as error:
                answers.append((port, error.code))
            except OSError:  # no HTTP: TLS
                answers.append((port, "closed"))
            else:
                pytest.fail(f"port {port} gives {page}")
    assert {kind for _, kind in answers} == {404, "closed"}
    assert len({port for port, kind in answers if kind == 404}) == 2


def test_its_workers_import_from_a_folder_that_only_the_owner_can_open(workers):
    """Regression: in the shared folder for temporary files, where another user may make one of that name beforehand."""
    with closing(workers.connect()) as client:
        (folder,) = client.run(lambda dask_worker: dask_worker.local_directory).values()
    own = Path(folder).parents[1]
    assert own.name.startswith("tripod-doe-")
    assert stat.S_IMODE(own.stat().st_mode) == 0o700


def test_it_leaves_no_folder_behind(monkeypatch):
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:  # a name that leaves room for sockets
        monkeypatch.setenv("TMPDIR", folder)
        workers = LocalWorkers(1)
        assert list(Path(folder).glob("tripod-doe-*"))
        workers.close()
        assert not list(Path(folder).glob("tripod-doe-*"))


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "was ended by SIGKILL"),
        ("raise SystemExit(3)", "ended with exit code 3; see the lines above"),
    ],
)
def test_a_start_that_fails_says_why(monkeypatch, tmp_path, body, reason):
    """Regression: killed while it started, it was said to be explained above, where nothing stood."""
    (tmp_path / "dying.py").write_text(body)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(dask_local_cluster, "__name__", "dying")
    with pytest.raises(TripodDoeError, match=f"could not be started: the process that starts them {reason}"):
        LocalWorkers(1)


@pytest.mark.slow
def test_a_long_name_of_the_temporary_folder_leaves_room_for_sockets(monkeypatch, tmp_path):
    """Schedulers of jobs make such folders; names of sockets have 107 bytes."""
    folder = tmp_path / ("job-" + "1" * 100)
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    with closing(LocalWorkers(1)) as started, closing(started.connect()) as client:
        assert client.submit(lambda: 6 * 7).result(timeout=30) == 42
