"""Workers: ended in time, replaced, and alone with what was sent; and runs that outlive all of it."""

from __future__ import annotations

import fcntl
import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from dataclasses import replace

import psutil
import pytest

from tripod_doe.service.limits import Limits
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.service import Service
from tripod_doe.service.settings import Settings
from tripod_doe.service.workers import worker_pool
from tripod_doe.service.workers.forking import start_process, start_program
from tripod_doe.service.workers.worker import _reply
from tripod_doe.service.workers.worker_pool import (
    AllBusyError,
    ClientLeftError,
    ServerEndsError,
    WorkerFailedError,
    WorkerPool,
)

MODULES = {
    "spinning": "while True: pass",
    "sleeping": "import time; time.sleep(1000)",
    "ending": "import os; os._exit(3)",
    "failing": "raise KeyError('inside')",
    "greedy": "bytearray(10**12)",
    "deep": "def f(): f()\nf()",
    "parent": "import os, subprocess; open(os.environ['MARK'], 'w').write(str(subprocess.Popen(['sleep', '999']).pid))\n"
    "while True: pass",
    "telling": "import json, os, resource, signal, sys\n"
    "memory = resource.getrlimit(resource.RLIMIT_AS)[1]\n"
    "print(json.dumps([sys.argv[1:], os.getpid(), os.getsid(0), os.nice(0), sys.stdin.read(), memory]), flush=True)\n"
    "signal.pause()",
}
"""What hostile questions do: a worker that imports one of these does it."""


@pytest.fixture
def pool(tmp_path, monkeypatch):
    for name, text in MODULES.items():
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    pool = WorkerPool(1, Limits(), patience=0.5)
    yield pool
    pool.close()


def load(pool, name, seconds=1.0):
    return pool.ask("workers.worker:import_module", seconds, name=name)


def until_gone(pid):
    until = time.monotonic() + 20
    while psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE:
        assert time.monotonic() < until
        time.sleep(0.05)


def works(pool):
    return pool.ask("workers.answers:wants_timing", 20, body=b'{"study": "", "timing": false}', limits=Limits())


@pytest.mark.parametrize(("name", "most"), [("spinning", 15), ("sleeping", 15)])
def test_an_answer_that_takes_too_long_ends_with_its_process(pool, name, most):
    """By CPU time, or by a multiple of it by the clock for one that only waits."""
    assert works(pool) is False
    started = time.monotonic()
    with pytest.raises(RefusedError, match=r"413.*no answer within 1 s of CPU time"):
        load(pool, name)
    assert time.monotonic() - started < most
    assert works(pool) is False


def test_questions_hear_that_the_server_ends(pool):
    """Those at work, those that wait and those to come: it was an internal error."""
    assert works(pool) is False
    heard = []

    def ask():
        try:
            load(pool, "sleeping", 20)
        except (ServerEndsError, AllBusyError) as error:
            heard.append(type(error))

    asking = [threading.Thread(target=ask) for _ in range(3)]
    for thread in asking:
        thread.start()
    time.sleep(0.3)
    pool.close()
    for thread in asking:
        thread.join(10)
    assert heard == [ServerEndsError] * 3
    with pytest.raises(ServerEndsError):
        works(pool)


def test_what_has_no_results_yet_is_not_found(tmp_path):
    """Regression: 422, "run a study with out=", and for the step of a workflow "there is no such file"."""
    for path in (tmp_path, tmp_path / "steps" / "map", tmp_path / "front.nc"):
        for question, more in (("workers.answers:describe", {}), ("explorer.answers:extremes", {"order": 3})):
            kind, (status, (problem,)) = _reply(question, {"path": str(path)} | more, False)
            assert (kind, status, problem.message) == ("refused", 404, "nothing has finished here yet")


@pytest.mark.parametrize("name", ["greedy", "deep"])
def test_memory_and_depth_are_refused(pool, name):
    with pytest.raises(RefusedError, match=r"413.*than is allowed here"):
        load(pool, name, 20)
    assert works(pool) is False


