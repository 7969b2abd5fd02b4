"""The states of runs, with processes that do nothing but hold the lock of their directory, or end."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import threading
import time
from contextlib import closing
from dataclasses import replace
from datetime import datetime

import pytest

import tripod_doe as td
from tripod_doe.cli import main
from tripod_doe.errors import CubeError, InputError, StorageError
from tripod_doe.notification import Notifier
from tripod_doe.service.limits import Limits
from tripod_doe.service.problems import RefusedError
from tripod_doe.service.requests.uploads import UPLOAD
from tripod_doe.service.runs import annotations, processes
from tripod_doe.service.runs.run_end import ending_of, remove_report, work_beside_points
from tripod_doe.service.runs.run_table import TABLE, PointCounts, Run, RunTable, State
from tripod_doe.service.runs.supervisor import Supervisor
from tripod_doe.service.settings import Settings
from tripod_doe.study.journal import Journal
from tripod_doe.study.result_directory.annotation import Annotation, read_annotation
from tripod_doe.study.result_directory.directory_lock import DirectoryLock
from tripod_doe.workflow.steps_file import STEPS, write_steps

PLAN = {"kind": "study", "name": "idle", "question": "", "unique": 3, "expected_outcomes": []}
SLEEP = "import signal, time; signal.signal(signal.SIGINT, signal.SIG_DFL); time.sleep(60)"
STUBBORN = (
    "import signal, time; signal.signal(signal.SIGINT, lambda *_: print('asked', flush=True));"
    " print('ready', flush=True); time.sleep(60)"
)
ENDS = "print('tripod-doe: {}', flush=True)"


@pytest.fixture
def settings(tmp_path):
    return Settings(tmp_path / "runs", limits=Limits(running=1, queued=3))


@pytest.fixture
def start(settings, monkeypatch):
    """Start a supervisor whose runs do what a line of Python says."""
    started, children = [], []
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a child would ignore what this process ignores

    def start(program, given=settings):
        def start_run(directory, words, memory_bytes):
            words = [sys.executable, "-c", program, "tripod_doe.cli", *words]
            lock = os.open(directory / ".alive", os.O_CREAT | os.O_RDWR)
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            try:
                with (directory / processes.LOG).open("wb") as log:
                    child = subprocess.Popen(words, stdout=log, stderr=log, start_new_session=True, pass_fds=(lock,))
                os.ftruncate(lock, 0)
                os.write(lock, f"{child.pid}\n".encode())
            finally:
                os.close(lock)
            children.append(child)

        monkeypatch.setattr(processes, "start_run", start_run)
        given.folder.mkdir(exist_ok=True)
        started.append(Supervisor(given))
        started[-1].start()
        return started[-1]

    yield start
    for supervisor in started:
        supervisor.close()
    for child in children:
        child.kill()
        child.wait()
    signal.signal(signal.SIGINT, before)


def submit(supervisor, tmp_path, **options):
    upload = tmp_path / f"new{time.monotonic_ns()}"
    upload.mkdir()
    return supervisor.submit(upload, PLAN, **options).id


def wait(supervisor, run_id, state, seconds=20):
    until = time.monotonic() + seconds
    while not (found := [run for run in supervisor.all() if run.id == run_id and run.state is state]):
        assert time.monotonic() < until, supervisor.all()
        time.sleep(0.02)
    return found[0]


def wait_for_word(log, word, seconds=20):
    until = time.monotonic() + seconds
    while word not in log.read_text():
        assert time.monotonic() < until
        time.sleep(0.02)


def test_runs_wait_their_turn_and_a_stop_lets_the_next_one_go(start, tmp_path):
    supervisor = start(SLEEP)
    first, second = submit(supervisor, tmp_path), submit(supervisor, tmp_path)
    wait(supervisor, first, State.RUNNING)
    assert supervisor.find(second).state is State.QUEUED
    assert supervisor.stop(first).state is State.STOPPING
    assert wait(supervisor, first, State.STOPPED).message == ""
    wait(supervisor, second, State.RUNNING, seconds=5)
    assert [run.id for run in supervisor.all()] == [second, first]


def test_a_run_that_dies_is_failed_with_its_last_words(start, tmp_path):
    supervisor = start(ENDS.format("the disk is full"))
    assert wait(supervisor, submit(supervisor, tmp_path), State.FAILED).message == "the disk is full"


def test_a_killed_run_does_not_show_its_progress_as_a_message(start, tmp_path):
    """Regression: after SIGTERM its message was "12 of 1,000 points (1 %) after 31 s"."""
    lines = ("12 of 1,000 points (1 %) after 31 s", "fit: search, 12 points", "wide: running")
    supervisor = start(f"print({chr(10).join(lines)!r}, flush=True)")
    assert wait(supervisor, submit(supervisor, tmp_path), State.FAILED).message.startswith("its process ended without")


def test_a_run_says_what_it_does_after_its_last_point(start, tmp_path):
    """Regression: it was "running" with all points ended, and said nothing."""
    study = {
        "study": {"name": "idle"},
        "base": {"model": "equilibrium"},
        "factors": {"joint_angle_deg": {"values": [4, 8, 12]}},
    }
    td.run(study, out=tmp_path / "out", workers=0, progress=False)
    supervisor = start(SLEEP)
    run_id = submit(supervisor, tmp_path)
    wait(supervisor, run_id, State.RUNNING)
    for name in ("cube.nc", "cost.nc", "study.toml", "journal.sqlite"):
        shutil.copy(tmp_path / "out" / name, supervisor.directory(run_id))
    wait_for_message(supervisor, run_id, "")
    lock = DirectoryLock(supervisor.directory(run_id))  # before it has begun, a run that was extended makes no report
    wait_for_message(supervisor, run_id, "all points have ended; now the analyses and the report are made")
    (supervisor.directory(run_id) / "cube.nc").unlink()
    wait_for_message(supervisor, run_id, "all points have ended; now the cube is written")
    with Journal(supervisor.directory(run_id)) as journal:
        journal.remember({"computing": "yes"})
    wait_for_message(supervisor, run_id, "")
    lock.release()
    supervisor.stop(run_id)
    assert wait(supervisor, run_id, State.STOPPED).message == ""


def test_a_run_says_that_a_pilot_comes_before_its_points(tmp_path):
    """Regression: it was "running" with no point for minutes, and said nothing."""
    run = Run("a" * 16, "study", "n", "", State.RUNNING, plan={"model_chosen_by_pilot": True})
    said = [work_beside_points(run, PointCounts(3, ended), tmp_path) for ended in (0, 1)]
    assert said == ["a pilot chooses the model of each point before the first one", ""]


def wait_for_message(supervisor, run_id, message, seconds=20):
    until = time.monotonic() + seconds
    while (found := supervisor.find(run_id)).message != message or found.counts.missing:
        assert time.monotonic() < until, found
        time.sleep(0.02)


def test_a_run_killed_without_a_message_is_failed_and_says_so(start, tmp_path):
    supervisor = start("import os; os.kill(os.getpid(), 9)")
    assert "without a message" in wait(supervisor, submit(supervisor, tmp_path), State.FAILED).message


def test_a_run_that_does_not_stop_is_killed(start, tmp_path):
    """It is asked once, goes on, and is killed when its time is over: that is now."""
    supervisor = start(STUBBORN)
    run_id = submit(supervisor, tmp_path)
    log = supervisor.directory(run_id) / processes.LOG
    wait(supervisor, run_id, State.RUNNING)
    wait_for_word(log, "ready")
    supervisor.stop(run_id)
    wait_for_word(log, "asked")
    supervisor._work[run_id]._kill_at = time.monotonic()
    wait(supervisor, run_id, State.STOPPED)
    assert log.read_text().split() == ["ready", "asked"]


def test_a_run_that_is_stopped_before_it_has_started_ends_as_soon_as_it_has(start, tmp_path, monkeypatch):
    """Its number is not there yet; it is asked to stop once, for the second time would end it at once."""
    monkeypatch.setattr("tripod_doe.service.runs.run_work._PATIENCE", 1000)
    supervisor = start(SLEEP)
    run_id = submit(supervisor, tmp_path)
    wait(supervisor, run_id, State.RUNNING)
    number = supervisor.directory(run_id) / ".alive"
    while not (told := number.read_text()):
        time.sleep(0.02)
    number.write_text("")
    assert supervisor.stop(run_id).state is State.STOPPING
    number.write_text(told)
    wait(supervisor, run_id, State.STOPPED)


def test_the_next_server_finds_runs_at_work_and_moves_the_queue(start, settings, tmp_path):
    """The first server ends as by a kill: nothing tells its runs, nothing is written."""
    first = start(SLEEP)
    at_work, waiting = submit(first, tmp_path), submit(first, tmp_path)
    wait(first, at_work, State.RUNNING)
    first._ended.set()
    first._thread.join()
    second = start(SLEEP)
    assert second.find(at_work).state is State.RUNNING
    assert second.find(waiting).state is State.QUEUED
    processes.kill_run(second.directory(at_work))
    wait(second, at_work, State.FAILED)
    wait(second, waiting, State.RUNNING, seconds=5)


def test_a_run_that_died_while_no_server_looked_is_not_running(start, settings, tmp_path):
    settings.folder.mkdir()
    table = RunTable(settings.folder)
    lost = start(SLEEP)
    run = replace(lost.find(submit(lost, tmp_path)), id="0" * 16, key=None, state=State.RUNNING)
    table.put(run)
    table.put(replace(run, id="1" * 16, state=State.STOPPING))
    table.close()
    supervisor = start(SLEEP)
    wait(supervisor, "0" * 16, State.FAILED)
    wait(supervisor, "1" * 16, State.STOPPED)


def test_a_directory_that_somebody_else_fills_is_left_alone(start, tmp_path):
    """`tripod-doe run --out` by hand holds the directory's own lock."""
    supervisor = start(ENDS.format("over"))
    run_id = submit(supervisor, tmp_path)
    wait(supervisor, run_id, State.FAILED)
    with (supervisor.directory(run_id) / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        for change in (supervisor.resume, supervisor.delete):
            with pytest.raises(RefusedError) as refused:
                change(run_id)
            assert refused.value.status == 409
    supervisor.delete(run_id)


def test_a_run_deleted_from_the_bin_leaves_nothing(start, settings, tmp_path):
    supervisor = start(ENDS.format("over"))
    run_id = submit(supervisor, tmp_path, key="k", digest="d")
    wait(supervisor, run_id, State.FAILED)
    supervisor.delete(run_id)
    supervisor.delete(run_id)
    assert [run.id for run in supervisor.in_bin()] == [run_id]
    supervisor.delete(run_id, from_bin=True)
    assert supervisor.in_bin() == []
    assert sorted(path.name for path in settings.folder.iterdir() if "sqlite" not in path.name) == []
    assert supervisor.find_by_key("k", "other") is None
    with pytest.raises(RefusedError) as refused:
        supervisor.find(run_id)
    assert refused.value.status == 404


def test_a_restored_run_is_as_it_was_also_for_the_next_server(start, settings, tmp_path):
    supervisor = start(ENDS.format("over"))
    runs = [submit(supervisor, tmp_path, key=key, digest="d") for key in ("a", "b", "c")]
    before = [wait(supervisor, run_id, State.FAILED) for run_id in runs]
    (supervisor.directory(runs[1]) / "kept").write_text("results")
    supervisor.annotate(runs[1], {"tags": ["customer"]})
    supervisor.delete(runs[1])
    with pytest.raises(RefusedError, match="in the bin"):
        supervisor.find(runs[1])
    again = submit(supervisor, tmp_path, key="b", digest="d")  # its key may be used again
    assert again not in runs
    supervisor.close()
    later = start(SLEEP)
    assert [run.id for run in later.all()] == [again, runs[2], runs[0]]
    assert [run.id for run in later.in_bin()] == [runs[1]]
    restored = later.restore(runs[1])
    assert [run.id for run in later.all()] == [again, *reversed(runs)]
    assert (restored.state, restored.counts, restored.tags) == (before[1].state, before[1].counts, ("customer",))
    assert (later.directory(runs[1]) / "kept").read_text() == "results"
    with pytest.raises(RefusedError) as refused:
        later.restore(runs[1])
    assert refused.value.status == 404


def test_the_bin_is_emptied_after_some_weeks(start, settings, tmp_path):
    supervisor = start(ENDS.format("over"))
    old, new = submit(supervisor, tmp_path), submit(supervisor, tmp_path)
    for run_id in (old, new):
        wait(supervisor, run_id, State.FAILED)
        supervisor.delete(run_id)
    supervisor.close()
    spoil_table(settings, old, lambda record: record | {"binned": "2020-01-01T00:00:00.000Z"})
    later = start(SLEEP)
    time.sleep(0.6)
    assert {run.id for run in later.in_bin()} == {old, new}  # regression: a clock a month ahead emptied it at once
    later._bin_due = 0.0
    until = time.monotonic() + 20
    while len(later.in_bin()) > 1 or (settings.folder / old).exists():
        assert time.monotonic() < until
        time.sleep(0.02)
    assert [run.id for run in later.in_bin()] == [new]
    assert (settings.folder / new).is_dir()


def test_what_the_command_line_writes_about_a_run_is_shown(start, settings, tmp_path):
    supervisor = start(SLEEP)
    run_id = submit(supervisor, tmp_path)
    wait(supervisor, run_id, State.RUNNING)
    assert main(["annotate", str(supervisor.directory(run_id)), "--name", "customer/joint-7", "--tags", "a,b"]) == 0
    until = time.monotonic() + 10
    while supervisor.find(run_id).shown_name != "customer/joint-7":
        assert time.monotonic() < until
        time.sleep(0.05)
    supervisor.annotate(run_id, {"owner": "Ada"})
    assert read_annotation(supervisor.directory(run_id)) == Annotation("customer/joint-7", "Ada", ("a", "b"))
    assert supervisor.find(run_id).record()["tags"] == ["a", "b"]


def test_annotations_are_read_beside_everything_else(start, tmp_path, monkeypatch):
    """Regression: all routes waited for a file on a slow disk. What is changed meanwhile is not undone."""
    supervisor = start(SLEEP)
    run_id = submit(supervisor, tmp_path)
    begun, release = threading.Event(), threading.Event()

    def slow(directory):
        found = read_annotation(directory)
        begun.set()
        release.wait(20)
        return found

    monkeypatch.setattr(annotations, "read_annotation", slow)
    (supervisor.directory(run_id) / "about.toml").write_text('name = "old"')
    assert begun.wait(20)
    changing = threading.Thread(target=supervisor.annotate, args=(run_id, {"name": "new"}), daemon=True)
    changing.start()
    changing.join(5)
    waited = changing.is_alive()
    release.set()
    assert not waited
    time.sleep(1)
    assert supervisor.find(run_id).label == "new"


def test_a_full_queue_is_told(start, tmp_path):
    supervisor = start(SLEEP)
    wait(supervisor, submit(supervisor, tmp_path), State.RUNNING)
    for _ in range(3):
        submit(supervisor, tmp_path)
    with pytest.raises(RefusedError) as refused:
        submit(supervisor, tmp_path)
    assert refused.value.status == 413
    assert "3 runs" in str(refused.value)


def test_an_empty_key_is_none(start, tmp_path):
    supervisor = start(SLEEP)
    assert submit(supervisor, tmp_path, key="") != submit(supervisor, tmp_path, key="")


def test_the_upload_becomes_part_of_the_run(start, settings, tmp_path):
    supervisor = start(SLEEP)
    upload = tmp_path / "new"
    upload.mkdir()
    (upload / "study.toml").write_text("a study")
    run = supervisor.submit(upload, PLAN)
    assert (settings.folder / run.id / UPLOAD / "study.toml").read_text() == "a study"
    assert len(run.id) == 16


def test_a_server_that_only_reads_follows_the_one_that_runs(start, settings, tmp_path):
    supervisor = start(SLEEP)
    run_id = submit(supervisor, tmp_path)
    reader = start(SLEEP, replace(settings, read_only=True))
    wait(supervisor, run_id, State.RUNNING)
    wait(reader, run_id, State.RUNNING)
    other = submit(supervisor, tmp_path)
    wait(reader, other, State.QUEUED)
    supervisor.stop(other)
    wait(reader, other, State.STOPPED)
    supervisor.delete(other)
    until = time.monotonic() + 10
    while any(run.id == other for run in reader.all()):
        assert time.monotonic() < until
        time.sleep(0.02)


def test_a_run_that_the_server_before_was_just_starting_is_started(start, settings, tmp_path):
    """Regression: a server that ended within the seconds of a start left a failed run (exit code 255)."""
    before = start(SLEEP, replace(settings, limits=Limits(running=0)))
    begun, unbegun = submit(before, tmp_path), submit(before, tmp_path)
    for run_id, number in ((begun, "1\n"), (unbegun, "")):
        before._store(before.find(run_id).changed(state=State.RUNNING))
        (settings.folder / run_id / ".alive").write_text(number)
    before.close()
    after = start(ENDS.format("it has started"))
    assert wait(after, unbegun, State.FAILED).message == "it has started"
    assert wait(after, begun, State.FAILED).message.startswith("its process ended without a message")


def test_every_row_is_in_one_file(tmp_path):
    """Regression: what a kill left stood in a log beside the table, and runs were lost in silence with the log."""
    table = RunTable(tmp_path)
    rows = [Run(f"{number:016x}", "study", "n", "", State.FINISHED) for number in range(3)]
    for row in rows:
        table.put(row)
    (tmp_path / "copy").mkdir()
    shutil.copy(tmp_path / TABLE, tmp_path / "copy")  # as a kill and the loss of all other files would leave it
    table.close()
    with closing(RunTable(tmp_path / "copy", read_only=True)) as copied:
        assert copied.all() == rows


def test_a_clock_that_jumps_moves_times_and_nothing_else(start, settings, tmp_path, monkeypatch):
    """Twenty years back, then forty on: order, states and the queue stay."""
    supervisor = start(SLEEP)
    first = submit(supervisor, tmp_path)
    wait(supervisor, first, State.RUNNING)
    for year in (2006, 2046):
        jumped = type(
            "Jumped", (datetime,), {"now": classmethod(lambda cls, zone, year=year: datetime(year, 1, 1, tzinfo=zone))}
        )
        monkeypatch.setattr("tripod_doe.service.runs.run_table.datetime", jumped)
        last = submit(supervisor, tmp_path)
        assert supervisor.find(last).created.startswith(str(year))
        assert supervisor.all()[0].id == last
        assert supervisor.find(first).state is State.RUNNING
    second = supervisor.all()[1].id
    processes.kill_run(supervisor.directory(first))
    wait(supervisor, first, State.FAILED)
    wait(supervisor, second, State.RUNNING)
    assert supervisor.stop(second).state is State.STOPPING
    wait(supervisor, second, State.STOPPED)
    wait(supervisor, last, State.RUNNING)


def test_a_report_that_seems_older_than_its_cube_is_the_last_word(tmp_path):
    """The clock jumped back between the two: a run that goes on has no report until it is done."""
    for name in ("cube.nc", "report/index.html"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("")
    os.utime(tmp_path / "report" / "index.html", (0, 0))
    run = Run("a" * 16, "study", "n", "", State.RUNNING, counts=PointCounts(1, 1))
    assert ending_of(run, run.counts, (), tmp_path) == (State.FINISHED, "")
    remove_report(tmp_path)
    assert ending_of(run, run.counts, (), tmp_path)[0] is State.FAILED


def test_a_run_whose_cube_is_damaged_at_its_end_says_so(tmp_path, monkeypatch):
    """Regression: the service could not supervise it, with a traceback in its log and its folder in the message."""

    def damaged(directory):
        raise CubeError(f"{directory}/cube.nc: damaged")

    monkeypatch.setattr("tripod_doe.service.runs.run_end.is_shown", damaged)
    run = Run("a" * 16, "study", "n", "", State.RUNNING, counts=PointCounts(1, 1))
    assert ending_of(run, run.counts, (), tmp_path) == (State.FAILED, "cube.nc: damaged")


def test_a_failed_workflow_says_what_its_studies_were_to_look_for(tmp_path):
    run = Run("a", "workflow", "a", "", State.RUNNING, counts=PointCounts(1))
    steps = (
        {"name": "map", "state": "finished", "detail": "", "found": "map: 2 of 3 points have thrust_rms > 5."},
        {"name": "shares", "state": "failed", "detail": "too few points"},
    )
    write_steps(tmp_path, steps)
    assert ending_of(run, run.counts, steps, tmp_path) == (
        State.FAILED,
        "shares: too few points; map: 2 of 3 points have thrust_rms > 5.",
    )


def test_a_change_that_a_kill_interrupted_is_taken_back_for_readers(tmp_path):
    """Regression: "attempt to write a readonly database", and no server with --read-only started."""
    table = RunTable(tmp_path)
    row = Run("0" * 16, "study", "n", "", State.FINISHED)
    table.put(row)
    table._connection.execute("PRAGMA cache_size = 1")
    table._connection.executemany(
        "INSERT INTO run VALUES (NULL, ?, ?, ?)", [(str(n), None, "x" * 999) for n in range(99)]
    )
    killed = tmp_path / "killed"
    killed.mkdir()
    for path in tmp_path.glob(f"{TABLE}*"):
        shutil.copyfile(path, killed / path.name)
    table.close()
    reader = RunTable(killed, read_only=True)
    assert reader.all() == [row]
    reader.close()


def test_a_flipped_bit_in_the_table_of_runs_is_told(tmp_path):
    """Regression: a text that was no UTF-8 kept the server from its start; another number of points was shown."""
    table = RunTable(tmp_path)
    runs = [Run(f"{number:016x}", "study", "a", "", State.FINISHED, counts=PointCounts(42, 42)) for number in (1, 2)]
    for run in runs:
        table.put(run)
    table.close()
    with closing(sqlite3.connect(tmp_path / TABLE)) as connection:
        connection.execute("PRAGMA journal_mode = DELETE")
    whole = (tmp_path / TABLE).read_bytes()
    first = whole.rindex(b'{"id": "0000000000000001"')
    for place in range(first, first + 300, 7):
        for bit in (0, 7):
            flipped = bytearray(whole)
            flipped[place] ^= 1 << bit
            (tmp_path / TABLE).write_bytes(flipped)
            table = RunTable(tmp_path)
            damaged, intact = table.all()
            table.close()
            assert intact == runs[1]
            assert "its row in service.sqlite is damaged" in damaged.message


def test_a_table_that_is_none_is_told(tmp_path):
    (tmp_path / "service.sqlite").write_bytes(b"no table" * 1000)
    with pytest.raises(InputError, match="cannot use this table of runs"):
        RunTable(tmp_path)


def test_a_full_disk_is_told_and_ends_nothing(start, tmp_path, monkeypatch):
    supervisor = start(SLEEP)
    run_id = submit(supervisor, tmp_path)
    wait(supervisor, run_id, State.RUNNING)

    def full(*_):
        raise StorageError("database or disk is full")

    with monkeypatch.context() as patch:
        patch.setattr(supervisor._table, "_write", full)
        with pytest.raises(StorageError):
            submit(supervisor, tmp_path)
        processes.kill_run(supervisor.directory(run_id))
        time.sleep(0.6)
        assert supervisor.find(run_id).state is State.RUNNING  # nothing is told that could not be stored
    wait(supervisor, run_id, State.FAILED)


def spoil(supervisor, run_id, **values):
    """Store a run at work with values that no run has, and give it as it is when the service has noticed."""
    with supervisor._lock:
        supervisor._store(supervisor.find(run_id).changed(**values))
    until = time.monotonic() + 20
    while (run := supervisor.find(run_id)).state is State.RUNNING:
        supervisor._work.pop(run_id, None)
        assert time.monotonic() < until
        time.sleep(0.02)
    return run


def test_a_run_that_cannot_be_looked_after_fails_alone(start, settings, tmp_path):
    """Regression: its KeyError ended every look, so that no run was started any more, also by the next server."""
    supervisor = start(SLEEP)
    bad, good = submit(supervisor, tmp_path), submit(supervisor, tmp_path)
    wait(supervisor, bad, State.RUNNING)
    failed = spoil(supervisor, bad, plan={"kind": "workflow"})
    assert failed.state is State.FAILED
    assert "cannot supervise it (KeyError: 'unique')" in failed.message
    wait(supervisor, good, State.RUNNING)
    supervisor.delete(bad)


def test_the_next_server_goes_on_beside_a_run_that_cannot_be_looked_after(start, settings, tmp_path):
    supervisor = start(SLEEP)
    bad, good = submit(supervisor, tmp_path), submit(supervisor, tmp_path)
    wait(supervisor, bad, State.RUNNING)
    supervisor.close()
    spoil_table(settings, bad, lambda record: record | {"plan": {}})
    later = start(SLEEP)
    wait(later, bad, State.FAILED)
    wait(later, good, State.RUNNING)
    later.delete(bad)


def spoil_table(settings, run_id, change):
    with closing(sqlite3.connect(settings.folder / TABLE)) as table, table:
        (text,) = table.execute("SELECT record FROM run WHERE id = ?", (run_id,)).fetchone()
        changed = change(json.loads(text.partition(" ")[2]))
        text = changed if isinstance(changed, str) else json.dumps(changed)
        table.execute("UPDATE run SET record = ? WHERE id = ?", (text, run_id))


@pytest.mark.parametrize(
    "change",
    [
        lambda record: "no JSON",
        lambda record: "[]",
        lambda record: record | {"state": "unheard of"},
        lambda record: record | {"counts": {"total": "many", "cpu_seconds": None}},
        lambda record: record | {"eta_seconds": float("nan")},
        lambda record: record | {"unknown": 1},
        lambda record: record | {"binned": 5, "created": None},
        lambda record: record | {"tags": [1, [2]]},
    ],
)
def test_a_damaged_row_is_a_run_that_failed(start, settings, tmp_path, change):
    supervisor = start(SLEEP)
    bad, good = submit(supervisor, tmp_path), submit(supervisor, tmp_path)
    wait(supervisor, bad, State.RUNNING)
    supervisor.stop(bad)
    wait(supervisor, bad, State.STOPPED)
    wait(supervisor, good, State.RUNNING)
    supervisor.close()
    spoil_table(settings, bad, change)
    later = start(SLEEP)
    assert {run.id for run in later.all()} == {bad, good}
    assert "its row in service.sqlite is damaged" in wait(later, bad, State.FAILED).message
    wait(later, good, State.RUNNING)
    later.delete(bad)
    assert [run.id for run in later.all()] == [good]


def _as_folder(path):
    path.unlink(missing_ok=True)
    path.mkdir()


@pytest.mark.parametrize(
    "damage",
    [
        lambda directory: shutil.rmtree(directory),
        lambda directory: shutil.rmtree(directory / UPLOAD),
        lambda directory: _as_folder(directory / ".alive"),
        lambda directory: _as_folder(directory / processes.LOG),
        lambda directory: _as_folder(directory / "journal.sqlite"),
        lambda directory: (directory / "journal.sqlite").write_bytes(b"SQLite format 3\0" + bytes(4000)),
        lambda directory: (directory / "report").write_text("no folder"),
    ],
)
def test_a_damaged_directory_is_the_failure_of_its_run_alone(settings, start, tmp_path, damage):
    """Damaged while the run waits: what it starts with is missing, or is something else."""
    supervisor = start(SLEEP)
    first, bad, good = [submit(supervisor, tmp_path) for _ in range(3)]
    wait(supervisor, first, State.RUNNING)
    damage(supervisor.directory(bad))
    supervisor.stop(first)
    until = time.monotonic() + 20
    while supervisor.find(bad).state is State.QUEUED:
        assert time.monotonic() < until
        time.sleep(0.02)
    if supervisor.find(bad).state is not State.FAILED:
        supervisor.stop(bad)
    wait(supervisor, good, State.RUNNING)
    supervisor.delete(bad)


def test_steps_that_say_nonsense_are_the_failure_of_their_workflow_alone(start, tmp_path):
    supervisor = start(SLEEP)
    bad, good = submit(supervisor, tmp_path), submit(supervisor, tmp_path)
    wait(supervisor, bad, State.RUNNING)
    (supervisor.directory(bad) / STEPS).write_text("[1, 2]")
    assert spoil(supervisor, bad, kind="workflow", plan={"steps": {}}).state is State.FAILED
    wait(supervisor, good, State.RUNNING)


def test_the_limit_of_the_queue_holds_for_runs_that_go_on(start, settings, tmp_path):
    supervisor = start(SLEEP)
    stopped = submit(supervisor, tmp_path)
    wait(supervisor, stopped, State.RUNNING)
    supervisor.stop(stopped)
    wait(supervisor, stopped, State.STOPPED)
    for _ in range(4):
        submit(supervisor, tmp_path)
        time.sleep(0.6)
    upload = tmp_path / "longer"
    upload.mkdir()
    with pytest.raises(RefusedError, match="413: 3 runs are waiting"):
        supervisor.resume(stopped)
    with pytest.raises(RefusedError, match="413: 3 runs are waiting"):
        supervisor.extend(stopped, upload, PLAN, lambda: pytest.fail("noted, but refused"))
    assert supervisor.find(stopped).state is State.STOPPED


def test_a_run_that_takes_a_larger_study_takes_nothing_else(start, tmp_path):
    """What the study adds to the results is stored when nothing is refused any more, and before the run starts."""
    supervisor = start("")
    run_id = submit(supervisor, tmp_path)
    wait(supervisor, run_id, State.FAILED)
    upload = tmp_path / "larger"
    upload.mkdir()

    def note():
        for change in (supervisor.resume, supervisor.delete, supervisor.refuse_extension):
            with pytest.raises(RefusedError, match="409: this run is being changed"):
                change(run_id)

    def broken():
        raise StorageError("full")

    with pytest.raises(StorageError, match="full"):
        supervisor.extend(run_id, upload, PLAN, broken)
    assert supervisor.find(run_id).state is State.FAILED
    made = [supervisor.directory(run_id) / name for name in ("report/index.html", "analysis/effects.nc", "cube.nc")]
    for path in made:
        path.parent.mkdir(exist_ok=True)
        path.touch()
    assert supervisor.extend(run_id, upload, PLAN, note).state is State.QUEUED
    assert not upload.exists()
    # regression: while it waited, the analyses of the smaller study were served as its own
    assert [path.exists() for path in made] == [False, False, True]


def test_the_end_of_a_run_is_told_once_and_not_that_of_results_that_were_there(tmp_path):
    """A run of the table is told; one that the command line filled has ended before the server began."""
    told = tmp_path / "told"
    script = tmp_path / "n.py"
    script.write_text(f"import sys; open({str(told)!r}, 'a').write(sys.stdin.read() + '\\n')")
    folder = tmp_path / "runs"
    folder.mkdir()
    supervisor = Supervisor(Settings(folder, notifier=Notifier((sys.executable, str(script)))))
    run = Run("a", "study", "name", "", State.RUNNING)
    for state in (State.RUNNING, State.FINISHED, State.FINISHED):
        supervisor._store(run.changed(state=state))
    for state in (State.RUNNING, State.FINISHED):
        supervisor._store(replace(run, id="b", place="found").changed(state=state))
    for thread in threading.enumerate():
        if thread.name == "notify":
            thread.join()
    facts = [json.loads(line) for line in told.read_text().splitlines()]
    assert [(fact["id"], fact["state"], fact["text"]) for fact in facts] == [("a", "finished", "name: finished")]
    assert set(facts[0]) == {"text", "state", "name", "message", "id", "kind", "points"}


@pytest.mark.parametrize(
    "stranger",
    [
        {"id": "../outside"},
        {"id": "", "binned": "2020-01-01T00:00:00.000Z"},
        {"id": "../outside", "binned": "2020-01-01T00:00:00.000Z"},
        {"id": "a" * 16, "place": "../outside", "taken": True},
        {"id": "a" * 16, "place": "{outside}", "taken": True},
    ],
)
def test_a_table_of_a_stranger_leads_nowhere_else(tmp_path, stranger):
    """Security: its rows named directories to read, to fill and to remove anywhere."""
    outside, folder = tmp_path / "outside", tmp_path / "runs"
    for directory in (outside, folder, folder / "kept"):
        directory.mkdir()
        (directory / "run.log").write_text("as it was")
    values = {name: value.format(outside=outside) if name == "place" else value for name, value in stranger.items()}
    queued = Run("b" * 16, "study", "n", "", State.QUEUED, counts=PointCounts(1))
    RunTable(folder).put(replace(queued, **values))
    supervisor = Supervisor(Settings(folder))
    supervisor.start()
    time.sleep(1)  # it would look after them
    supervisor.close()
    for directory in (outside, folder / "kept"):
        assert [path.name for path in directory.iterdir()] == ["run.log"]
        assert (directory / "run.log").read_text() == "as it was"
    for run in supervisor.all():
        assert supervisor.directory(run.id).parent == folder
