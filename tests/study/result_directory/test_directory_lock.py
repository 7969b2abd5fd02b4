"""Holding a directory: who holds it is told, a dead holder's place is taken, and a living one never loses it."""

from __future__ import annotations

import fcntl
import inspect
import json
import os
import socket
import subprocess
import time

import psutil
import pytest

import tripod_doe as td
from tripod_doe.cli import main
from tripod_doe.study.result_directory.directory_lock import DirectoryLock

pytestmark = pytest.mark.usefixtures("pages_not_made")

STUDY = '[study]\nname = "h"\n[base]\nmodel = "equilibrium"\n[factors.joint_angle_deg]\nvalues = [2.5, 17]\n'


def said(path, holder):
    (path / ".lock").write_text(json.dumps(holder))


@pytest.fixture
def elsewhere(tmp_path):
    """A directory whose lock belongs to a process of another host."""
    with_lock = DirectoryLock(tmp_path)
    said(tmp_path, {"host": "far.example", "process": 7})
    yield with_lock
    with_lock.release()


@pytest.mark.parametrize("take_over", [False, True])
def test_a_living_holder_of_this_host_keeps_its_place(tmp_path, take_over):
    hold = DirectoryLock(tmp_path)
    with pytest.raises(td.InputError, match=f"process {os.getpid()} on {socket.gethostname()} is writing here; wait"):
        DirectoryLock(tmp_path, take_over)
    hold.check()
    hold.release()
    DirectoryLock(tmp_path).release()


@pytest.mark.parametrize("holder", [None, {"host": "far.example", "process": 7}, {"host": "far.example"}, [1]])
def test_a_dead_holder_is_replaced_when_told_so_and_notices(tmp_path, holder):
    hold = DirectoryLock(tmp_path)
    (tmp_path / ".lock").write_text("" if holder is None else json.dumps(holder))
    with pytest.raises(
        td.InputError, match="or take the directory over with take_over=True if that process is dead, or choose another"
    ):
        DirectoryLock(tmp_path)
    successor = DirectoryLock(tmp_path, take_over=True)
    with pytest.raises(td.StorageError, match="took this directory over"):
        hold.check()
    successor.check()
    with pytest.raises(td.InputError, match=f"process {os.getpid()}"):
        DirectoryLock(tmp_path, take_over=True)
    hold.release()
    successor.release()


def test_a_process_that_is_gone_from_this_host_does_not_live(tmp_path):
    child = subprocess.Popen(["true"])
    child.wait()
    hold = DirectoryLock(tmp_path)
    said(tmp_path, {"host": socket.gethostname(), "process": child.pid})
    DirectoryLock(tmp_path, take_over=True).release()
    with pytest.raises(td.StorageError, match="took this directory over"):
        hold.check()
    hold.release()


def test_a_holder_whose_lock_was_deleted_says_so_and_stops(tmp_path):
    hold = DirectoryLock(tmp_path)
    (tmp_path / ".lock").unlink()
    with pytest.raises(td.StorageError, match=r"\.lock was deleted, so another process may write here; this one stops"):
        hold.check()
    hold.release()


def test_run_takes_over_only_when_asked(tmp_path, monkeypatch, capsys, elsewhere):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "study.toml").write_text(STUDY)
    command = ["run", "study.toml", "--out", str(tmp_path), "--workers", "0"]
    assert main(command) == 2
    assert "process 7 on far.example is writing here" in capsys.readouterr().err
    assert main([*command, "--take-over"]) == 0
    assert td.open_cube(tmp_path).sizes["joint_angle_deg"] == 2
    with pytest.raises(td.StorageError):
        elsewhere.check()


def test_derive_takes_over_only_when_asked(tmp_path, capsys):
    """Regression: its message named --take-over, which derive, fit and optimise did not have."""
    (tmp_path / "study.toml").write_text(STUDY)
    td.run(tmp_path / "study.toml", out=tmp_path, workers=0, progress=False)
    (tmp_path / "more.toml").write_text('[responses.peak]\nformula = "max(thrust)"\nunit = "N"\n')
    said(tmp_path, {"host": "far.example", "process": 7})
    command = ["derive", str(tmp_path), str(tmp_path / "more.toml")]
    assert main(command) == 2
    assert "--take-over" in capsys.readouterr().err
    assert main([*command, "--take-over"]) == 0
    assert "peak" in td.open_cube(tmp_path)


@pytest.mark.parametrize("call", [td.run, td.derive, td.fit, td.optimise, td.run_workflow])
def test_all_that_hold_a_directory_take_over_when_asked(call, capsys):
    assert "take_over" in inspect.signature(call).parameters
    assert main([call.__name__.removeprefix("run_"), "--help"]) == 0
    assert "--take-over" in capsys.readouterr().out


@pytest.fixture
def without_locks(monkeypatch):
    """As a network filesystem that grants every lock."""
    monkeypatch.setattr(fcntl, "flock", lambda file, how: None)