@pytest.mark.parametrize(("name", "told"), [("ending", "the worker has ended"), ("failing", "KeyError: 'inside'")])
def test_a_worker_that_fails_says_so_and_is_replaced(pool, name, told):
    with pytest.raises(WorkerFailedError, match=told):
        load(pool, name, 20)
    assert works(pool) is False


def test_what_a_worker_started_ends_with_it(pool, tmp_path, monkeypatch):
    script = (tmp_path / "parent.py").read_text().replace("os.environ['MARK']", repr(str(tmp_path / "mark")))
    (tmp_path / "parent.py").write_text(script)
    with pytest.raises(RefusedError, match="413"):
        load(pool, "parent")
    until_gone(int((tmp_path / "mark").read_text()))


def test_a_question_does_not_wait_for_ever(pool):
    def spin():
        with suppress(RefusedError):
            load(pool, "spinning", 3)

    thread = threading.Thread(target=spin)
    thread.start()
    time.sleep(0.2)
    with pytest.raises(AllBusyError):
        works(pool)
    thread.join()


def test_questions_of_clients_that_have_left_are_dropped(pool):
    """Regression: they were worked off, one after the other; here the first would take 80 s, and so would the second."""
    assert works(pool) is False
    left, dropped = threading.Event(), []

    def ask():
        with pytest.raises(ClientLeftError):
            pool.ask("workers.worker:import_module", 20.0, left=left, name="sleeping")
        dropped.append(time.monotonic() - started)

    started = time.monotonic()
    asking = [threading.Thread(target=ask) for _ in range(2)]
    for thread in asking:
        thread.start()
    time.sleep(0.1)
    left.set()
    for thread in asking:
        thread.join(20)
    assert len(dropped) == 2
    assert dropped[0] < 2 < dropped[1] < 15
    with pytest.raises(ClientLeftError):
        pool.ask("workers.worker:import_module", 20.0, left=left, name="sleeping")
    assert works(pool) is False


def test_the_fork_server_is_replaced(pool):
    assert works(pool) is False
    from multiprocessing import forkserver

    pool._workers[0]._process.kill()
    os.kill(forkserver._forkserver._forkserver_pid, signal.SIGKILL)
    time.sleep(0.2)
    try:
        assert works(pool) is False
    except (WorkerFailedError, AllBusyError):  # its end was not known yet
        assert works(pool) is False


def test_a_process_that_cannot_start_is_said_and_tried_again(tmp_path, monkeypatch, caplog):
    """Regression: the first refusal ended the thread that looks for directories, without a word to anybody."""

    def refuse(*_):
        raise ConnectionRefusedError(111, "Connection refused")

    service, looked = Service(Settings(tmp_path, token="t" * 32)), threading.Event()
    monkeypatch.setattr(service.found, "watch", looked.set)
    try:
        with monkeypatch.context() as refusing:
            refusing.setattr(worker_pool, "start_process", refuse)
            service._watch_folder()
            assert looked.is_set()
            with pytest.raises(AllBusyError, match=r"no process can be started for the answer .*Connection refused"):
                works(service._pool)
        assert "no process can be started" in caplog.text
        assert works(service._pool) is False
    finally:
        service.end_questions()


def test_a_run_is_a_session_of_its_own_and_holds_its_lock(pool, tmp_path):
    lock = os.open(tmp_path / "lock", os.O_CREAT | os.O_RDWR, 0o600)
    fcntl.flock(lock, fcntl.LOCK_EX)
    (tmp_path / "log").touch()
    start_program("telling", ["one", "two"], tmp_path / "log", lock, 3, 5 * 10**9).join()
    until = time.monotonic() + 20
    while not (told := (tmp_path / "log").read_text()).endswith("\n"):
        assert time.monotonic() < until
        time.sleep(0.05)
    words, pid, session, niceness, asked, memory = json.loads(told)
    assert memory == 5 * 10**9
    assert (words, asked) == (["one", "two"], "")
    assert session == pid == int((tmp_path / "lock").read_text())
    assert niceness == os.nice(0) + 3
    process = psutil.Process(pid)
    assert {file.path for file in process.open_files()} == {str(tmp_path / "lock"), str(tmp_path / "log")}
    with (tmp_path / "lock").open() as probe:
        with pytest.raises(BlockingIOError):
            fcntl.flock(probe, fcntl.LOCK_EX | fcntl.LOCK_NB)
        process.send_signal(signal.SIGINT)  # as Ctrl-C: it is not ignored
        until_gone(pid)
        fcntl.flock(probe, fcntl.LOCK_EX | fcntl.LOCK_NB)
    assert "KeyboardInterrupt" in (tmp_path / "log").read_text()


