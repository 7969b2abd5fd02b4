"""Studies on a Dask cluster of somebody else, whose processes die: real schedulers and workers."""

from __future__ import annotations

import importlib
import json
import os
import pickle
import sys
import threading
import time
from collections import Counter
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from distributed import Client, LocalCluster
from distributed.security import Security

import tripod_doe as td
from started import Process
from tripod_doe.errors import TripodDoeError
from tripod_doe.study.definition.simulators import load_simulator, matching_simulator
from tripod_doe.study.definition.study_folder import StudyFolder
from tripod_doe.study.execution import dask_executor, dask_workers
from tripod_doe.study.execution.dask_existing_scheduler import ExistingScheduler, TlsFiles
from tripod_doe.study.execution.user_code import placed, read_user_code
from tripod_doe.workflow.run_study import run

sys.path.append(str(Path(__file__).parents[3] / "benchmarks"))
from supervised_cluster import Proxy, SupervisedCluster

pytestmark = pytest.mark.usefixtures("pages_not_made")

FUNCTION = """
import os, time
def f(x):
    with open({log!r}, "a") as log:
        log.write(f"{{x:.0f}} {{os.getpid()}}\\n")
    if x == {killer}:
        os._exit(1)
    time.sleep({pause})
    return {{"y": x**2}}
"""
STUDY = """
[study]
name = "cluster"
function = "cluster_function:f"
[factors.x]
low = 1
high = {count}
count = {count}
[run]
block = {block}
"""


class Cluster(SupervisedCluster):
    """One whose processes are forked, but for those that import from another place."""

    def start(self, words, place):
        return super().start(words, place) if place else Process(words, quiet=True)


@pytest.fixture
def case(tmp_path, monkeypatch):
    """Writes a study of a function that notes every point that it starts, and reads these notes."""
    log = tmp_path / "log"

    def write(count, block=1, pause=0.1, killer=0):
        (tmp_path / "cluster_function.py").write_text(FUNCTION.format(log=str(log), killer=killer, pause=pause))
        (tmp_path / "s.toml").write_text(STUDY.format(count=count, block=block))
        return tmp_path / "s.toml"

    def started():
        return Counter(int(line.split()[0]) for line in log.read_text().splitlines()) if log.exists() else Counter()

    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))
    write.started = started
    return write


def meanwhile(step, condition):
    """Do something in a thread as soon as a condition holds."""

    def wait():
        while not condition():
            time.sleep(0.02)
        step()

    thread = threading.Thread(target=wait)
    thread.start()
    return thread


@pytest.mark.slow
def test_a_scheduler_that_is_killed_and_comes_back_costs_the_blocks_at_work_only(case, tmp_path, capsys):
    """Exact: every value, and no more points ran twice than were at work; workers that join late are used."""
    study = case(count=60)
    with Cluster(tmp_path, workers=1) as cluster:

        def disturb():
            cluster.add_worker("late worker")
            cluster.kill("scheduler")

        thread = meanwhile(disturb, lambda: sum(case.started().values()) >= 5)
        run(study, tmp_path / "out", scheduler_file=cluster.file, progress=False)
        thread.join()
    cube = td.open_cube(tmp_path / "out")
    np.testing.assert_array_equal(cube["y"], cube["x"] ** 2)
    assert sum(case.started().values()) - 60 <= 4
    assert {name for name in np.unique(cube["worker"].values) if name} == {"worker 0", "late worker"}
    printed = capsys.readouterr().err
    assert "the connection is lost; trying for 60 s to connect again" in printed
    assert "connected again" in printed


@pytest.mark.slow
def test_a_point_that_kills_its_worker_is_condemned_alone(case, tmp_path, monkeypatch):
    """Its neighbours in block and queue die with it, and finish all the same, although this scheduler blames them."""
    monkeypatch.setenv("DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES", "0")
    study = case(count=200, block=4, pause=0.001, killer=5)
    with Cluster(tmp_path, workers=1) as cluster:
        run(study, tmp_path / "out", scheduler=cluster.address, progress=False)
    cube = td.open_cube(tmp_path / "out")
    lost = cube["outcome"].values == td.Outcome.WORKER_LOST
    assert cube["x"].values[lost].tolist() == [5]
    np.testing.assert_array_equal(cube["y"].values[~lost], cube["x"].values[~lost] ** 2)
    assert str(cube["outcome_detail"].values[lost][0]) == "3 worker processes died on this point"
    assert case.started()[5] == 2 + 1 + 3  # in the block, in its halves, among others, then by itself