@pytest.mark.usefixtures("without_locks")
def test_without_working_locks_a_holder_counts_as_long_as_it_is_not_known_to_be_gone(tmp_path):
    hold = DirectoryLock(tmp_path)
    with pytest.raises(td.InputError, match=f"process {os.getpid()}"):
        DirectoryLock(tmp_path, take_over=True)
    hold.release()
    DirectoryLock(tmp_path).release()  # given back
    said(tmp_path, {"host": "far.example", "process": 7})
    with pytest.raises(td.InputError, match=r"process 7 on far\.example is writing here"):
        DirectoryLock(tmp_path)
    DirectoryLock(tmp_path, take_over=True).release()


@pytest.mark.usefixtures("without_locks")
def test_a_holder_that_slept_through_a_take_over_notices_before_it_writes(tmp_path):
    """Nothing but the token tells: file, host and process are the same."""
    sleeper = DirectoryLock(tmp_path)
    said(tmp_path, {"host": socket.gethostname(), "process": 1, "since": 0.0, "token": "gone"})
    successor = DirectoryLock(tmp_path)
    with pytest.raises(td.StorageError, match="took this directory over"):
        sleeper.check()
    sleeper.release()
    successor.check()
    successor.release()


def test_a_number_that_another_process_has_got_since_is_no_holder(tmp_path):
    """Process 1 lives, and began after the holder had signed."""
    said(tmp_path, {"host": socket.gethostname(), "process": 1, "since": 0.0})
    DirectoryLock(tmp_path).release()


def test_a_holder_that_was_killed_and_not_yet_reaped_is_gone(tmp_path):
    child = subprocess.Popen(["true"])
    while psutil.Process(child.pid).status() != psutil.STATUS_ZOMBIE:
        time.sleep(0.01)
    said(tmp_path, {"host": socket.gethostname(), "process": child.pid, "since": time.time()})
    DirectoryLock(tmp_path).release()
    child.wait()


def test_a_lock_that_outlives_its_process_on_this_host_is_taken_over_at_once(tmp_path):
    child = subprocess.Popen(["true"])
    child.wait()
    stale = DirectoryLock(tmp_path)
    said(tmp_path, {"host": socket.gethostname(), "process": child.pid, "since": time.time()})
    DirectoryLock(tmp_path).release()
    stale.release()


@pytest.mark.parametrize("link", ["symlink_to", "hardlink_to"])
def test_a_lock_that_is_a_link_empties_no_other_file(tmp_path, link):
    """Regression: a planted .lock emptied the file that it led to."""
    precious, place = tmp_path / "precious", tmp_path / "out"
    precious.write_text("precious")
    place.mkdir()
    getattr(place / ".lock", link)(precious)
    with pytest.raises(td.InputError, match="cannot write here"):
        DirectoryLock(place)
    assert precious.read_text() == "precious"


def test_a_lock_is_its_owners_alone(tmp_path):
    hold = DirectoryLock(tmp_path)
    assert (tmp_path / ".lock").stat().st_mode & 0o077 == 0
    hold.release()


@pytest.mark.parametrize("name", ["report", "analysis", "steps", "journal.sqlite", "journal.sqlite-wal"])
@pytest.mark.parametrize("command", ["run", "report", "workflow"])
def test_a_directory_with_planted_links_is_refused(tmp_path, capsys, name, command):
    """Regression: `run` and `report` wrote through a link out of the directory."""
    (tmp_path / "h.toml").write_text(STUDY)
    (tmp_path / "w.toml").write_text('[workflow]\nname = "w"\n[steps.s]\nkind = "study"\nstudy = "h.toml"\n')
    elsewhere, out = tmp_path / "elsewhere", tmp_path / "out"
    elsewhere.mkdir()
    out.mkdir()
    target = elsewhere / "a.sqlite" if name.startswith("journal") else elsewhere
    (out / name).symlink_to(target)
    words = {
        "run": ["run", str(tmp_path / "h.toml"), "--out", str(out), "--workers", "0"],
        "report": ["report", str(out)],
        "workflow": ["workflow", str(tmp_path / "w.toml"), "--out", str(out), "--workers", "0"],
    }[command]
    assert main(words) == 2
    assert f"{name} is a link to {str(target)!r}" in capsys.readouterr().err
    assert not list(elsewhere.iterdir())


@pytest.mark.parametrize(
    "signature",
    [
        '{"host": "HERE", "process": 99999999999999999999}',
        '{"host": "HERE", "process": -1}',
        '{"host": "HERE", "process": true}',
        '{"host": "HERE", "process": 1, "since": "x"}',
        '{"host": "HERE", "process": 1, "since": 1e999}',
        '{"host": ["a"], "process": 5, "token": {}}',
        "[" * 100_000,
        "9" * 5000,
    ],
)
def test_a_signature_that_no_process_wrote_names_nobody(tmp_path, signature):
    """Regression: numbers that no process can have ended in internal errors."""
    (tmp_path / ".lock").write_text(signature.replace("HERE", socket.gethostname()))
    DirectoryLock(tmp_path).release()
    assert (tmp_path / ".lock").read_text() == ""