def test_a_run_that_cannot_start_says_so_in_its_log(tmp_path, monkeypatch):
    from tripod_doe.service.workers import forking

    lock = os.open(tmp_path / "lock", os.O_CREAT | os.O_RDWR, 0o600)
    monkeypatch.setattr(forking, "_detach", sys.exit)  # takes one argument at most
    start_program("telling", [], tmp_path / "log", lock, 0, 10**10).join()
    assert "tripod-doe: cannot start a process: exit code 1" in (tmp_path / "log").read_text()
    with pytest.raises(OSError, match="Bad file"):
        os.close(lock)


def test_workers_end_with_the_process_that_started_them(tmp_path):
    script = (
        "import os, time; from tripod_doe.service.workers.forking import start_process\n"
        "print(start_process(time.sleep, 1000).pid, flush=True)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60)
    until_gone(int(done.stdout))


def test_what_is_forked_imports_nothing_from_the_current_folder(tmp_path):
    """Regression: `tripod-doe serve` in a folder of others, as /tmp, ran their multiprocessing.py."""
    theirs, script = tmp_path / "theirs", tmp_path / "script.py"
    theirs.mkdir()
    for name in ("multiprocessing", "socket", "struct"):
        (theirs / f"{name}.py").write_text("open('was_here', 'w')\nraise ImportError\n")
    script.write_text(
        "if __name__ == '__main__':\n    import os, time\n"
        "    from tripod_doe.service.workers.forking import start_process\n"
        "    process = start_process(time.sleep, 0)\n    process.join(60)\n"
        "    print(process.exitcode, os.environ.get('PYTHONSAFEPATH'))\n"
    )
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    done = subprocess.run(
        [sys.executable, script], cwd=theirs, env=environment, capture_output=True, text=True, timeout=100
    )
    assert not (theirs / "was_here").exists()
    assert done.stdout == "0 None\n", done.stderr


def test_what_is_forked_has_one_thread_and_knows_nothing_of_the_web():
    """A process with threads must not fork."""
    script = (
        "import os, sys; import tripod_doe.process.own_process, tripod_doe.service.workers.preload; "
        "print(len(os.listdir('/proc/self/task')), sys.modules.keys() & {'fastapi', 'starlette', 'uvicorn'})"
    )
    environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "1 set()\n"


def test_a_worker_ends_when_nobody_can_ask_any_more(pool):
    process = start_process(time.sleep, 0)
    process.join(20)
    assert process.exitcode == 0
    assert works(pool) is False
    worker = psutil.Process(pool._workers[0]._process.pid)
    pool._workers[0]._connection.close()
    worker.wait(20)


def test_questions_of_readers_hold_up_no_question_of_the_owner(tmp_path, monkeypatch):
    """Regression: three workbooks that a holder of a link asked for held the owner's large answers for 19 s."""
    (tmp_path / "sleeping.py").write_text(MODULES["sleeping"])
    monkeypatch.syspath_prepend(str(tmp_path))
    service = Service(Settings(tmp_path, token="t" * 32))
    left, questions = threading.Event(), {"question": "workers.worker:import_module", "name": "sleeping"}
    seen = service.seen_by(service.settings, lambda: True).asked_by(left)
    endless(monkeypatch, service)
    asking = [threading.Thread(target=_refused, args=(ask, questions)) for ask in [seen.ask, seen.ask_large] * 2]
    try:
        for thread in asking:
            thread.start()
        for ask in (service.ask, service.ask_large):
            body = b'{"study": "", "timing": false}'
            assert ask("workers.answers:wants_timing", body=body, limits=Limits()) is False
        assert all(thread.is_alive() for thread in asking)  # they wait for the owner's answers
    finally:
        left.set()
        service.end_questions()
        for thread in asking:
            thread.join(30)


@pytest.mark.parametrize("kind", ["ask", "ask_large"])
def test_a_reader_leaves_a_worker_to_the_others(tmp_path, monkeypatch, kind):
    """Regression: a link's differences of large cubes, and its PDFs, held up the answers of all other readers."""
    (tmp_path / "sleeping.py").write_text(MODULES["sleeping"])
    monkeypatch.syspath_prepend(str(tmp_path))
    service, left = Service(Settings(tmp_path, token="t" * 32)), threading.Event()
    one, other = (service.seen_by(replace(service.settings, key=key), lambda: True).asked_by(left) for key in "ab")
    endless(monkeypatch, service)
    questions = {"question": "workers.worker:import_module", "name": "sleeping"}
    asking = [threading.Thread(target=_refused, args=(getattr(one, kind), questions)) for _ in range(2)]
    try:
        for thread in asking:
            thread.start()
        pool = one._pool if kind == "ask" else one._large
        while pool._open["a"] < 2:
            time.sleep(0.01)
        body = b'{"study": "", "timing": false}'
        asked = {"question": "workers.answers:wants_timing", "body": body, "limits": Limits()}
        assert getattr(other, kind)(**asked) is False
        assert all(thread.is_alive() for thread in asking)
        if kind == "ask_large":
            with pytest.raises(AllBusyError):  # one is at work, one waits
                one.ask_large(**asked)
    finally:
        left.set()
        service.end_questions()
        for thread in asking:
            thread.join(30)


def test_two_readers_who_hold_all_workers_make_room_for_a_third(pool, monkeypatch):
    """Regression: a third reader waited until one of their answers was ready, and after 30 s got none."""
    monkeypatch.setattr("tripod_doe.service.workers.worker_pool._TURN", 0.5)
    shared = WorkerPool(2, Limits(), of_one=2)
    ended, heard = threading.Event(), []

    def hold(reader):
        try:
            shared.ask("workers.worker:import_module", 60, left=ended, reader=reader, name="sleeping")
        except AllBusyError as error:
            heard.append(str(error))
        except (RefusedError, ServerEndsError):
            pass

    greedy = [threading.Thread(target=hold, args=(reader,)) for reader in "ab"]
    try:
        for thread in greedy:
            thread.start()
        while not shared._free.empty():
            time.sleep(0.01)
        body = b'{"study": "", "timing": false}'
        question = {"question": "workers.answers:wants_timing", "body": body, "limits": Limits()}
        assert shared.ask(seconds=60, reader="c", **question) is False
        assert heard == ["503: import module: ended after 0.5 s, since others wait: try again in a moment"]
        assert sorted(thread.is_alive() for thread in greedy) == [False, True]  # the other one goes on
    finally:
        ended.set()
        shared.close()
        for thread in greedy:
            thread.join(30)


def endless(monkeypatch, service):
    """Let questions of readers wait and last until they are ended, also on a busy machine."""
    for name in ("_PATIENCE", "_TURN"):
        monkeypatch.setattr(f"tripod_doe.service.workers.worker_pool.{name}", 1000)
    for readers in service._of_readers:
        readers._patience = 1000


def _refused(ask, arguments):
    with suppress(RefusedError, AllBusyError, ServerEndsError):
        ask(**arguments)


def test_only_so_many_questions_wait(tmp_path, monkeypatch):
    """Regression: each that waits holds a thread of the server, and 60 of them held all."""
    (tmp_path / "napping.py").write_text("import time; time.sleep(2); raise KeyError")
    monkeypatch.syspath_prepend(str(tmp_path))
    pool = WorkerPool(1, Limits(), waiting=2)
    heard = []

    def ask():
        started = time.monotonic()
        try:
            load(pool, "napping", 20)
        except AllBusyError:
            heard.append(time.monotonic() - started)
        except WorkerFailedError:
            pass

    try:
        asking = [threading.Thread(target=ask) for _ in range(8)]
        for thread in asking:
            thread.start()
        for thread in asking:
            thread.join(30)
        assert len(heard) == 8 - pool.threads
        assert max(heard) < 1
    finally:
        pool.close()