@pytest.mark.slow
def test_workers_that_join_before_the_first_block_is_finished_get_work_at_once(case, tmp_path, monkeypatch):
    """Regression: without a worker at the start two blocks were sent, and others only when one of them was finished."""
    study, printed, begun = case(count=4, pause=8.0), [], time.monotonic()
    monkeypatch.setattr(dask_workers, "print", lambda text, **_: printed.append(text), raising=False)
    with Cluster(tmp_path, workers=0) as cluster:

        def join():
            for number in range(4):
                cluster.add_worker(f"worker {number}")

        thread = meanwhile(join, lambda: printed or time.monotonic() > begun + 60)
        run(study, tmp_path / "out", scheduler=cluster.address, progress=False)
        thread.join()
    assert set(td.open_cube(tmp_path / "out")["worker"].values.tolist()) == {f"worker {number}" for number in range(4)}
    assert "no worker has joined yet; waiting for the first" in printed[0]


@pytest.mark.slow
def test_what_does_not_match_is_left_out_by_name_and_what_is_shipped_matches(case, tmp_path, capsys):
    """A worker without this package; a function that changes while its workers stay; a folder they do not see."""
    study = case(count=6)
    (tmp_path / "other" / "tripod_doe").mkdir(parents=True)
    (tmp_path / "other" / "tripod_doe" / "__init__.py").write_text("__version__ = '0'\n")
    with Cluster(tmp_path, workers=1) as cluster:
        cluster.add_worker("old worker", python_path=str(tmp_path / "other"))
        with Client(cluster.address) as client:
            client.wait_for_workers(2)
        run(study, tmp_path / "out", scheduler=cluster.address, progress=False)
        printed = capsys.readouterr().err
        code = tmp_path / "cluster_function.py"
        code.write_text(
            code.read_text().replace("x**2", "x**3 + helper.SHIFT").replace("import os", "import helper, os")
        )
        (tmp_path / "helper.py").write_text("SHIFT = 7\n")
        sys.modules.pop("cluster_function")
        run(study, tmp_path / "changed", scheduler=cluster.address, progress=False)
    assert set(td.open_cube(tmp_path / "out")["worker"].values.tolist()) == {"worker 0"}
    cube = td.open_cube(tmp_path / "changed")
    np.testing.assert_array_equal(cube["y"], cube["x"] ** 3 + 7)
    assert printed.count("worker old worker at tcp://127.0.0.1") == 1
    assert "is left out: it has no tripod-doe that can be used (ModuleNotFoundError: No module named" in printed


@pytest.mark.slow
def test_a_connection_that_is_reset_or_carries_nothing_more_is_replaced(case, tmp_path, monkeypatch, capsys):
    """Half-open: nobody closes it, the scheduler lives, and no answer ever comes."""
    monkeypatch.setattr(dask_executor, "_ANSWER", 0.5)
    monkeypatch.setattr(dask_executor, "_SILENCE", 2.0)
    study = case(count=60)
    with Cluster(tmp_path, workers=1) as cluster:
        proxy = Proxy(cluster.port)
        threads = [
            meanwhile(proxy.reset, lambda: sum(case.started().values()) >= 5),
            meanwhile(proxy.swallow, lambda: sum(case.started().values()) >= 25),
        ]
        run(study, tmp_path / "out", scheduler=f"tcp://127.0.0.1:{proxy.port}", progress=False)
        for thread in threads:
            thread.join()
        proxy.close()
    cube = td.open_cube(tmp_path / "out")
    np.testing.assert_array_equal(cube["y"], cube["x"] ** 2)
    assert max(case.started().values()) <= 3
    assert capsys.readouterr().err.count("connected again") == 2


@pytest.fixture
def here():
    """Gives an executor whose workers are threads of this process, and the keys of each question for answers."""
    asked = []
    with (
        LocalCluster(n_workers=1, threads_per_worker=2, processes=False, dashboard_address="127.0.0.1:0") as cluster,
        Client(cluster) as client,
    ):
        gather = cluster.scheduler.handlers["gather"]

        async def counted(keys, **others):
            asked.append(keys)
            return await gather(keys=keys, **others)

        cluster.scheduler.handlers["gather"] = counted
        with closing(dask_executor.OnDask(client, lambda client: client)) as executor:
            yield executor, asked


@pytest.mark.parametrize("broken", [None, 5])
def test_answers_that_are_there_are_fetched_together(here, monkeypatch, broken):
    """Regression: one after the other took as many ways to the scheduler and back, for which workers waited."""

    def square(wanted, work):
        number, _ = pickle.loads(work)
        if number == broken:
            raise ValueError("broken")
        return "name", "address", pickle.dumps(number**2)

    monkeypatch.setattr(dask_executor, "run_block", square)
    executor, asked = here
    for number in range(16):
        executor.submit(np.array([number]), number)
    while executor._finished.qsize() < 16:
        time.sleep(0.01)
    result = {}
    while executor.busy:
        try:
            points, answer = executor.next_finished()
        except ValueError as error:
            result[broken] = str(error)
        else:
            result[points.item()] = answer
    assert result == {number: "broken" if number == broken else number**2 for number in range(16)}
    assert len(asked) == 2


def test_code_that_a_worker_does_not_see_is_copied_there(tmp_path, monkeypatch):
    """And an installed module of another version is refused."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "far").mkdir()
    (tmp_path / "far" / "__init__.py").write_text("from far.inner import y\n")
    (tmp_path / "far" / "inner.py").write_text("def y(x):\n    return {'y': x + 1}\n")
    importlib.import_module("far")
    code = read_user_code("far:y", tmp_path)
    assert sorted(code.files) == ["far/__init__.py", "far/inner.py"]
    assert placed(code, str(tmp_path)) == str(tmp_path)
    assert sys.modules["far"].__file__.startswith(str(tmp_path))
    copy = placed(code, "/nowhere")
    assert "far" not in sys.modules  # imported again, from the copy
    assert (Path(copy) / "far" / "inner.py").read_bytes() == code.files["far/inner.py"]
    loaded = load_simulator(function="far:y", folder=StudyFolder(Path(copy)))
    assert matching_simulator("joint", "far:y", StudyFolder(Path(copy)), loaded.source_hash) is loaded
    with pytest.raises(td.InputError, match="it has another version of far:y"):
        matching_simulator("joint", "far:y", StudyFolder(Path(copy)), "other")


@pytest.mark.slow
def test_a_scheduler_that_stays_away_ends_the_run_with_its_points_kept(case, tmp_path):
    study = case(count=30)
    with Cluster(tmp_path, workers=1) as cluster:

        def end():
            cluster.kill("scheduler", for_good=True)

        thread = meanwhile(end, lambda: sum(case.started().values()) >= 5)
        with pytest.raises(
            TripodDoeError, match=r"no Dask scheduler has answered for 1 s: .*; finished points are kept"
        ):
            run(study, tmp_path / "out", scheduler=cluster.address, wait=1, progress=False)
        thread.join()
    before = case.started()
    summary = run(study, tmp_path / "out", workers=0, progress=False)
    assert summary.reused >= 3
    assert summary.computed + summary.reused == 30
    assert sum((case.started() - before).values()) == summary.computed


def test_what_names_no_scheduler_is_refused(tmp_path):
    (tmp_path / "empty.json").write_text(json.dumps({}))
    with pytest.raises(td.InputError, match=r"scheduler_file='.*none.json': there is no such file"):
        ExistingScheduler(file=tmp_path / "none.json").connect()
    with pytest.raises(td.InputError, match=r"give scheduler='tcp://a:1' or scheduler_file='.*', not both"):
        ExistingScheduler("tcp://a:1", tmp_path / "empty.json")
    with pytest.raises(td.InputError, match="no Dask scheduler answers there"):
        ExistingScheduler(file=tmp_path / "empty.json").connect()


@pytest.fixture
def credentials(tmp_path):
    """Files of credentials, as an administrator hands them out: of an authority, a certificate, its key."""
    security = Security.temporary()
    files = {"tls_ca_file": tmp_path / "ca.pem", "tls_cert": tmp_path / "cert.pem", "tls_key": tmp_path / "key.pem"}
    texts = security.tls_ca_file, security.tls_client_cert, security.tls_client_key
    for file, text in zip(files.values(), texts, strict=True):
        file.write_text(text)
    with LocalCluster(n_workers=1, processes=False, security=security, dashboard_address="127.0.0.1:0") as cluster:
        yield cluster.scheduler_address, files


def test_a_scheduler_that_talks_tls_takes_clients_with_its_credentials_only(case, tmp_path, credentials, capsys):
    address, files = credentials
    study = case(count=2, pause=0)
    summary = run(study, tmp_path / "out", scheduler=address, progress=False, **files)
    assert summary.computed == 2
    assert "without TLS" not in capsys.readouterr().err
    with pytest.raises(td.InputError, match=f"'{address}': {address} asks for credentials: give tls_ca_file, tls_cert"):
        run(study, tmp_path / "none", scheduler=address, progress=False)
    other = Security.temporary()
    files["tls_cert"].write_text(other.tls_client_cert)
    files["tls_key"].write_text(other.tls_client_key)
    with pytest.raises(td.InputError, match="answers there, or it refuses these credentials"):
        run(study, tmp_path / "other", scheduler=address, progress=False, **files)
    files["tls_ca_file"].write_text(other.tls_ca_file)
    with pytest.raises(TripodDoeError, match=r"for 0.* its certificate does not pass tls_ca_file: "):
        run(study, tmp_path / "other", scheduler=address, progress=False, wait=0, **files)
    files["tls_key"].write_text("no key")
    with pytest.raises(td.InputError, match=r"tls_ca_file='.*ca.pem', tls_cert='.*', tls_key='.*': cannot be used for"):
        run(study, tmp_path / "other", scheduler=address, progress=False, **files)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"tls_cert": "cert.pem"}, "credentials: give tls_ca_file and tls_cert, both"),
        ({"tls_ca_file": "ca.pem", "tls_cert": "cert.pem"}, "tls_cert='cert.pem': credentials are for scheduler"),
        (
            {"tls_ca_file": "ca.pem", "tls_cert": "cert.pem", "scheduler": "tcp://a:1"},
            "credentials are for an address that begins with tls://",
        ),
        (
            {"tls_ca_file": "none.pem", "tls_cert": "cert.pem", "scheduler": "tls://a:1"},
            "tls_ca_file='none.pem': there is no such file",
        ),
    ],
)
def test_credentials_that_cannot_be_meant_are_refused(case, tmp_path, given, message):
    with pytest.raises(td.InputError, match=message):
        run(case(count=2), tmp_path / "out", progress=False, **given)


def test_a_wrong_scheme_is_named_also_after_a_wait(credentials):
    """Regression: the message was that no scheduler had answered."""
    address, files = credentials
    with pytest.raises(TripodDoeError, match=r"for 0.* answers there without TLS; .* begins with tls://"):
        ExistingScheduler(address.replace("tls:", "tcp:"), wait=0).connect_first()
    with LocalCluster(n_workers=0, processes=False, protocol="tcp://", dashboard_address="127.0.0.1:0") as cluster:
        plain = cluster.scheduler_address.replace("tcp:", "tls:")
        with pytest.raises(TripodDoeError, match=r"for 0.* handshake failed \(.*\); .* begins with tcp://"):
            ExistingScheduler(plain, wait=0, tls=TlsFiles(*files.values())).connect_first()


def test_a_connection_without_tls_is_warned_of(capsys):
    with LocalCluster(n_workers=0, processes=False, protocol="tcp://", dashboard_address="127.0.0.1:0") as cluster:
        ExistingScheduler(cluster.scheduler_address).connect_first().close()
    warning = capsys.readouterr().err
    assert "a connection without TLS: a program that reaches this scheduler or its workers can run" in warning
    assert "close it with tls_ca_file, tls_cert and tls_key; page 'On a cluster'" in warning
    assert ".md" not in warning  # no file that an installed package lacks


def test_an_address_without_a_protocol_is_one_of_tcp():
    """Regression: 127.0.0.1:8786, which Dask's own client takes, was no scheduler."""
    with LocalCluster(n_workers=0, dashboard_address="127.0.0.1:0", silence_logs=50, host="127.0.0.1") as cluster:
        plain = cluster.scheduler_address.removeprefix("tcp://")
        with ExistingScheduler(address=plain).connect() as client:
            assert client.scheduler.address == cluster.scheduler_address


def test_a_command_that_was_told_to_wait_waits_at_the_start(tmp_path):
    with pytest.raises(TripodDoeError, match="there is no such file"):
        ExistingScheduler(file=tmp_path / "none.json").connect_first()
    with pytest.raises(TripodDoeError, match="no Dask scheduler has answered for 0"):
        ExistingScheduler(file=tmp_path / "none.json", wait=0.2).connect_first()
